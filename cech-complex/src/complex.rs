//! The filtered complex: built from points, normals and options, it holds simplices and their values.

use crate::cylinder::Cylinder;
use crate::error::Error;
use crate::filtration::orient;
use crate::matching;
use crate::nerve::{self, Vertices};
use crate::options::Options;
use crate::persistence::{self, Barcode};
use crate::skeleton::{Skeleton, run};
use crate::valuation::Valuation;
use crate::values::{Attained, Values};
use nalgebra::{Point3, UnitVector3};
use std::sync::OnceLock;

/// Filtered cylinder-Čech complex up to dimension 3.
///
/// Simplices of each dimension are in lexicographic order of their (ascending) vertices. Values never decrease from a face to a
/// coface. Vertices have value 0 and keep their indices; removed vertices leave gaps.
///
/// Which simplices there are is decided when the complex is built or updated. Their values are computed when they are first asked for, and kept: by
/// [`edge_values`](Self::edge_values) and the like, by [`barcode`](Self::barcode), or by any question about a scale below the largest. Which question
/// comes first, and from which thread, does not matter to the result.
#[derive(Debug, Clone)]
pub struct Complex {
    pub(crate) points: Vec<Point3<f64>>,
    pub(crate) normals: Vec<UnitVector3<f64>>,
    pub(crate) cylinder: Cylinder,
    pub(crate) options: Options,
    pub(crate) present: Vec<bool>,
    pub(crate) skeleton: Skeleton,
    pub(crate) values: Values,
    pub(crate) adjacency: Adjacency,
    pub(crate) barcode: OnceLock<Barcode>,
    /// Betti numbers of all simplices.
    pub(crate) whole: OnceLock<[usize; 3]>,
}

/// Neighbours of every vertex, ascending, each with the edge that leads there.
#[derive(Debug, Clone)]
pub(crate) struct Adjacency {
    runs: Vec<u32>,
    vertices: Vec<u32>,
    edges: Vec<u32>,
}

impl Adjacency {
    pub(crate) fn new(edges: &[[u32; 2]], vertices: usize) -> Self {
        let runs = crate::skeleton::runs(edges.iter().flatten().copied(), vertices);
        let mut next = runs.clone();
        let mut adjacency = Self {
            runs,
            vertices: vec![0; 2 * edges.len()],
            edges: vec![0; 2 * edges.len()],
        };
        // Two passes put the smaller neighbours first, so that each list ascends.
        for (from, to) in [(1, 0), (0, 1)] {
            for (e, edge) in edges.iter().enumerate() {
                let slot = &mut next[edge[from] as usize];
                adjacency.vertices[*slot as usize] = edge[to];
                adjacency.edges[*slot as usize] = e as u32;
                *slot += 1;
            }
        }
        adjacency
    }

    pub(crate) fn neighbours(&self, v: u32) -> &[u32] {
        &self.vertices[run(&self.runs, v)]
    }

    pub(crate) fn edges(&self, v: u32) -> &[u32] {
        &self.edges[run(&self.runs, v)]
    }
}

impl Complex {
    /// Builds the nerve of the cylinders at `points` (m) with unit `normals`, up to dimension 3 and
    /// scale `options.max_scale`. Exact filtration values follow when they are asked for.
    ///
    /// # Errors
    /// [`Error::LengthMismatch`], [`Error::NonFinitePoint`], [`Error::NonUnitNormal`], [`Error::NotPositive`] and
    /// [`Error::OutOfRange`] for the options, [`Error::TooManySimplices`].
    ///
    /// # Complexity
    /// `O(n log n)` for the neighbours, and a test of a few points for nearly every pair, triple and quadruple of mutual neighbours. All values: one small
    /// convex problem for each edge, half of the triangles and a tenth of the tetrahedra, about three times as long as the build.
    ///
    /// Empty clouds, single points and duplicates are valid.
    ///
    /// ```
    /// use cech_complex::nalgebra::{Point3, Vector3};
    /// use cech_complex::{Complex, Cylinder, Options};
    ///
    /// // Four corners of a square whose discs meet along the sides but not across.
    /// let points = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(|(x, y)| Point3::new(x, y, 0.0));
    /// let complex = Complex::build(&points, &[Vector3::z_axis(); 4], Cylinder::new(0.6, 0.2)?, &Options::default())?;
    /// assert_eq!(complex.counts(), [4, 4, 0, 0]);
    /// assert!((complex.edge_values()[0] - 0.5 / 0.6).abs() < 1e-12); // two discs of half a side touch
    /// # Ok::<(), cech_complex::Error>(())
    /// ```
    pub fn build(
        points: &[Point3<f64>],
        normals: &[UnitVector3<f64>],
        cylinder: Cylinder,
        options: &Options,
    ) -> Result<Self, Error> {
        Self::of(points, normals, cylinder, options, None)
    }

    fn of(
        points: &[Point3<f64>],
        normals: &[UnitVector3<f64>],
        cylinder: Cylinder,
        options: &Options,
        pairs: Option<&[[u32; 2]]>,
    ) -> Result<Self, Error> {
        let (skeleton, values, _) = Vertices::of_cloud(points, normals, options, |vertices| {
            let nothing = (&Skeleton::default(), &mut Values::default());
            let vertices = Vertices { pairs, ..*vertices };
            nerve::build(&vertices, nothing, cylinder, options)
        })??;
        Ok(Self {
            points: points.to_vec(),
            normals: normals.to_vec(),
            cylinder,
            options: *options,
            present: vec![true; points.len()],
            adjacency: Adjacency::new(&skeleton.edges, points.len()),
            skeleton,
            values,
            barcode: OnceLock::new(),
            whole: OnceLock::new(),
        })
    }

    /// As [`Self::build`], but two points can be joined only if `pairs` contains them, in either order: for points of which more is known than their
    /// positions, such as those of a mesh, where only what is near along the surface may be joined. The two sides of a thin sheet and
    /// the sides of a deep crease, which a limit on normals cannot tell apart, then can be.
    ///
    /// The result is the complex of [`Self::build`] after [`Self::cut`] has removed all other edges, except that no point is removed; and so an
    /// [`update`](Self::update) joins the vertices that it adds or moves by position and normal alone.
    ///
    /// # Errors
    /// As [`Self::build`], and [`Error::NoSuchVertex`].
    ///
    /// # Complexity
    /// As [`Self::build`], without its search for neighbours.
    ///
    /// ```
    /// use cech_complex::nalgebra::{Point3, Vector3};
    /// use cech_complex::{Complex, Cylinder, Options, Orientation};
    ///
    /// // A strip folded to a sharp V, seen from the side: its ends are nearly as close to each other as its neighbours.
    /// let points = [(-2.0, 3.0), (-1.0, 1.5), (0.0, 0.0), (1.0, 1.5), (2.0, 3.0)].map(|(x, z)| Point3::new(1e-3 * x, 0.0, 1e-3 * z));
    /// let [left, up, right] = [(3.0, 2.0), (0.0, 1.0), (-3.0, 2.0)].map(|(x, z)| nalgebra::UnitVector3::new_normalize(Vector3::new(x, 0.0, z)));
    /// let normals = [left, left, up, right, right];
    /// let cylinder = Cylinder::new(1.5e-3, 1e-3)?;
    /// let options = Options::default().with_orientation(Orientation::Free);
    ///
    /// let by_position = Complex::build(&points, &normals, cylinder, &options)?;
    /// assert!(by_position.find_edge(1, 3).is_some());
    /// let along = [[0, 1], [1, 2], [2, 3], [3, 4]];
    /// let along_the_strip = Complex::build_among(&points, &normals, cylinder, &options, &along)?;
    /// assert_eq!(along_the_strip.edges(), along);
    /// # Ok::<(), cech_complex::Error>(())
    /// ```
    pub fn build_among(
        points: &[Point3<f64>],
        normals: &[UnitVector3<f64>],
        cylinder: Cylinder,
        options: &Options,
        pairs: &[[u32; 2]],
    ) -> Result<Self, Error> {
        let len = points.len();
        if let Some(index) = pairs
            .iter()
            .flatten()
            .map(|&v| v as usize)
            .find(|&v| v >= len)
        {
            return Err(Error::NoSuchVertex { index, len });
        }
        let mut sorted: Vec<[u32; 2]> = pairs.iter().map(|&[a, b]| [a.min(b), a.max(b)]).collect();
        sorted.retain(|[a, b]| a != b);
        sorted.sort_unstable();
        sorted.dedup();
        Self::of(points, normals, cylinder, options, Some(&sorted))
    }

    /// The points, indexed by vertex.
    pub fn points(&self) -> &[Point3<f64>] {
        &self.points
    }

    /// The normals, indexed by vertex.
    pub fn normals(&self) -> &[UnitVector3<f64>] {
        &self.normals
    }

    /// The cylinder of every vertex.
    pub fn cylinder(&self) -> Cylinder {
        self.cylinder
    }

    /// Largest filtration value that was kept.
    pub fn max_scale(&self) -> f64 {
        self.options.max_scale
    }

    /// Whether vertex `v` exists and has not been cut.
    pub fn contains_vertex(&self, v: u32) -> bool {
        self.present.get(v as usize).copied().unwrap_or(false)
    }

    /// Edges, vertices ascending.
    pub fn edges(&self) -> &[[u32; 2]] {
        &self.skeleton.edges
    }

    /// Filtration value of every edge, computed on first use and kept.
    pub fn edge_values(&self) -> &[f64] {
        &self.edges_attained().values
    }

    fn edges_attained(&self) -> &Attained {
        let edges = &self.skeleton.edges;
        self.values
            .edges
            .all(|attained| self.valuate(|v| v.complete_edges(edges, attained)))
    }

    fn triangles_attained(&self) -> &Attained {
        self.values.triangles.all(|attained| {
            let (s, of_facets) = (&self.skeleton, self.edges_attained());
            self.valuate(|v| v.complete(&s.triangles, &s.triangle_edges, of_facets, attained));
        })
    }

    /// Hands out what values depend on.
    fn valuate(&self, work: impl FnOnce(&Valuation)) {
        let cloud = orient(&self.points, &self.normals);
        work(&Valuation {
            cloud: &cloud,
            cylinder: self.cylinder,
            options: &self.options,
        });
    }

    /// Triangles, vertices ascending.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.skeleton.triangles
    }

    /// Filtration value of every triangle, computed on first use and kept.
    pub fn triangle_values(&self) -> &[f64] {
        &self.triangles_attained().values
    }

    /// Tetrahedra, vertices ascending.
    pub fn tetrahedra(&self) -> &[[u32; 4]] {
        &self.skeleton.tetrahedra
    }

    /// Filtration value of every tetrahedron, computed on first use and kept.
    pub fn tetrahedron_values(&self) -> &[f64] {
        let complete = |tetrahedra: &mut Attained| {
            let (s, of_facets) = (&self.skeleton, self.triangles_attained());
            let facets = &s.tetrahedron_triangles;
            self.valuate(|v| v.complete(&s.tetrahedra, facets, of_facets, tetrahedra));
        };
        &self.values.tetrahedra.all(complete).values
    }

    /// Whether the value of an edge is at most `scale`: known of all edges from the largest scale on, without their values.
    pub(crate) fn edge_within(&self, edge: usize, scale: f64) -> bool {
        scale >= self.options.max_scale || self.edge_values()[edge] <= scale
    }

    /// The same for a triangle.
    pub(crate) fn triangle_within(&self, triangle: usize, scale: f64) -> bool {
        scale >= self.options.max_scale || self.triangle_values()[triangle] <= scale
    }

    /// The same for a tetrahedron.
    pub(crate) fn tetrahedron_within(&self, tetrahedron: usize, scale: f64) -> bool {
        scale >= self.options.max_scale || self.tetrahedron_values()[tetrahedron] <= scale
    }

    /// Number of simplices of dimension 0 to 3.
    pub fn counts(&self) -> [usize; 4] {
        let vertices = self.present.iter().filter(|present| **present).count();
        let s = &self.skeleton;
        [
            vertices,
            s.edges.len(),
            s.triangles.len(),
            s.tetrahedra.len(),
        ]
    }

    /// Neighbours of vertex `v`, ascending; empty for a vertex that is isolated, cut or not there.
    pub fn neighbours(&self, v: u32) -> &[u32] {
        if (v as usize) < self.points.len() {
            self.adjacency.neighbours(v)
        } else {
            &[]
        }
    }

    /// Index of the edge between `a` and `b`, in either order.
    pub fn find_edge(&self, a: u32, b: u32) -> Option<usize> {
        let inside = (a.max(b) as usize) < self.points.len();
        inside
            .then(|| self.skeleton.find_edge(a, b))
            .flatten()
            .map(|e| e as usize)
    }

    /// Euclidean length of an edge.
    pub(crate) fn length(&self, edge: u32) -> f64 {
        let [a, b] = self.skeleton.edges[edge as usize];
        (self.points[a as usize] - self.points[b as usize]).norm()
    }

    pub(crate) fn check_vertex(&self, v: u32) -> Result<(), Error> {
        let (index, len) = (v as usize, self.points.len());
        if index < len {
            Ok(())
        } else {
            Err(Error::NoSuchVertex { index, len })
        }
    }

    /// Persistence bars of dimension 0, 1 and 2 over Z/2, computed on first use and kept.
    ///
    /// # Complexity
    /// All values, if they are not known yet; sorting, and nearly linear time and memory in the number of simplices.
    ///
    /// ```
    /// use cech_complex::manifolds::Manifold;
    /// use cech_complex::{Complex, Cylinder, Options};
    ///
    /// let tube = Manifold::Tube { radius: 0.5, length: 1.5 }.net(500, 1);
    /// let cylinder = Cylinder::new(1.25 * tube.spacing, tube.spacing)?;
    /// let complex = Complex::build(&tube.points, &tube.normals, cylinder, &Options::default())?;
    /// let longest = complex.barcode().of_dimension(1).max_by(|a, b| a.persistence().total_cmp(&b.persistence()));
    /// assert!(longest.unwrap().death.is_infinite()); // around the tube
    /// # Ok::<(), cech_complex::Error>(())
    /// ```
    pub fn barcode(&self) -> &Barcode {
        // Beforehand: with feature `rayon` a task that computes values may take up another that asks for the barcode.
        self.tetrahedron_values();
        self.barcode.get_or_init(|| persistence::barcode(self))
    }

    /// Betti numbers `β₀, β₁, β₂` of the subcomplex of values up to and including `scale` (the whole complex for scales above
    /// [`max_scale`](Self::max_scale)).
    ///
    /// # Complexity
    /// At the largest scale linear in the number of simplices, without their values, but for a reduction of one simplex in forty. At other scales
    /// that of [`barcode`](Self::barcode).
    pub fn betti(&self, scale: f64) -> [usize; 3] {
        let barcode = self.barcode.get();
        if scale >= self.options.max_scale && barcode.is_none() {
            return *self.whole.get_or_init(|| matching::betti(self));
        }
        self.barcode().rank(scale, scale)
    }

    /// Persistent Betti numbers: ranks of `H_k(K_from) → H_k(K_to)`, that is classes born by `from` and alive after `to`.
    pub fn persistent_betti(&self, from: f64, to: f64) -> [usize; 3] {
        self.barcode().rank(from, to)
    }

    /// Euler characteristic of the 3-skeleton up to `scale`: vertices − edges + triangles − tetrahedra.
    ///
    /// It equals `β₀ − β₁ + β₂ − β₃` *of the 3-skeleton*, whose `β₃` counts hollow 4-simplices and is not that of the nerve.
    pub fn euler_characteristic(&self, scale: f64) -> i64 {
        let [vertices, edges, triangles, tetrahedra] = self.counts().map(signed);
        if scale >= self.options.max_scale {
            return vertices - edges + triangles - tetrahedra;
        }
        let up_to = |values: &[f64]| signed(values.iter().filter(|value| **value <= scale).count());
        let vertices = if scale >= 0.0 { vertices } else { 0 };
        vertices - up_to(self.edge_values()) + up_to(self.triangle_values())
            - up_to(self.tetrahedron_values())
    }
}

/// Counts of simplices are below `u32::MAX`.
fn signed(count: usize) -> i64 {
    i64::try_from(count).unwrap_or(i64::MAX)
}
