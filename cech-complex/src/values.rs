//! Filtration values, computed when they are first asked for and kept.
//!
//! Which simplices there are is decided without values (module `decision`). Until its value is computed, a simplex has in its place NaN and
//! *some* common point of its cylinders instead of the minimiser.

use nalgebra::Vector3;
use std::sync::{Mutex, OnceLock, PoisonError};

/// Values of the simplices of one dimension and the points where they are attained.
#[derive(Debug, Clone, Default)]
pub(crate) struct Attained {
    /// NaN where not yet computed.
    pub(crate) values: Vec<f64>,
    /// Minimisers; where the value is NaN any common point, or NaN if none is known. None for tetrahedra, on which nothing stands.
    pub(crate) points: Vec<Vector3<f64>>,
}

impl Attained {
    pub(crate) fn push(&mut self, value: f64, point: Option<Vector3<f64>>) {
        self.values.push(value);
        self.points.extend(point);
    }
}

/// Values of one dimension, of which some may be missing until all are asked for.
#[derive(Debug, Default)]
pub(crate) struct Deferred {
    /// Until then. Emptied when `all` is about to be set.
    some: Mutex<Option<Attained>>,
    all: OnceLock<Attained>,
}

/// Values of dimension 1 to 3.
#[derive(Debug, Clone, Default)]
pub(crate) struct Values {
    pub(crate) edges: Deferred,
    pub(crate) triangles: Deferred,
    pub(crate) tetrahedra: Deferred,
}

impl Deferred {
    pub(crate) fn new(some: Attained) -> Self {
        Self {
            some: Mutex::new(Some(some)),
            all: OnceLock::new(),
        }
    }

    fn known(all: Attained) -> Self {
        Self {
            some: Mutex::new(None),
            all: OnceLock::from(all),
        }
    }

    /// All values; the first call lets `complete` compute those that are missing. Other threads wait for it.
    pub(crate) fn all(&self, complete: impl FnOnce(&mut Attained)) -> &Attained {
        self.all.get_or_init(|| {
            let mut some = self.some.lock().unwrap_or_else(PoisonError::into_inner);
            if let Some(attained) = some.as_mut() {
                complete(attained);
            }
            some.take().unwrap_or_default()
        })
    }

    /// The values so far.
    pub(crate) fn so_far(&mut self) -> &Attained {
        static NONE: Attained = Attained {
            values: Vec::new(),
            points: Vec::new(),
        };
        let some = self.some.get_mut().unwrap_or_else(PoisonError::into_inner);
        self.all.get().or(some.as_ref()).unwrap_or(&NONE)
    }
}

impl Clone for Deferred {
    /// Missing values are missing in the clone too.
    fn clone(&self) -> Self {
        if let Some(all) = self.all.get() {
            return Self::known(all.clone());
        }
        let some = self.some.lock().unwrap_or_else(PoisonError::into_inner);
        match some.clone() {
            Some(some) => Self::new(some),
            // Another thread has just completed them.
            None => Self::known(self.all.wait().clone()),
        }
    }
}
