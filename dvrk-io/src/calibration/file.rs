//! A calibration as a TOML file with explicit frames and units.
//!
//! ```toml
//! format = "dvrk-io calibration"
//! version = 1
//! arm = "PSM1"
//! method = "touches"
//!
//! [units]
//! length = "m"
//! angle = "rad"
//!
//! [camera_from_rcm]
//! target = "camera_depth_optical_frame"
//! source = "PSM1_base"
//! translation = [0.1, 0.0, 0.4]
//! quaternion_xyzw = [0.0, 0.0, 0.0, 1.0]
//!
//! [residuals]
//! samples = 12
//! outliers = [5]
//! rms = 0.0004
//! max = 0.0007
//! rms_angle = 0.0
//! max_angle = 0.0
//! ```
//! A marker adds `[wrist_from_marker]`, with the same keys. A transform maps coordinates in `source` to
//! coordinates in `target`. Numbers are written with all digits and are read back to the same bits.

use std::fs;
use std::io::Write;
use std::ops::Range;
use std::path::Path;

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use toml::Spanned;

use super::Fit;
use crate::Error;
use crate::kinematics::check_pose;

const FORMAT: &str = "dvrk-io calibration";
const VERSION: i64 = 1;
const WRIST: &str = "wrist";
const MARKER: &str = "marker";
/// Quaternions this close to norm 1 are used unchanged, so that bits are preserved; others, typed by hand, are
/// normalised.
const EXACT: f64 = 1e-14;

/// The kind of samples of a calibration.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Method {
    /// Touched points.
    Touches,
    /// Poses of a marker.
    Sightings,
}

/// The pose of an arm relative to a camera, and its accuracy when it was determined.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Calibration {
    /// The arm, such as `PSM1`.
    pub arm: String,
    /// Name of the camera frame: +z along the optical axis, x to the right, y down.
    pub camera_frame: String,
    /// Name of the frame of the remote centre, such as `PSM1_base`.
    pub rcm_frame: String,
    /// The kind of samples.
    pub method: Method,
    /// Pose of the remote centre in the camera frame.
    pub camera_from_rcm: Isometry3<f64>,
    /// Pose of the marker in the wrist frame, if there was one.
    pub wrist_from_marker: Option<Isometry3<f64>>,
    /// Number of samples.
    pub samples: usize,
    /// Indices of the outliers.
    pub outliers: Vec<usize>,
    /// Root mean square of the distances of the inliers, metres.
    pub rms: f64,
    /// Largest distance of the inliers, metres.
    pub max: f64,
    /// Root mean square of the angles of the inliers, radians; 0 for touches.
    pub rms_angle: f64,
    /// Largest angle of the inliers, radians; 0 for touches.
    pub max_angle: f64,
}

impl Calibration {
    /// A fit with the names of its frames.
    ///
    /// # Errors
    /// A name that is empty or holds control characters.
    pub fn new(arm: &str, camera_frame: &str, rcm_frame: &str, fit: &Fit) -> Result<Self, Error> {
        let residuals = &fit.residuals;
        let calibration = Self {
            arm: arm.to_owned(),
            camera_frame: camera_frame.to_owned(),
            rcm_frame: rcm_frame.to_owned(),
            method: fit.method(),
            camera_from_rcm: fit.camera_from_rcm,
            wrist_from_marker: fit.wrist_from_marker,
            samples: residuals.distances.len(),
            outliers: residuals.outliers.clone(),
            rms: residuals.rms,
            max: residuals.max,
            rms_angle: residuals.rms_angle,
            max_angle: residuals.max_angle,
        };
        calibration.to_toml()?;
        Ok(calibration)
    }

    /// The transform in the camera convention of the dVRK (x left, y up, z away) instead of that of ROS and
    /// this crate (x right, y down, z away), for use in its base frames.
    pub fn dvrk_camera_from_rcm(&self) -> Isometry3<f64> {
        let half_turn = UnitQuaternion::from_quaternion(Quaternion::new(0.0, 0.0, 0.0, 1.0));
        half_turn * self.camera_from_rcm
    }

    /// The text of the file.
    ///
    /// # Errors
    /// [`Error::BadCalibration`] with the key of an invalid value: a name that is empty, a number that is
    /// not finite.
    pub fn to_toml(&self) -> Result<String, Error> {
        let transform = |pose: &Isometry3<f64>, target: &str, source: &str| Transform {
            target: target.to_owned().into_unplaced(),
            source: source.to_owned().into_unplaced(),
            translation: <[f64; 3]>::from(pose.translation.vector).into_unplaced(),
            quaternion_xyzw: <[f64; 4]>::from(pose.rotation.coords).into_unplaced(),
        };
        let file = File {
            format: FORMAT.to_owned(),
            version: VERSION,
            arm: self.arm.clone().into_unplaced(),
            method: self.method.into_unplaced(),
            units: Units {
                length: "m".to_owned().into_unplaced(),
                angle: "rad".to_owned().into_unplaced(),
            },
            camera_from_rcm: transform(&self.camera_from_rcm, &self.camera_frame, &self.rcm_frame),
            wrist_from_marker: self
                .wrist_from_marker
                .map(|pose| transform(&pose, WRIST, MARKER)),
            residuals: Table {
                samples: self.samples,
                outliers: self.outliers.clone().into_unplaced(),
                rms: self.rms.into_unplaced(),
                max: self.max.into_unplaced(),
                rms_angle: self.rms_angle.into_unplaced(),
                max_angle: self.max_angle.into_unplaced(),
            },
        };
        let text = toml::to_string(&file).map_err(|error| Error::BadCalibration {
            line: 0,
            key: "calibration".to_owned(),
            reason: error.to_string(),
        })?;
        // A file that could not be read back is not written.
        Self::from_toml(text.as_bytes())?;
        Ok(text)
    }

    /// Reads the text of a file.
    ///
    /// # Errors
    /// [`Error::BadCalibration`] with line and key: not UTF-8, not TOML, a key that is missing, unknown or of the
    /// wrong type, another format, version or unit, a number that is not finite, a quaternion that is not a unit.
    pub fn from_toml(bytes: &[u8]) -> Result<Self, Error> {
        let text = str::from_utf8(bytes).map_err(|error| Error::BadCalibration {
            line: newlines(&bytes[..error.valid_up_to()]) + 1,
            key: "text".to_owned(),
            reason: "is not UTF-8".to_owned(),
        })?;
        let malformed = |error: toml::de::Error| bad(text, error.span(), error.message());
        // The version first: a newer file has keys that this one does not know.
        let head: Head = toml::from_str(text).map_err(malformed)?;
        if head.format.get_ref() != FORMAT {
            return Err(bad(
                text,
                Some(head.format.span()),
                &format!("must be \"{FORMAT}\""),
            ));
        }
        if *head.version.get_ref() != VERSION {
            let reason = format!("this program reads version {VERSION}");
            return Err(bad(text, Some(head.version.span()), &reason));
        }
        let file: File = toml::from_str(text).map_err(malformed)?;
        file.check(text)
    }

    /// Writes the file, replacing an existing one.
    ///
    /// # Errors
    /// See [`Calibration::to_toml`]; [`Error::Io`].
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), Error> {
        let path = path.as_ref();
        let text = self.to_toml()?;
        let io = |error| Error::Io {
            path: path.to_owned(),
            error,
        };
        // Written to a temporary file first: after a crash there is the old file or the new one.
        let mut partial = path.as_os_str().to_owned();
        partial.push(".partial");
        let mut file = fs::File::create(&partial).map_err(io)?;
        file.write_all(text.as_bytes()).map_err(io)?;
        file.sync_all().map_err(io)?;
        fs::rename(&partial, path).map_err(io)
    }

    /// Reads the file.
    ///
    /// # Errors
    /// See [`Calibration::from_toml`]; [`Error::Io`].
    pub fn load(path: impl AsRef<Path>) -> Result<Self, Error> {
        let path = path.as_ref();
        let bytes = fs::read(path).map_err(|error| Error::Io {
            path: path.to_owned(),
            error,
        })?;
        Self::from_toml(&bytes)
    }
}

#[derive(Deserialize)]
struct Head {
    format: Spanned<String>,
    version: Spanned<i64>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    format: String,
    version: i64,
    arm: Spanned<String>,
    method: Spanned<Method>,
    units: Units,
    camera_from_rcm: Transform,
    #[serde(skip_serializing_if = "Option::is_none")]
    wrist_from_marker: Option<Transform>,
    residuals: Table,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Units {
    length: Spanned<String>,
    angle: Spanned<String>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Transform {
    target: Spanned<String>,
    source: Spanned<String>,
    translation: Spanned<[f64; 3]>,
    quaternion_xyzw: Spanned<[f64; 4]>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Table {
    samples: usize,
    outliers: Spanned<Vec<usize>>,
    rms: Spanned<f64>,
    max: Spanned<f64>,
    rms_angle: Spanned<f64>,
    max_angle: Spanned<f64>,
}

/// A value without a place in the file yet.
trait Unplaced: Sized {
    fn into_unplaced(self) -> Spanned<Self> {
        Spanned::new(0..0, self)
    }
}

impl<T> Unplaced for T {}

impl File {
    fn check(self, text: &str) -> Result<Calibration, Error> {
        for (unit, expected) in [(&self.units.length, "m"), (&self.units.angle, "rad")] {
            if unit.get_ref() != expected {
                return Err(bad(
                    text,
                    Some(unit.span()),
                    &format!("must be \"{expected}\""),
                ));
            }
        }
        let name = |name: &Spanned<String>| {
            let value = name.get_ref();
            if value.trim().is_empty() || value.chars().any(char::is_control) {
                return Err(bad(text, Some(name.span()), "must be a name"));
            }
            Ok(value.clone())
        };
        let residual = |value: &Spanned<f64>| {
            if *value.get_ref() >= 0.0 && value.get_ref().is_finite() {
                Ok(*value.get_ref())
            } else {
                Err(bad(
                    text,
                    Some(value.span()),
                    "must be finite and not negative",
                ))
            }
        };
        let table = &self.residuals;
        let outliers = table.outliers.get_ref();
        if !outliers.is_sorted_by(|a, b| a < b)
            || outliers.last().is_some_and(|&last| last >= table.samples)
        {
            let reason = "must be rising and below `samples`";
            return Err(bad(text, Some(table.outliers.span()), reason));
        }
        let wrist_from_marker = match &self.wrist_from_marker {
            Some(transform) => {
                for (frame, expected) in [(&transform.target, WRIST), (&transform.source, MARKER)] {
                    if frame.get_ref() != expected {
                        return Err(bad(
                            text,
                            Some(frame.span()),
                            &format!("must be \"{expected}\""),
                        ));
                    }
                }
                Some(transform.pose(text)?)
            }
            None => None,
        };
        let method = *self.method.get_ref();
        if (method == Method::Sightings) != wrist_from_marker.is_some() {
            let reason = "\"sightings\" go with a table [wrist_from_marker], \"touches\" without";
            return Err(bad(text, Some(self.method.span()), reason));
        }
        Ok(Calibration {
            arm: name(&self.arm)?,
            camera_frame: name(&self.camera_from_rcm.target)?,
            rcm_frame: name(&self.camera_from_rcm.source)?,
            method,
            camera_from_rcm: self.camera_from_rcm.pose(text)?,
            wrist_from_marker,
            samples: table.samples,
            outliers: outliers.clone(),
            rms: residual(&table.rms)?,
            max: residual(&table.max)?,
            rms_angle: residual(&table.rms_angle)?,
            max_angle: residual(&table.max_angle)?,
        })
    }
}

impl Transform {
    fn pose(&self, text: &str) -> Result<Isometry3<f64>, Error> {
        let [x, y, z, w] = *self.quaternion_xyzw.get_ref();
        let quaternion = Quaternion::new(w, x, y, z);
        let translation = Translation3::from(Vector3::from(*self.translation.get_ref()));
        // Typed by hand, with about four digits.
        if !(-1e-3..=1e-3).contains(&(quaternion.norm() - 1.0)) {
            let reason = "must be four numbers of norm 1, the scalar last";
            return Err(bad(text, Some(self.quaternion_xyzw.span()), reason));
        }
        let rotation = if (quaternion.norm() - 1.0).abs() <= EXACT {
            UnitQuaternion::new_unchecked(quaternion)
        } else {
            UnitQuaternion::new_normalize(quaternion)
        };
        let pose = Isometry3::from_parts(translation, rotation);
        if check_pose(&pose).is_err() {
            let reason = "must be three finite numbers, metres";
            return Err(bad(text, Some(self.translation.span()), reason));
        }
        Ok(pose)
    }
}

/// The error at `place` of `text`: with its line, and its key or table.
fn bad(text: &str, place: Option<Range<usize>>, reason: &str) -> Error {
    let start = place.map_or(0, |place| place.start.min(text.len()));
    let before = newlines(&text.as_bytes()[..start]);
    let named = text.lines().take(before + 1).filter_map(|line| {
        let line = line.trim();
        let key = line.split_once('=').map(|(key, _)| key.trim());
        key.or_else(|| line.strip_prefix('[')?.strip_suffix(']'))
    });
    Error::BadCalibration {
        line: before + 1,
        key: named.last().unwrap_or("file").chars().take(60).collect(),
        reason: reason.to_owned(),
    }
}

fn newlines(bytes: &[u8]) -> usize {
    bytes.split(|&byte| byte == b'\n').count() - 1
}
