//! Values that are checked as they are read, so that an error names the line of the file.

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, UnitVector3, Vector3};
use serde::{Deserialize, Serialize};

const FORMAT: &str = "explore cell";
const VERSION: u32 = 1;

/// A number that is positive and finite.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "f64", into = "f64")]
pub struct Positive(pub(super) f64);

impl Positive {
    /// # Errors
    /// The number is not.
    pub fn new(value: f64) -> Result<Self, String> {
        if value > 0.0 && value.is_finite() {
            Ok(Self(value))
        } else {
            Err(format!("{value} is not positive and finite"))
        }
    }

    /// The number.
    pub fn get(self) -> f64 {
        self.0
    }
}

impl TryFrom<f64> for Positive {
    type Error = String;

    fn try_from(value: f64) -> Result<Self, String> {
        Self::new(value)
    }
}

impl From<Positive> for f64 {
    fn from(value: Positive) -> Self {
        value.0
    }
}

/// A vector of non-zero length.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "[f64; 3]", into = "[f64; 3]")]
pub struct Direction(pub UnitVector3<f64>);

impl TryFrom<[f64; 3]> for Direction {
    type Error = String;

    fn try_from(value: [f64; 3]) -> Result<Self, String> {
        let unit = UnitVector3::try_new(Vector3::from(value), 1e-6);
        let unit = unit.filter(|unit| unit.iter().all(|x| x.is_finite()));
        unit.map(Self)
            .ok_or_else(|| format!("{value:?} is not a direction"))
    }
}

impl From<Direction> for [f64; 3] {
    fn from(value: Direction) -> Self {
        value.0.into_inner().into()
    }
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawPose {
    translation: [f64; 3],
    quaternion_xyzw: [f64; 4],
}

/// A pose.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "RawPose", into = "RawPose")]
pub struct PoseEntry(pub Isometry3<f64>);

impl TryFrom<RawPose> for PoseEntry {
    type Error = String;

    fn try_from(raw: RawPose) -> Result<Self, String> {
        let [x, y, z, w] = raw.quaternion_xyzw;
        let quaternion = Quaternion::new(w, x, y, z);
        // Typed by hand, with about four digits.
        if !(-1e-3..=1e-3).contains(&(quaternion.norm() - 1.0)) {
            return Err("the quaternion must be four numbers of norm 1, the scalar last".into());
        }
        if !raw.translation.iter().all(|x| x.is_finite()) {
            return Err("the translation must be three finite numbers, metres".into());
        }
        Ok(Self(Isometry3::from_parts(
            Translation3::from(Vector3::from(raw.translation)),
            UnitQuaternion::new_normalize(quaternion),
        )))
    }
}

impl From<PoseEntry> for RawPose {
    fn from(PoseEntry(pose): PoseEntry) -> Self {
        Self {
            translation: pose.translation.vector.into(),
            quaternion_xyzw: pose.rotation.coords.into(),
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub(super) struct Format;

impl TryFrom<String> for Format {
    type Error = String;

    fn try_from(value: String) -> Result<Self, String> {
        (value == FORMAT)
            .then_some(Self)
            .ok_or_else(|| format!("the format must be \"{FORMAT}\""))
    }
}

impl From<Format> for String {
    fn from(_: Format) -> Self {
        FORMAT.to_owned()
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "u32", into = "u32")]
pub(super) struct Version;

impl TryFrom<u32> for Version {
    type Error = String;

    fn try_from(value: u32) -> Result<Self, String> {
        (value == VERSION)
            .then_some(Self)
            .ok_or_else(|| format!("this program reads version {VERSION}"))
    }
}

impl From<Version> for u32 {
    fn from(_: Version) -> Self {
        VERSION
    }
}
