//! Loops of the surface: around its holes and handles, and along its boundary; and the vector area they span.
//!
//! ```text
//! A(loop) = ½ ∮ x × dx          m = −Σ area_i·n_i
//! ```
//!
//! For a closed surface `Σ area_i·n_i = 0`, so for a partly seen one `m` is the vector area of the missing part: it points where the hidden
//! surface faces, and its length is a lower bound of the hidden area.

use crate::complex::Complex;
use crate::error::Error;
use crate::local_homology::VertexKind;
use crate::short_cycles::{Cycle, Part};
use crate::union_find::UnionFind;
use nalgebra::{Point3, UnitVector3, Vector3};

/// Scale at which the boundary is traced: the cylinder's own size.
const SCALE: f64 = 1.0;
/// A boundary loop encloses a gap that the discs leave open, so it is longer than the circle of one disc. Shorter loops are pinholes of the
/// strip of boundary vertices, not of the surface.
const SHORTEST_BOUNDARY_IN_RADII: f64 = std::f64::consts::TAU;

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
    /// Loops along the boundary of the surface, longest first: the shortest basis of `H₁` of the subcomplex of boundary vertices.
    ///
    /// `kinds` is the result of [`classify`](Self::classify). Boundary vertices form a strip about two spacings wide along each
    /// boundary component; squared edge lengths make the loop step from neighbour to neighbour along it instead of taking the longest chords. A strip that noise has
    /// broken is closed by adding its neighbours.
    ///
    /// # Errors
    /// [`Error::LengthMismatch`] if there is not one kind per point.
    ///
    /// # Complexity
    /// As [`representative_loops`](Self::representative_loops), on the vertices of the strips.
    ///
    /// ```
    /// use cech_complex::manifolds::Manifold;
    /// use cech_complex::{Complex, Cylinder, Options};
    ///
    /// let tube = Manifold::Tube { radius: 0.5, length: 1.5 }.net(500, 1);
    /// let cylinder = Cylinder::new(1.25 * tube.spacing, tube.spacing)?;
    /// let complex = Complex::build(&tube.points, &tube.normals, cylinder, &Options::default())?;
    /// let boundary = complex.boundary_loops(&complex.classify(tube.spacing)?)?;
    /// assert_eq!(boundary.len(), 2); // both ends
    /// for circle in &boundary {
    ///     assert!((0.9..1.2).contains(&(circle.length / (0.5 * std::f64::consts::TAU))));
    /// }
    /// # Ok::<(), cech_complex::Error>(())
    /// ```
    pub fn boundary_loops(&self, kinds: &[VertexKind]) -> Result<Vec<BoundaryLoop>, Error> {
        if kinds.len() != self.points.len() {
            let others = kinds.len();
            return Err(Error::LengthMismatch {
                points: self.points.len(),
                what: "kinds",
                others,
            });
        }
        let mut loops = self.boundaries(|v| kinds[v as usize] == VertexKind::Boundary);
        let broken = self.broken_strips(kinds, &loops);
        if broken.contains(&true) {
            loops.extend(self.boundaries(|v| broken[v as usize]));
        }
        loops.sort_by(|a, b| b.length.total_cmp(&a.length));
        Ok(loops)
    }

    /// Long loops of the shortest basis of the subcomplex of some vertices.
    fn boundaries(&self, wanted: impl Fn(u32) -> bool) -> Vec<BoundaryLoop> {
        let strip = Part::new(self, SCALE, wanted);
        let mut loops = self.measure(strip.shortest_basis(self, |edge| self.length(edge).powi(2)));
        loops.retain(|path| path.length > SHORTEST_BOUNDARY_IN_RADII * self.cylinder.radius());
        loops
    }

    /// Marks the strips of boundary vertices without one of `loops` along them, and the neighbours of these strips.
    fn broken_strips(&self, kinds: &[VertexKind], loops: &[BoundaryLoop]) -> Vec<bool> {
        let at_boundary = |v: u32| kinds[v as usize] == VertexKind::Boundary;
        let edges = self.edges().iter().zip(self.edge_values());
        let near: Vec<[u32; 2]> = edges
            .filter(|(_, value)| **value <= SCALE)
            .map(|(edge, _)| *edge)
            .collect();
        let mut strips = UnionFind::new(self.points.len());
        for &[a, b] in near
            .iter()
            .filter(|edge| edge.iter().all(|&v| at_boundary(v)))
        {
            strips.union(a, b);
        }
        let mut closed = vec![false; self.points.len()];
        for v in loops.iter().filter_map(|path| path.vertices.first()) {
            closed[strips.find(*v) as usize] = true;
        }
        let mut is_broken = |v: u32| at_boundary(v) && !closed[strips.find(v) as usize];
        let count = self.points.len() as u32;
        let mut broken: Vec<bool> = (0..count).map(&mut is_broken).collect();
        let strip = broken.clone();
        for [a, b] in near.into_iter().flat_map(|[a, b]| [[a, b], [b, a]]) {
            broken[b as usize] |= strip[a as usize] && !at_boundary(b);
        }
        broken
    }

    /// One loop for each class of `H₁` at `scale`, together the shortest basis; shortest first.
    ///
    /// # Complexity
    /// One run of Dijkstra's algorithm from each vertex of the cocycles, about `√n` per class.
    ///
    /// ```
    /// use cech_complex::manifolds::Manifold;
    /// use cech_complex::{Complex, Cylinder, Options};
    ///
    /// let tube = Manifold::Tube { radius: 0.5, length: 1.5 }.net(500, 1);
    /// let cylinder = Cylinder::new(1.25 * tube.spacing, tube.spacing)?;
    /// let complex = Complex::build(&tube.points, &tube.normals, cylinder, &Options::default())?;
    /// let loops = complex.representative_loops(1.0);
    /// assert_eq!(loops.len(), 1); // once around the tube
    /// assert!((0.96..1.1).contains(&(loops[0].length / (0.5 * std::f64::consts::TAU))));
    /// # Ok::<(), cech_complex::Error>(())
    /// ```
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

/// Vector area `½ ∮ x × dx` of a closed polygon, m²: its length is the area of its projection along its direction, at most the
/// area of any surface bounded by the polygon.
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
    // Relative to the first vertex rather than the origin, so that no digits are lost far from it.
    let twice: Vector3<f64> = points
        .windows(2)
        .map(|side| (side[0] - origin).cross(&(side[1] - origin)))
        .sum();
    0.5 * twice
}

/// Vector area `−Σ area_i·n_i` (m²) of the missing part of a partly seen closed surface, from area and outward normal of every seen piece.
///
/// # Errors
/// [`Error::LengthMismatch`].
///
/// ```
/// use cech_complex::missing_vector_area;
/// use cech_complex::nalgebra::Vector3;
///
/// // A cube without its top.
/// let (x, y, z) = (Vector3::x_axis(), Vector3::y_axis(), Vector3::z_axis());
/// let missing = missing_vector_area(&[1.0; 5], &[x, -x, y, -y, -z])?;
/// assert_eq!(missing, Vector3::new(0.0, 0.0, 1.0));
/// # Ok::<(), cech_complex::Error>(())
/// ```
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
