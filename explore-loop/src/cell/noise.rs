//! Gaussian noise on points, from a seed.

use nalgebra::{Point3, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Independent noise on every coordinate of every point: the same for the same seed and frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct Noise {
    /// Standard deviation, m.
    sigma: f64,
    seed: u64,
    frames: u64,
}

impl Noise {
    /// `None` if the standard deviation is negative or not finite.
    pub fn new(sigma: f64, seed: u64) -> Option<Self> {
        (sigma >= 0.0 && sigma.is_finite()).then_some(Self {
            sigma,
            seed,
            frames: 0,
        })
    }

    /// Moves the points of the next frame.
    pub fn add(&mut self, points: &mut [Point3<f64>]) {
        let mut random = ChaCha8Rng::seed_from_u64(self.seed);
        random.set_stream(self.frames);
        self.frames += 1;
        for point in points {
            *point += self.sigma * Vector3::from_fn(|_, _| normal(&mut random));
        }
    }
}

/// A standard normal number (Box and Muller).
pub(super) fn normal(random: &mut impl Rng) -> f64 {
    let (u, v): (f64, f64) = (1.0 - random.random::<f64>(), random.random());
    (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
}
