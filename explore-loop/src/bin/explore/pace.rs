//! The time that a planned motion still takes.

use explore_loop::explore::Phase;
use grip_planner::Plan;
use std::time::Instant;

/// Share of a motion after which its pace can be extrapolated.
const KNOWN: f64 = 0.1;

/// The pace of the current motion. Its duration is planned in the robot's time; the wall-clock time of a second of it is measured. How many more
/// manipulations a run needs is unknown, and no estimate is shown.
#[derive(Debug, Default)]
pub struct Pace {
    /// Planned durations of the reaching motion and of the manipulation, s.
    planned: Option<[f64; 2]>,
    motion: Option<Motion>,
}

#[derive(Debug)]
struct Motion {
    duration: f64,
    /// Robot stamp and wall-clock time at its beginning.
    began: (f64, Instant),
}

impl Pace {
    /// A plan was made.
    pub fn planned(&mut self, plan: &Plan) {
        self.planned = Some([plan.reach.duration, plan.motion.duration]);
    }

    /// A phase begins at this stamp.
    pub fn phase(&mut self, phase: Phase, stamp: f64) {
        let duration = self.planned.and_then(|[reach, motion]| match phase {
            Phase::Reach => Some(reach),
            Phase::Manipulate => Some(motion),
            _ => None,
        });
        self.motion = duration.map(|duration| Motion {
            duration,
            began: (stamp, Instant::now()),
        });
    }

    /// Wall-clock seconds until the motion is over, once its pace is known.
    pub fn left(&self, stamp: f64) -> Option<f64> {
        let motion = self.motion.as_ref()?;
        let done = stamp - motion.began.0;
        let left = (motion.duration - done).max(0.0);
        (done > KNOWN * motion.duration)
            .then(|| left * motion.began.1.elapsed().as_secs_f64() / done)
    }
}
