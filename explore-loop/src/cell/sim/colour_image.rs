//! The colour image of the camera, and the features found in it.
//!
//! ```text
//! pixel = (½ + ½ cos θ) · colour + 2 grey levels of noise        θ between the normal and the ray: a lamp beside the lens
//! image ──► corners with descriptors ──► points on the object, by the depth image of the same frame      dvrk_io::features
//! ```
//! It has k × k pixels for each pixel of the depth image, as colour cameras have a higher resolution than depth cameras.

use dvrk_io::depth::{Capsule, Intrinsics, Scan};
use dvrk_io::features::{Feature, FeatureOptions, GreyImage, Surface, detect, lift};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::camera::{DepthCamera, Thing};
use super::options::CameraOptions;
use crate::cell::noise::normal;

/// Standard deviation of the noise of a pixel, grey levels.
const NOISE: f64 = 2.0;
/// A random stream separate from the depth noise of the same frame.
const OWN_STREAM: u64 = 1 << 63;
/// Grey levels of everything but the object.
const ARM: f64 = 190.0;
const ELSEWHERE: f64 = 128.0;

/// A colour camera with the pose and field of view of a depth camera.
pub(super) struct ColourCamera {
    pub camera: DepthCamera,
    pixels: usize,
    size: [usize; 2],
    intrinsics: Intrinsics,
    options: FeatureOptions,
}

impl ColourCamera {
    /// A camera with `scale` × `scale` pixels for each pixel of the depth camera.
    pub fn new(depth: &CameraOptions, scale: usize) -> Result<Self, dvrk_io::Error> {
        let size = [depth.width * scale, depth.height * scale];
        let finer = CameraOptions {
            width: size[0],
            height: size[1],
            focal: depth.focal * scale as f64,
            ..*depth
        };
        let center = [depth.width, depth.height].map(|n| 0.5 * n as f64 - 0.5);
        Ok(Self {
            camera: DepthCamera::new(finer),
            pixels: size[0] * size[1],
            size,
            intrinsics: Intrinsics::new(depth.width, depth.height, [depth.focal; 2], center)?,
            options: FeatureOptions::default(),
        })
    }

    /// The features in the rendered image; `colour` gives the colour of the object at a pixel, `of_object` the pixels of the depth image that belong
    /// to the object.
    pub fn features(
        &self,
        scan: &Scan,
        of_object: &[bool],
        arms: &[Capsule],
        colour: impl Fn(usize) -> [u8; 3],
        [seed, frame]: [u64; 2],
    ) -> Result<Vec<Feature>, dvrk_io::Error> {
        let mut noise = ChaCha8Rng::seed_from_u64(seed);
        noise.set_stream(frame | OWN_STREAM);
        let mut pixels = Vec::with_capacity(self.pixels);
        for at in 0..self.pixels {
            let light = 0.5 + 0.5 * self.camera.facing(at);
            let shown = match self.camera.thing(at) {
                Thing::Object => colour(at).map(|c| light * f64::from(c)),
                Thing::Arm => [light * ARM; 3],
                Thing::Beside => [light * ELSEWHERE; 3],
                Thing::Nothing => [ELSEWHERE; 3],
            };
            let off = NOISE * normal(&mut noise);
            pixels.push(shown.map(|c| (c + off).round().clamp(0.0, 255.0) as u8));
        }
        let [width, height] = self.size;
        let image = GreyImage::from_rgb(width, height, &pixels)?;
        let surface = Surface {
            scan,
            object: Some(of_object),
            arms,
        };
        let found = detect(&image, &self.options);
        lift(&found, &image, &surface, &self.options)
    }

    /// Camera parameters of the depth image.
    pub fn intrinsics(&self) -> &Intrinsics {
        &self.intrinsics
    }
}
