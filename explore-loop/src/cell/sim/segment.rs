//! From the image of a depth camera to the cloud of one object, the way a real camera takes.
//!
//! ```text
//! depth image ─► dvrk_io::Scan ─► dvrk_io::find_object ─► points of the object
//!                                   ▲ table, capsules of the arms, a point of the object
//! ```
//! Nothing here knows which pixel shows what. Of several bodies the one next to the seed point is the object, else the largest; from then on the
//! point of its cloud that was in its middle is the seed.

use dvrk_io::depth::{
    Capsule, DepthImage, Intrinsics, Object, ObjectOptions, Scan, chain, find_object,
};
use dvrk_io::features::Feature;
use nalgebra::{Isometry3, Point3};

use super::links::Links;
use super::options::CameraOptions;
use crate::cell::Plane;

/// Edge of the voxels, metres: a model of 5 mm spacing wants a point every 2.5 mm.
const VOXEL: f64 = 0.0022;
/// An arm before the object shall not divide it: twice shaft and clearance, metres.
const GAP: f64 = 0.018;
/// Where arms and table are is known well here, metres.
const CLEARANCE: f64 = 0.004;
/// Radius of a shaft, metres.
const SHAFT: f64 = 0.004;
/// A finger, metres: its radius, and where it begins and ends along z.
const FINGER: (f64, f64, f64) = (0.0025, -0.014, 0.006);

/// Finds the object in one image after the other.
#[derive(Debug, Clone)]
pub(super) struct Segmenter {
    camera: Intrinsics,
    options: ObjectOptions,
    /// A point of the object, in the frame of the camera at rest.
    seed: Option<Point3<f64>>,
    camera_from_rest: Isometry3<f64>,
}

impl Segmenter {
    /// `seed`: a point on or next to the object, camera frame.
    pub fn new(
        camera: &CameraOptions,
        table: &Plane,
        seed: Option<Point3<f64>>,
    ) -> Result<Self, dvrk_io::Error> {
        let center = [camera.width, camera.height].map(|n| 0.5 * n as f64 - 0.5);
        Ok(Self {
            camera: Intrinsics::new(camera.width, camera.height, [camera.focal; 2], center)?,
            options: ObjectOptions::default()
                .with_table(table.normal, table.offset)
                .with_clearances(CLEARANCE, CLEARANCE)
                .with_voxel(VOXEL)
                .with_parts(GAP, 4),
            seed,
            camera_from_rest: Isometry3::identity(),
        })
    }

    /// The points of the object with the mean of what `colour` gives for the pixels of each; none when there is nothing that could be it.
    ///
    /// # Errors
    /// An image of another size than the camera's; an arm whose place is not finite.
    pub fn points(
        &self,
        image: &DepthImage,
        arms: &[Capsule],
        colour: impl Fn(usize) -> [u8; 3],
    ) -> Result<Seen, dvrk_io::Error> {
        let scan = Scan::from_image(image, &self.camera)?;
        let seed = self.seed.map(|seed| self.camera_from_rest * seed);
        let near_seed = seed.map(|seed| self.options.with_seed_point(seed));
        let anywhere = Some(self.options);
        // What is not where it was, or was never asked for, is the largest body in view.
        for options in [near_seed, anywhere].into_iter().flatten() {
            match find_object(&scan, arms, &options) {
                Ok(object) => {
                    return Ok(Seen {
                        colours: mean_colours(&object, colour),
                        points: object.points,
                        features: None,
                        of_object: object.point_of.iter().map(Option::is_some).collect(),
                    });
                }
                Err(dvrk_io::Error::NoObject { .. }) => {}
                Err(error) => return Err(error),
            }
        }
        Ok(Seen::default())
    }

    /// Of a camera that moves: where its frame at rest is now, and the table there.
    pub fn look_from(&mut self, camera_from_rest: &Isometry3<f64>, table: &Plane) {
        let table = table.carried(camera_from_rest);
        self.options = self.options.with_table(table.normal, table.offset);
        // The seed is kept in the frame at rest.
        self.camera_from_rest = *camera_from_rest;
    }

    /// Looks for the object where it was seen last.
    pub fn follow(&mut self, seen: &Seen) {
        let middle = middle(&seen.points);
        let at_rest = middle.map(|p| self.camera_from_rest.inverse() * p);
        self.seed = at_rest.or(self.seed);
    }
}

/// Points with their colours.
#[derive(Debug, Clone, Default)]
pub(super) struct Seen {
    pub points: Vec<Point3<f64>>,
    pub colours: Vec<[u8; 3]>,
    /// Features of the colour image, if there is one.
    pub features: Option<Vec<Feature>>,
    /// Which pixels were taken for the object's, where it had to be looked for.
    pub of_object: Vec<bool>,
}

/// Mean colour of the pixels that each point is made of.
fn mean_colours(object: &Object, colour: impl Fn(usize) -> [u8; 3]) -> Vec<[u8; 3]> {
    let mut sums = vec![([0_u32; 3], 0_u32); object.points.len()];
    for (pixel, point) in object.point_of.iter().enumerate() {
        if let Some(point) = *point {
            let (sum, count) = &mut sums[point];
            for (sum, c) in sum.iter_mut().zip(colour(pixel)) {
                *sum += u32::from(c);
            }
            *count += 1;
        }
    }
    // A mean of bytes is a byte.
    sums.iter()
        .map(|(sum, count)| sum.map(|c| (c / (*count).max(1)) as u8))
        .collect()
}

/// The point next to the mean of all.
fn middle(points: &[Point3<f64>]) -> Option<Point3<f64>> {
    let sum: nalgebra::Vector3<f64> = points.iter().map(|p| p.coords).sum();
    let mean = Point3::from(sum / points.len().max(1) as f64);
    let away = |p: &Point3<f64>| (p - mean).norm_squared();
    points
        .iter()
        .min_by(|a, b| away(a).total_cmp(&away(b)))
        .copied()
}

/// The visible part of an arm whose fingers are `opening` off the middle.
pub(super) fn capsules(
    camera_from_tip: &Isometry3<f64>,
    opening: f64,
    links: &Links,
) -> Vec<Capsule> {
    let finger = |side: f64| {
        let (radius, z0, z1) = FINGER;
        let at = |y: f64, z: f64| camera_from_tip * Point3::new(0.0, side * y, z);
        Capsule {
            start: at(0.002, z0),
            end: at(opening + 0.001, z1),
            radius,
        }
    };
    let shaft = chain(&links.points, &vec![SHAFT; links.points.len()]);
    shaft.into_iter().chain([-1.0, 1.0].map(finger)).collect()
}
