//! Segments the cloud of one object from the image of a depth camera, as with a real camera.
//!
//! ```text
//! depth image ─► dvrk_io::Scan ─► dvrk_io::find_object ─► points of the object
//!                                   ▲ table, capsules of the arms, a point of the object
//! ```
//! This does not use the simulator's knowledge of what a pixel shows. Of several bodies the one nearest to the seed point is the object, else the
//! largest; in later frames the central point of its last cloud is the seed.

use dvrk_io::depth::{
    Capsule, DepthImage, Intrinsics, Object, ObjectOptions, Scan, chain, find_object,
};
use dvrk_io::features::Feature;
use nalgebra::{Isometry3, Point3};

use super::links::Links;
use super::options::CameraOptions;
use crate::cell::Plane;

/// Edge of the voxels, metres: a model of 5 mm spacing needs a point every 2.5 mm.
const VOXEL: f64 = 0.0022;
/// Gap in the cloud that is bridged, so that an arm in front of the object does not divide it: twice shaft and clearance, metres.
const GAP: f64 = 0.018;
/// Clearance around arms and table, metres; their poses are exactly known here.
const CLEARANCE: f64 = 0.004;
/// Radius of a shaft, metres.
const SHAFT: f64 = 0.004;
/// A finger: its radius, and where it begins and ends along z, metres.
const FINGER: (f64, f64, f64) = (0.0025, -0.014, 0.006);

/// Finds the object image by image.
#[derive(Debug, Clone)]
pub(super) struct Segmenter {
    camera: Intrinsics,
    options: ObjectOptions,
    /// A point of the object, in the frame of the camera in its rest pose.
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
                .with_table((table.normal, table.offset))
                .with_table_clearance(CLEARANCE)
                .with_arm_clearance(CLEARANCE)
                .with_voxel(VOXEL)
                .with_gap(GAP)
                .with_support(4),
            seed,
            camera_from_rest: Isometry3::identity(),
        })
    }

    /// The points of the object, each with the mean of `colour` over its pixels; empty when no object is found.
    ///
    /// # Errors
    /// An image of another size than the camera's; an arm whose pose is not finite.
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
        // If there is no body near the seed, or no seed, the largest body in view is taken.
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

    /// Sets the pose of a moving camera relative to its rest pose, and the table in its frame.
    pub fn look_from(&mut self, camera_from_rest: &Isometry3<f64>, table: &Plane) {
        let table = table.carried(camera_from_rest);
        self.options = self.options.with_table((table.normal, table.offset));
        // The seed is stored in the frame of the rest pose.
        self.camera_from_rest = *camera_from_rest;
    }

    /// Searches for the object at its last position from now on.
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
    /// Which pixels belong to the object, if it was segmented.
    pub of_object: Vec<bool>,
}

/// Mean colour of the pixels of each point.
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

/// The point nearest to the mean of all.
fn middle(points: &[Point3<f64>]) -> Option<Point3<f64>> {
    let sum: nalgebra::Vector3<f64> = points.iter().map(|p| p.coords).sum();
    let mean = Point3::from(sum / points.len().max(1) as f64);
    let away = |p: &Point3<f64>| (p - mean).norm_squared();
    points
        .iter()
        .min_by(|a, b| away(a).total_cmp(&away(b)))
        .copied()
}

/// The visible part of an arm whose fingers are `opening` away from the centre plane.
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
