//! Path-following on the logarithmic barrier: slower than the active-set method, but it always converges.
//!
//! ```text
//! F_t(y, s) = t·s − Σ_i [ ln(sH − a_i) + ln(sH + a_i) + ln(s²r² − ρ_i²) ],   a_i = n_i·(y − p_i),  ρ_i = ‖P_i(y − p_i)‖
//! ```
//!
//! `F_t` is self-concordant with parameter `4k`, so a Newton step damped by `1/(1 + decrement)` never leaves the domain, and the centre
//! for `t` is within `4k/t` of the minimum (Nesterov and Nemirovskii 1994, ch. 2). At a centre the gradients of the barrier terms are the multipliers of
//! the certificate.

use crate::problem::{Bracket, Goal, MAX_PIECES, PIECES_PER_CYLINDER, Problem};
use nalgebra::{Matrix4, Vector3, Vector4};

/// Growth of `t` between centres.
const GROWTH: f64 = 8.0;
/// Newton decrement below which the multipliers at a centre are accurate enough.
const CENTRED: f64 = 0.1;
/// Largest number of Newton steps per centre; self-concordance needs fewer than twenty from the previous centre.
const MAX_NEWTON: usize = 40;

/// State of the path: `y`, `s` and the weight `t`.
pub(crate) struct Path {
    y: Vector3<f64>,
    s: f64,
    t: f64,
}

impl Path {
    /// Starts at the centroid, strictly inside.
    pub(crate) fn new<const N: usize>(problem: &Problem<N>) -> Self {
        let y = Vector3::zeros();
        let s = 2.0 * problem.pieces(&y).max();
        Self { y, s, t: 1.0 / s }
    }

    /// Follows the path until the gap of the centre is below `gap·s` (or rounding stops it), improving `bracket`;
    /// returns the multipliers of the pieces there.
    pub(crate) fn follow<const N: usize>(
        &mut self,
        problem: &Problem<N>,
        bracket: &mut Bracket,
        gap: f64,
        goal: &Goal,
    ) -> [f64; MAX_PIECES] {
        let parameter = 4.0 * N as f64;
        while parameter / self.t > gap * self.s {
            self.t *= GROWTH;
            let centred = self.centre(problem);
            let (forces, _) = self.read(problem);
            bracket.improve_lower(problem.lower_bound(forces));
            bracket.improve_upper(problem.pieces(&self.y).max(), &self.y);
            if !centred || bracket.lower > goal.cutoff || bracket.upper <= goal.enough {
                break;
            }
        }
        self.read(problem).1
    }

    /// Damped Newton steps to the centre for the present `t`; false if rounding stops them early.
    fn centre<const N: usize>(&mut self, problem: &Problem<N>) -> bool {
        for _ in 0..MAX_NEWTON {
            let (gradient, hessian) = self.derivatives(problem);
            let Some(cholesky) = hessian.cholesky() else {
                return false;
            };
            let step = -cholesky.solve(&gradient);
            let decrement = (-step.dot(&gradient)).max(0.0).sqrt();
            let damping = if decrement > 0.25 {
                1.0 / (1.0 + decrement)
            } else {
                1.0
            };
            let (y, s) = (self.y + step.xyz() * damping, self.s + step.w * damping);
            let inside = problem.pieces(&y).max() < s;
            if !inside {
                return false;
            }
            (self.y, self.s) = (y, s);
            if decrement < CENTRED {
                return true;
            }
        }
        false
    }

    fn derivatives<const N: usize>(&self, problem: &Problem<N>) -> (Vector4<f64>, Matrix4<f64>) {
        let (half, radius, s) = (problem.half_height, problem.radius, self.s);
        let mut gradient = Vector4::new(0.0, 0.0, 0.0, self.t);
        let mut hessian = Matrix4::zeros();
        for i in 0..N {
            let n = &problem.normals[i];
            let d = self.y - problem.points[i];
            let along = n.dot(&d);
            let across = d - n * along;
            for sign in [1.0, -1.0] {
                let slack = s * half - sign * along;
                let row = (n * -sign).push(half) / slack;
                gradient -= row;
                hessian += row * row.transpose();
            }
            let slack = s * s * radius * radius - across.norm_squared();
            let row = (across * -2.0).push(2.0 * s * radius * radius) / slack;
            gradient -= row;
            hessian += row * row.transpose();
            let curvature = 2.0 / slack;
            let projector = nalgebra::Matrix3::identity() - n * n.transpose();
            let mut block = hessian.fixed_view_mut::<3, 3>(0, 0);
            block += projector * curvature;
            hessian[(3, 3)] -= curvature * radius * radius;
        }
        (gradient, hessian)
    }

    /// Forces `w_i` for the certificate and the multiplier of every piece.
    fn read<const N: usize>(&self, problem: &Problem<N>) -> ([Vector3<f64>; N], [f64; MAX_PIECES]) {
        let (half, radius, s) = (problem.half_height, problem.radius, self.s);
        let mut forces = [Vector3::zeros(); N];
        let mut multipliers = [0.0; MAX_PIECES];
        for i in 0..N {
            let n = &problem.normals[i];
            let d = self.y - problem.points[i];
            let along = n.dot(&d);
            let across = d - n * along;
            let tube = 2.0 / (self.t * (s * s * radius * radius - across.norm_squared()));
            let upper = 1.0 / (self.t * (s * half - along));
            let lower = 1.0 / (self.t * (s * half + along));
            forces[i] = across * tube + n * (upper - lower);
            let base = PIECES_PER_CYLINDER * i;
            multipliers[base] = tube * across.norm() * radius;
            multipliers[base + 1] = upper * half;
            multipliers[base + 2] = lower * half;
        }
        (forces, multipliers)
    }
}
