//! Simplices that join parts near in space but far apart on the surface, and their removal.
//!
//! ```text
//! A1 = ‖u_a − u_b‖          A2 = u_a·u_b / (‖u_a‖‖u_b‖)          u: displacements of the ends of an edge
//! ```
//!
//! Such edges are recognised when the object opens: their ends separate (`A1` high) or move in different directions (`A2` low).
//! Cutting a simplex removes every simplex that contains it, and the points that are left without an edge.

use crate::complex::{Adjacency, Complex};
use crate::error::Error;
use crate::skeleton::Marks;
use derive_setters::Setters;
use nalgebra::Vector3;
use std::sync::OnceLock;

/// `A1 = ‖u_a − u_b‖`, m: how far the ends of an edge have separated.
///
/// ```
/// use cech_complex::nalgebra::Vector3;
/// assert_eq!(cech_complex::displacement_difference(&Vector3::x(), &Vector3::zeros()), 1.0);
/// ```
pub fn displacement_difference(u_a: &Vector3<f64>, u_b: &Vector3<f64>) -> f64 {
    (u_a - u_b).norm()
}

/// `A2 = cos ∠(u_a, u_b)`, or `None` if one of them does not move.
///
/// ```
/// use cech_complex::displacement_cosine;
/// use cech_complex::nalgebra::Vector3;
/// assert_eq!(displacement_cosine(&Vector3::x(), &(-Vector3::x())), Some(-1.0));
/// assert_eq!(displacement_cosine(&Vector3::x(), &Vector3::zeros()), None);
/// ```
pub fn displacement_cosine(u_a: &Vector3<f64>, u_b: &Vector3<f64>) -> Option<f64> {
    let norms = u_a.norm() * u_b.norm();
    (norms > 0.0).then(|| (u_a.dot(u_b) / norms).clamp(-1.0, 1.0))
}

/// Limits beyond which an edge counts as distorted.
#[derive(Debug, Clone, Copy, PartialEq, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct DistortionLimits {
    /// Largest `A1`, m. Default 0.02: about two spacings of 2,000 points on an object of 0.2 m.
    pub max_difference: f64,
    /// Smallest `A2`. Default 0: directions up to 90° apart.
    pub min_cosine: f64,
    /// Displacements shorter than this have no direction: `A2` is not tested, m. Default 0.01.
    pub min_displacement: f64,
}

impl Default for DistortionLimits {
    fn default() -> Self {
        Self {
            max_difference: 0.02,
            min_cosine: 0.0,
            min_displacement: 0.01,
        }
    }
}

/// What a cut has removed.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Removed {
    /// Vertices: the given ones and those left without an edge.
    pub vertices: Vec<u32>,
    /// Number of edges.
    pub edges: usize,
    /// Number of triangles.
    pub triangles: usize,
    /// Number of tetrahedra.
    pub tetrahedra: usize,
}

impl Complex {
    /// Edges whose ends have separated (`A1`) or moved in different directions (`A2`), by the displacement (m) of every vertex.
    ///
    /// # Errors
    /// [`Error::LengthMismatch`].
    ///
    /// ```
    /// use cech_complex::nalgebra::{Point3, Vector3};
    /// use cech_complex::{Complex, Cylinder, DistortionLimits, Options};
    ///
    /// let points = [0.0, 0.1, 0.2, 0.3].map(|x| Point3::new(x, 0.0, 0.0));
    /// let complex = Complex::build(&points, &[Vector3::z_axis(); 4], Cylinder::new(0.06, 0.1)?, &Options::default())?;
    /// // The right half moves away.
    /// let (stays, goes) = (Vector3::zeros(), Vector3::new(0.05, 0.0, 0.0));
    /// let limits = DistortionLimits::default().with_max_difference(0.03);
    /// assert_eq!(complex.distorted_edges(&[stays, stays, goes, goes], &limits)?, [[1, 2]]);
    /// # Ok::<(), cech_complex::Error>(())
    /// ```
    pub fn distorted_edges(
        &self,
        displacements: &[Vector3<f64>],
        limits: &DistortionLimits,
    ) -> Result<Vec<[u32; 2]>, Error> {
        if displacements.len() != self.points.len() {
            let others = displacements.len();
            return Err(Error::LengthMismatch {
                points: self.points.len(),
                what: "displacements",
                others,
            });
        }
        let distorted = |[a, b]: [u32; 2]| {
            let (u_a, u_b) = (&displacements[a as usize], &displacements[b as usize]);
            let moves = u_a.norm().min(u_b.norm()) >= limits.min_displacement;
            displacement_difference(u_a, u_b) > limits.max_difference
                || (moves && displacement_cosine(u_a, u_b).is_some_and(|c| c < limits.min_cosine))
        };
        Ok(self
            .edges()
            .iter()
            .copied()
            .filter(|edge| distorted(*edge))
            .collect())
    }

    /// Removes `simplices`, each given by its one to four vertices in any order, with every simplex that contains one of them, and the
    /// vertices that thereby lose their last edge. Vertex indices do not change; simplices that are not in the complex are
    /// ignored.
    ///
    /// # Errors
    /// [`Error::NoSuchVertex`], [`Error::SimplexSize`]; the complex is then unchanged.
    ///
    /// # Complexity
    /// One pass over the complex.
    ///
    /// ```
    /// use cech_complex::nalgebra::{Point3, Vector3};
    /// use cech_complex::{Complex, Cylinder, Options};
    ///
    /// let points = [0.0, 0.1, 0.2, 0.3].map(|x| Point3::new(x, 0.0, 0.0));
    /// let normals = [Vector3::z_axis(); 4];
    /// let mut complex = Complex::build(&points, &normals, Cylinder::new(1.0, 1.0)?, &Options::default())?;
    /// assert_eq!(complex.counts(), [4, 6, 4, 1]);
    /// complex.cut(&[[0, 3]])?; // an edge, its two triangles, the tetrahedron
    /// assert_eq!(complex.counts(), [4, 5, 2, 0]);
    /// complex.cut(&[&[2, 1, 0][..], &[3]])?; // a triangle, and a vertex with all that is left around it
    /// assert_eq!(complex.counts(), [3, 3, 0, 0]);
    /// # Ok::<(), cech_complex::Error>(())
    /// ```
    pub fn cut<S: AsRef<[u32]>>(&mut self, simplices: &[S]) -> Result<Removed, Error> {
        let marks = self.marks(simplices)?;
        let before = self.counts();
        let (skeleton, values) = self
            .skeleton
            .without(&marks, &mut self.values, self.points.len());
        let adjacency = Adjacency::new(&skeleton.edges, self.points.len());
        let stays = |v: u32| {
            let lost_all = adjacency.neighbours(v).is_empty() && !self.neighbours(v).is_empty();
            self.present[v as usize] && !marks.vertices[v as usize] && !lost_all
        };
        let present: Vec<bool> = (0..self.points.len() as u32).map(stays).collect();
        let removed = (0..present.len()).filter(|&v| self.present[v] && !present[v]);
        let vertices = removed.map(|v| v as u32).collect();
        (self.skeleton, self.values) = (skeleton, values);
        (self.adjacency, self.present, self.barcode) = (adjacency, present, OnceLock::new());
        self.whole = OnceLock::new();
        let after = self.counts();
        let [_, edges, triangles, tetrahedra] = std::array::from_fn(|d| before[d] - after[d]);
        Ok(Removed {
            vertices,
            edges,
            triangles,
            tetrahedra,
        })
    }

    /// Marks the given simplices and the edges of the given vertices.
    fn marks<S: AsRef<[u32]>>(&self, simplices: &[S]) -> Result<Marks, Error> {
        let skeleton = &self.skeleton;
        let mut marks = Marks {
            vertices: vec![false; self.points.len()],
            edges: vec![false; skeleton.edges.len()],
            triangles: vec![false; skeleton.triangles.len()],
            tetrahedra: vec![false; skeleton.tetrahedra.len()],
        };
        for simplex in simplices {
            let mut vertices = simplex.as_ref().to_vec();
            for &v in &vertices {
                self.check_vertex(v)?;
            }
            vertices.sort_unstable();
            let (marked, found) = match *vertices {
                [a] => (&mut marks.vertices, Some(a as usize)),
                [a, b] => (
                    &mut marks.edges,
                    skeleton.find_edge(a, b).map(|e| e as usize),
                ),
                [a, b, c] => (
                    &mut marks.triangles,
                    skeleton.triangles.binary_search(&[a, b, c]).ok(),
                ),
                [a, b, c, d] => (
                    &mut marks.tetrahedra,
                    skeleton.tetrahedra.binary_search(&[a, b, c, d]).ok(),
                ),
                _ => {
                    return Err(Error::SimplexSize {
                        count: vertices.len(),
                    });
                }
            };
            if let Some(index) = found {
                marked[index] = true;
            }
        }
        for (mark, edge) in marks.edges.iter_mut().zip(&skeleton.edges) {
            *mark |= edge.iter().any(|&v| marks.vertices[v as usize]);
        }
        Ok(marks)
    }
}
