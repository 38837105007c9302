//! The ground truth of a simulation.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use nalgebra::Point3;

use super::mesh::TriangleMesh;

/// The true surface, for measuring a reconstruction.
///
/// It is returned once, beside the cell; no `Cell` gives access to it. Positions are in the camera frame and belong to frames: they
/// change only when the cell observes.
#[derive(Debug, Clone)]
pub struct Truth {
    shared: Arc<Mutex<Snapshot>>,
}

#[derive(Debug, Default)]
struct Snapshot {
    triangles: Vec<[usize; 3]>,
    rest: Vec<Point3<f64>>,
    live: Vec<Point3<f64>>,
    frames: usize,
}

impl Truth {
    pub(super) fn new(triangles: Vec<[usize; 3]>, settled: Vec<Point3<f64>>) -> Self {
        let snapshot = Snapshot {
            triangles,
            rest: settled.clone(),
            live: settled,
            frames: 0,
        };
        Self {
            shared: Arc::new(Mutex::new(snapshot)),
        }
    }

    /// The surface at the first observation.
    pub fn rest(&self) -> TriangleMesh {
        let snapshot = self.lock();
        TriangleMesh {
            vertices: snapshot.rest.clone(),
            triangles: snapshot.triangles.clone(),
        }
    }

    /// Positions of the same vertices at the last observation.
    pub fn live(&self) -> Vec<Point3<f64>> {
        self.lock().live.clone()
    }

    /// The triangles of both.
    pub fn triangles(&self) -> Vec<[usize; 3]> {
        self.lock().triangles.clone()
    }

    pub(super) fn record(&self, live: &[Point3<f64>]) {
        let mut snapshot = self.lock();
        snapshot.live.clear();
        snapshot.live.extend_from_slice(live);
        if snapshot.frames == 0 {
            snapshot.rest = live.to_vec();
        }
        snapshot.frames += 1;
    }

    fn lock(&self) -> MutexGuard<'_, Snapshot> {
        // A reader that panicked cannot have left the snapshot half written.
        self.shared.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
