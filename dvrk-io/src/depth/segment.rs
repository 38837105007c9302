//! The segmentation itself: tests that need one pixel first, then those that need its neighbours or the arms.

use nalgebra::{Isometry3, Point3, UnitVector3, Vector3};

use super::edge::EdgeTest;
use super::{Capsule, DepthImage, Intrinsics};
use crate::Error;

/// A box with its own orientation; what lies outside is of no interest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Workspace {
    /// Pose of the centre of the box in the camera frame.
    pub camera_from_center: Isometry3<f64>,
    /// Half the length of each side, metres.
    pub half_extents: Vector3<f64>,
}

impl Workspace {
    /// Whether the box, surface included, contains a point given in the camera frame.
    pub fn contains(&self, point: &Point3<f64>) -> bool {
        let local = self.camera_from_center.inverse_transform_point(point);
        local
            .iter()
            .zip(&self.half_extents)
            .all(|(value, half)| value.abs() <= *half)
    }
}

/// Settings of [`segment`]. All lengths in metres.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Segmentation {
    /// Everything outside goes. Default: no crop.
    pub workspace: Option<Workspace>,
    /// The table, `normal · x + offset ≥ 0` on its free side. Default: none.
    pub table: Option<(UnitVector3<f64>, f64)>,
    /// Everything up to this height above the table goes with it. Default 4 mm: twice the depth noise of a
    /// close stereo camera. The object loses a rim of this height where it meets the table.
    pub table_clearance: f64,
    /// How far outside of its capsule a point may still belong to an arm. Default 5 mm: what a dVRK is off
    /// after a careful registration of its base.
    pub arm_clearance: f64,
    /// Steepest trusted angle between normal and ray, radians. Default 80°: beyond it one pixel of error in
    /// the direction of a ray is six pixels of error in depth.
    pub max_incidence: f64,
    /// Differences of depth that noise alone makes. Default 2 mm.
    pub noise: f64,
    /// Neighbours (of eight) that must be level with a pixel and neither table nor outside. Default 3: a pixel in the corner of a
    /// rectangle has as many.
    pub support: usize,
}

impl Default for Segmentation {
    fn default() -> Self {
        Self {
            workspace: None,
            table: None,
            table_clearance: 0.004,
            arm_clearance: 0.005,
            max_incidence: 80_f64.to_radians(),
            noise: 0.002,
            support: 3,
        }
    }
}

impl Segmentation {
    /// The same settings with this workspace.
    #[must_use]
    pub fn with_workspace(self, workspace: Workspace) -> Self {
        Self {
            workspace: Some(workspace),
            ..self
        }
    }

    /// The same settings with this table.
    #[must_use]
    pub fn with_table(self, normal: UnitVector3<f64>, offset: f64) -> Self {
        Self {
            table: Some((normal, offset)),
            ..self
        }
    }

    /// The same settings with these clearances, metres.
    #[must_use]
    pub fn with_clearances(self, table_clearance: f64, arm_clearance: f64) -> Self {
        Self {
            table_clearance,
            arm_clearance,
            ..self
        }
    }

    /// The same settings with this definition of a depth edge: steepest angle in radians, noise in metres,
    /// and neighbours needed.
    #[must_use]
    pub fn with_edges(self, max_incidence: f64, noise: f64, support: usize) -> Self {
        Self {
            max_incidence,
            noise,
            support,
            ..self
        }
    }

    fn check(&self) -> Result<(), Error> {
        let lengths = [
            ("table clearance", self.table_clearance),
            ("arm clearance", self.arm_clearance),
            ("depth noise", self.noise),
            (
                "table offset",
                self.table.map_or(0.0, |(_, offset)| offset.abs()),
            ),
        ];
        for (what, value) in lengths {
            if !(value >= 0.0 && value.is_finite()) {
                return Err(Error::OutOfRange {
                    what,
                    value,
                    expected: "must be finite and not negative",
                });
            }
        }
        if !(self.max_incidence > 0.0 && self.max_incidence < std::f64::consts::FRAC_PI_2) {
            let expected = "must be between 0 and π/2";
            return Err(Error::OutOfRange {
                what: "largest incidence",
                value: self.max_incidence,
                expected,
            });
        }
        Ok(())
    }
}

/// How many pixels went, and why. The tests run in this order, and the first that fails counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Removed {
    /// Nothing was measured.
    pub no_depth: usize,
    /// Outside the workspace.
    pub outside: usize,
    /// The table.
    pub table: usize,
    /// Between two surfaces, or alone.
    pub flying: usize,
    /// An arm.
    pub arm: usize,
}

/// What is left: the object.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ObjectCloud {
    /// Points in the camera frame, in the order of the pixels.
    pub points: Vec<Point3<f64>>,
    /// Pixel of each point, row · width + column: for colours and features of an aligned image.
    pub pixels: Vec<usize>,
    /// What was taken away.
    pub removed: Removed,
}

/// Takes table, arms, flying pixels and surroundings out of a depth image; what is left is the object.
///
/// *Guarantees.* Every point is the back-projection of its pixel, inside the workspace, above the table by more
/// than the clearance, and outside of every capsule by more than the clearance. Each measured pixel is either in
/// the cloud or counted in [`Removed`].
///
/// *Limits.* Edges are judged by single pixels: a step of depth below `jump` is taken for a surface. What
/// stands on the table and is neither object nor arm stays in the cloud.
///
/// # Errors
/// Image and camera of different size, a setting out of range, or a capsule that is not finite.
///
/// # Complexity
/// O(pixels · (9 + capsules)).
pub fn segment(
    image: &DepthImage,
    camera: &Intrinsics,
    arms: &[Capsule],
    settings: &Segmentation,
) -> Result<ObjectCloud, Error> {
    settings.check()?;
    arms.iter()
        .enumerate()
        .try_for_each(|(index, capsule)| capsule.check(index))?;
    if (image.width(), image.height()) != (camera.width(), camera.height()) {
        let (width, height) = (camera.width(), camera.height());
        return Err(Error::ImageSize {
            width,
            height,
            length: image.width() * image.height(),
        });
    }
    let mut cloud = ObjectCloud::default();
    let candidates = candidates(image, camera, settings, &mut cloud.removed);
    let slope = settings.max_incidence.tan() * camera.ray_spacing();
    let edges = EdgeTest {
        noise: settings.noise,
        slope,
        support: settings.support,
    };
    for pixel in (0..candidates.len()).filter(|&pixel| candidates[pixel]) {
        let (column, row) = (pixel % image.width(), pixel / image.width());
        let Some(depth) = image.depth(column, row) else {
            continue;
        };
        let point = camera.back_project(column as f64, row as f64, depth);
        if edges.is_flying(image, &candidates, [column, row], depth) {
            cloud.removed.flying += 1;
        } else if arms
            .iter()
            .any(|arm| arm.distance(&point) <= settings.arm_clearance)
        {
            cloud.removed.arm += 1;
        } else {
            cloud.points.push(point);
            cloud.pixels.push(pixel);
        }
    }
    Ok(cloud)
}

/// The pixels that are measured, inside the workspace and above the table: those tests look at one pixel only.
fn candidates(
    image: &DepthImage,
    camera: &Intrinsics,
    settings: &Segmentation,
    removed: &mut Removed,
) -> Vec<bool> {
    let mut is_candidate = |column: usize, row: usize| {
        let Some(depth) = image.depth(column, row) else {
            removed.no_depth += 1;
            return false;
        };
        let point = camera.back_project(column as f64, row as f64, depth);
        if settings
            .workspace
            .is_some_and(|workspace| !workspace.contains(&point))
        {
            removed.outside += 1;
            return false;
        }
        let is_table = settings
            .table
            .is_some_and(|table| height_above(table, &point) <= settings.table_clearance);
        removed.table += usize::from(is_table);
        !is_table
    };
    let (width, height) = (image.width(), image.height());
    (0..width * height)
        .map(|pixel| is_candidate(pixel % width, pixel / width))
        .collect()
}

fn height_above((normal, offset): (UnitVector3<f64>, f64), point: &Point3<f64>) -> f64 {
    normal.dot(&point.coords) + offset
}
