//! Which parts have come apart where they touched.
//!
//! ```text
//! opened(i, j)  ⇔  the line from X_i to X_j crosses the fan of a contact,  ‖X_j − X_i‖ ≤ 4 ε,  i and j are seen,
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

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use crate::cell::{Observation, Plane};
    use crate::reconstruct::ReconstructOptions;
    use crate::reconstruct::track::Fill;
    use crate::reconstruct::view::FrameView;

    const SPACING: f64 = 5e-3;

    /// The upper half of a ball of 30 mm, with a contact across its middle.
    fn ball() -> Track {
        let grid = (-14..=14).flat_map(|x| (-14..=14).map(move |y| (x, y)));
        let points = grid.filter_map(|(x, y)| {
            let (x, y) = (0.002 * f64::from(x), 0.002 * f64::from(y));
            let squared = 0.03_f64.powi(2) - x * x - y * y;
            (squared > 1e-4).then(|| Point3::new(x, y, 0.5 - squared.sqrt()))
        });
        let observation = Observation {
            stamp: 0.0,
            camera: None,
            points: points.collect(),
            colours: None,
            features: None,
            arms: Vec::new(),
        };
        let table = Plane {
            normal: -Vector3::z_axis(),
            offset: 0.5,
        };
        let view = FrameView::new(&observation, SPACING).unwrap().unwrap();
        let options = ReconstructOptions::new(SPACING);
        let mut track = Track::begin(&view, &table, &options, Fill { inner: 1.0 }).unwrap();
        let angles = (0..24).map(|k| std::f64::consts::TAU * f64::from(k) / 24.0);
        let around = angles.map(|a| Point3::new(0.0, 0.03 * a.cos(), 0.5 + 0.03 * a.sin()));
        track.walls = vec![around.collect()];
        track
    }

    /// The pairs that are cut when the half with positive x moves by `far` along an axis.
    fn cut(track: &mut Track, axis: usize, far: f64) -> Vec<[u32; 2]> {
        let right: Vec<bool> = track.model.rest().iter().map(|p| p.x > 0.0).collect();
        for (p, _) in (track.model.live_mut().iter_mut().zip(right)).filter(|(_, right)| *right) {
            p[axis] += far;
        }
        track.cut_opened(SPACING);
        track.model.cut_edges()
    }

    #[test]
    fn what_comes_apart_across_a_contact_is_cut() {
        for axis in 0..3 {
            let mut track = ball();
            let pairs = cut(&mut track, axis, 3.0 * SPACING);
            assert!(pairs.len() > 20, "{}", pairs.len());
            for pair in pairs {
                let [a, b] = pair.map(|v| track.model.rest()[v as usize]);
                assert!(
                    a.x * b.x <= 0.0 && (a - b).norm() <= NEAR * SPACING + 1e-9,
                    "{a} {b}"
                );
            }
        }
    }

    /// Less than two spacings may be an error of tracking; what was not seen may be wrong; without a contact there is nothing to open; a body that
    /// turns as a whole opens nowhere.
    #[test]
    fn nothing_else_is_cut() {
        assert!(cut(&mut ball(), 0, 1.9 * SPACING).is_empty());
        let mut unseen = ball();
        unseen.seen.fill(false);
        assert!(cut(&mut unseen, 0, 3.0 * SPACING).is_empty());
        let mut whole = ball();
        whole.walls.clear();
        assert!(cut(&mut whole, 0, 3.0 * SPACING).is_empty());
        let mut turned = ball();
        let turn = nalgebra::Rotation3::from_euler_angles(1.0, -2.0, 0.5);
        for p in turned.model.live_mut() {
            *p = turn * *p;
        }
        turned.model.rotations_mut().fill(*turn.matrix());
        assert!(cut(&mut turned, 0, 0.0).is_empty());
    }
}
