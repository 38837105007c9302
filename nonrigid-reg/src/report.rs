//! The result of a registration and its confidence.
//!
//! ```text
//! trust of a point       w_p exp(−(ρ / 3σ)²);  0 without a match, or with a boundary point
//! confidence of a node   (1 − doubt) Σ_p φ⁺ trust / Σ_p φ⁺;  1 at an exact landmark;  doubt: see `slippage`
//! confidence of a point  Σ_k φ⁺ confidence_k / Σ_k φ⁺
//! ```
//!
//! A hidden point between visible ones thus has more confidence than one far behind the boundary, and a point that free rigid motions move has none. That a
//! part slides along itself, while the rest holds the body, is not detected.

use nalgebra::{Matrix3, Point3, Vector3};

use crate::frame::{Frame, Match, State};
use crate::registration::{Registration, Residuals, Status};
use crate::slippage::Slippage;
use crate::traits::Residual;

/// Largest squared ratio of width to length of what counts as a line.
const THIN: f64 = 1e-4;

impl Frame<'_> {
    pub fn report(
        &self,
        state: State,
        matches: &[Option<Match>],
        residual: &impl Residual,
        iterations: usize,
        ended: Status,
    ) -> Registration {
        // Matches with boundary points do not support the motion of their points.
        let inner: Vec<Option<&Match>> = matches
            .iter()
            .map(|m| m.as_ref().filter(|(pair, _)| !pair.on_boundary))
            .collect();
        let size = |(pair, _): &Match| residual.linearise(pair).residual.norm();
        let trust: Vec<f64> = inner
            .iter()
            // A residual of three sigma of a point is the scale at which trust ends.
            .map(|m| {
                m.map_or(0.0, |m| {
                    m.1 * (-(size(m) / (3.0 * self.options.point_sigma)).powi(2)).exp()
                })
            })
            .collect();
        let slippage = self.slippage(&inner);
        // A source that is a line at rest may rotate about itself, however it is bent by now.
        let rolls = !self.predicted && self.is_line(&inner);
        let free_motions = slippage.free().max(usize::from(rolls));
        let node_confidence = self.node_confidence(&trust, &slippage);
        let shapes = self.model.shapes.iter();
        let confidence = shapes
            .map(|shape| positive_mean(shape, |k| node_confidence[k]))
            .collect();
        let fits: Vec<(f64, f64)> = inner.iter().flatten().map(|m| (size(m), m.1)).collect();
        let residuals = Residuals::new(fits);
        let overlap = residuals.count as f64 / self.source.points.len() as f64;
        Registration {
            node_positions: self.model.nodes.positions.clone(),
            node_confidence,
            displacements: self.model.displacements(&state.u),
            confidence,
            feature_confidence: self.feature_confidence(&state.u),
            matches: inner
                .iter()
                .map(|m| m.map(|(pair, _)| pair.target as u32))
                .collect(),
            residuals,
            overlap,
            iterations,
            status: self.judge(ended, overlap, residuals.rms, free_motions),
            node_displacements: state.u,
        }
    }

    fn judge(&self, ended: Status, overlap: f64, residual: f64, free_motions: usize) -> Status {
        let options = self.options;
        if overlap < options.min_overlap {
            let threshold = options.min_overlap;
            return Status::LowOverlap { overlap, threshold };
        }
        if residual > options.max_residual {
            let threshold = options.max_residual;
            return Status::HighResidual {
                residual,
                threshold,
            };
        }
        match free_motions {
            0 => ended,
            free_motions => Status::Undetermined { free_motions },
        }
    }

    /// Rigid motions that neither matches, landmarks, features nor a prediction determine.
    fn slippage(&self, matches: &[Option<&Match>]) -> Slippage {
        let matched = || {
            matches
                .iter()
                .flatten()
                .map(|(pair, weight)| (pair, *weight))
        };
        let landmarks = self.landmarks.iter().map(|l| l.source);
        let held: Vec<Point3<f64>> = landmarks
            .chain(self.features.iter().map(|f| f.source))
            .collect();
        let points: Vec<Point3<f64>> = matched()
            .map(|(pair, _)| pair.point)
            .chain(held.iter().copied())
            .collect();
        let mut slippage = Slippage::around(&points);
        if self.predicted {
            return slippage;
        }
        for (pair, weight) in matched() {
            slippage.add_match(&pair.point, &pair.normal, &pair.probe.normal, weight);
        }
        for p in &held {
            slippage.add_held(p);
        }
        slippage.solve();
        slippage
    }

    /// Whether all data on the source at rest (matches, landmarks and features) lie within a hundredth of its length of a line.
    fn is_line(&self, matches: &[Option<&Match>]) -> bool {
        let matched = self.source.points.iter().zip(matches);
        let matched = matched.filter_map(|(p, m)| m.map(|_| p.coords));
        let landmarks = self.landmarks.iter().map(|l| l.source.coords);
        let features = self.features.iter().map(|f| f.source.coords);
        let points: Vec<Vector3<f64>> = matched.chain(landmarks).chain(features).collect();
        let centre = points.iter().sum::<Vector3<f64>>() / points.len().max(1) as f64;
        let spread = |p: &Vector3<f64>| (p - centre) * (p - centre).transpose();
        let scatter: Matrix3<f64> = points.iter().map(spread).sum();
        let mut widths: [f64; 3] = scatter.symmetric_eigenvalues().into();
        widths.sort_by(f64::total_cmp);
        widths[1] <= THIN * widths[2]
    }

    /// Mean trust of the points that a node influences, less the doubt of free motions; exact landmarks are trusted.
    fn node_confidence(&self, trust: &[f64], slippage: &Slippage) -> Vec<f64> {
        let mut sums = vec![(0.0, 0.0); self.model.nodes.len()];
        for (shape, t) in self.model.shapes.iter().zip(trust) {
            for &(k, phi) in shape {
                sums[k].0 += phi.max(0.0) * t;
                sums[k].1 += phi.max(0.0);
            }
        }
        let mut confidence: Vec<f64> = sums
            .iter()
            .map(|(sum, w)| if *w > 0.0 { sum / w } else { 0.0 })
            .zip(&self.model.nodes.positions)
            .map(|(mean, p)| mean * (1.0 - slippage.doubt(p)))
            .collect();
        for (landmark, &node) in self.landmarks.iter().zip(&self.model.nodes.of_landmark) {
            if landmark.sigma <= self.options.point_sigma {
                confidence[node] = 1.0;
            }
        }
        confidence
    }
}

impl Residuals {
    /// Statistics of residuals with their weights.
    fn new(mut fits: Vec<(f64, f64)>) -> Self {
        let weight: f64 = fits.iter().map(|f| f.1).sum();
        let squares: f64 = fits.iter().map(|f| f.1 * f.0 * f.0).sum();
        fits.sort_by(|a, b| a.0.total_cmp(&b.0));
        let rank = |share: usize| fits.get(fits.len() * share / 100).map_or(0.0, |f| f.0);
        Self {
            count: fits.len(),
            rms: if weight > 0.0 {
                (squares / weight).sqrt()
            } else {
                0.0
            },
            median: rank(50),
            p95: rank(95),
            largest: fits.last().map_or(0.0, |f| f.0),
        }
    }
}

/// Mean of a node value over the nodes that influence a point, without negative weights.
fn positive_mean(shape: &[(usize, f64)], value: impl Fn(usize) -> f64) -> f64 {
    let total: f64 = shape.iter().map(|(_, phi)| phi.max(0.0)).sum();
    let sum: f64 = shape.iter().map(|&(k, phi)| phi.max(0.0) * value(k)).sum();
    if total > 0.0 { sum / total } else { 0.0 }
}
