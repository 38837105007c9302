//! Rigid motions along which the matched surface slides on the target.
//!
//! ```text
//! J(n)    = (n, (y − c) × n / L)                  how fast a match with normal n opens under a rigid motion (shift, turn · L)
//! I       = Σ w J(n̄) J(n̄)ᵀ                       n̄ = (n_s + n_t)/2, the normals of source and target
//! I₀      = Σ w J(d) J(d)ᵀ                       d = (n_s − n_t)/2, what noise makes of the normals
//! free    v with  vᵀ I v ≤ ratio · vᵀ (I₀ + bias · λ_max(I)) v
//! ```
//!
//! On a plane, a sphere or a cylinder `I` has a null space (slippable motions: Gelfand and Guibas 2004, doi 10.2312/SGP/SGP04/219-228), but only if the
//! normals are exact. The mean and half the difference of two independent normals have the same noise, and the surface itself appears only in the
//! mean; so `I₀` is what `I` would be along a free motion, for every direction and without a parameter.

use nalgebra::{Matrix3, Matrix6, Point3, SymmetricEigen, Vector3, Vector6};

/// A motion is free up to this resistance, in multiples of that of noise.
const RATIO: f64 = 4.0;
/// Squared noise that both normals share: estimated beside the same boundary, both are off by the same degree or two.
const BIAS: f64 = 3e-4;
/// Weight of a held point relative to that of all matches, in all directions.
const HELD: f64 = 0.1;

/// Resistance of the matches to rigid motions about their centre, and the motions with next to none.
pub(crate) struct Slippage {
    centre: Vector3<f64>,
    extent: f64,
    count: f64,
    information: Matrix6<f64>,
    noise: Matrix6<f64>,
    /// Orthonormal motions (shift, then rotation times extent) and their resistance in multiples of that of noise, smallest first.
    motions: Vec<(Vector6<f64>, f64)>,
}

impl Slippage {
    /// Without matches and held points yet, for those at `points`.
    pub fn around(points: &[Point3<f64>]) -> Self {
        let count = points.len().max(1) as f64;
        let centre = points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / count;
        let squares: f64 = points
            .iter()
            .map(|p| (p.coords - centre).norm_squared())
            .sum();
        Self {
            centre,
            // A single place has no extent to rotate about.
            extent: Some((squares / count).sqrt())
                .filter(|extent| *extent > 0.0)
                .unwrap_or(1.0),
            count,
            information: Matrix6::zeros(),
            noise: Matrix6::zeros(),
            motions: Vec::new(),
        }
    }

    pub fn add_match(&mut self, p: &Point3<f64>, n: &Vector3<f64>, m: &Vector3<f64>, weight: f64) {
        let mean = self.row(p, &(0.5 * (n + m)));
        let difference = self.row(p, &(0.5 * (n - m)));
        self.information += mean * mean.transpose() * weight;
        self.noise += difference * difference.transpose() * weight;
    }

    pub fn add_held(&mut self, p: &Point3<f64>) {
        for n in [Vector3::x(), Vector3::y(), Vector3::z()] {
            let row = self.row(p, &n);
            self.information += row * row.transpose() * (HELD * self.count);
        }
    }

    /// Finds the motions by their resistance: the generalised eigenvectors of `I` and `I₀`.
    pub fn solve(&mut self) {
        let largest = self.information.symmetric_eigenvalues().max();
        let floor = self.noise + Matrix6::identity() * (BIAS * largest).max(f64::MIN_POSITIVE);
        let Some(cholesky) = floor.cholesky() else {
            return;
        };
        let half = cholesky.l().solve_lower_triangular(&self.information);
        let whole = half.and_then(|half| cholesky.l().solve_lower_triangular(&half.transpose()));
        let Some(whole) = whole else { return };
        let eigen = SymmetricEigen::new(0.5 * (whole + whole.transpose()));
        let mut ascending: Vec<usize> = (0..6).collect();
        ascending.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
        for k in ascending {
            let whitened = eigen.eigenvectors.column(k).into_owned();
            let motion = cholesky.l().tr_solve_lower_triangular(&whitened);
            let others = &self.motions;
            let rest = |m: Vector6<f64>| others.iter().fold(m, |m, (v, _)| m - v * v.dot(&m));
            if let Some(v) = motion.map(rest).and_then(|m| m.try_normalize(1e-12)) {
                self.motions.push((v, eigen.eigenvalues[k]));
            }
        }
    }

    /// Number of free motions.
    pub fn free(&self) -> usize {
        self.motions
            .iter()
            .filter(|(_, ratio)| *ratio <= RATIO)
            .count()
    }

    /// How far the free motions may move a point, 0 to 1: 1 where a free one moves it as far as a shift would, 0 where none does or all are resisted; a motion
    /// that is resisted by `k` times as much as a free one has the weight `1/k`.
    pub fn doubt(&self, p: &Point3<f64>) -> f64 {
        let arm = (p.coords - self.centre) / self.extent;
        let moved = |(v, ratio): &(Vector6<f64>, f64)| {
            let u = v.fixed_rows::<3>(0) + v.fixed_rows::<3>(3).cross(&arm);
            u * u.transpose() * (RATIO / ratio.max(RATIO)).powi(2)
        };
        let moves: Matrix3<f64> = self.motions.iter().map(moved).sum();
        let farthest = moves.symmetric_eigenvalues().max();
        // The distance of a node may overflow; a rotation moves it without limit.
        if farthest.is_finite() {
            farthest.clamp(0.0, 1.0).sqrt()
        } else {
            1.0
        }
    }

    fn row(&self, p: &Point3<f64>, n: &Vector3<f64>) -> Vector6<f64> {
        let arm = (p.coords - self.centre).cross(n) / self.extent;
        Vector6::new(n.x, n.y, n.z, arm.x, arm.y, arm.z)
    }
}
