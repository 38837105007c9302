//! What the uncertainty of rotations adds to that of positions.
//!
//! ```text
//! ω ~ N(0, T⁻¹)      T = diag(λ) + Σ_e (1/τ²)(e_i − e_j)(e_i − e_j)ᵀ      λ_i: how well the data around i tell its turn
//! δx = S⁻¹ Σ_e w_e (e_i − e_j) ½(ω_i + ω_j) × R E_e                     what a turn of the rest edges does to the estimate
//! P  = S⁻¹ + cov δx
//! ```
//!
//! `S⁻¹` takes the rotations of the shape prior for given. Where a part is hidden they are spread from what is seen and fitted to the estimate itself, and an
//! error of a turn grows with its lever: a hidden end may be wrong by many of the standard deviations that `S⁻¹` gives it. The covariance of `δx` has no sparse
//! form; it is estimated from draws whose right-hand sides have the covariance `T`, all solved at once (as the diagonal of a matrix is by probing:
//! Bekas, Kokiopoulou and Saad 2007, doi 10.1016/j.apnum.2007.01.003).

use nalgebra::Vector3;

use crate::filter::Filter;
use crate::options::Motion;
use crate::{Error, columns};

/// Draws, of three columns each: the variance of a coordinate is a mean of 48 squares, and smooth over neighbours.
const DRAWS: usize = 16;
/// Frames whose errors of the turns add up before the shape prior has taken them back; each leaves neighbours
/// [`Options::bend_sigma`](crate::Options::bend_sigma) apart. Calibrated on sheets that are lifted and folded (test `motions`); what is closed or braced is known
/// better than this says.
const FRAMES: f64 = 4.0;

impl Filter {
    /// Variance of each coordinate of every vertex that the uncertainty of the rotations adds; none if nothing turns.
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

    /// `λ`: information on the turn of each vertex from the edges around it whose ends were measured, 1/rad².
    fn turn_information(&self) -> Vec<f64> {
        // One unit (1 rad) keeps components without any data solvable.
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

    /// Right-hand sides with covariance `T`: a sign for each vertex and each edge.
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

/// Signs without pattern, the same in every run (SplitMix64: Steele, Lea and Flood 2014).
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
