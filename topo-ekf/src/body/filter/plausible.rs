//! The limits beyond which a frame is rejected.
//!
//! ```text
//! motion    95 % of the points of the surface move less than it; after a release, than the limit of a fall
//! pull      ‖grip force‖ / max(W, W₀/2),    W the weight, W₀ the weight assumed before anything was lifted
//! ```
//! A stiff body does not sag, so its weight is estimated as nearly zero, and the least error of its shape would be a force of any number of weights.

use nalgebra::Point3;

use super::BodyFilter;
use crate::Error;
use crate::body::frame::{BodyFrame, BodyReport, Limits};
use crate::body::lattice::Embedding;

/// Least weight in which the pull of the grips is judged, in weights assumed before anything was lifted.
const LIGHTEST: f64 = 0.5;

impl BodyFilter {
    /// Rejects a frame beyond its limits.
    pub(super) fn check_plausible(
        &self,
        before: &[Point3<f64>],
        released: bool,
        frame: &BodyFrame<'_>,
        report: &BodyReport,
    ) -> Result<(), Error> {
        let Limits { motion, fall, pull } = frame.limits;
        let motion = if released { fall } else { motion };
        let moved = |at: &Embedding| {
            let (lattice, live) = (&self.lattice, &self.state.pose.live);
            (lattice.warp(live, at) - lattice.warp(before, at)).norm()
        };
        let mut moves: Vec<f64> = frame.surface.iter().map(moved).collect();
        moves.sort_unstable_by(f64::total_cmp);
        let moved = moves.get(moves.len() * 95 / 100).copied().unwrap_or(0.0);
        let pulled = report.grip_force.norm() / self.assumed_weight().max(f64::MIN_POSITIVE);
        let told = [
            ("motion of the surface, m", moved, motion),
            ("pull of the grips in weights of the body", pulled, pull),
        ];
        let beyond = told.into_iter().find(|(_, value, limit)| value > limit);
        beyond.map_or(Ok(()), |(what, value, limit)| {
            Err(Error::Beyond { what, value, limit })
        })
    }

    /// The weight in which forces of grips are judged: the estimate, but at least half of what was assumed before anything was lifted.
    pub(super) fn assumed_weight(&self) -> f64 {
        self.weight_at(
            self.weight
                .value()
                .max(LIGHTEST * self.options.initial_weight),
        )
    }
}
