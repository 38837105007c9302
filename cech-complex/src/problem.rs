//! The convex problem of a filtration value, in the form used by the solvers.
//!
//! ```text
//! f = min_y max_j g_j(y)       pieces j: the tube ‖P_i(y − p_i)‖/r and the two slabs ±n_i·(y − p_i)/H of every cylinder i
//! L(w) = −Σ w_i·p_i / Σ h_i(w_i) ≤ f   for any w_1 … w_k with Σ w_i = 0
//! ```
//!
//! The right-hand side is weak duality with the support functions `h_i`, so a lower bound does not rely on any solver.
//! Coordinates are centred and divided by the size of the simplex, and the cylinder by its larger half-width, so that every
//! tolerance of the solvers is dimensionless.

use crate::cylinder::support;
use nalgebra::{Matrix3, Vector3};

/// Largest simplex: Helly's number in space.
const MAX_CYLINDERS: usize = 4;
/// Tube, upper slab, lower slab.
pub(crate) const PIECES_PER_CYLINDER: usize = 3;
/// Pieces of the largest simplex.
pub(crate) const MAX_PIECES: usize = MAX_CYLINDERS * PIECES_PER_CYLINDER;

/// A point with its unit normal.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Oriented {
    pub(crate) point: Vector3<f64>,
    pub(crate) normal: Vector3<f64>,
}

/// `N` cylinders in normalised coordinates. Their number is a constant, so that every small loop unrolls.
pub(crate) struct Problem<const N: usize> {
    pub(crate) points: [Vector3<f64>; N],
    pub(crate) normals: [Vector3<f64>; N],
    pub(crate) half_height: f64,
    pub(crate) radius: f64,
}

/// Values, gradients and curvatures of all pieces at one `y`: tubes first-hand, the two slabs of a cylinder as one signed height.
#[derive(Clone, Copy)]
pub(crate) struct Pieces<const N: usize> {
    tube: [f64; N],
    height: [f64; N],
    tube_gradient: [Vector3<f64>; N],
    height_gradient: [Vector3<f64>; N],
    /// Hessian of the tube of cylinder `i` is `bend·c cᵀ` with `c` the unit tangent of its circles.
    bend: [f64; N],
    tangent: [Vector3<f64>; N],
}

/// When the search for a value may end.
#[derive(Clone, Copy)]
pub(crate) struct Goal {
    /// Relative gap at which the value is known.
    pub(crate) tolerance: f64,
    /// A value certainly above it need not be known.
    pub(crate) cutoff: f64,
    /// Nor one that is at most this.
    pub(crate) enough: f64,
}

/// Best upper and lower bound so far, and where the upper one is attained.
pub(crate) struct Bracket {
    pub(crate) lower: f64,
    pub(crate) upper: f64,
    pub(crate) y: Vector3<f64>,
}

impl Bracket {
    /// Whether the search can end.
    pub(crate) fn settled(&self, goal: &Goal) -> bool {
        self.upper - self.lower <= goal.tolerance * self.upper
            || self.lower > goal.cutoff
            || self.upper <= goal.enough
    }

    pub(crate) fn improve_lower(&mut self, lower: f64) {
        if lower > self.lower {
            self.lower = lower;
        }
    }

    pub(crate) fn improve_upper(&mut self, upper: f64, y: &Vector3<f64>) {
        if upper < self.upper {
            self.upper = upper;
            self.y = *y;
        }
    }
}

impl<const N: usize> Problem<N> {
    /// All pieces at `y`.
    pub(crate) fn pieces(&self, y: &Vector3<f64>) -> Pieces<N> {
        let zero = [Vector3::zeros(); N];
        let mut pieces = Pieces {
            tube: [0.0; N],
            height: [0.0; N],
            tube_gradient: zero,
            height_gradient: zero,
            bend: [0.0; N],
            tangent: zero,
        };
        let (per_height, per_radius) = (1.0 / self.half_height, 1.0 / self.radius);
        for i in 0..N {
            let (n, d) = (&self.normals[i], y - self.points[i]);
            let along = n.dot(&d);
            let across = d - n * along;
            let distance = across.norm();
            pieces.tube[i] = distance * per_radius;
            // On the axis the tube is at its minimum, 0, and is active only if all values are 0.
            if distance > f64::MIN_POSITIVE {
                let outward = across / distance;
                pieces.tube_gradient[i] = outward * per_radius;
                pieces.bend[i] = per_radius / distance;
                pieces.tangent[i] = n.cross(&outward);
            }
            pieces.height[i] = along * per_height;
            pieces.height_gradient[i] = n * per_height;
        }
        pieces
    }

    /// The certificate: a lower bound of `f` from any `w`. The deviation of `Σ w_i` from zero is subtracted from the largest term, where it
    /// changes the bound least.
    pub(crate) fn lower_bound(&self, mut w: [Vector3<f64>; N]) -> f64 {
        let mut heights = [0.0; N];
        let (mut sum, mut largest) = (Vector3::zeros(), 0);
        for i in 0..N {
            heights[i] = self.support(i, &w[i]);
            sum += w[i];
            if heights[i] > heights[largest] {
                largest = i;
            }
        }
        w[largest] -= sum;
        heights[largest] = self.support(largest, &w[largest]);
        let (mut numerator, mut denominator) = (0.0, 0.0);
        for i in 0..N {
            numerator -= w[i].dot(&self.points[i]);
            denominator += heights[i];
        }
        if denominator > 0.0 {
            numerator / denominator
        } else {
            0.0
        }
    }

    fn support(&self, i: usize, w: &Vector3<f64>) -> f64 {
        support(w, &self.normals[i], self.half_height, self.radius)
    }
}

impl<const N: usize> Pieces<N> {
    /// Number of pieces.
    pub(crate) const COUNT: usize = N * PIECES_PER_CYLINDER;

    /// `g_j`.
    pub(crate) fn value(&self, j: usize) -> f64 {
        let i = j / PIECES_PER_CYLINDER;
        match j % PIECES_PER_CYLINDER {
            0 => self.tube[i],
            1 => self.height[i],
            _ => -self.height[i],
        }
    }

    /// `∇g_j`.
    pub(crate) fn gradient(&self, j: usize) -> Vector3<f64> {
        let i = j / PIECES_PER_CYLINDER;
        match j % PIECES_PER_CYLINDER {
            0 => self.tube_gradient[i],
            1 => self.height_gradient[i],
            _ => -self.height_gradient[i],
        }
    }

    /// `max_j g_j(y)`, an upper bound of `f`.
    pub(crate) fn max(&self) -> f64 {
        let larger = |max: f64, i: usize| max.max(self.tube[i]).max(self.height[i].abs());
        (0..N).fold(0.0, larger)
    }

    /// `w_i = Σ λ_j ∇g_j` over the pieces `j` of cylinder `i`.
    pub(crate) fn forces(&self, multipliers: &[f64; MAX_PIECES]) -> [Vector3<f64>; N] {
        std::array::from_fn(|i| {
            let base = PIECES_PER_CYLINDER * i;
            self.tube_gradient[i] * multipliers[base]
                + self.height_gradient[i] * (multipliers[base + 1] - multipliers[base + 2])
        })
    }

    /// Hessian of the Lagrangian, `Σ λ_tube·bend·c cᵀ`: exact, since slabs are flat.
    pub(crate) fn hessian(&self, multipliers: &[f64; MAX_PIECES]) -> Matrix3<f64> {
        let mut hessian = Matrix3::zeros();
        for i in 0..N {
            let weight = multipliers[PIECES_PER_CYLINDER * i] * self.bend[i];
            hessian += self.tangent[i] * (self.tangent[i] * weight).transpose();
        }
        hessian
    }

    /// The piece with the largest predicted value after a step, among those that `skip` does not contain, if it is above `level`.
    pub(crate) fn most_violated(
        &self,
        step: &Vector3<f64>,
        level: f64,
        skip: impl Fn(usize) -> bool,
    ) -> Option<usize> {
        let mut found = (None, level);
        for i in 0..N {
            let tube = self.tube[i] + self.tube_gradient[i].dot(step);
            let height = self.height[i] + self.height_gradient[i].dot(step);
            for (kind, value) in [tube, height, -height].into_iter().enumerate() {
                let j = PIECES_PER_CYLINDER * i + kind;
                if value > found.1 && !skip(j) {
                    found = (Some(j), value);
                }
            }
        }
        found.0
    }
}
