//! Matches colour features with those of the previous frame, with a confidence for each match.
//!
//! ```text
//! pairs        mutually best features within the largest plausible motion                              dvrk_io::features
//! confidence   from a registration of the two clouds that uses the pairs: how well each agrees      nonrigid_reg
//!              with the motion found from clouds and pairs together
//! ```
//! Both hypotheses of the body use the same matches.

use super::view::FrameView;
use dvrk_io::features::{Feature, FeatureOptions, match_features};
use nalgebra::Point3;
use nonrigid_reg::{Cloud, Options, Status};
use std::sync::Arc;

/// Confidence below which a pair is dropped.
const BELIEVED: f64 = 0.3;
/// Fewest pairs for which a registration is computed.
const FEWEST: usize = 6;

/// The data of the last frame that the next one needs.
#[derive(serde::Serialize, serde::Deserialize)]
pub(super) struct Before {
    pub view: Arc<FrameView>,
    pub features: Vec<Feature>,
}

/// The features of a frame, and their matches with the previous one.
pub(super) struct Recognised {
    /// Position of the camera.
    pub eye: Point3<f64>,
    pub features: Vec<Feature>,
    /// For each feature of the previous frame: its index in this one, and the confidence of the match.
    pub from: Vec<Option<(usize, f64)>>,
}

impl Recognised {
    /// A frame without a predecessor.
    pub fn first(view: &FrameView, features: &[Feature]) -> Self {
        Self {
            eye: view.eye(),
            features: features.to_vec(),
            from: Vec::new(),
        }
    }

    /// A frame after another; `motion` is the largest motion of a feature, metres.
    pub fn after(
        before: &Before,
        view: &FrameView,
        features: &[Feature],
        motion: f64,
        spacing: f64,
    ) -> Self {
        let options = FeatureOptions::default().with_motion(motion);
        let pairs = match_features(&before.features, features, &options);
        let mut from = vec![None; before.features.len()];
        let places: Vec<_> = pairs
            .iter()
            .map(|m| nonrigid_reg::Feature {
                source: before.features[m.a].point,
                target: features[m.b].point,
            })
            .collect();
        let confidence = confidence(&before.view, view, &places, spacing);
        for (pair, confidence) in pairs.iter().zip(confidence.unwrap_or_default()) {
            from[pair.a] = (confidence >= BELIEVED).then_some((pair.b, confidence));
        }
        Self {
            eye: view.eye(),
            features: features.to_vec(),
            from,
        }
    }
}

/// How well each pair agrees with the motion from one view to the other; `None` when no such motion is found.
fn confidence(
    before: &FrameView,
    now: &FrameView,
    pairs: &[nonrigid_reg::Feature],
    spacing: f64,
) -> Option<Vec<f64>> {
    if pairs.len() < FEWEST {
        return None;
    }
    let thinned = |view: &FrameView| {
        nonrigid_reg::voxel_downsample(&view.points, &view.normals, spacing).ok()
    };
    let (source, target) = (thinned(before)?, thinned(now)?);
    let registered = nonrigid_reg::register(
        &Cloud {
            points: &source.points,
            normals: &source.normals,
        },
        &Cloud {
            points: &target.points,
            normals: &target.normals,
        },
        &[],
        pairs,
        &Options::default(),
    )
    .ok()?;
    let poor = matches!(
        registered.status,
        Status::LowOverlap { .. } | Status::HighResidual { .. }
    );
    (!poor).then_some(registered.feature_confidence)
}
