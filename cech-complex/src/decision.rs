//! Whether cylinders have a common point at a scale, without the value at which they first have one.
//!
//! ```text
//! g_i(y) ≤ s(1 − ε) for all i ∈ σ, some y    ⇒  f(σ) ≤ s       a common point is proof
//! L(w) > s(1 + ε), some w_1 … w_k, Σ w_i = 0  ⇒  f(σ) > s       so is a dual bound (module `problem`)
//! ```
//!
//! For triples and quadruples on a surface the centre of the smallest circle around three of the points is such a `y` in nearly all cases,
//! and nothing is solved. Otherwise the solver runs until one side is proved, usually one or two steps instead of four. If the value is within
//! `ε` of the scale it is computed from the values of the faces, as for a [`Complex`](crate::Complex): so the decision is that of the
//! complex, also in ties.

use crate::filtration::{TOLERANCE, search};
use crate::problem::{Goal, Oriented};
use crate::valuation::{Candidate, Valuation, Valued};
use nalgebra::Vector3;

/// `ε`: ten times the widest bracket of a value, which the complex takes for the truth.
const CLEAR: f64 = 1e-8;

/// A cloud in an order of its own, and the complex about which to decide.
pub(crate) struct Decisions<'a> {
    /// Cylinders in the order of this cloud.
    pub(crate) cloud: Vec<Oriented>,
    /// Index of each in the cloud of `valuation`.
    pub(crate) names: Vec<u32>,
    pub(crate) valuation: Valuation<'a>,
}

impl Decisions<'_> {
    /// Whether two cylinders have a common point at `scale`, and their normals are admissible.
    pub(crate) fn edge(&self, [i, j]: [u32; 2], scale: f64) -> bool {
        let (a, b) = (&self.cloud[i as usize], &self.cloud[j as usize]);
        if !self.joinable(i, j) {
            return false;
        }
        let middle = (a.point + b.point) / 2.0;
        self.proves(&[i, j], &middle, scale) || self.search([i, j], &middle, scale)
    }

    /// Whether three cylinders whose pairs are edges have a common point at `scale`.
    pub(crate) fn triangle(&self, triangle: [u32; 3], scale: f64) -> bool {
        let centre = self.centre(triangle);
        self.proves(&triangle, &centre, scale) || self.search(triangle, &centre, scale)
    }

    /// Whether four cylinders whose triples are triangles have a common point at `scale`.
    pub(crate) fn tetrahedron(&self, tetrahedron: [u32; 4], scale: f64) -> bool {
        let [i, j, k, l] = tetrahedron;
        let centres = [[i, j, k], [i, j, l], [i, k, l], [j, k, l]].map(|t| self.centre(t));
        if centres.iter().any(|y| self.proves(&tetrahedron, y, scale)) {
            return true;
        }
        let mean = centres.iter().sum::<Vector3<f64>>() / 4.0;
        self.search(tetrahedron, &mean, scale)
    }

    /// Whether the normals allow an edge.
    pub(crate) fn joinable(&self, i: u32, j: u32) -> bool {
        let (a, b) = (&self.cloud[i as usize], &self.cloud[j as usize]);
        let orientation = self.valuation.options.orientation;
        !orientation.separates(&a.normal, &b.normal)
    }

    /// Whether `y` is clearly in all cylinders.
    pub(crate) fn proves(&self, simplex: &[u32], y: &Vector3<f64>, scale: f64) -> bool {
        let (half, radius) = (
            self.valuation.cylinder.half_height(),
            self.valuation.cylinder.radius(),
        );
        let scale = scale * (1.0 - CLEAR);
        let (reach, squared) = (scale * half, (scale * radius).powi(2));
        simplex.iter().all(|&v| {
            let Oriented { point, normal } = &self.cloud[v as usize];
            let offset = y - point;
            let along = normal.dot(&offset);
            along.abs() <= reach && (offset - normal * along).norm_squared() <= squared
        })
    }

    /// Centre of the smallest circle around three points: of the longest side if the triangle is obtuse, otherwise the circumcentre.
    pub(crate) fn centre(&self, triangle: [u32; 3]) -> Vector3<f64> {
        let [a, b, c] = triangle.map(|v| self.cloud[v as usize].point);
        let (aa, bb, cc) = (
            (b - c).norm_squared(),
            (c - a).norm_squared(),
            (a - b).norm_squared(),
        );
        let (at_a, at_b, at_c) = (bb + cc - aa, cc + aa - bb, aa + bb - cc);
        if at_a <= 0.0 {
            return (b + c) / 2.0;
        }
        if at_b <= 0.0 {
            return (c + a) / 2.0;
        }
        if at_c <= 0.0 {
            return (a + b) / 2.0;
        }
        let (u, v, w) = (aa * at_a, bb * at_b, cc * at_c);
        (a * u + b * v + c * w) / (u + v + w)
    }

    fn search<const N: usize>(&self, simplex: [u32; N], start: &Vector3<f64>, scale: f64) -> bool {
        let goal = Goal {
            tolerance: TOLERANCE,
            cutoff: scale * (1.0 + CLEAR),
            enough: scale * (1.0 - CLEAR),
        };
        let cylinders = simplex.map(|v| self.cloud[v as usize]);
        let found = search(&cylinders, self.valuation.cylinder, Some(start), goal);
        if found.value <= goal.enough {
            true
        } else if found.lower > goal.cutoff {
            false
        } else {
            let mut names = simplex.map(|v| self.names[v as usize]);
            names.sort_unstable();
            let exact = match *names.as_slice() {
                [i, j] => self.valuation.edge([i, j]),
                [i, j, k] => self.value_of_triangle([i, j, k]),
                [i, j, k, l] => self.value_of_tetrahedron([i, j, k, l]),
                _ => None,
            };
            exact.is_some_and(|(value, _)| value <= scale)
        }
    }

    fn value_of_triangle(&self, [i, j, k]: [u32; 3]) -> Option<Valued> {
        let edges = [[i, j], [i, k], [j, k]].map(|edge| self.valuation.edge(edge));
        self.from_facets([i, j, k], [0, 1, 2], &edges)
    }

    fn value_of_tetrahedron(&self, [i, j, k, l]: [u32; 4]) -> Option<Valued> {
        let facets = [[i, j, k], [i, j, l], [i, k, l], [j, k, l]];
        let triangles = facets.map(|triangle| self.value_of_triangle(triangle));
        self.from_facets([i, j, k, l], [0, 1, 2, 3], &triangles)
    }

    fn from_facets<const N: usize>(
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
