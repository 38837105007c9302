//! What a frame says of vertices that registration could not match.
//!
//! ```text
//! misplaced cloud with the same sheet of the model behind it: the sheet comes out to it
//! outline   cloud that no vertex accounts for, next to surface that does not end there: the surface comes out to it
//! sight     a vertex that was not measured is hidden: it lies behind the cloud, and within its outline
//! ```
//! Closest points along normals do not feel an outline slide sideways; what sticks out of the model does. And a hidden
//! vertex is not unknown: the camera says where it is not.

use crate::canonical::{CanonicalModel, graph, surface::aside};
use crate::cell::ArmState;
use crate::stages::Measured;
use crate::visibility::{DepthGrid, behind_arm};
use nalgebra::{Point3, UnitVector3};

/// A frame beside the model as it is expected to be in it.
pub(crate) struct Evidence<'a> {
    pub model: &'a CanonicalModel,
    /// Where each vertex is expected.
    pub expected: &'a [Point3<f64>],
    /// The thinned cloud and its normals.
    pub points: &'a [Point3<f64>],
    pub normals: &'a [UnitVector3<f64>],
    /// Spacing of the model, metres.
    pub spacing: f64,
}

/// A vertex within this many spacings accounts for a point of the cloud.
const EXPLAINS: f64 = 1.3;
/// Farthest vertex that comes out to a point, in spacings.
const REACHES: f64 = 4.0;
/// A vertex that lies less than `BEHIND` spacings behind a point, and less than `BESIDE` beside its normal, is that point of the surface.
const BEHIND: f64 = 3.0;
const BESIDE: f64 = 0.85;
/// How far outside the outline a vertex is drawn back from, metres.
const OUTSIDE: f64 = 0.08;

impl Evidence<'_> {
    /// Draws the surface out to the cloud it does not account for; grips (`grip_sigma` or less) stay.
    pub fn reach_for_unexplained(&self, measured: &mut Vec<Measured>, sigma: f64, grip_sigma: f64) {
        let mut place = self.expected.to_vec();
        let mut slot: Vec<Option<usize>> = vec![None; place.len()];
        for (k, m) in measured.iter().enumerate() {
            place[m.vertex as usize] = m.position;
            slot[m.vertex as usize] = Some(k);
        }
        let normals = self.model.live_normals();
        let pull = self.pulls(&place, &normals);
        for i in (0..place.len()).filter(|&i| pull[i] > 0.4 * self.spacing) {
            // A step at a time: the rest of the surface follows before the next.
            let position = place[i] + normals[i].into_inner() * pull[i].min(self.spacing);
            let vertex = i as u32;
            let m = Measured {
                vertex,
                position,
                sigma,
            };
            match slot[i] {
                Some(k) if measured[k].sigma > grip_sigma => measured[k] = m,
                Some(_) => {}
                None => measured.push(m),
            }
        }
    }

    /// How far each vertex has to come out along its normal, metres.
    fn pulls(&self, place: &[Point3<f64>], normals: &[UnitVector3<f64>]) -> Vec<f64> {
        let mut pull = vec![0.0_f64; place.len()];
        let frontier = graph::frontier(self.model);
        let Some(tree) = graph::tree(place) else {
            return pull;
        };
        for (point, normal) in self.points.iter().zip(self.normals) {
            let around = graph::near(&tree, point, REACHES * self.spacing, 40);
            let explains = |&(i, d): &(usize, f64)| {
                d < EXPLAINS * self.spacing && normals[i].dot(normal) > 0.0
            };
            if around.iter().any(explains) {
                continue;
            }
            if let Some((i, height)) = self.misplaced(&around, (point, normal), place, normals) {
                pull[i] = pull[i].max(height);
                continue;
            }
            // Only the nearest vertex of the sheet answers, and only if the surface goes on behind it: at the
            // frontier the point is new surface.
            let nearest = around.iter().find(|(i, _)| normals[*i].dot(normal) > 0.3);
            if let Some(&(i, _)) = nearest.filter(|(i, _)| !frontier[*i]) {
                pull[i] = pull[i].max(normals[i].dot(&(point - place[i])));
            }
        }
        pull
    }

    /// The vertex nearest to a point of the cloud that lies behind it and faces the same way, and how far behind, metres: the
    /// surface seen there is known, but out of place.
    fn misplaced(
        &self,
        around: &[(usize, f64)],
        (point, normal): (&Point3<f64>, &UnitVector3<f64>),
        place: &[Point3<f64>],
        normals: &[UnitVector3<f64>],
    ) -> Option<(usize, f64)> {
        around
            .iter()
            .filter(|(i, d)| *d < BEHIND * self.spacing && normals[*i].dot(normal) > 0.5)
            .map(|(i, _)| (*i, point - place[*i]))
            .find(|(_, offset)| {
                normal.dot(offset) > 0.0 && aside(normal, offset) < BESIDE * self.spacing
            })
            .map(|(i, offset)| (i, normal.dot(&offset)))
    }

    /// Draws vertices that were not measured to the nearest place that the camera cannot see: behind the cloud, and
    /// within its outline unless an arm hides the background.
    pub fn keep_out_of_sight(
        &self,
        depth: &DepthGrid,
        arms: &[ArmState],
        measured: &mut Vec<Measured>,
        sigma: f64,
    ) {
        let mut known = vec![false; self.model.len()];
        for m in measured.iter() {
            known[m.vertex as usize] = true;
        }
        let margin = 3.0 * self.spacing;
        let by_arm = |p: &Point3<f64>| {
            arms.iter()
                .any(|arm| behind_arm(p, &arm.camera_from_tip, margin))
        };
        for i in (0..self.model.len()).filter(|&i| !known[i]) {
            let at = self.expected[i];
            let goal = match depth.depth(&at) {
                Some(seen) if seen - at.z > self.spacing => Some(Point3::from(
                    at.coords * ((seen + 0.5 * self.spacing) / at.z),
                )),
                Some(_) => None,
                None if by_arm(&at) => None,
                None => depth
                    .nearest_seen(&at, OUTSIDE)
                    .filter(|p| (p - at).norm() > self.spacing),
            };
            if let Some(position) = goal {
                measured.push(Measured {
                    vertex: i as u32,
                    position,
                    sigma,
                });
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::canonical::NewVertex;
    use nalgebra::{Matrix3, Vector3};

    const SPACING: f64 = 5e-3;

    fn grid(pitch: f64, depth: impl Fn(f64) -> f64) -> Vec<Point3<f64>> {
        let side = (0.1 / pitch) as u32;
        (0..side * side)
            .map(|k| (f64::from(k % side) * pitch, f64::from(k / side) * pitch))
            .map(|(x, y)| Point3::new(x, y, depth(x)))
            .collect()
    }

    /// A sheet whose right half lies two spacings behind the cloud that shows it: that half, and nothing else, comes out, a spacing at
    /// a time.
    #[test]
    fn what_is_out_of_place_comes_out() {
        let mut model = CanonicalModel::default();
        let behind = 2.0 * SPACING;
        for p in grid(SPACING, |x| if x > 0.05 { 0.4 + behind } else { 0.4 }) {
            model.push(
                NewVertex {
                    rest: p,
                    rest_normal: -Vector3::z_axis(),
                    live: p,
                    rotation: Matrix3::identity(),
                },
                0,
            );
        }
        let points = grid(0.5 * SPACING, |_| 0.4);
        let normals = vec![-Vector3::z_axis(); points.len()];
        let evidence = Evidence {
            model: &model,
            expected: &model.live,
            points: &points,
            normals: &normals,
            spacing: SPACING,
        };
        let mut measured = Vec::new();
        evidence.reach_for_unexplained(&mut measured, 1e-3, 3e-4);
        let displaced = model.live.iter().filter(|p| p.z > 0.4).count();
        // Beside the step the left half accounts for the cloud.
        assert!(
            measured.len() > displaced * 3 / 4,
            "{} of {displaced}",
            measured.len()
        );
        for m in measured {
            let at = model.live[m.vertex as usize];
            assert!(at.z > 0.4);
            assert!((m.position - at - Vector3::z() * -SPACING).norm() < 1e-9);
        }
    }
}
