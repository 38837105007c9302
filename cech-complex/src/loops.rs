//! Loops of the surface: around its holes and handles, and along its rim; and the vector area they span.
//!
//! ```text
//! A(loop) = ½ ∮ x × dx          m = −Σ area_i·n_i
//! ```
//!
//! For a closed surface `Σ area_i·n_i = 0`, so for a partly seen one `m` is the vector area of all that is missing: it points where the hidden
//! surface faces, and its length is a lower bound of the hidden area.

use crate::complex::Complex;
use crate::error::Error;
use crate::local_homology::VertexKind;
use crate::short_cycles::{Cycle, Part};
use nalgebra::{Point3, UnitVector3, Vector3};

/// Scale at which rims are traced: the cylinder's own size.
const SCALE: f64 = 1.0;
/// A rim encloses a gap that the discs leave open, so it is longer than the circle of one disc. Shorter loops are pinholes of the
/// strip of boundary vertices, not of the surface.
const SHORTEST_RIM_IN_RADII: f64 = std::f64::consts::TAU;

/// A closed path over edges of the complex.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct BoundaryLoop {
    /// Vertices in order; the last is joined to the first.
    pub vertices: Vec<u32>,
    /// Euclidean length, m.
    pub length: f64,
}

impl BoundaryLoop {
    /// Positions of the vertices, in order.
    pub fn points(&self, complex: &Complex) -> Vec<Point3<f64>> {
        self.vertices
            .iter()
            .filter_map(|&v| complex.points().get(v as usize).copied())
            .collect()
    }
}

impl Complex {
    /// Loops along the rim of the surface, longest first: the shortest basis of `H₁` of the subcomplex of boundary vertices.
    ///
    /// `kinds` is what [`classify`](Self::classify) returned. Boundary vertices form a strip about two spacings wide along each
    /// rim; squared edge lengths make the loop step from neighbour to neighbour along it instead of taking the longest chords.
    ///
    /// # Errors
    /// [`Error::LengthMismatch`] if there is not one kind per point.
    pub fn boundary_loops(&self, kinds: &[VertexKind]) -> Result<Vec<BoundaryLoop>, Error> {
        if kinds.len() != self.points.len() {
            let others = kinds.len();
            return Err(Error::LengthMismatch {
                points: self.points.len(),
                what: "kinds",
                others,
            });
        }
        let rim = Part::new(self, SCALE, |v| kinds[v as usize] == VertexKind::Boundary);
        let cycles = rim.shortest_basis(self, |edge| self.length(edge).powi(2));
        let mut loops = self.measure(cycles);
        loops.retain(|rim| rim.length > SHORTEST_RIM_IN_RADII * self.cylinder.radius());
        loops.sort_by(|a, b| b.length.total_cmp(&a.length));
        Ok(loops)
    }

    /// One loop for each class of `H₁` at `scale`, together the shortest basis there is; shortest first.
    ///
    /// # Complexity
    /// One Dijkstra from each vertex of the cocycles, about `√n` per class.
    pub fn representative_loops(&self, scale: f64) -> Vec<BoundaryLoop> {
        let all = Part::new(self, scale, |_| true);
        self.measure(all.shortest_basis(self, |edge| self.length(edge)))
    }

    fn measure(&self, cycles: Vec<Cycle>) -> Vec<BoundaryLoop> {
        let measure = |cycle: Cycle| {
            let next = cycle.vertices.iter().cycle().skip(1);
            let side =
                |(&a, &b): (&u32, &u32)| (self.points[a as usize] - self.points[b as usize]).norm();
            let length = cycle.vertices.iter().zip(next).map(side).sum();
            BoundaryLoop {
                vertices: cycle.vertices,
                length,
            }
        };
        cycles.into_iter().map(measure).collect()
    }
}

/// Vector area `½ ∮ x × dx` of a closed polygon, m²: its length is the area of the shadow in the direction it points, at most the
/// area of any surface the polygon bounds.
///
/// ```
/// use nalgebra::Point3;
/// let square = [[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]].map(|[x, y]| Point3::new(x, y, 7.0));
/// assert!((cech_complex::vector_area_of_loop(&square).z - 4.0).abs() < 1e-12);
/// ```
pub fn vector_area_of_loop(points: &[Point3<f64>]) -> Vector3<f64> {
    let Some(&origin) = points.first() else {
        return Vector3::zeros();
    };
    // From the first vertex rather than the frame's origin: no digits are lost far away from it.
    let twice: Vector3<f64> = points
        .windows(2)
        .map(|side| (side[0] - origin).cross(&(side[1] - origin)))
        .sum();
    0.5 * twice
}

/// Vector area `−Σ area_i·n_i` (m²) of what a partly seen closed surface lacks, from the area and outward normal of every seen piece.
///
/// # Errors
/// [`Error::LengthMismatch`].
pub fn missing_vector_area(
    areas: &[f64],
    normals: &[UnitVector3<f64>],
) -> Result<Vector3<f64>, Error> {
    if areas.len() != normals.len() {
        return Err(Error::LengthMismatch {
            points: normals.len(),
            what: "areas",
            others: areas.len(),
        });
    }
    Ok(-areas
        .iter()
        .zip(normals)
        .map(|(area, normal)| normal.scale(*area))
        .sum::<Vector3<f64>>())
}
