//! A long sequence: an object that deforms there and back, seen afresh in every frame.

use nalgebra::Point3;
use nonrigid_reg::{Feature, Landmark};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::{Motion, Shape, View, features, grips, view};

/// Frames of one object, made one by one.
pub struct Track {
    shape: Shape,
    motion: Motion,
    frames: usize,
    amplitude: f64,
    dense: Vec<Point3<f64>>,
    rng: ChaCha8Rng,
}

impl Track {
    /// `frames` frames that go out to `size` m and back twice.
    pub fn new(shape: Shape, motion: Motion, size: f64, frames: usize, seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let (dense, _) = shape.surfels(20_000, &mut rng);
        let amplitude = motion.amplitude(&dense, size);
        Self {
            shape,
            motion,
            frames,
            amplitude,
            dense,
            rng,
        }
    }

    /// Where a point of the rest shape is in frame `k`.
    pub fn place(&self, p: &Point3<f64>, k: usize) -> Point3<f64> {
        let phase = 2.0 * std::f64::consts::TAU * k as f64 / self.frames as f64;
        self.motion
            .apply(p, self.amplitude * 0.5 * (1.0 - phase.cos()))
    }

    /// What the camera sees in frame `k`: about 3,000 points, 0.5 mm of noise.
    pub fn look(&mut self, k: usize) -> View {
        let mut rng = self.rng.clone();
        let (rest, normals) = self.shape.surfels(16_000, &mut rng);
        let now: Vec<Point3<f64>> = rest.iter().map(|p| self.place(p, k)).collect();
        let turned = view::carry(&rest, &normals, |p| self.place(p, k));
        let seen = view::visible(&now, &turned);
        let view = view::sample(&now, &seen, 3000, 0.0005, &mut rng);
        self.rng = rng;
        view
    }

    /// Three grips of the rest shape, the same ones all along.
    pub fn grips(&self) -> Vec<Point3<f64>> {
        let most = |p: &Point3<f64>| self.motion.apply(p, self.amplitude);
        grips(&self.dense, most).iter().map(|l| l.source).collect()
    }

    /// The grips as landmarks from frame `k` to the next.
    pub fn landmarks(&self, grips: &[Point3<f64>], k: usize) -> Vec<Landmark> {
        let step = |p: &Point3<f64>| Landmark {
            source: self.place(p, k),
            target: self.place(p, k + 1),
            sigma: 0.0,
        };
        grips.iter().map(step).collect()
    }

    /// Sixty image features from frame `k` to the next, at points of the rest shape.
    pub fn features(&mut self, rest: &[Point3<f64>], k: usize) -> Vec<Feature> {
        let mut rng = self.rng.clone();
        let now: Vec<Point3<f64>> = rest.iter().map(|p| self.place(p, k)).collect();
        let next: Vec<Point3<f64>> = rest.iter().map(|p| self.place(p, k + 1)).collect();
        let to_next = |p: &Point3<f64>| {
            let found = now.iter().position(|q| q == p).unwrap_or(0);
            next[found]
        };
        let made = features(&now, to_next, &mut rng);
        self.rng = rng;
        made
    }
}
