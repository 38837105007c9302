//! Plausibility of a frame: how far the surface may have moved since the last accepted one.
//!
//! ```text
//! moved      min( 95 % of d(vertices measured last → cloud),  95 % of d(cloud → vertices) )
//! plausible  moved ≤ ξ · frames since,    ξ the largest motion in a frame, or the fall of a released body
//! ```

use super::Track;
use crate::canonical::graph;
use crate::reconstruct::view::FrameView;
use nalgebra::Point3;
use topo_ekf::body::{Embedding, Limits};

impl Track {
    /// The limits for this frame: each missed frame allows as much motion again.
    pub(super) fn limits_now(&self, limits: &Limits) -> Limits {
        let frames = (self.missed + 1) as f64;
        limits
            .with_motion(limits.motion * frames)
            .with_fall(limits.fall * frames)
    }

    /// Returns a message when the cloud shows more motion than is plausible.
    pub(super) fn gone_too_far(
        &self,
        view: &FrameView,
        grips: &[(Embedding, Point3<f64>)],
        limits: &Limits,
    ) -> Option<String> {
        let falls = grips.is_empty() && (self.is_held() || self.body.is_falling());
        let most = if falls { limits.fall } else { limits.motion };
        let gone = self.gone(view);
        (gone > most).then(|| {
            format!(
                "the surface moved by more than {:.1} mm, at most {:.1} mm can be followed",
                1e3 * gone,
                1e3 * most
            )
        })
    }

    /// A lower bound on the motion of the seen surface, metres: 95 % of the vertices measured last have a point of the cloud within it, or 95 % of
    /// the cloud has a vertex. The first fails where an arm hides surface, the second where it reveals surface; a motion affects both.
    fn gone(&self, view: &FrameView) -> f64 {
        let last_taken = self.frame.saturating_sub(self.missed as u32 + 1);
        let seen = self.model.live().iter().zip(self.model.last_seen());
        let left = seen
            .filter(|(_, last)| **last == last_taken)
            .map(|(p, _)| graph::nearest(&view.tree, p).1);
        let left = most_of(left.collect());
        let Some(live) = graph::tree(self.model.live()) else {
            return 0.0;
        };
        let reached = view.points.iter().map(|p| graph::nearest(&live, p).1);
        left.min(most_of(reached.collect()))
    }

    /// Rejects an implausible frame: the state from before it is kept.
    pub(super) fn refuse(&mut self, why: String) {
        self.refused = Some(why);
        self.missed += 1;
        self.seen.fill(false);
        self.landmarks.lose();
        self.still = 0;
        self.frame += 1;
    }
}

/// The 95th percentile of the values; 0 if there are none.
fn most_of(mut values: Vec<f64>) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    let at = values.len() * 95 / 100;
    values.get(at).copied().unwrap_or(0.0)
}
