//! The table, the arms and their workspaces.
//!
//! Everything is in the camera frame, metres. A tip frame has its origin midway between the jaws, +z along
//! the approach (from the wrist to the object) and ±y along the direction in which the jaws open.

use std::fmt;
use std::sync::Arc;

use nalgebra::{Isometry3, Point3, UnitVector3, Vector3};

use crate::Error;

/// The plane `normal · x + offset = 0`; `normal` points to the free side, where `normal · x + offset ≥ 0`.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Plane {
    /// Unit normal, toward the free side.
    pub normal: UnitVector3<f64>,
    /// Offset in metres.
    pub offset: f64,
}

impl Plane {
    /// Signed height of `point` above the plane, in metres.
    pub fn height(&self, point: &Point3<f64>) -> f64 {
        self.normal.dot(&point.coords) + self.offset
    }

    /// `point`, or the nearest point of the plane if it lies under it.
    pub fn above(&self, point: &Point3<f64>) -> Point3<f64> {
        point - self.normal.as_ref() * self.height(point).min(0.0)
    }

    /// The plane moved by a rigid motion.
    #[must_use]
    pub fn carried(&self, motion: &Isometry3<f64>) -> Self {
        let normal = motion.rotation * self.normal;
        Self {
            normal,
            offset: self.offset - normal.dot(&motion.translation.vector),
        }
    }

    /// The point of the plane below `point`.
    pub fn foot(&self, point: &Point3<f64>) -> Point3<f64> {
        point - self.normal.as_ref() * self.height(point)
    }

    /// The component of `v` along the plane.
    pub fn along(&self, v: &Vector3<f64>) -> Vector3<f64> {
        v - self.normal.as_ref() * self.normal.dot(v)
    }

    /// Two unit vectors that span the plane, `(u, v, normal)` right-handed.
    pub fn axes(&self) -> [UnitVector3<f64>; 2] {
        let n = self.normal;
        // The coordinate axis with the least component along the normal gives the best conditioned cross product.
        let helper = match n.iamin() {
            0 => Vector3::x(),
            1 => Vector3::y(),
            _ => Vector3::z(),
        };
        let u = UnitVector3::new_normalize(helper - n.as_ref() * n.dot(&helper));
        [u, UnitVector3::new_normalize(n.cross(&u))]
    }
}

/// A test on a tip pose, `camera_from_tip`.
pub type PoseTest = Arc<dyn Fn(&Isometry3<f64>) -> bool + Send + Sync>;

/// Positions or poses that the tip of an arm can reach.
#[derive(Clone)]
#[non_exhaustive]
pub enum Workspace {
    /// A box about the origin of its own frame.
    Box {
        /// Pose of the box.
        camera_from_box: Isometry3<f64>,
        /// Half its sides.
        half_extents: Vector3<f64>,
    },
    /// All points within `radius` of `center`.
    Ball {
        /// Centre.
        center: Point3<f64>,
        /// Radius.
        radius: f64,
    },
    /// A truncated cone between two spheres, the workspace of an arm with a remote centre of motion.
    SphereSector {
        /// The fixed point.
        apex: Point3<f64>,
        /// Axis of the cone.
        axis: UnitVector3<f64>,
        /// Angle between the axis and the surface of the cone, radians.
        half_angle: f64,
        /// Smallest and largest distance from the apex.
        radii: [f64; 2],
    },
    /// Any test on the pose of the tip, for example with wrist limits.
    Custom(PoseTest),
}

impl Workspace {
    /// Whether the tip may be at `camera_from_tip`.
    pub fn contains(&self, camera_from_tip: &Isometry3<f64>) -> bool {
        let tip = Point3::from(camera_from_tip.translation.vector);
        match self {
            Self::Box {
                camera_from_box,
                half_extents,
            } => {
                let p = camera_from_box.inverse_transform_point(&tip);
                (0..3).all(|k| p[k].abs() <= half_extents[k])
            }
            Self::Ball { center, radius } => (tip - center).norm() <= *radius,
            Self::SphereSector {
                apex,
                axis,
                half_angle,
                radii,
            } => {
                let d = tip - apex;
                let r = d.norm();
                let angle = d.cross(axis).norm().atan2(d.dot(axis));
                (radii[0]..=radii[1]).contains(&r) && angle <= *half_angle
            }
            Self::Custom(test) => test(camera_from_tip),
        }
    }
}

impl Workspace {
    /// Whether its numbers are finite and its sizes not negative.
    fn is_sound(&self) -> bool {
        let finite = |p: &Point3<f64>| p.iter().all(|x| x.is_finite());
        match self {
            Self::Box {
                camera_from_box,
                half_extents,
            } => {
                camera_from_box
                    .to_homogeneous()
                    .iter()
                    .all(|x| x.is_finite())
                    && half_extents.iter().all(|x| *x >= 0.0)
            }
            Self::Ball { center, radius } => finite(center) && *radius >= 0.0,
            Self::SphereSector {
                apex,
                axis,
                half_angle,
                radii,
            } => {
                finite(apex)
                    && axis.iter().all(|x| x.is_finite())
                    && *half_angle >= 0.0
                    && 0.0 <= radii[0]
                    && radii[0] <= radii[1]
            }
            Self::Custom(_) => true,
        }
    }
}

impl fmt::Debug for Workspace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Box {
                camera_from_box,
                half_extents,
            } => f
                .debug_struct("Box")
                .field("camera_from_box", camera_from_box)
                .field("half_extents", half_extents)
                .finish(),
            Self::Ball { center, radius } => f
                .debug_struct("Ball")
                .field("center", center)
                .field("radius", radius)
                .finish(),
            Self::SphereSector {
                apex,
                axis,
                half_angle,
                radii,
            } => f
                .debug_struct("SphereSector")
                .field("apex", apex)
                .field("axis", axis)
                .field("half_angle", half_angle)
                .field("radii", radii)
                .finish(),
            Self::Custom(_) => f.write_str("Custom(..)"),
        }
    }
}

/// An arm.
#[derive(Debug, Clone)]
pub struct Arm {
    /// Position of the base of the arm.
    pub base: Point3<f64>,
    /// Workspace of its tip.
    pub workspace: Workspace,
    /// Pose in which the tip waits without hiding the object (`camera_from_tip`).
    pub home: Isometry3<f64>,
    /// Largest speed of the tip, m/s.
    pub max_speed: f64,
}

/// The environment of the object.
#[derive(Debug, Clone, Copy)]
pub struct Scene<'a> {
    /// The table.
    pub table: Plane,
    /// The arms.
    pub arms: &'a [Arm],
    /// Position of the camera.
    pub camera: Point3<f64>,
    /// Half the width that fits between the open jaws; also half the thickness of a tool.
    pub jaw_radius: f64,
    /// Length of the straight part of a tool behind its tip, from the tip to the wrist.
    pub shaft_length: f64,
    /// Smallest distance between two grips.
    pub jaw_separation: f64,
    /// Least distance between a tip and the table, and between two tools.
    pub clearance: f64,
}

impl Scene<'_> {
    /// Least distance between the centre line of a tool and the body: half the thickness of a tool is half the opening of its jaws.
    pub(crate) fn tool_radius(&self) -> f64 {
        0.5 * self.jaw_radius
    }

    /// The part of a tool that straddles the surface while it holds; only the part behind it can collide with the body.
    pub(crate) fn jaw_length(&self) -> f64 {
        2.5 * self.jaw_radius
    }

    /// Rejects values that are not finite or not positive.
    pub(crate) fn check(&self) -> Result<(), Error> {
        positive("jaw_radius", self.jaw_radius)?;
        positive("shaft_length", self.shaft_length)?;
        not_negative("jaw_separation", self.jaw_separation)?;
        not_negative("clearance", self.clearance)?;
        if !self.camera.iter().all(|x| x.is_finite()) {
            return Err(Error::BadSetting {
                name: "camera",
                value: f64::NAN,
                expected: "finite",
            });
        }
        if !(self.table.offset.is_finite() && (self.table.normal.norm() - 1.0).abs() < 1e-6) {
            return Err(Error::BadSetting {
                name: "table",
                value: self.table.offset,
                expected: "a unit normal and a finite offset",
            });
        }
        self.arms
            .iter()
            .enumerate()
            .try_for_each(|(arm, a)| check_arm(arm, a))
    }
}

fn check_arm(arm: usize, a: &Arm) -> Result<(), Error> {
    if !a.base.iter().all(|x| x.is_finite()) {
        return Err(Error::BadArm {
            arm,
            what: "its base",
        });
    }
    if !a.home.to_homogeneous().iter().all(|x| x.is_finite()) {
        return Err(Error::BadArm {
            arm,
            what: "its home",
        });
    }
    if !a.workspace.is_sound() {
        return Err(Error::BadArm {
            arm,
            what: "its workspace",
        });
    }
    if !(a.max_speed.is_finite() && a.max_speed > 0.0) {
        return Err(Error::BadArm {
            arm,
            what: "its largest speed",
        });
    }
    Ok(())
}

pub(crate) fn positive(name: &'static str, value: f64) -> Result<(), Error> {
    if value.is_finite() && value > 0.0 {
        return Ok(());
    }
    Err(Error::BadSetting {
        name,
        value,
        expected: "finite and above 0",
    })
}

pub(crate) fn not_negative(name: &'static str, value: f64) -> Result<(), Error> {
    if value.is_finite() && value >= 0.0 {
        return Ok(());
    }
    Err(Error::BadSetting {
        name,
        value,
        expected: "finite and at least 0",
    })
}

pub(crate) fn within(
    name: &'static str,
    value: f64,
    low: f64,
    high: f64,
    expected: &'static str,
) -> Result<(), Error> {
    if value >= low && value <= high {
        return Ok(());
    }
    Err(Error::BadSetting {
        name,
        value,
        expected,
    })
}
