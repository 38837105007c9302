//! The contribution of uncertain rotations to the variance of positions.
//!
//! ```text
//! ω ~ N(0, T⁻¹)      T = diag(λ) + Σ_e (1/τ²)(e_i − e_j)(e_i − e_j)ᵀ      λ_i: information of the data around i on its rotation
//! δx = S⁻¹ Σ_e w_e (e_i − e_j) ½(ω_i + ω_j) × R E_e                     effect of rotations of the rest edges on the estimate
//! P  = S⁻¹ + cov δx
//! ```
//!
//! `S⁻¹` treats the rotations of the shape prior as known. In hidden parts they are extrapolated from the seen ones and fitted to the estimate itself, and an
//! error of a rotation acts with a lever: a hidden end may be wrong by many of the standard deviations from `S⁻¹`. The covariance of `δx` has no sparse
//! form; it is estimated from random draws whose right-hand sides have the covariance `T`, all solved at once (similar to probing for the diagonal of a matrix:
//! Bekas, Kokiopoulou and Saad 2007, doi 10.1016/j.apnum.2007.01.003).

use nalgebra::Vector3;

use crate::filter::Filter;
use crate::options::Motion;
use crate::{Error, columns};

/// Number of draws, of three columns each: the variance of a coordinate is a mean of 48 squares, and smooth over neighbours.
const DRAWS: usize = 16;
/// Number of frames over which errors of the rotations accumulate before the shape prior corrects them; in each, neighbours deviate by
/// [`Options::bend_sigma`](crate::Options::bend_sigma). Calibrated on sheets that are lifted and folded (test `motions`); for closed or braced bodies it
/// is conservative.
const FRAMES: f64 = 4.0;

impl Filter {
    /// The additional variance of each coordinate of every vertex due to uncertain rotations; zero with [`Motion::Still`].
    pub(crate) fn turn_variances(
        &self,
        values: &[f64],
        weights: &[f64],
    ) -> Result<Vec<f64>, Error> {
        let size = self.live.len();
        if self.options.motion == Motion::Still {
            return Ok(vec![0.0; size]);
        }
        let stiff = 1.0 / (FRAMES * self.options.bend_sigma.powi(2));
        let told = self.turn_information();
        let turn_values = self
            .system
            .pattern
            .assemble(&told, &self.graph.edges, |_| stiff);
        let mut turns = self.draws(&told, stiff);
        self.system.solve_once(&turn_values, &mut turns)?;

        let mut shifts = vec![0.0; turns.len()];
        for (turn, shift) in turns.chunks(3 * size).zip(shifts.chunks_mut(3 * size)) {
            let turn = columns::read(turn);
            for (e, &[i, j]) in self.graph.edges.iter().enumerate() {
                let (i, j) = (i as usize, j as usize);
                let rest = self.graph.vectors[e];
                let edge = (self.rotations[i] * rest + self.rotations[j] * rest) * 0.5;
                let force = (turn[i] + turn[j]).cross(&edge) * (0.5 * weights[e]);
                columns::add(shift, i, &force);
                columns::add(shift, j, &-force);
            }
        }
        self.system.solve_once(values, &mut shifts)?;
        let mut variances = vec![0.0; size];
        for column in shifts.chunks(size) {
            for (variance, shift) in variances.iter_mut().zip(column) {
                *variance += shift * shift / (3 * DRAWS) as f64;
            }
        }
        Ok(variances)
    }

    /// `λ`: information on the rotation of each vertex from the edges around it whose ends were measured, 1/rad².
    fn turn_information(&self) -> Vec<f64> {
        // A weight of one (1 rad) keeps components without any data solvable.
        let mut told = vec![1.0; self.live.len()];
        for (e, &[i, j]) in self.graph.edges.iter().enumerate() {
            let [a, b] = [i, j].map(|v| self.information[v as usize]);
            if a > 0.0 && b > 0.0 {
                let weight = a * b / (a + b);
                // A third of the trace of ‖E‖² I − E Eᵀ.
                let information = weight * self.graph.vectors[e].norm_squared() * 2.0 / 3.0;
                told[i as usize] += information;
                told[j as usize] += information;
            }
        }
        told
    }

    /// Right-hand sides with covariance `T`: a random sign for each vertex and each edge.
    fn draws(&self, told: &[f64], stiff: f64) -> Vec<f64> {
        let size = self.live.len();
        let mut signs = Signs(0);
        let mut draws = vec![0.0; 3 * size * DRAWS];
        for draw in draws.chunks_mut(3 * size) {
            for (i, told) in told.iter().enumerate() {
                columns::add(draw, i, &(signs.vector() * told.sqrt()));
            }
            for &[i, j] in &self.graph.edges {
                let pull = signs.vector() * stiff.sqrt();
                columns::add(draw, i as usize, &pull);
                columns::add(draw, j as usize, &-pull);
            }
        }
        draws
    }
}

/// Pseudo-random signs, the same in every run (SplitMix64: Steele, Lea and Flood 2014).
struct Signs(u64);

impl Signs {
    fn vector(&mut self) -> Vector3<f64> {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^= z >> 31;
        Vector3::from_fn(|axis, _| if z >> (40 + axis) & 1 == 0 { 1.0 } else { -1.0 })
    }
}
