//! What is projected: the estimate, its metric, the plane and the rows; and what the search for the active sets starts from.

use std::collections::HashMap;

use nalgebra::Point3;

use crate::observation::Plane;
use crate::rows::{Key, Row};
use crate::system::Factor;

/// A row violated by more than this is projected, m. It leaves a hundredfold reserve to the 1e-6 m that is promised.
pub(crate) const ROW_DEPTH: f64 = 1e-8;

/// The main plane is handled by striking vertices; everything else is a row.
pub(crate) struct Problem<'a> {
    /// Lower triangle of the metric.
    pub values: &'a [f64],
    pub factor: &'a Factor,
    pub estimate: &'a [Point3<f64>],
    pub plane: Option<Plane>,
    pub rows: &'a [Row],
}

/// What to start from: the last frame's or the last linearisation's.
#[derive(Clone, Debug, Default)]
pub(crate) struct Warm {
    /// Vertices that rested on the plane.
    pub resting: Vec<u32>,
    /// How far every vertex was moved along the normal of the plane, m; empty if there is nothing to go by.
    pub risen: Vec<f64>,
    /// Forces of the rows that pushed.
    pub forces: HashMap<Key, f64>,
}
