//! Stops all arms together.
//!
//! The thread that drives an arm checks it after each tick, 100 times a second, independently of what the loop computes:
//!
//! ```text
//! trouble   state not ENABLED · guided by hand · teleoperation · other publisher · silence   moving or at rest
//!           or its motion ended for another reason than arrival, hold, obstruction or an unreachable pose
//! trouble begins            ⇒  the other arms are told to hold, once; a fault is kept: the interrupted motion must not continue after it
//! stop is requested         ⇒  all arms are told to hold
//! ```

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use dvrk_io::arm::{Arm, Stop};

/// The state shared by the threads of the arms of one cell.
#[derive(Debug, Clone, Default)]
pub(super) struct Interlock(Arc<Shared>);

#[derive(Debug, Default)]
struct Shared {
    /// Number of times that trouble has begun.
    trips: AtomicU64,
    /// The first fault of each arm that had one.
    faults: Mutex<Vec<(usize, String)>>,
    asked_to_stop: Mutex<Arc<AtomicBool>>,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Interlock {
    /// Also stops when this flag is set.
    pub fn listen(&self, flag: Arc<AtomicBool>) {
        *lock(&self.0.asked_to_stop) = flag;
    }

    /// Whether a stop was requested.
    pub fn is_asked_to_stop(&self) -> bool {
        lock(&self.0.asked_to_stop).load(Ordering::Relaxed)
    }

    /// The first fault of an arm; only a new cell clears it.
    pub fn fault_of(&self, arm: usize) -> Option<String> {
        let faults = lock(&self.0.faults);
        let found = faults.iter().find(|(of, _)| *of == arm);
        found.map(|(_, reason)| reason.clone())
    }

    /// The check of an arm, for its thread.
    pub fn look(&self, index: usize) -> impl FnMut(&mut Arm) + Send + 'static {
        let shared = self.clone();
        let (mut seen, mut troubled) = (self.trips(), false);
        move |arm| {
            let trouble = trouble(arm);
            if let Some(stop) = &trouble {
                shared.keep(index, stop);
            }
            // The arm itself has already stopped; this stops the others.
            if trouble.is_some() && !troubled {
                shared.0.trips.fetch_add(1, Ordering::Relaxed);
            }
            troubled = trouble.is_some();
            let trips = shared.trips();
            if arm.is_moving() && (trips != seen || shared.is_asked_to_stop()) {
                arm.hold();
            }
            seen = trips;
        }
    }

    fn trips(&self) -> u64 {
        self.0.trips.load(Ordering::Relaxed)
    }

    fn keep(&self, arm: usize, stop: &Stop) {
        let mut faults = lock(&self.0.faults);
        if is_fault(stop) && faults.iter().all(|(of, _)| *of != arm) {
            faults.push((arm, stop.to_string()));
        }
    }
}

/// Why the other arms must stop, if they must.
fn trouble(arm: &Arm) -> Option<Stop> {
    if arm.is_moving() {
        return None;
    }
    let ended = arm.last_stop().filter(|stop| stops_all(stop));
    ended.cloned().or_else(|| arm.unready())
}

/// Whether an arm that stopped for this reason may be commanded again.
pub(super) fn goes_on_after(reason: &Stop) -> bool {
    matches!(reason, Stop::Arrived | Stop::Held | Stop::Blocked { .. })
}

/// Whether a reason stops the other arms: an obstruction, or a pose that only this arm cannot reach, does not.
fn stops_all(reason: &Stop) -> bool {
    !(goes_on_after(reason) || matches!(reason, Stop::Unreachable(_)))
}

/// Whether a reason needs attention by a person. An arm that was silent may recover.
fn is_fault(reason: &Stop) -> bool {
    stops_all(reason) && !matches!(reason, Stop::Stale { .. })
}
