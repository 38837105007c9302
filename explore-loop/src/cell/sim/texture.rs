//! A solid texture: a colour for every material point of a body.
//!
//! ```text
//! value noise   n(p) = trilinear interpolation of a hash of the corners of the cube around p, smoothed,  in [0, 1]
//! marbling      t(p) = Σₖ 2⁻ᵏ n(2ᵏ p / 24 mm) / Σₖ 2⁻ᵏ,   k = 0, 1, 2
//! veins         v(p) = 1 where |n(p / 18 mm) − ½| < 0.035
//! colour        base + (second − base) · step(t), darkened to 55 % in veins
//! ```
//! The two colours depend on the scene; `p` is in the scene's own frame at rest, so that the texture moves with the body.

use nalgebra::{Point3, Vector3};

/// The colours of a body.
#[derive(Debug, Clone, Copy)]
pub(super) struct Texture {
    seed: u64,
    base: Vector3<f64>,
    second: Vector3<f64>,
}

/// Sizes of the marbling and of the veins, metres.
const MARBLE: f64 = 0.024;
const VEIN: f64 = 0.018;
/// Half the width of a vein, in values of the noise, and its darkness.
const WIDTH: f64 = 0.035;
const DARK: f64 = 0.55;

impl Texture {
    /// The texture of a scene.
    pub fn of(scene: &str, seed: u64) -> Self {
        let (base, second) = match scene {
            "liver" | "attached" | "clutter" => ([118.0, 38.0, 32.0], [176.0, 84.0, 70.0]),
            "glove" => ([36.0, 92.0, 190.0], [88.0, 150.0, 226.0]),
            "beanie" | "cap" => ([186.0, 188.0, 176.0], [92.0, 108.0, 96.0]),
            "colon" => ([214.0, 140.0, 128.0], [236.0, 186.0, 160.0]),
            "sheet" => ([70.0, 130.0, 84.0], [150.0, 186.0, 120.0]),
            _ => ([190.0, 150.0, 70.0], [226.0, 204.0, 150.0]),
        };
        Self {
            seed,
            base: Vector3::from(base),
            second: Vector3::from(second),
        }
    }

    /// Red, green and blue of a point in the scene's own frame at rest.
    pub fn colour(&self, p: &Point3<f64>) -> [u8; 3] {
        let octaves = [1.0, 0.5, 0.25];
        let marble: f64 = octaves
            .iter()
            .map(|a| a * self.noise(&(p.coords / (MARBLE * a))))
            .sum();
        let share = smooth(((marble / 1.75 - 0.3) / 0.4).clamp(0.0, 1.0));
        let vein = self.noise(&(p.coords / VEIN + Vector3::repeat(71.3)));
        let light = if (vein - 0.5).abs() < WIDTH {
            DARK
        } else {
            1.0
        };
        let colour = self.base.lerp(&self.second, share) * light;
        [colour.x, colour.y, colour.z].map(|c| c.round().clamp(0.0, 255.0) as u8)
    }

    fn noise(&self, p: &Vector3<f64>) -> f64 {
        let corner = p.map(f64::floor);
        let t = (p - corner).map(smooth);
        let at = |dx: i64, dy: i64, dz: i64| {
            self.hash([
                corner.x as i64 + dx,
                corner.y as i64 + dy,
                corner.z as i64 + dz,
            ])
        };
        let along = |dy, dz| mix(at(0, dy, dz), at(1, dy, dz), t.x);
        let across = |dz| mix(along(0, dz), along(1, dz), t.y);
        mix(across(0), across(1), t.z)
    }

    /// A number in [0, 1) for a corner (the finaliser of SplitMix64).
    fn hash(&self, corner: [i64; 3]) -> f64 {
        let mut h = self.seed ^ 0x9e37_79b9_7f4a_7c15;
        for c in corner {
            h = (h ^ c.cast_unsigned()).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            h = (h ^ (h >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            h ^= h >> 31;
        }
        (h >> 11) as f64 / (1u64 << 53) as f64
    }
}

fn smooth(t: f64) -> f64 {
    t * t * (3.0 - 2.0 * t)
}

fn mix(a: f64, b: f64, t: f64) -> f64 {
    a + (b - a) * t
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// The same seed gives the same colours; neighbours 0.1 mm apart differ little, except at the rim of a vein.
        #[test]
        fn a_texture_is_a_function_of_place(p in [-0.2..0.2f64, -0.2..0.2f64, -0.1..0.1f64], seed in any::<u64>()) {
            let texture = Texture::of("liver", seed);
            let p = Point3::from(p);
            prop_assert_eq!(texture.colour(&p), Texture::of("liver", seed).colour(&p));
            let noise = texture.noise(&(p.coords / VEIN));
            prop_assert!((0.0..=1.0).contains(&noise));
            let beside = texture.noise(&((p.coords + Vector3::new(1e-4, 0.0, 0.0)) / VEIN));
            // The slope of the smoothed interpolation is at most 3/2 of the difference of two corners.
            prop_assert!((noise - beside).abs() <= 1.5 * 1e-4 / VEIN + 1e-12);
        }
    }

    #[test]
    fn textures_are_not_plain() {
        let texture = Texture::of("glove", 1);
        let colours: std::collections::BTreeSet<[u8; 3]> = (0..200)
            .map(|k| texture.colour(&Point3::new(0.001 * f64::from(k), 0.0, 0.0)))
            .collect();
        assert!(colours.len() > 50, "{}", colours.len());
    }
}
