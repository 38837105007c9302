//! The input of a projection: the estimate, its metric, the plane and the rows; and the start of the active sets.

use std::collections::HashMap;

use nalgebra::Point3;

use crate::observation::Plane;
use crate::rows::{Key, Row};
use crate::system::Factor;

/// A row violated by more than this is projected, m: a hundredth of the guaranteed 1e-6 m.
pub(crate) const ROW_DEPTH: f64 = 1e-8;

/// The main plane is handled by striking vertices; every other constraint is a row.
pub(crate) struct Problem<'a> {
    /// Lower triangle of the metric.
    pub values: &'a [f64],
    pub factor: &'a Factor,
    pub estimate: &'a [Point3<f64>],
    pub plane: Option<Plane>,
    pub rows: &'a [Row],
}

/// The start of the active sets: from the last frame or the last linearisation.
#[derive(Clone, Debug, Default)]
pub(crate) struct Warm {
    /// Vertices that rested on the plane.
    pub resting: Vec<u32>,
    /// Displacement of every vertex along the normal of the plane, m; empty if unknown.
    pub risen: Vec<f64>,
    /// Forces of the active rows.
    pub forces: HashMap<Key, f64>,
}
