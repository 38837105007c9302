//! The convex problem behind a filtration value, as its solvers see it.
//!
//! ```text
//! f = min_y max_j g_j(y)       pieces j: the tube ‖P_i(y − p_i)‖/r and the two slabs ±n_i·(y − p_i)/H of every cylinder i
//! L(w) = −Σ w_i·p_i / Σ h_i(w_i) ≤ f   for any w_1 … w_k with Σ w_i = 0
//! ```
//!
//! The right-hand side is weak duality with the support functions `h_i`, so a lower bound needs no trust in any solver.
//! Coordinates are centred and divided by the size of the simplex, and the cylinder by its larger half-width, so that every
//! tolerance of the solvers is a pure number.

use crate::cylinder::support;
use nalgebra::{Matrix3, Vector3};

/// Largest simplex: Helly's number in space.
pub(crate) const MAX_CYLINDERS: usize = 4;
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

/// Two to four cylinders in normalised coordinates.
pub(crate) struct Problem {
    pub(crate) count: usize,
    pub(crate) points: [Vector3<f64>; MAX_CYLINDERS],
    pub(crate) normals: [Vector3<f64>; MAX_CYLINDERS],
    pub(crate) half_height: f64,
    pub(crate) radius: f64,
}

/// Values, gradients and curvatures of all pieces at one `y`.
pub(crate) struct Pieces {
    pub(crate) count: usize,
    pub(crate) value: [f64; MAX_PIECES],
    pub(crate) gradient: [Vector3<f64>; MAX_PIECES],
    /// Hessian of the tube of cylinder `i` is `bend·c cᵀ` with `c` the unit tangent of its circles.
    bend: [f64; MAX_CYLINDERS],
    tangent: [Vector3<f64>; MAX_CYLINDERS],
}

/// Best upper and lower bound so far, and where the upper one is attained.
pub(crate) struct Bracket {
    pub(crate) lower: f64,
    pub(crate) upper: f64,
    pub(crate) y: Vector3<f64>,
}

impl Bracket {
    /// True once nothing more can be learnt: the gap is closed, or the value is above `cutoff` for certain.
    pub(crate) fn settled(&self, tolerance: f64, cutoff: f64) -> bool {
        self.upper - self.lower <= tolerance * self.upper || self.lower > cutoff
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

impl Problem {
    /// All pieces at `y`.
    pub(crate) fn pieces(&self, y: &Vector3<f64>) -> Pieces {
        let zero = Vector3::zeros();
        let mut pieces = Pieces {
            count: self.count * PIECES_PER_CYLINDER,
            value: [0.0; MAX_PIECES],
            gradient: [zero; MAX_PIECES],
            bend: [0.0; MAX_CYLINDERS],
            tangent: [zero; MAX_CYLINDERS],
        };
        let (per_height, per_radius) = (1.0 / self.half_height, 1.0 / self.radius);
        for i in 0..self.count {
            let (n, d) = (&self.normals[i], y - self.points[i]);
            let along = n.dot(&d);
            let across = d - n * along;
            let distance = across.norm();
            let base = PIECES_PER_CYLINDER * i;
            pieces.value[base] = distance * per_radius;
            // On the axis the tube is at its minimum, 0, and can only be active if everything is 0.
            if distance > f64::MIN_POSITIVE {
                let outward = across / distance;
                pieces.gradient[base] = outward * per_radius;
                pieces.bend[i] = per_radius / distance;
                pieces.tangent[i] = n.cross(&outward);
            }
            pieces.value[base + 1] = along * per_height;
            pieces.gradient[base + 1] = n * per_height;
            pieces.value[base + 2] = -along * per_height;
            pieces.gradient[base + 2] = n * -per_height;
        }
        pieces
    }

    /// The certificate: a lower bound of `f` from any `w`. What `Σ w_i` misses of zero goes to the largest term, where it
    /// changes the bound least.
    pub(crate) fn lower_bound(&self, mut w: [Vector3<f64>; MAX_CYLINDERS]) -> f64 {
        let mut heights = [0.0; MAX_CYLINDERS];
        let (mut sum, mut largest) = (Vector3::zeros(), 0);
        for i in 0..self.count {
            heights[i] = self.support(i, &w[i]);
            sum += w[i];
            if heights[i] > heights[largest] {
                largest = i;
            }
        }
        w[largest] -= sum;
        heights[largest] = self.support(largest, &w[largest]);
        let (mut numerator, mut denominator) = (0.0, 0.0);
        for i in 0..self.count {
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

impl Pieces {
    /// `max_j g_j(y)`, an upper bound of `f`.
    pub(crate) fn max(&self) -> f64 {
        self.value[..self.count].iter().copied().fold(0.0, f64::max)
    }

    /// `w_i = Σ λ_j ∇g_j` over the pieces `j` of cylinder `i`.
    pub(crate) fn forces(&self, multipliers: &[f64; MAX_PIECES]) -> [Vector3<f64>; MAX_CYLINDERS] {
        let mut w = [Vector3::zeros(); MAX_CYLINDERS];
        for j in 0..self.count {
            if multipliers[j] != 0.0 {
                w[j / PIECES_PER_CYLINDER] += self.gradient[j] * multipliers[j];
            }
        }
        w
    }

    /// Hessian of the Lagrangian, `Σ λ_tube·bend·c cᵀ`: exact, since slabs are flat.
    pub(crate) fn hessian(&self, multipliers: &[f64; MAX_PIECES]) -> Matrix3<f64> {
        let mut hessian = Matrix3::zeros();
        for i in 0..self.count / PIECES_PER_CYLINDER {
            let weight = multipliers[PIECES_PER_CYLINDER * i] * self.bend[i];
            if weight != 0.0 {
                hessian += self.tangent[i] * (self.tangent[i] * weight).transpose();
            }
        }
        hessian
    }
}
