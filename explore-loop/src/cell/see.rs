//! Finds the object in a frame of the camera, without table and arms.

use dvrk_io::Error;
use dvrk_io::depth::{Capsule, Object, ObjectOptions, Scan, find_object};
use dvrk_io::features::{Feature, FeatureOptions, GreyImage, Surface, detect, lift};
use dvrk_io::kinematics::Kinematics;
use nalgebra::{Isometry3, Point3, Vector3};

use super::Plane;

/// Edge of the voxels, metres: a model of 5 mm spacing needs a point every 2.5 mm.
const VOXEL: f64 = 0.0022;
/// Gap in the cloud that is bridged, so that an arm in front of the object does not divide it: twice shaft and clearance, metres.
const GAP: f64 = 0.018;
/// Points within this distance of the table are removed with it, metres.
const TABLE_CLEARANCE: f64 = 0.004;
/// Radius of a finger, and where it begins and ends along the tip's z axis, metres.
const FINGER: (f64, f64, f64) = (0.0025, -0.014, 0.006);

/// Finds the object frame by frame: of several bodies the one nearest to its last position, else the largest.
#[derive(Debug, Clone)]
pub(super) struct Eye {
    options: ObjectOptions,
    table: Option<Plane>,
    /// The share of the points of the last scan, without arms, that lay on the table.
    on_table: Option<f64>,
    seed: Option<Point3<f64>>,
}

/// The object in a frame.
#[derive(Debug, Clone, Default)]
pub(super) struct Seen {
    pub points: Vec<Point3<f64>>,
    pub colours: Option<Vec<[u8; 3]>>,
    /// Features of the colour image, if the scan is an organised cloud with colours.
    pub features: Option<Vec<Feature>>,
}

impl Eye {
    /// `arm_clearance`: points within this distance of an arm are removed with it, metres; `seed`: a point on or next to the object.
    pub fn new(table: Option<Plane>, arm_clearance: f64, seed: Option<Point3<f64>>) -> Self {
        let options = ObjectOptions::default()
            .with_table_clearance(TABLE_CLEARANCE)
            .with_arm_clearance(arm_clearance)
            .with_voxel(VOXEL)
            .with_gap(GAP)
            .with_support(4);
        Self {
            options,
            table,
            on_table: None,
            seed,
        }
    }

    /// The table, once it is known.
    pub fn table(&self) -> Option<Plane> {
        self.table
    }

    /// The share of the points of the last scan, without arms, that lay on the table.
    pub fn on_table(&self) -> Option<f64> {
        self.on_table
    }

    /// # Errors
    /// No table among the points, a scan without points, an arm whose pose is not finite. It is no error if no object is found.
    pub fn look(&mut self, scan: &Scan, arms: &[Capsule]) -> Result<Seen, Error> {
        let mut options = self.options;
        if let Some(table) = &self.table {
            options = options.with_table((table.normal, table.offset));
        }
        let near = self.seed.map(|seed| options.with_seed_point(seed));
        for options in [near, Some(options)].into_iter().flatten() {
            match find_object(scan, arms, &options) {
                Ok(object) => {
                    self.table.get_or_insert(Plane {
                        normal: object.table.normal,
                        offset: object.table.offset,
                    });
                    self.on_table = Some(object.table.inlier_share);
                    self.seed = middle(&object.points).or(self.seed);
                    return Ok(Seen {
                        features: features(scan, &object, arms),
                        points: object.points,
                        colours: object.colours,
                    });
                }
                Err(Error::NoObject { .. }) => {}
                Err(error) => return Err(error),
            }
        }
        Ok(Seen::default())
    }
}

/// Corners of the colour image on the object.
fn features(scan: &Scan, object: &Object, arms: &[Capsule]) -> Option<Vec<Feature>> {
    let (columns, colours) = (scan.columns()?, scan.colours()?);
    let rows = colours.len().checked_div(columns)?;
    let image = GreyImage::from_rgb(columns, rows, colours).ok()?;
    let of_object: Vec<bool> = object.point_of.iter().map(Option::is_some).collect();
    let surface = Surface {
        scan,
        object: Some(&of_object),
        arms,
    };
    let options = FeatureOptions::default();
    lift(&detect(&image, &options), &image, &surface, &options).ok()
}

/// The point nearest to the mean of all.
fn middle(points: &[Point3<f64>]) -> Option<Point3<f64>> {
    let sum: Vector3<f64> = points.iter().map(|p| p.coords).sum();
    let mean = Point3::from(sum / points.len().max(1) as f64);
    let away = |p: &Point3<f64>| (p - mean).norm_squared();
    let nearest = points.iter().min_by(|a, b| away(a).total_cmp(&away(b)));
    nearest.copied()
}

/// Links and fingers of an arm with its tip at this pose; `opening`: distance of each finger from the centre plane, metres.
pub(super) fn links(
    kinematics: &Kinematics,
    camera_from_rcm: &Isometry3<f64>,
    joints: &[f64; 6],
    opening: f64,
) -> Result<Vec<Capsule>, Error> {
    let camera_from_tip = camera_from_rcm * kinematics.rcm_from_tip(joints)?.0;
    let finger = |side: f64| {
        let (radius, behind, before) = FINGER;
        let at = |y: f64, z: f64| camera_from_tip * Point3::new(0.0, side * y, z);
        Capsule {
            start: at(0.002, behind),
            end: at(opening + 0.001, before),
            radius,
        }
    };
    let mut links = kinematics.capsules(camera_from_rcm, joints, 0.0)?;
    links.extend([-1.0, 1.0].map(finger));
    Ok(links)
}
