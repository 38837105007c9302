//! Which parts have come apart where they touched.
//!
//! ```text
//! opened(i, j)  ⇔  the line from X_i to X_j crosses the fan of a contact,  ‖X_j − X_i‖ < 4 ε,  i and j are seen,
//!                  ‖(x_j − x_i) − R_i (X_j − X_i)‖ > 2 ε,  and the same with i and j exchanged                        (A1 of the paper)
//! ```
//! with positions `X` at rest and `x` now, rotations `R`, and the spacing `ε`. The rim of the contact itself is hidden by the jaws often, so that vertices around it count, too.

use super::Track;
use crate::canonical::closed_surface::{crosses, fan};
use crate::canonical::graph;
use nalgebra::{Point3, Vector3};

/// Largest distance of the vertices of a pair at rest, in spacings.
const NEAR: f64 = 4.0;
/// Least separation, in spacings: several times the errors of tracked vertices. The material is divided between them, so that no strain is mistaken for it.
const OPENED: f64 = 2.0;
/// Most neighbours of a vertex that are looked at.
const MOST: usize = 64;

impl Track {
    /// Cuts the pairs of vertices that have come apart in this frame across a contact.
    pub fn cut_opened(&mut self, spacing: f64) {
        let mut opened = Vec::new();
        for wall in &self.walls {
            opened.extend(self.opened(wall, spacing));
        }
        if self.model.cut(&opened) > 0 {
            self.settle_edges(spacing);
        }
    }

    fn opened(&self, wall: &[Point3<f64>], spacing: f64) -> Vec<[u32; 2]> {
        let around: Vec<Vector3<f64>> = wall.iter().map(|p| p.coords).collect();
        let fan = fan(&around);
        let (rest, live) = (self.model.rest(), self.model.live());
        let reach = NEAR * spacing;
        let beside = |i: usize| wall.iter().any(|p| (p - rest[i]).norm() < reach);
        let seen: Vec<usize> = (0..rest.len())
            .filter(|&i| self.seen[i] && beside(i))
            .collect();
        let places: Vec<Point3<f64>> = seen.iter().map(|&i| rest[i]).collect();
        let Some(tree) = graph::tree(&places) else {
            return Vec::new();
        };
        let apart = |i: usize, j: usize| {
            let turned = self.model.rotations()[i] * (rest[j] - rest[i]);
            ((live[j] - live[i]) - turned).norm() > OPENED * spacing
        };
        let across = |i: usize, j: usize| {
            let (start, way) = (rest[i].coords, rest[j] - rest[i]);
            fan.iter().any(|triangle| crosses(triangle, &start, &way))
        };
        let mut pairs = Vec::new();
        for &i in &seen {
            for (k, _) in graph::near(&tree, &rest[i], reach, MOST) {
                let j = seen[k];
                if i < j && apart(i, j) && apart(j, i) && across(i, j) {
                    pairs.push([i as u32, j as u32]);
                }
            }
        }
        pairs
    }
}
