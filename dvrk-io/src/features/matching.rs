//! Matches the features of two frames.
//!
//! ```text
//! candidates   features within the bound on the motion
//! a ↔ b        mutually best among them, with few different bits, and clearly fewer than the second best
//! confidence   1 − d / d',     d different bits, d' those of the second best, limited to the largest number allowed
//! ```

use nalgebra::Point3;

use super::brief::BITS;
use super::lift::Feature;
use super::options::FeatureOptions;

/// A match between a feature of frame A and one of frame B.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FeatureMatch {
    /// Index in frame A.
    pub a: usize,
    /// Index in frame B.
    pub b: usize,
    /// Confidence of the match, above 0, at most 1.
    pub confidence: f64,
}

/// Corresponding points of a surface in two frames.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LandmarkPairs {
    /// Positions in frame A, camera frame, metres.
    pub a: Vec<Point3<f64>>,
    /// Positions in frame B.
    pub b: Vec<Point3<f64>>,
    /// Confidence of each pair, above 0, at most 1.
    pub confidence: Vec<f64>,
}

/// Matches the features of two frames; the result does not depend on the order of the features.
///
/// # Complexity
/// O(features of A · features of B).
pub fn match_features(a: &[Feature], b: &[Feature], options: &FeatureOptions) -> Vec<FeatureMatch> {
    let (to_b, to_a) = (best(a, b, options), best(b, a, options));
    let mutual = to_b.iter().enumerate().filter_map(|(i, found)| {
        let (j, confidence) = (*found)?;
        let (back, other) = to_a[j]?;
        (back == i).then_some(FeatureMatch {
            a: i,
            b: j,
            confidence: confidence.min(other),
        })
    });
    mutual.collect()
}

/// The landmarks that two frames share.
pub fn landmark_pairs(a: &[Feature], b: &[Feature], options: &FeatureOptions) -> LandmarkPairs {
    let matches = match_features(a, b, options);
    LandmarkPairs {
        a: matches.iter().map(|m| a[m.a].point).collect(),
        b: matches.iter().map(|m| b[m.b].point).collect(),
        confidence: matches.iter().map(|m| m.confidence).collect(),
    }
}

/// For each of `from` the best of `to`, if it is unambiguous, and its confidence.
fn best(from: &[Feature], to: &[Feature], options: &FeatureOptions) -> Vec<Option<(usize, f64)>> {
    let reach = options.motion * options.motion;
    // No more than all bits can differ, and the best is never farther than the second best.
    let (most, ratio) = (options.most_different.min(BITS), options.ratio.min(1.0));
    let one = |feature: &Feature| {
        let (mut first, mut second) = ((u32::MAX, 0), u32::MAX);
        for (j, other) in to.iter().enumerate() {
            // False for points that are not finite.
            let near = (other.point - feature.point).norm_squared() <= reach;
            if !near {
                continue;
            }
            let distance = feature.descriptor.distance(&other.descriptor);
            if distance < first.0 {
                (first, second) = ((distance, j), first.0);
            } else {
                second = second.min(distance);
            }
        }
        let (distance, j) = first;
        if distance > most {
            return None;
        }
        // At the distance at which another feature would be rejected anyway.
        let rival = f64::from(second.min(most + 1));
        let clear = f64::from(distance) < ratio * f64::from(second);
        clear.then(|| (j, 1.0 - f64::from(distance) / rival))
    };
    from.iter().map(one).collect()
}
