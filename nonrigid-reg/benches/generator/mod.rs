//! Pairs of views of deforming objects with known truth, made from a seed.
//!
//! A pinhole camera half a metre above sees about half of the surface. Source and target are sampled independently, one point
//! per cell of the image; noise lies along the ray. The part that a view does not show is sampled too, to score
//! the extrapolation.

// Every target that includes this module uses another part of it.
#![allow(dead_code)]

pub mod motions;
pub mod shapes;
pub mod track;
pub mod view;

pub use motions::Motion;
use nalgebra::{Point3, Vector3};
use nonrigid_reg::{Feature, Landmark};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
pub use shapes::Shape;
pub use view::View;

/// Dense points from which views are taken: a little less than one per mm².
const DENSE: usize = 40_000;

/// What to make.
#[derive(Debug, Clone, Copy)]
pub struct Case {
    pub shape: Shape,
    pub motion: Motion,
    /// Largest displacement, in m.
    pub size: f64,
    /// Standard deviation along the ray, in m.
    pub noise: f64,
    /// About as many points in each cloud.
    pub count: usize,
    /// A shadow over a fifth of the target, and 3 % of strays.
    pub occluded: bool,
    pub seed: u64,
}

impl Case {
    /// 3,000 points with 0.5 mm of noise.
    pub fn new(shape: Shape, motion: Motion, size: f64) -> Self {
        Self {
            shape,
            motion,
            size,
            noise: 0.0005,
            count: 3000,
            occluded: false,
            seed: 1,
        }
    }

    /// As the folders of shared pairs are called.
    pub fn name(&self) -> String {
        let occluded = if self.occluded { "_occluded" } else { "" };
        format!(
            "{:?}_{:?}_M{:.0}{occluded}",
            self.shape,
            self.motion,
            self.size * 1e3
        )
        .to_lowercase()
        .replace("_m", "_M")
    }

    /// The twelve pairs of the core.
    pub fn core(size: f64) -> Vec<Self> {
        use {Motion as M, Shape as S};
        [
            (S::Blob, M::Bend),
            (S::Blob, M::Pinch),
            (S::Hare, M::Twist),
            (S::Glove, M::Fold),
            (S::Glove, M::Pinch),
            (S::Liver, M::Combo),
            (S::Liver, M::Pinch),
            (S::Slab, M::Fold),
            (S::Torus, M::Stretch),
            (S::Torus, M::Twist),
            (S::Tube, M::Bend),
            (S::Tube, M::Pinch),
        ]
        .map(|(shape, motion)| Self::new(shape, motion, size))
        .to_vec()
    }

    /// The four pairs of the sweeps.
    pub fn sweep(size: f64) -> Vec<Self> {
        use {Motion as M, Shape as S};
        [
            (S::Blob, M::Pinch),
            (S::Tube, M::Bend),
            (S::Glove, M::Fold),
            (S::Liver, M::Combo),
        ]
        .map(|(shape, motion)| Self::new(shape, motion, size))
        .to_vec()
    }

    pub fn make(&self) -> Pair {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        let (dense, normals) = self.shape.surfels(DENSE, &mut rng);
        let t = self.motion.amplitude(&dense, self.size);
        let map = |p: &Point3<f64>| self.motion.apply(p, t);
        let seen = view::visible(&dense, &normals);
        let source = view::sample(&dense, &seen, self.count, self.noise, &mut rng);

        let (again, normals_again) = self.shape.surfels(DENSE, &mut rng);
        let moved: Vec<Point3<f64>> = again.iter().map(map).collect();
        let turned = view::carry(&again, &normals_again, map);
        let seen_after = view::visible(&moved, &turned);
        let mut target = view::sample(&moved, &seen_after, self.count, self.noise, &mut rng);

        let landmarks = grips(&dense, map);
        if self.occluded {
            view::shadow(&mut target, &landmarks[0].target, 0.2);
            view::strays(&mut target, 0.03, &mut rng);
        }
        let hidden: Vec<Point3<f64>> = (0..DENSE)
            .step_by(13)
            .filter(|&i| !seen[i])
            .map(|i| dense[i])
            .collect();
        Pair {
            truth: source.points.iter().map(map).collect(),
            features: features(&source.points, map, &mut rng),
            hidden_truth: hidden.iter().map(map).collect(),
            source,
            target,
            landmarks,
            hidden,
        }
    }
}

/// Two views and their ground truth.
pub struct Pair {
    pub source: View,
    pub target: View,
    /// Where each source point went.
    pub truth: Vec<Point3<f64>>,
    /// Three exact grips.
    pub landmarks: Vec<Landmark>,
    /// Sixty image features, a fifth of them wrong.
    pub features: Vec<Feature>,
    /// What the source view does not show.
    pub hidden: Vec<Point3<f64>>,
    /// Where that went.
    pub hidden_truth: Vec<Point3<f64>>,
}

/// Where it moves most, and the two points farthest from that and from each other.
pub fn grips(dense: &[Point3<f64>], map: impl Fn(&Point3<f64>) -> Point3<f64>) -> Vec<Landmark> {
    let best = |score: &dyn Fn(&Point3<f64>) -> f64| {
        let better = |a: &&Point3<f64>, b: &&Point3<f64>| score(a).total_cmp(&score(b));
        dense.iter().max_by(better).copied().unwrap_or_default()
    };
    let first = best(&|p| (map(p) - p).norm());
    let second = best(&|p| (p - first).norm());
    let third = best(&|p| (p - first).norm().min((p - second).norm()));
    [first, second, third]
        .map(|source| Landmark {
            source,
            target: map(&source),
            sigma: 0.0,
        })
        .to_vec()
}

/// 1.1 mm of noise, and 15 mm for every fifth.
pub fn features(
    points: &[Point3<f64>],
    map: impl Fn(&Point3<f64>) -> Point3<f64>,
    rng: &mut ChaCha8Rng,
) -> Vec<Feature> {
    let make = |k: usize, rng: &mut ChaCha8Rng| {
        let source = points[rng.random_range(0..points.len())];
        let wrong = if k.is_multiple_of(5) { 0.015 } else { 0.0 };
        let off =
            view::normal_vector(rng) * 0.000_64 + view::normal_vector(rng).normalize() * wrong;
        Feature {
            source,
            target: map(&source) + off,
        }
    };
    (0..60).map(|k| make(k, rng)).collect()
}

/// Mean and 95th percentile of distances, in mm.
pub fn error_mm(found: &[Point3<f64>], truth: &[Point3<f64>]) -> (f64, f64) {
    let mut off: Vec<f64> = found
        .iter()
        .zip(truth)
        .map(|(a, b)| (a - b).norm() * 1e3)
        .collect();
    off.sort_by(f64::total_cmp);
    let mean = off.iter().sum::<f64>() / off.len().max(1) as f64;
    (mean, off.get(off.len() * 95 / 100).copied().unwrap_or(0.0))
}

/// `points + displacements`.
pub fn moved(points: &[Point3<f64>], displacements: &[Vector3<f64>]) -> Vec<Point3<f64>> {
    points
        .iter()
        .zip(displacements)
        .map(|(p, u)| p + u)
        .collect()
}
