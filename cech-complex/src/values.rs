//! Filtration values, computed when they are first asked for and kept.
//!
//! Which simplices there are is decided without values (module `decision`). Until its value is computed, a simplex has in its place NaN and
//! *some* common point of its cylinders instead of the minimiser.

use nalgebra::Vector3;
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};

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
    /// Until then. Emptied after `all` has been set.
    some: Mutex<Attained>,
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
            some: Mutex::new(some),
            all: OnceLock::new(),
        }
    }

    /// All values; `complete` computes those that are missing.
    ///
    /// Nothing is locked meanwhile: with feature `rayon` this thread may take up another task that asks for the same values, and would wait for
    /// itself. So threads that ask at once may compute them twice; the first result is kept.
    pub(crate) fn all(&self, complete: impl FnOnce(&mut Attained)) -> &Attained {
        if let Some(all) = self.all.get() {
            return all;
        }
        let mut attained = self.some().clone();
        complete(&mut attained);
        let all = self.all.get_or_init(|| attained);
        *self.some() = Attained::default();
        all
    }

    /// The values so far.
    pub(crate) fn so_far(&mut self) -> &Attained {
        let some = self.some.get_mut().unwrap_or_else(PoisonError::into_inner);
        self.all.get().unwrap_or(some)
    }

    fn some(&self) -> MutexGuard<'_, Attained> {
        self.some.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Clone for Deferred {
    /// Missing values are missing in the clone too.
    fn clone(&self) -> Self {
        let some = self.some();
        match self.all.get() {
            Some(all) => Self {
                some: Mutex::default(),
                all: OnceLock::from(all.clone()),
            },
            None => Self::new(some.clone()),
        }
    }
}
