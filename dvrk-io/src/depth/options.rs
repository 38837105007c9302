//! Options that distinguish the object from everything else.

use derive_setters::Setters;
use nalgebra::{Point3, UnitVector3};

use super::Workspace;
use crate::Error;

/// Options of [`find_object`](super::find_object). All lengths in metres.
#[derive(Debug, Clone, Copy, PartialEq, Setters)]
#[setters(prefix = "with_")]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct ObjectOptions {
    /// Points outside of it are removed. Default: no crop.
    #[setters(strip_option)]
    pub workspace: Option<Workspace>,
    /// The table, `normal · x + offset ≥ 0` on its free side, where the camera is. Default: it is found.
    /// For a scene without a table, give a plane far behind everything.
    #[setters(strip_option)]
    pub table: Option<(UnitVector3<f64>, f64)>,
    /// Largest distance of a point of the table from its plane. Default 4 mm: twice the depth noise of a close stereo camera.
    pub table_tolerance: f64,
    /// Least share of the points on the plane of the table. Default 0.3: the visible cap of a ball alone in view has
    /// less.
    pub least_table_share: f64,
    /// Points up to this height above the table are removed with it. Default 4 mm. The object loses a strip of this height
    /// where it meets the table.
    pub table_clearance: f64,
    /// Points up to this distance outside of a capsule are removed with the arm. Default 5 mm: the error of a dVRK after a careful
    /// registration of its base.
    pub arm_clearance: f64,
    /// Steepest trusted angle between normal and ray, radians. Default 80°: beyond it one pixel of error in the direction
    /// of a ray is six pixels of error in depth.
    pub max_incidence: f64,
    /// Differences of distance caused by noise alone. Default 2 mm.
    pub noise: f64,
    /// Edge of the voxels, each of which gives one point. Default 3 mm.
    pub voxel: f64,
    /// Largest gap within one object; 2 to 50 voxels. Default 10 mm.
    pub gap: f64,
    /// Number of points within `gap` of a voxel, including its own, that make it trusted. Default 4: outliers have fewer.
    pub support: usize,
    /// The object is the part nearest to this point. Default: the part with most points.
    #[setters(strip_option)]
    pub seed_point: Option<Point3<f64>>,
    /// Position of the camera in the frame of the points. Default: the origin.
    pub viewpoint: Point3<f64>,
    /// Seed of the search for the table.
    pub seed: u64,
}

impl Default for ObjectOptions {
    fn default() -> Self {
        Self {
            workspace: None,
            table: None,
            table_tolerance: 0.004,
            least_table_share: 0.3,
            table_clearance: 0.004,
            arm_clearance: 0.005,
            max_incidence: 80_f64.to_radians(),
            noise: 0.002,
            voxel: 0.003,
            gap: 0.010,
            support: 4,
            seed_point: None,
            viewpoint: Point3::origin(),
            seed: 0,
        }
    }
}

impl ObjectOptions {
    pub(super) fn check(&self) -> Result<(), Error> {
        let refuse = |what, value, expected| {
            Err(Error::OutOfRange {
                what,
                value,
                expected,
            })
        };
        for (what, value) in [
            ("table tolerance", self.table_tolerance),
            ("table clearance", self.table_clearance),
            ("arm clearance", self.arm_clearance),
            ("depth noise", self.noise),
        ] {
            if !(value >= 0.0 && value.is_finite()) {
                return refuse(what, value, "must be finite and not negative");
            }
        }
        // Below a micrometre there is no detail, and the cells of a large cloud could no longer be counted.
        if !(1e-6..=1e3).contains(&self.voxel) {
            return refuse("voxel", self.voxel, "must be between 1 µm and 1 km");
        }
        // The mean points of neighbouring cells are up to two cells apart; with a far larger gap every voxel would be a neighbour.
        if !(2.0..=50.0).contains(&(self.gap / self.voxel)) {
            return refuse("gap", self.gap, "must be 2 to 50 voxels");
        }
        if !(0.0..=1.0).contains(&self.least_table_share) {
            return refuse(
                "least share of the table",
                self.least_table_share,
                "must be between 0 and 1",
            );
        }
        if !(self.max_incidence > 0.0 && self.max_incidence < std::f64::consts::FRAC_PI_2) {
            return refuse(
                "largest incidence",
                self.max_incidence,
                "must be between 0 and π/2",
            );
        }
        for (index, point) in [Some(self.viewpoint), self.seed_point]
            .into_iter()
            .flatten()
            .enumerate()
        {
            if !point.iter().all(|value| value.is_finite()) {
                return Err(Error::NonFinitePoint {
                    index,
                    point: point.into(),
                });
            }
        }
        if let Some((normal, offset)) = self.table {
            let height = normal.dot(&self.viewpoint.coords) + offset;
            if !(height > 0.0 && height.is_finite()) {
                return refuse(
                    "height of the camera above the table",
                    height,
                    "must be positive and finite",
                );
            }
        }
        Ok(())
    }
}
