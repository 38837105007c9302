//! The true surface.

use super::{MeasureError, Surface};
use nalgebra::{Point3, UnitVector3, Vector3};

/// A true surface at one moment; vertices have the same order at every moment.
#[derive(Debug, Clone, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct TrueSurface {
    /// Vertices, camera frame, metres.
    pub vertices: Vec<Point3<f64>>,
    /// Triangles, oriented outward.
    pub triangles: Vec<[u32; 3]>,
}

impl TrueSurface {
    /// Diagonal of the bounding box: the object's size, metres.
    pub fn size(&self) -> f64 {
        let Some(first) = self.vertices.first() else {
            return 0.0;
        };
        let (low, high) = self
            .vertices
            .iter()
            .fold((*first, *first), |(low, high), p| (low.inf(p), high.sup(p)));
        (high - low).norm()
    }

    /// Area, m².
    pub fn area(&self) -> f64 {
        crate::canonical::surface::vertex_areas(&self.vertices, &self.triangles)
            .iter()
            .sum()
    }

    /// Outward normal at each vertex: the mean of its triangles', weighted by their areas.
    pub fn normals(&self) -> Vec<UnitVector3<f64>> {
        let mut sums = vec![Vector3::zeros(); self.vertices.len()];
        for t in &self.triangles {
            let [a, b, c] = t.map(|i| self.vertices[i as usize]);
            let cross = (b - a).cross(&(c - a));
            for i in t {
                sums[*i as usize] += cross;
            }
        }
        sums.into_iter()
            .map(|sum| UnitVector3::try_new(sum, 1e-300).unwrap_or(Vector3::z_axis()))
            .collect()
    }

    /// The surface, validated for measuring.
    ///
    /// # Errors
    /// Those of [`Surface::new`].
    pub fn surface(&self) -> Result<Surface, MeasureError> {
        Surface::new(&self.vertices, &self.triangles)
    }
}
