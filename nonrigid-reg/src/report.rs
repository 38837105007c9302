//! What came out, and how far to believe it.
//!
//! ```text
//! trust of a point       w_p exp(−(ρ / 3σ)²);  0 without a match, or with the rim of the target
//! confidence of a node   Σ_p φ⁺ trust / Σ_p φ⁺;  1 at an exact landmark
//! confidence of a point  Σ_k φ⁺ confidence_k / Σ_k φ⁺
//! ```
//!
//! A hidden point between seen ones is so believed more than one far behind the rim. Sliding along a smooth surface is
//! invisible to matches, and so to this.

use nalgebra::{Matrix3, Vector3};

use crate::frame::{Frame, blend};
use crate::matching::Matcher;
use crate::options::Options;
use crate::registration::{Registration, Status};

impl Frame<'_> {
    pub fn report(
        self,
        u: Vec<Vector3<f64>>,
        rotations: &[Matrix3<f64>],
        matcher: &mut Matcher,
        iterations: usize,
        ended: Status,
    ) -> Registration {
        let gate = self.options.gate(usize::MAX);
        let matches = self.find_matches(&u, rotations, gate, matcher);
        let displacements: Vec<Vector3<f64>> =
            self.shapes.iter().map(|shape| blend(shape, &u)).collect();
        let mut fit = Fit::default();
        let trust: Vec<f64> = matches
            .iter()
            .enumerate()
            .map(|(i, m)| {
                let Some(m) = m.filter(|m| !m.on_rim) else {
                    return 0.0;
                };
                let y = self.source.points[i] + displacements[i];
                let rho = matcher.normal(&m).dot(&(y - matcher.point(&m)));
                fit.add(m.weight, rho);
                // Three sigma of a point is the scale at which a match stops being one.
                m.weight * (-(rho / (3.0 * self.options.point_sigma)).powi(2)).exp()
            })
            .collect();
        let node_confidence = self.node_confidence(&trust);
        let confidence = self
            .shapes
            .iter()
            .map(|shape| positive_mean(shape, |k| node_confidence[k]))
            .collect();
        let overlap = fit.count / self.source.points.len() as f64;
        let residual_rms = fit.rms();
        Registration {
            node_positions: self.nodes.positions,
            node_displacements: u,
            node_confidence,
            displacements,
            confidence,
            matches: matches
                .iter()
                .map(|m| m.filter(|m| !m.on_rim).map(|m| m.target as u32))
                .collect(),
            residual_rms,
            overlap,
            iterations,
            status: judge(ended, overlap, residual_rms, self.options),
        }
    }

    /// Mean trust of the points that lean on a node; exact landmarks are trusted.
    fn node_confidence(&self, trust: &[f64]) -> Vec<f64> {
        let mut sums = vec![(0.0, 0.0); self.nodes.len()];
        for (shape, t) in self.shapes.iter().zip(trust) {
            for &(k, phi) in shape {
                sums[k].0 += phi.max(0.0) * t;
                sums[k].1 += phi.max(0.0);
            }
        }
        let mut confidence: Vec<f64> = sums
            .iter()
            .map(|(sum, w)| if *w > 0.0 { sum / w } else { 0.0 })
            .collect();
        for (landmark, &node) in self.landmarks.iter().zip(&self.nodes.of_landmark) {
            if landmark.sigma <= self.options.point_sigma {
                confidence[node] = 1.0;
            }
        }
        confidence
    }
}

/// Weighted residuals.
#[derive(Default)]
struct Fit {
    count: f64,
    weight: f64,
    squares: f64,
}

impl Fit {
    fn add(&mut self, weight: f64, rho: f64) {
        self.count += 1.0;
        self.weight += weight;
        self.squares += weight * rho * rho;
    }

    fn rms(&self) -> f64 {
        if self.weight > 0.0 {
            (self.squares / self.weight).sqrt()
        } else {
            0.0
        }
    }
}

fn judge(ended: Status, overlap: f64, residual: f64, options: &Options) -> Status {
    if overlap < options.min_overlap {
        let threshold = options.min_overlap;
        Status::LowOverlap { overlap, threshold }
    } else if residual > options.max_residual {
        let threshold = options.max_residual;
        Status::HighResidual {
            residual,
            threshold,
        }
    } else {
        ended
    }
}

/// Mean of a node value over the nodes a point leans on, negative parts left out.
fn positive_mean(shape: &[(usize, f64)], value: impl Fn(usize) -> f64) -> f64 {
    let total: f64 = shape.iter().map(|(_, phi)| phi.max(0.0)).sum();
    let sum: f64 = shape.iter().map(|&(k, phi)| phi.max(0.0) * value(k)).sum();
    if total > 0.0 { sum / total } else { 0.0 }
}
