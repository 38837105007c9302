//! An active stereo depth camera, such as a RealSense D435, with the geometry of a pinhole camera.
//!
//! A point at depth `z` has the disparity `d = f B / z` between the two imagers, at a distance of `B`. The matched disparity has an error of a fraction
//! of a pixel and is rounded to a fraction of a pixel, so that both errors of depth grow with its square:
//!
//! ```text
//! d' = q · round((d + ν)/q),  ν ~ N(0, σ_d²)         z' = u · round(f B / (d' u))
//! σ_z = z² σ_d / (f B)          step of z = z² q / (f B), at least the unit u of the image
//! ```
//! `ν` is averaged over 3 × 3 pixels, because windows are matched, not single pixels. In addition the camera
//!
//! - **drops** pixels whose ray meets the surface at a grazing angle `θ`, with probability `s²`, `s = (θ − 55°)/(85° − 55°)` in [0, 1], and one in
//!   two hundred anywhere;
//! - **mixes** near and far at edges: where the depths of the four neighbours differ by more than 8 mm, half of the pixels get a depth
//!   between the nearest and the farthest of them;
//! - **has its own clock**: frames come at 29.97 Hz independently of the loop, which gets the newest of them ([`FrameClock`]).

use derive_setters::Setters;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::SimError;
use super::options::within;

/// Parameters of an active stereo camera.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct StereoOptions {
    /// Distance between the imagers, metres.
    pub baseline: f64,
    /// Standard deviation of the disparity, pixels.
    pub disparity_noise: f64,
    /// Resolution of disparities, pixels.
    pub disparity_step: f64,
    /// Unit of the depth image, metres.
    pub unit: f64,
    /// Angles between normal and ray at which pixels begin to be dropped, and at which all are, radians.
    pub grazing: [f64; 2],
    /// Share of pixels that are dropped independently of the angle.
    pub dropped: f64,
    /// Share of pixels at an edge that get a mixed depth.
    pub mixed: f64,
    /// Frames each second of the camera's own clock.
    pub rate: f64,
}

impl Default for StereoOptions {
    /// A D435 at 848 × 480.
    fn default() -> Self {
        Self {
            baseline: 0.05,
            disparity_noise: 0.08,
            disparity_step: 1.0 / 32.0,
            unit: 0.001,
            grazing: [55_f64.to_radians(), 85_f64.to_radians()],
            dropped: 0.005,
            mixed: 0.5,
            rate: 29.97,
        }
    }
}

/// Differences of depth between neighbours that make an edge, metres.
const EDGE: f64 = 0.008;

/// An image of true depths.
#[derive(Debug, Clone, Copy)]
pub(super) struct TrueImage<'a> {
    pub width: usize,
    pub focal: f64,
    /// Depth of each pixel, metres.
    pub depth: &'a [f64],
    /// Cosine of the angle between normal and ray.
    pub cosine: &'a [f64],
}

impl StereoOptions {
    /// Rejects implausible values; `loop_rate` is how often the loop asks for a frame, 1/s.
    pub(super) fn check(&self, loop_rate: f64) -> Result<(), SimError> {
        within("camera baseline", self.baseline, 1e-3, 1.0, "1 mm to 1 m")?;
        let (noise, step) = (self.disparity_noise, self.disparity_step);
        within("disparity noise", noise, 0.0, 10.0, "0 to 10 pixels")?;
        within("disparity step", step, 1e-6, 10.0, "1e-6 to 10 pixels")?;
        within("depth unit", self.unit, 1e-5, 0.01, "10 µm to 10 mm")?;
        let [from, all] = self.grazing;
        within("first grazing angle", from, 0.0, 1.6, "0 to 1.6 rad")?;
        let beyond = "more than the first to 1.6 rad";
        within("second grazing angle", all, from + 1e-6, 1.6, beyond)?;
        for share in [self.dropped, self.mixed] {
            within("share of pixels", share, 0.0, 1.0, "0 to 1")?;
        }
        // Each frame of the loop must find a new frame of the camera.
        let range = "the loop's rate to 1000 Hz";
        within("camera's own rate", self.rate, loop_rate, 1000.0, range)
    }

    /// Standard deviation of the depth at `depth`, metres, for a focal length of `focal` pixels.
    pub fn depth_noise(&self, depth: f64, focal: f64) -> f64 {
        depth * depth * self.disparity_noise / (focal * self.baseline)
    }

    /// The image as the camera measures it in frame `frame`: depths in units of [`Self::unit`], 0 where there is none.
    pub(super) fn measure(&self, image: TrueImage<'_>, seed: u64, frame: u64) -> Vec<u16> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        random.set_stream(frame);
        let errors = self.matching_errors(image.width, image.depth.len(), &mut random);
        (0..image.depth.len())
            .map(|pixel| {
                // The same number of draws for every pixel, so that pixels do not affect each other.
                let [drop, mix, share]: [f64; 3] = random.random();
                if drop < self.drop_probability(image.cosine[pixel]) {
                    return 0;
                }
                let depth = if mix < self.mixed {
                    image.mixed(pixel, share)
                } else {
                    image.depth[pixel]
                };
                self.quantised(depth, image.focal, errors[pixel])
            })
            .collect()
    }

    fn drop_probability(&self, cosine: f64) -> f64 {
        let [from, to] = self.grazing;
        let angle = cosine.clamp(-1.0, 1.0).acos();
        let s = ((angle - from) / (to - from).max(1e-9)).clamp(0.0, 1.0);
        (s * s).max(self.dropped)
    }

    fn quantised(&self, depth: f64, focal: f64, error: f64) -> u16 {
        let product = focal * self.baseline;
        let step = self.disparity_step;
        let disparity = ((product / depth + error) / step).round() * step;
        if disparity <= 0.0 {
            return 0;
        }
        // Saturates at the largest 16-bit depth.
        (product / disparity / self.unit).round() as u16
    }

    /// Errors of the disparity: white noise averaged over 3 × 3 pixels, with the given standard deviation.
    fn matching_errors(&self, width: usize, count: usize, random: &mut impl Rng) -> Vec<f64> {
        let white: Vec<f64> = (0..count)
            .map(|_| crate::cell::noise::normal(random) * self.disparity_noise)
            .collect();
        let rows = count / width.max(1);
        let window = |pixel: usize| {
            let (u, v) = (pixel % width, pixel / width);
            let (columns, lines) = (
                u.saturating_sub(1)..=(u + 1).min(width - 1),
                v.saturating_sub(1)..=(v + 1).min(rows - 1),
            );
            let (mut sum, mut seen) = (0.0, 0.0_f64);
            for row in lines {
                for column in columns.clone() {
                    sum += white[row * width + column];
                    seen += 1.0;
                }
            }
            sum / seen.sqrt()
        };
        (0..count).map(window).collect()
    }
}

impl TrueImage<'_> {
    /// The depth of a mixed pixel at an edge: `share` of the way from the nearest to the farthest neighbour.
    fn mixed(&self, pixel: usize, share: f64) -> f64 {
        let own = self.depth[pixel];
        let column = pixel % self.width;
        let neighbours = [
            (column > 0).then(|| pixel - 1),
            (column + 1 < self.width).then_some(pixel + 1),
            pixel.checked_sub(self.width),
            Some(pixel + self.width),
        ];
        let depths = neighbours.into_iter().flatten();
        let depths = depths.filter_map(|other| self.depth.get(other));
        let (near, far) = depths.fold((own, own), |(near, far), d| (near.min(*d), far.max(*d)));
        if far - near > EDGE {
            near + share * (far - near)
        } else {
            own
        }
    }
}

/// A free-running clock: frame `n` is taken at `phase + n / rate`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct FrameClock {
    rate: f64,
    phase: f64,
}

impl FrameClock {
    /// `phase` as a share of the frame period.
    pub fn new(rate: f64, phase: f64) -> Self {
        Self {
            rate,
            phase: phase / rate,
        }
    }

    /// Time of the newest frame at time `now`, seconds.
    pub fn newest(&self, now: f64) -> f64 {
        // A tick at `now` counts, whatever the rounding.
        let ticks = ((now - self.phase) * self.rate + 1e-9).floor();
        self.phase + ticks / self.rate
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const WIDTH: usize = 64;
    const FOCAL: f64 = 424.0;

    fn image(depth: &[f64], cosine: f64, options: &StereoOptions, seed: u64) -> Vec<u16> {
        let image = TrueImage {
            width: WIDTH,
            focal: FOCAL,
            depth,
            cosine: &vec![cosine; depth.len()],
        };
        options.measure(image, seed, 7)
    }

    /// A wall at `depth`, as measured, metres; what was dropped is left out.
    fn wall(depth: f64, cosine: f64, options: &StereoOptions, seed: u64) -> Vec<f64> {
        let units = image(&vec![depth; WIDTH * WIDTH], cosine, options, seed);
        let seen = units.into_iter().filter(|u| *u > 0);
        seen.map(|u| f64::from(u) * options.unit).collect()
    }

    fn deviation(values: &[f64]) -> f64 {
        let count = values.len() as f64;
        let mean = values.iter().sum::<f64>() / count;
        (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / count).sqrt()
    }

    /// Without steps that would add to the noise.
    fn fine() -> StereoOptions {
        StereoOptions {
            unit: 1e-5,
            disparity_step: 1e-4,
            ..StereoOptions::default()
        }
    }

    proptest! {
        /// Twice as far, four times the noise. (4,096 pixels in windows of nine are some 455 independent ones: their deviation is known to
        /// 1/√910 = 3.3 %, at the edge of the image too; four times that. The largest depth keeps within 16 bits of 10 µm.)
        #[test]
        fn noise_grows_with_the_square_of_depth(depth in 0.25..0.6f64, seed in any::<u64>()) {
            let options = fine();
            let got = deviation(&wall(depth, 1.0, &options, seed));
            let wanted = options.depth_noise(depth, FOCAL);
            prop_assert!((got / wanted - 1.0).abs() < 0.14, "{got} {wanted}");
            prop_assert!((options.depth_noise(2.0 * depth, FOCAL) / wanted - 4.0).abs() < 1e-9);
        }

        /// Depths are whole units, and without noise off by at most half a step of disparity and half a unit.
        #[test]
        fn steps_are_those_of_disparity(depth in 0.2..3.0f64, unit in prop::sample::select(vec![1e-4, 1e-3])) {
            let options = StereoOptions { disparity_noise: 0.0, unit, dropped: 0.0, ..StereoOptions::default() };
            let got = wall(depth, 1.0, &options, 0);
            let step = depth * depth * options.disparity_step / (FOCAL * options.baseline);
            // To second order in the step.
            let most = 0.5 * step * (1.0 + step / depth) + 0.5 * unit + 1e-12;
            prop_assert!(got.iter().all(|z| (z - depth).abs() <= most), "{} {depth}", got[0]);
        }

        #[test]
        fn the_same_seed_gives_the_same_bits(seed in any::<u64>()) {
            let options = StereoOptions::default();
            prop_assert_eq!(wall(0.5, 0.5, &options, seed), wall(0.5, 0.5, &options, seed));
            prop_assert_ne!(wall(0.5, 0.5, &options, seed), wall(0.5, 0.5, &options, seed ^ 1));
        }

        /// The newest frame is never of the future, never older than a period, and never older than the one before.
        #[test]
        fn the_clock_never_waits(now in 0.0..1e4f64, later in 0.0..10.0f64, phase in 0.0..1.0f64) {
            let clock = FrameClock::new(29.97, phase);
            let newest = clock.newest(now);
            prop_assert!(newest <= now + 1e-9 && now - newest < 1.0 / 29.97 + 1e-9);
            prop_assert!(clock.newest(now + later) >= newest);
        }
    }

    /// None but the usual ones head on, more the flatter, all at the end.
    #[test]
    fn more_is_dropped_the_flatter_it_is_looked_at() {
        let options = StereoOptions::default();
        let share = |degrees: f64| {
            let seen = wall(0.5, degrees.to_radians().cos(), &options, 3).len();
            1.0 - seen as f64 / (WIDTH * WIDTH) as f64
        };
        let shares = [0.0, 50.0, 60.0, 70.0, 80.0, 89.0].map(share);
        assert!(shares[0] < 0.01 && shares[1] < 0.01, "{shares:?}");
        assert!(shares.windows(2).skip(1).all(|w| w[1] > w[0]), "{shares:?}");
        assert!((shares[3] - 0.25).abs() < 0.03, "{shares:?}");
        assert!((shares[5] - 1.0).abs() < 1e-9, "{shares:?}");
    }

    /// At a step between two walls about half of the pixels beside it lie between them; elsewhere none does.
    #[test]
    fn edges_are_mixed() {
        let options = StereoOptions::default();
        let depth: Vec<f64> = (0..WIDTH * WIDTH)
            .map(|i| if i % WIDTH < WIDTH / 2 { 0.50 } else { 0.55 })
            .collect();
        let units = image(&depth, 1.0, &options, 5);
        let between = |u: u16| (510..540).contains(&u);
        let at = |column: usize| (0..WIDTH).map(move |row| row * WIDTH + column);
        let mixed = |column: usize| at(column).filter(|&i| between(units[i])).count();
        for column in [WIDTH / 2 - 1, WIDTH / 2] {
            // Half of them, three fifths of the way; three standard deviations of 64 draws.
            assert!((8..32).contains(&mixed(column)), "{}", mixed(column));
        }
        assert_eq!(mixed(WIDTH / 2 - 3) + mixed(WIDTH / 2 + 3), 0);
    }
}
