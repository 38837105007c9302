//! Whether cylinders have a common point at a scale, without the value at which they first have one.
//!
//! ```text
//! g_i(y) ≤ s(1 − ε) for all i ∈ σ, some y    ⇒  f(σ) ≤ s       a common point is proof
//! L(w) > s(1 + ε), some w_1 … w_k, Σ w_i = 0  ⇒  f(σ) > s       so is a dual bound (module `problem`)
//! ```
//!
//! On a surface the centre of the smallest circle around two or three of the points, or a point of the line through it along the mean normal, is
//! such a `y` for nearly every simplex, and the directions away from it bound nearly every triple that is none: nothing is solved. Otherwise
//! the solver runs until one side is proved. If the value is within `ε` of the scale it is computed from the values of the
//! faces: so a simplex is there if and only if its value is at most the scale, also in ties.

use crate::filtration::{TOLERANCE, pair_lower_bound, search};
use crate::problem::{Goal, Oriented, Problem};
use crate::valuation::{Candidate, Valuation, Valued};
use crate::values::Attained;
use nalgebra::Vector3;

/// `ε`: ten times the widest bracket of a value (nearly parallel stacked cylinders), whose upper end the complex takes for the value.
const CLEAR: f64 = 1e-5;

/// A cloud in an order of its own, and the complex about which to decide.
pub(crate) struct Decisions<'a> {
    cloud: Vec<Oriented>,
    /// Index of each in the cloud of `valuation`.
    names: Vec<u32>,
    valuation: Valuation<'a>,
    scale: f64,
    /// A scale clearly within it.
    inner: f64,
    /// Half-height and squared radius of the cylinders that are clearly within `scale`.
    half_height: f64,
    squared_radius: f64,
}

/// How cylinders meet.
#[derive(Clone, Copy)]
pub(crate) enum Meeting {
    /// Clearly: this point is inside all of them.
    At(Vector3<f64>),
    /// Just so.
    Barely,
}

impl Meeting {
    /// A point inside all of them.
    pub(crate) fn point(self) -> Option<Vector3<f64>> {
        match self {
            Self::At(point) => Some(point),
            Self::Barely => None,
        }
    }

    /// The same, NaN instead of none.
    pub(crate) fn point_or_nan(self) -> Vector3<f64> {
        self.point().unwrap_or(Vector3::repeat(f64::NAN))
    }
}

/// The smallest circle around three points.
struct Circle {
    centre: Vector3<f64>,
    squared_radius: f64,
    /// Barycentric coordinates of the centre.
    weights: [f64; 3],
}

impl Circle {
    /// Around the longest side if the triangle is obtuse, otherwise the circumcircle.
    fn around([a, b, c]: [Vector3<f64>; 3]) -> Self {
        let squares = [b - c, c - a, a - b].map(|side| side.norm_squared());
        // Positive at an acute angle.
        let at = squares.map(|opposite| squares.iter().sum::<f64>() - 2.0 * opposite);
        let mut weights = [0, 1, 2].map(|i| squares[i] * at[i]);
        if let Some(obtuse) = at.iter().position(|at| *at <= 0.0) {
            weights = [1.0; 3];
            weights[obtuse] = 0.0;
        }
        let sum: f64 = weights.iter().sum();
        let weights = weights.map(|weight| weight / sum);
        let centre = a * weights[0] + b * weights[1] + c * weights[2];
        let distances = [a, b, c].map(|point| (point - centre).norm_squared());
        Self {
            centre,
            squared_radius: distances.into_iter().fold(0.0, f64::max),
            weights,
        }
    }
}

impl<'a> Decisions<'a> {
    /// About the complex of `valuation` at its largest scale; vertices are named by their position in `names`.
    pub(crate) fn new(names: Vec<u32>, valuation: Valuation<'a>) -> Self {
        let scale = valuation.options.max_scale;
        let inner = scale * (1.0 - CLEAR);
        Self {
            cloud: names.iter().map(|&v| valuation.cloud[v as usize]).collect(),
            names,
            scale,
            inner,
            half_height: inner * valuation.cylinder.half_height(),
            squared_radius: (inner * valuation.cylinder.radius()).powi(2),
            valuation,
        }
    }

    pub(crate) fn cloud(&self) -> &[Oriented] {
        &self.cloud
    }

    /// Whether two cylinders meet and may be joined.
    pub(crate) fn edge(&self, edge: [u32; 2]) -> Option<Meeting> {
        let cylinders = edge.map(|v| self.cloud[v as usize]);
        let [a, b] = &cylinders;
        if !self.joinable(edge[0], edge[1]) {
            return None;
        }
        match self.prove(&cylinders, (a.point + b.point) / 2.0) {
            Ok(y) => Some(Meeting::At(y)),
            Err(_) if self.excludes(pair_lower_bound(a, b, self.valuation.cylinder)) => None,
            Err(y) => self.search(edge, &cylinders, &y),
        }
    }

    /// Whether three cylinders of which any two are joined meet.
    pub(crate) fn triangle(&self, triangle: [u32; 3]) -> Option<Meeting> {
        let cylinders = triangle.map(|v| self.cloud[v as usize]);
        let circle = Circle::around(cylinders.map(|o| o.point));
        match self.prove(&cylinders, circle.centre) {
            Ok(y) => Some(Meeting::At(y)),
            Err(y) if self.excludes(self.lower_bound(&cylinders, &y, circle.weights)) => None,
            Err(y) => self.search(triangle, &cylinders, &y),
        }
    }

    /// Whether four cylinders of which any three form a triangle meet. If their points were in a plane, the smallest circle around them
    /// would be the largest of those around three.
    pub(crate) fn tetrahedron(&self, tetrahedron: [u32; 4]) -> Option<Meeting> {
        let cylinders = tetrahedron.map(|v| self.cloud[v as usize]);
        let [a, b, c, d] = cylinders.map(|o| o.point);
        let mut largest = Circle::around([a, b, c]);
        for facet in [[a, b, d], [a, c, d], [b, c, d]] {
            let circle = Circle::around(facet);
            if circle.squared_radius > largest.squared_radius {
                largest = circle;
            }
        }
        match self.prove(&cylinders, largest.centre) {
            Ok(y) => Some(Meeting::At(y)),
            Err(y) => self.search(tetrahedron, &cylinders, &y),
        }
    }

    /// Whether the cylinders of a triangle or tetrahedron meet, all of whose facets do, given values and points of these: usually a common point
    /// of a facet lies in the opposite cylinder too.
    pub(crate) fn coface<const N: usize>(
        &self,
        Candidate { vertices, facets }: &Candidate<N>,
        of_facets: &Attained,
    ) -> Option<Meeting> {
        for (f, facet) in facets.map(|facet| facet as usize).into_iter().enumerate() {
            let (value, y) = (of_facets.values[facet], of_facets.points[facet]);
            // Where the value is missing, the point is clearly in all cylinders of the facet.
            let clear = value.is_nan() || value <= self.inner;
            // Facet `f` leaves out the vertex `N − 1 − f`.
            if clear && self.contains(vertices[N - 1 - f], &y) {
                return Some(Meeting::At(y));
            }
        }

        match *vertices.as_slice() {
            [i, j, k] => self.triangle([i, j, k]),
            [i, j, k, l] => self.tetrahedron([i, j, k, l]),
            _ => None,
        }
    }

    /// Whether the normals allow an edge.
    pub(crate) fn joinable(&self, i: u32, j: u32) -> bool {
        let (a, b) = (&self.cloud[i as usize], &self.cloud[j as usize]);
        let orientation = self.valuation.options.orientation;
        !orientation.separates(&a.normal, &b.normal)
    }

    /// Whether `y` is clearly in a cylinder.
    pub(crate) fn contains(&self, v: u32, y: &Vector3<f64>) -> bool {
        self.inside(&self.cloud[v as usize], y)
    }

    fn inside(&self, Oriented { point, normal }: &Oriented, y: &Vector3<f64>) -> bool {
        let offset = y - point;
        let along = normal.dot(&offset);
        let across = offset - normal * along;
        along.abs() <= self.half_height && across.norm_squared() <= self.squared_radius
    }

    /// Whether a value above `bound` is clearly above the scale.
    fn excludes(&self, bound: f64) -> bool {
        bound > self.scale * (1.0 + CLEAR)
    }

    /// A point that is clearly in all cylinders, looked for on the line through `centre` along the mean normal; or else a point near all of them.
    fn prove<const N: usize>(
        &self,
        cylinders: &[Oriented; N],
        centre: Vector3<f64>,
    ) -> Result<Vector3<f64>, Vector3<f64>> {
        if cylinders.iter().all(|o| self.inside(o, &centre)) {
            return Ok(centre);
        }
        let y = self.on_line(cylinders, centre);
        if cylinders.iter().all(|o| self.inside(o, &y)) {
            Ok(y)
        } else {
            Err(y)
        }
    }

    /// The middle of the part of the line through `y` along the mean normal that lies in all cylinders, or of its shortest gap.
    fn on_line<const N: usize>(&self, cylinders: &[Oriented; N], y: Vector3<f64>) -> Vector3<f64> {
        let first = cylinders[0].normal;
        let mut line = first;
        for other in &cylinders[1..] {
            line += other.normal * other.normal.dot(&first).signum();
        }
        let (mut from, mut to) = (f64::NEG_INFINITY, f64::INFINITY);
        for Oriented { point, normal } in cylinders {
            let offset = y - point;
            let (along, slope) = (normal.dot(&offset), normal.dot(&line));
            let (middle, half) = (-along / slope, (self.half_height / slope).abs());
            (from, to) = (from.max(middle - half), to.min(middle + half));
            // ‖across + t·drift‖ ≤ radius
            let (across, drift) = (offset - normal * along, line - normal * slope);
            let (a, b) = (drift.norm_squared(), across.dot(&drift));
            let c = across.norm_squared() - self.squared_radius;
            // Otherwise the line is parallel to the axis.
            if a > 1e-12 {
                let root = (b * b - a * c).max(0.0).sqrt();
                (from, to) = (from.max((-b - root) / a), to.min((-b + root) / a));
            }
        }
        let t = 0.5 * (from + to);
        if t.is_finite() { y + line * t } else { y }
    }

    /// Lower bound of the value of a triangle: the outward directions of the tubes at `y`, weighted.
    fn lower_bound(&self, cylinders: &[Oriented; 3], y: &Vector3<f64>, weights: [f64; 3]) -> f64 {
        let problem = Problem {
            points: cylinders.map(|o| o.point - y),
            normals: cylinders.map(|o| o.normal),
            half_height: self.valuation.cylinder.half_height(),
            radius: self.valuation.cylinder.radius(),
        };
        problem.lower_bound(std::array::from_fn(|i| {
            let (offset, normal) = (-problem.points[i], problem.normals[i]);
            let across = offset - normal * normal.dot(&offset);
            let distance = across.norm();
            if distance > 0.0 {
                across * (weights[i] / distance)
            } else {
                Vector3::zeros()
            }
        }))
    }

    /// Decides by the solver, ties by the value.
    fn search<const N: usize>(
        &self,
        simplex: [u32; N],
        cylinders: &[Oriented; N],
        start: &Vector3<f64>,
    ) -> Option<Meeting> {
        let goal = Goal {
            tolerance: TOLERANCE,
            cutoff: self.scale * (1.0 + CLEAR),
            enough: self.inner,
        };
        let found = search(cylinders, self.valuation.cylinder, Some(start), goal);
        if found.value <= goal.enough {
            Some(Meeting::At(found.minimiser.coords))
        } else if found.lower > goal.cutoff {
            None
        } else {
            let mut names = simplex.map(|v| self.names[v as usize]);
            names.sort_unstable();
            let exact = match *names.as_slice() {
                [i, j] => self.valuation.edge([i, j]),
                [i, j, k] => self.value_of_triangle([i, j, k]),
                [i, j, k, l] => self.value_of_tetrahedron([i, j, k, l]),
                _ => None,
            };
            exact.map(|_| Meeting::Barely)
        }
    }

    fn value_of_triangle(&self, [i, j, k]: [u32; 3]) -> Option<Valued> {
        let edges = [[i, j], [i, k], [j, k]].map(|edge| self.valuation.edge(edge));
        self.value_from([i, j, k], [0, 1, 2], &edges)
    }

    fn value_of_tetrahedron(&self, [i, j, k, l]: [u32; 4]) -> Option<Valued> {
        let facets = [[i, j, k], [i, j, l], [i, k, l], [j, k, l]];
        let triangles = facets.map(|triangle| self.value_of_triangle(triangle));
        self.value_from([i, j, k, l], [0, 1, 2, 3], &triangles)
    }

    fn value_from<const N: usize>(
        &self,
        vertices: [u32; N],
        facets: [u32; N],
        valued: &[Option<Valued>; N],
    ) -> Option<Valued> {
        let (mut values, mut points) = ([0.0; N], [Vector3::zeros(); N]);
        for (f, facet) in valued.iter().enumerate() {
            (values[f], points[f]) = (*facet)?;
        }
        self.valuation
            .simplex(&Candidate { vertices, facets }, (&values, &points))
    }
}
