//! Arms that stop together.
//!
//! The thread that drives an arm looks at it after each tick, 100 times a second, whatever the loop is computing:
//!
//! ```text
//! trouble   state not ENABLED · hand · teleoperation · other writer · silence            moving or at rest
//!           the reason why its motion ended, unless it arrived, was held, kept back, or is out of reach
//! trouble begins            ⇒  the others are told to hold, once; a fault is kept, as what was interrupted must not go on when it is over
//! somebody asks to stop     ⇒  all are told to hold
//! ```

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use dvrk_io::arm::{Arm, Stop};

/// What the threads of the arms of one cell share.
#[derive(Debug, Clone, Default)]
pub(super) struct Interlock(Arc<Shared>);

#[derive(Debug, Default)]
struct Shared {
    /// How often trouble has begun.
    trips: AtomicU64,
    /// The first fault of each arm that has had one.
    faults: Mutex<Vec<(usize, String)>>,
    asked_to_stop: Mutex<Arc<AtomicBool>>,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Interlock {
    /// Listens to this flag from now on.
    pub fn listen(&self, flag: Arc<AtomicBool>) {
        *lock(&self.0.asked_to_stop) = flag;
    }

    /// Whether somebody asks to stop.
    pub fn is_asked_to_stop(&self) -> bool {
        lock(&self.0.asked_to_stop).load(Ordering::Relaxed)
    }

    /// The first fault that an arm had; nothing but a new cell makes it good.
    pub fn fault_of(&self, arm: usize) -> Option<String> {
        let faults = lock(&self.0.faults);
        let found = faults.iter().find(|(of, _)| *of == arm);
        found.map(|(_, reason)| reason.clone())
    }

    /// The look at an arm for its thread.
    pub fn look(&self, index: usize) -> impl FnMut(&mut Arm) + Send + 'static {
        let shared = self.clone();
        let (mut seen, mut troubled) = (self.trips(), false);
        move |arm| {
            let trouble = trouble(arm);
            if let Some(stop) = &trouble {
                shared.keep(index, stop);
            }
            // The arm itself has stopped; this is for the others.
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

/// Why the others must not go on, if so.
fn trouble(arm: &Arm) -> Option<Stop> {
    if arm.is_moving() {
        return None;
    }
    let ended = arm.last_stop().filter(|stop| stops_all(stop));
    ended.cloned().or_else(|| arm.unready())
}

/// Whether an arm that stopped for this may be commanded again without more ado.
pub(super) fn goes_on_after(reason: &Stop) -> bool {
    matches!(reason, Stop::Arrived | Stop::Held | Stop::Blocked { .. })
}

/// What is in the way of one arm, or out of its reach, is no reason for the others to stop.
fn stops_all(reason: &Stop) -> bool {
    !(goes_on_after(reason) || matches!(reason, Stop::Unreachable(_)))
}

/// Whether somebody has to look why an arm stopped. One that was silent may speak again.
fn is_fault(reason: &Stop) -> bool {
    stops_all(reason) && !matches!(reason, Stop::Stale { .. })
}
