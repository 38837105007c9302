//! What makes a motion impossible.
//!
//! At every key frame and half-way between: each tip in its workspace, tips and jaws above the table, and
//! the tools apart. A tool is two segments as thick as its jaws, from the tip back along its straight part and from there
//! to the base of its arm.

use nalgebra::{Isometry3, Point3, Vector3};
use parry3d_f64::query::details::closest_points_segment_segment_with_locations_nD as closest;
use parry3d_f64::shape::Segment;

use crate::motion::between;
use crate::{Error, Motion, Scene};

/// Why a motion was not planned.
#[derive(Debug, Clone, thiserror::Error)]
#[non_exhaustive]
pub enum Refusal {
    /// The input cannot be used.
    #[error(transparent)]
    Input(#[from] Error),
    /// A tip would have to leave its workspace.
    #[error("arm {arm} cannot reach {position:?} at {time:.2} s")]
    OutOfWorkspace {
        /// The arm.
        arm: usize,
        /// When, seconds.
        time: f64,
        /// Where, metres.
        position: [f64; 3],
    },
    /// A tip or jaw would hit the table.
    #[error(
        "arm {arm} is {height:.4} m above the table at {time:.2} s, it must stay {clearance} m above"
    )]
    HitsTable {
        /// The arm.
        arm: usize,
        /// When, seconds.
        time: f64,
        /// Height of its tip, or of its lower jaw plus the clearance, metres.
        height: f64,
        /// What must be kept, metres.
        clearance: f64,
    },
    /// Two tools would meet.
    #[error("arms {arms:?} come within {distance:.4} m of each other at {time:.2} s")]
    ArmsCollide {
        /// The arms.
        arms: [usize; 2],
        /// When, seconds.
        time: f64,
        /// Distance of their surfaces, metres.
        distance: f64,
    },
    /// The set does not have two lifting grips on the lifted side.
    #[error("{lifting} lifting grips on the lifted side: a turn takes 2")]
    CannotLift {
        /// How many there are.
        lifting: usize,
    },
    /// A hole needs a grip on each of its sides.
    #[error("no candidate that an arm can take on side {side} of the hole")]
    NoGripBesideHole {
        /// Which side, 0 or 1.
        side: usize,
    },
    /// A hole this small or thin has no long axis.
    #[error("the loop of {vertices} vertices does not span a hole")]
    NotAHole {
        /// Vertices of the loop.
        vertices: usize,
    },
}

/// Rounding of poses that touch a bound exactly (the grasp itself may stand at the clearance).
const ROUNDING: f64 = 1e-9;

/// Refuses a motion that leaves a workspace, meets the table or lets two tools meet.
pub(crate) fn check(motion: &Motion, scene: &Scene, shaft_length: f64) -> Result<(), Refusal> {
    let frames = motion.arms.first().map_or(0, |p| p.keyframes.len());
    for k in 0..frames {
        check_instant(motion, scene, shaft_length, k, 0.0)?;
        if k + 1 < frames {
            check_instant(motion, scene, shaft_length, k, 0.5)?;
        }
    }
    Ok(())
}

fn check_instant(
    motion: &Motion,
    scene: &Scene,
    shaft: f64,
    k: usize,
    share: f64,
) -> Result<(), Refusal> {
    let instant = |path: &crate::ArmPath| {
        let from = path.keyframes[k];
        let Some(to) = path.keyframes.get(k + 1) else {
            return (from.time, from.camera_from_tip);
        };
        let pose = if share > 0.0 {
            between(&from.camera_from_tip, &to.camera_from_tip, share)
        } else {
            from.camera_from_tip
        };
        (from.time + share * (to.time - from.time), pose)
    };
    let mut tools: Vec<(usize, Tool)> = Vec::with_capacity(motion.arms.len());
    for path in &motion.arms {
        let (time, pose) = instant(path);
        check_tip(path.arm, time, &pose, scene)?;
        let tool = Tool::new(&pose, &scene.arms[path.arm].base, shaft);
        for (other, o) in &tools {
            let distance = tool.distance(o) - 2.0 * scene.jaw_radius;
            if distance < scene.clearance {
                return Err(Refusal::ArmsCollide {
                    arms: [*other, path.arm],
                    time,
                    distance,
                });
            }
        }
        tools.push((path.arm, tool));
    }
    Ok(())
}

fn check_tip(arm: usize, time: f64, pose: &Isometry3<f64>, scene: &Scene) -> Result<(), Refusal> {
    let tip = Point3::from(pose.translation.vector);
    if !scene.arms[arm].workspace.contains(pose) {
        return Err(Refusal::OutOfWorkspace {
            arm,
            time,
            position: [tip.x, tip.y, tip.z],
        });
    }
    let drop = scene
        .table
        .normal
        .dot(&(pose.rotation * Vector3::y()))
        .abs()
        * scene.jaw_radius;
    // The tip keeps the clearance; a jaw may come down to the table.
    let height = scene
        .table
        .height(&tip)
        .min(scene.table.height(&tip) - drop + scene.clearance);
    if height < scene.clearance - ROUNDING {
        return Err(Refusal::HitsTable {
            arm,
            time,
            height,
            clearance: scene.clearance,
        });
    }
    Ok(())
}

/// Tip, end of the straight part, base.
struct Tool([parry3d_f64::math::Vector; 3]);

impl Tool {
    fn new(pose: &Isometry3<f64>, base: &Point3<f64>, shaft: f64) -> Self {
        let wrist = pose.translation.vector - pose.rotation * Vector3::z() * shaft;
        Self([pose.translation.vector, wrist, base.coords].map(Into::into))
    }

    fn distance(&self, other: &Self) -> f64 {
        let mut least = f64::INFINITY;
        for a in self.0.windows(2) {
            for b in other.0.windows(2) {
                let (at, bt) = closest((&a[0], &a[1]), (&b[0], &b[1]));
                let gap =
                    Segment::new(a[0], a[1]).point_at(&at) - Segment::new(b[0], b[1]).point_at(&bt);
                least = least.min(gap.length());
            }
        }
        least
    }
}
