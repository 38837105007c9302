//! The colour of the surface at rest.
//!
//! Points of a frame are moved to rest with their nearest vertex, `X = X_v + R_vᵀ (x − x_v)`, and averaged in cells of half a spacing,
//! separately for six directions of the normal, so that the two sides of a thin wall do not mix.
//!
//! ```text
//! colour(X, N) = Σ w_c k_c / Σ w_c over cells c within a spacing that do not face away,   w = points · exp(−‖X − X_c‖²/(0.5 spacing)²)
//! ```
//! Colour is stored by position and not by vertex, so that it survives renumbering of the vertices.

use super::{CanonicalModel, graph};
use crate::cell::Observation;
use nalgebra::{Point3, UnitVector3, Vector3};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Most points of a frame that are used.
const POINTS: usize = 1500;
/// Largest weight of a cell, in points, so that later colours still have an effect.
const ENOUGH: f32 = 30.0;
/// Edge of a cell, in spacings.
const CELL: f64 = 0.5;

/// The cell, and the direction its surface faces: the axis, and whether against it.
type Key = ([i32; 3], u8);

/// Mean colours over the surface at rest.
///
/// ```
/// use explore_loop::canonical::colour::ColourMap;
/// use explore_loop::nalgebra::{Point3, Vector3};
///
/// // The two sides of a thin wall keep their colours.
/// let (mut map, spacing) = (ColourMap::default(), 0.005);
/// let place = Point3::new(0.01, 0.02, 0.5);
/// map.add(&place, &Vector3::z(), [200, 10, 10], spacing);
/// map.add(&place, &-Vector3::z(), [10, 10, 200], spacing);
/// assert_eq!(map.at(&place, &Vector3::z_axis(), spacing), Some([200, 10, 10]));
/// assert_eq!(map.at(&place, &-Vector3::z_axis(), spacing), Some([10, 10, 200]));
/// // 2 cm away nothing is known.
/// let far = place + Vector3::new(0.02, 0.0, 0.0);
/// assert_eq!(map.at(&far, &Vector3::z_axis(), spacing), None);
/// ```
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct ColourMap {
    cells: BTreeMap<Key, ([f32; 3], f32)>,
}

fn cell(place: &Point3<f64>, spacing: f64) -> [i32; 3] {
    [place.x, place.y, place.z].map(|c| (c / (CELL * spacing)).floor() as i32)
}

fn faces(normal: &Vector3<f64>) -> u8 {
    let axis = normal.iamax();
    2 * axis as u8 + u8::from(normal[axis] < 0.0)
}

fn direction(faces: u8) -> Vector3<f64> {
    let mut direction = Vector3::zeros();
    direction[usize::from(faces / 2)] = if faces.is_multiple_of(2) { 1.0 } else { -1.0 };
    direction
}

impl ColourMap {
    /// Whether nothing has a colour.
    pub fn is_empty(&self) -> bool {
        self.cells.is_empty()
    }

    /// Adds the colour of a position.
    pub fn add(
        &mut self,
        place: &Point3<f64>,
        normal: &Vector3<f64>,
        colour: [u8; 3],
        spacing: f64,
    ) {
        let (mean, count) = self
            .cells
            .entry((cell(place, spacing), faces(normal)))
            .or_default();
        *count = (*count + 1.0).min(ENOUGH);
        for (mean, new) in mean.iter_mut().zip(colour) {
            *mean += (f32::from(new) - *mean) / *count;
        }
    }

    /// The colour at a position whose surface faces along `normal`, if one is known nearby.
    pub fn at(
        &self,
        place: &Point3<f64>,
        normal: &UnitVector3<f64>,
        spacing: f64,
    ) -> Option<[u8; 3]> {
        let [x, y, z] = cell(place, spacing);
        let (mut sum, mut weights) = (Vector3::zeros(), 0.0);
        let around =
            (-2..=2).flat_map(|i| (-2..=2).flat_map(move |j| (-2..=2).map(move |k| [i, j, k])));
        for [i, j, k] in around {
            let key = [(x, i), (y, j), (z, k)].map(|(c, step): (i32, i32)| c.saturating_add(step));
            let middle = Vector3::from(key.map(|c| (f64::from(c) + 0.5) * CELL * spacing));
            let away = (middle - place.coords).norm() / spacing;
            for side in (0..6).filter(|side| away < 1.0 && direction(*side).dot(normal) > 0.0) {
                if let Some((mean, count)) = self.cells.get(&(key, side)) {
                    let weight = f64::from(*count) * (-(away / 0.5).powi(2)).exp();
                    sum += Vector3::from(mean.map(f64::from)) * weight;
                    weights += weight;
                }
            }
        }
        let colour = sum / weights;
        (weights > 0.0).then(|| [colour.x, colour.y, colour.z].map(|c| c.round() as u8))
    }
}

impl CanonicalModel {
    /// Adds the colours of a registered frame; `measured` marks the vertices that were seen in it.
    pub fn take_colours(&mut self, observation: &Observation, measured: &[bool], spacing: f64) {
        let Some(colours) = observation.colours() else {
            return;
        };
        let seen: Vec<usize> = (0..self.len().min(measured.len()))
            .filter(|&v| measured[v])
            .collect();
        let places: Vec<Point3<f64>> = seen.iter().map(|&v| self.live[v]).collect();
        let Some(tree) = graph::tree(&places) else {
            return;
        };
        let every = observation.points.len().div_ceil(POINTS).max(1);
        for (point, colour) in observation.points.iter().zip(colours).step_by(every) {
            if !point.iter().all(|c| c.is_finite()) {
                continue;
            }
            let (nearest, distance) = graph::nearest(&tree, point);
            if distance > spacing {
                continue;
            }
            let v = seen[nearest];
            let at_rest = self.rest[v] + self.rotations[v].transpose() * (point - self.live[v]);
            let normal = self.rest_normals[v].into_inner();
            self.colours.add(&at_rest, &normal, *colour, spacing);
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    const SPACING: f64 = 0.005;

    #[test]
    fn the_two_sides_of_a_wall_keep_their_colours() {
        let mut map = ColourMap::default();
        let place = Point3::new(0.01, 0.02, 0.5);
        map.add(&place, &Vector3::z(), [200, 10, 10], SPACING);
        map.add(&place, &-Vector3::z(), [10, 10, 200], SPACING);
        assert_eq!(
            map.at(&place, &Vector3::z_axis(), SPACING),
            Some([200, 10, 10])
        );
        assert_eq!(
            map.at(&place, &-Vector3::z_axis(), SPACING),
            Some([10, 10, 200])
        );
        let far = place + Vector3::new(0.02, 0.0, 0.0);
        assert_eq!(map.at(&far, &Vector3::z_axis(), SPACING), None);
    }

    #[test]
    fn colours_are_averaged() {
        let mut map = ColourMap::default();
        let place = Point3::new(0.0, 0.0, 0.5);
        for k in 0..20u8 {
            map.add(&place, &Vector3::z(), [100 + k % 2 * 20, 0, 0], SPACING);
        }
        let [red, ..] = map.at(&place, &Vector3::z_axis(), SPACING).unwrap();
        assert!((108..=112).contains(&red), "{red}");
    }
}
