//! Where a surface was never seen: its unsupported patches that are more than random gaps, each with position, size and orientation.
//!
//! ```text
//! middle = Σ a_t c_t / Σ a_t        facing = Σ a_t n_t / |Σ a_t n_t|        over the triangles t of the patch: area, centroid, outward normal
//! ```

use super::ClosedSurface;
use super::support::Gap;
use nalgebra::{Point3, UnitVector3, Vector3};

/// A connected patch of a closed surface that no point supports.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[non_exhaustive]
pub struct Unseen {
    /// Its centroid, in the frame of the points, m.
    pub middle: Point3<f64>,
    /// The direction it faces: its normalised vector area. For a patch that faces all ways equally this direction is arbitrary.
    pub facing: UnitVector3<f64>,
    /// Its area, m².
    pub area: f64,
    /// Its share of the area of the surface.
    pub share: f64,
    /// Greatest distance of its corners from the nearest point that faces the same way, m; infinite if there is none.
    pub farthest: f64,
}

impl ClosedSurface {
    /// The patches that were never seen, the largest first; none when all was seen. [`Self::trimmed`] is open at these patches.
    pub fn unseen(&self) -> Vec<Unseen> {
        let all: Vec<usize> = (0..self.triangles.len()).collect();
        let total = self.area(&all).max(f64::MIN_POSITIVE);
        let places = self.places_not_seen().into_iter().rev();
        places.map(|gap| self.place(&gap, total)).collect()
    }

    fn place(&self, gap: &Gap, total: f64) -> Unseen {
        let (mut moment, mut vector) = (Vector3::zeros(), Vector3::zeros());
        for t in &gap.triangles {
            let [a, b, c] = self.triangles[*t].map(|v| self.vertices[v as usize].coords);
            let face = (b - a).cross(&(c - a)) / 2.0;
            moment += (a + b + c) / 3.0 * face.norm();
            vector += face;
        }
        Unseen {
            middle: Point3::from(moment / gap.area.max(f64::MIN_POSITIVE)),
            facing: UnitVector3::try_new(vector, f64::MIN_POSITIVE).unwrap_or(Vector3::z_axis()),
            area: gap.area,
            share: gap.area / total,
            farthest: gap.farthest,
        }
    }
}
