//! What is believed of a frame: how far the surface may have gone since the last one that was taken.
//!
//! ```text
//! gone      min( 95 % of d(vertices measured last → cloud),  95 % of d(cloud → vertices) )
//! believed  gone ≤ ξ · frames since,     ξ the motion a frame, or the fall of a body that was let go
//! ```

use super::Track;
use crate::canonical::graph;
use crate::reconstruct::view::FrameView;
use nalgebra::Point3;
use topo_ekf::body::{Embedding, Limits};

impl Track {
    /// What is believed of this frame: what was not followed for some frames may have gone as much farther.
    pub(super) fn limits_now(&self, limits: &Limits) -> Limits {
        let frames = (self.missed + 1) as f64;
        limits
            .with_motion(limits.motion * frames)
            .with_fall(limits.fall * frames)
    }

    /// Says so when the cloud shows more motion than is believed.
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

    /// A lower bound on how far the seen surface moved, metres: 95 % of what was measured last has a point of the cloud this near, or 95 % of
    /// the cloud has a vertex. What an arm hides spoils the first, what it shows again the second, what moves both.
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

    /// A frame that is not believed: everything stays as it was before it.
    pub(super) fn refuse(&mut self, why: String) {
        self.refused = Some(why);
        self.missed += 1;
        self.seen.fill(false);
        self.landmarks.lose();
        self.still = 0;
        self.frame += 1;
    }
}

/// What 95 % of the values do not exceed; 0 of none.
fn most_of(mut values: Vec<f64>) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    let at = values.len() * 95 / 100;
    values.get(at).copied().unwrap_or(0.0)
}
