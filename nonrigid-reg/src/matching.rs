//! Which target point a source point meets, and how much that counts.
//!
//! ```text
//! w = Tukey(|y − q|, gate) · [n_y · n_q > cos] · (small if the target ends at q),      y = p + Φu,  q nearest to y
//! ```
//!
//! The gate shrinks from iteration to iteration. A source point that leaves the view finds its nearest target on the rim of
//! what is still seen, and would be dragged along with it; that is why rim matches count little.

use nalgebra::{Point3, UnitVector3, Vector3};

use crate::cloud::{Cloud, is_boundary};
use crate::options::Options;
use crate::tree::{Neighbour, Tree};

/// Neighbours that decide whether the target ends.
const RIM_NEIGHBOURS: usize = 12;

/// The match of one source point.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Match {
    pub target: usize,
    pub weight: f64,
    pub on_rim: bool,
}

/// Whether a target point lies on the rim, found out when first asked.
#[derive(Clone, Copy, PartialEq)]
enum Rim {
    Unknown,
    No,
    Yes,
}

/// The target cloud, ready to be searched.
pub(crate) struct Matcher<'a> {
    target: &'a Cloud<'a>,
    tree: Tree,
    rim: Vec<Rim>,
}

impl<'a> Matcher<'a> {
    pub fn new(target: &'a Cloud<'a>, tree: Tree) -> Self {
        Self {
            target,
            tree,
            rim: vec![Rim::Unknown; target.points.len()],
        }
    }

    /// The target nearest to a source point now at `y` with normal `n`; nothing beyond the gate or between incompatible normals.
    pub fn find(
        &self,
        y: &Point3<f64>,
        n: &Vector3<f64>,
        gate: f64,
        options: &Options,
    ) -> Option<Neighbour> {
        let hit = self.tree.nearest(y);
        let compatible = n.dot(&self.target.normals[hit.index]) > options.normal_cosine;
        (hit.squared < gate * gate && compatible).then_some(hit)
    }

    /// What a match counts.
    pub fn weigh(&mut self, hit: Neighbour, gate: f64, options: &Options) -> Match {
        let share = 1.0 - hit.squared / (gate * gate);
        let on_rim = self.on_rim(hit.index, options.boundary_angle);
        let trust = if on_rim { options.boundary_weight } else { 1.0 };
        Match {
            target: hit.index,
            weight: share * share * trust,
            on_rim,
        }
    }

    pub fn point(&self, m: &Match) -> &Point3<f64> {
        &self.target.points[m.target]
    }

    pub fn normal(&self, m: &Match) -> &UnitVector3<f64> {
        &self.target.normals[m.target]
    }

    fn on_rim(&mut self, index: usize, angle: f64) -> bool {
        if self.rim[index] == Rim::Unknown {
            let ends = is_boundary(self.target, &self.tree, index, RIM_NEIGHBOURS, angle);
            self.rim[index] = if ends { Rim::Yes } else { Rim::No };
        }
        self.rim[index] == Rim::Yes
    }
}
