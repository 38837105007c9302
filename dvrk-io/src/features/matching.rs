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
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct FeatureMatch {
    /// Index in frame A.
    pub a: usize,
    /// Index in frame B.
    pub b: usize,
    /// Confidence of the match, above 0, at most 1.
    pub confidence: f64,
}

/// A point of a surface in two frames.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct LandmarkPair {
    /// Position in frame A, camera frame, metres.
    pub a: Point3<f64>,
    /// Position in frame B.
    pub b: Point3<f64>,
    /// Confidence of the match, above 0, at most 1.
    pub confidence: f64,
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
///
/// ```
/// use dvrk_io::features::{Descriptor, Feature, FeatureOptions, landmark_pairs, match_features};
/// use dvrk_io::nalgebra::Point3;
///
/// let feature = |x: f64, bits: u32| {
///     Feature { point: Point3::new(x, 0.0, 0.5), descriptor: Descriptor([bits; 8]) }
/// };
/// // Two features move by 5 mm and come in another order; a third appears too far away to be one of them.
/// let a = [feature(0.0, 0), feature(0.02, u32::MAX)];
/// let b = [feature(0.025, u32::MAX), feature(0.005, 0), feature(0.2, 0)];
/// let options = FeatureOptions::default();
/// let found = match_features(&a, &b, &options);
/// assert_eq!(found.iter().map(|m| (m.a, m.b)).collect::<Vec<_>>(), [(0, 1), (1, 0)]);
/// let pairs = landmark_pairs(&a, &b, &options);
/// assert_eq!(pairs.len(), 2);
/// assert!(pairs.iter().all(|p| (p.b.x - p.a.x - 0.005).abs() < 1e-12 && p.confidence == 1.0));
/// ```
pub fn landmark_pairs(a: &[Feature], b: &[Feature], options: &FeatureOptions) -> Vec<LandmarkPair> {
    let pair = |found: FeatureMatch| LandmarkPair {
        a: a[found.a].point,
        b: b[found.b].point,
        confidence: found.confidence,
    };
    match_features(a, b, options)
        .into_iter()
        .map(pair)
        .collect()
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
