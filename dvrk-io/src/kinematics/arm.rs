//! Lengths and joint limits of an arm with its instrument.
//!
//! ```text
//! joint          Classic            S, Si              unit
//! yaw            ±1.588             ±2.964             rad
//! pitch          ±0.925             −1.265 … 1.301     rad
//! insertion      0 … 0.240          0 … 0.290          m
//! roll           ±4.53786           ±4.53786           rad   (260°)
//! wrist pitch    ±1.39626           ±1.39626           rad   (80°)
//! wrist yaw      ±1.39626           ±1.39626           rad   (80°)
//! carriage       0.4318             0.4826             m
//! shaft          0.4162 (400006)    0.4670 (420006)    m     large needle driver
//! wrist          0.0091             0.0091             m
//! ```
//! Source: PSM.json, PSM_Si.json and the tool files of sawIntuitiveResearchKit 2.4. The length of the jaws,
//! 10.2 mm, is in the dVRK model files (URDF) only.

use derive_setters::Setters;
use std::f64::consts::FRAC_PI_2;
use std::fmt;

use crate::{Error, Psm};

/// The joints of a PSM, in the order of its joint values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Joint {
    /// About the y axis of the remote centre.
    Yaw,
    /// About the axis moved by yaw.
    Pitch,
    /// Along the shaft; the one joint in metres.
    Insertion,
    /// About the shaft.
    Roll,
    /// First wrist joint.
    WristPitch,
    /// Second wrist joint, the axis that the jaws turn about.
    WristYaw,
}

impl Joint {
    /// All six, in the order of the joint values.
    pub const ALL: [Self; 6] = [
        Self::Yaw,
        Self::Pitch,
        Self::Insertion,
        Self::Roll,
        Self::WristPitch,
        Self::WristYaw,
    ];

    /// The name that the robot gives it in `measured_js`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Yaw => "yaw",
            Self::Pitch => "pitch",
            Self::Insertion => "insertion",
            Self::Roll => "roll",
            Self::WristPitch => "wrist_pitch",
            Self::WristYaw => "wrist_yaw",
        }
    }

    /// Unit of its value: `m` or `rad`.
    pub fn unit(self) -> &'static str {
        if self == Self::Insertion { "m" } else { "rad" }
    }
}

impl fmt::Display for Joint {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(self.name())
    }
}

/// Lengths of an instrument, metres. The default is the large needle driver of a Classic.
#[derive(Debug, Clone, Copy, PartialEq, Setters)]
#[setters(prefix = "with_")]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct Instrument {
    /// Roll joint to wrist pitch axis, in the convention of the robot's tool files.
    pub shaft: f64,
    /// Wrist pitch axis to wrist yaw axis; positive.
    pub wrist: f64,
    /// Wrist yaw axis to the tips of the closed jaws; the robot does not include it in its poses. With 0, poses are those
    /// of the wrist itself.
    pub jaw: f64,
}

impl Default for Instrument {
    fn default() -> Self {
        Self::LARGE_NEEDLE_DRIVER_400006
    }
}

impl Instrument {
    /// Large needle driver of a Classic.
    pub const LARGE_NEEDLE_DRIVER_400006: Self = Self {
        shaft: 0.4162,
        wrist: 0.0091,
        jaw: 0.0102,
    };
    /// Large needle driver of an S or Si. The 10.2 mm of its jaws are in the model files, and are also assumed
    /// for 400006, whose model lacks them.
    pub const LARGE_NEEDLE_DRIVER_420006: Self = Self {
        shaft: 0.4670,
        ..Self::LARGE_NEEDLE_DRIVER_400006
    };
}

/// The kinematics of one arm with one instrument: lengths, joint limits, checked once.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(try_from = "Unchecked")
)]
pub struct Kinematics {
    pub(super) carriage: f64,
    pub(super) instrument: Instrument,
    pub(super) limits: [[f64; 2]; 6],
    pub(super) min_wrist_distance: f64,
}

/// Kinematics as read, before the checks.
#[cfg(feature = "serde")]
#[derive(serde::Deserialize)]
struct Unchecked {
    carriage: f64,
    instrument: Instrument,
    limits: [[f64; 2]; 6],
    min_wrist_distance: f64,
}

#[cfg(feature = "serde")]
impl TryFrom<Unchecked> for Kinematics {
    type Error = Error;

    fn try_from(read: Unchecked) -> Result<Self, Error> {
        if !(0.0..=1.0).contains(&read.carriage) {
            return Err(Error::OutOfRange {
                what: "carriage",
                value: read.carriage,
                expected: "must be 0 to 1 m",
            });
        }
        let arm = Self {
            carriage: read.carriage,
            ..Self::new(Psm::Classic)
        };
        arm.with_instrument(read.instrument)?
            .with_limits(read.limits)?
            .with_min_wrist_distance(read.min_wrist_distance)
    }
}

/// The robot silently pushes the end of the shaft out to this distance from the remote centre. Metres.
const MIN_WRIST_DISTANCE: f64 = 0.045;
/// The robot rejects goals nearer to the remote centre than this. Metres.
const REFUSED_DISTANCE: f64 = 0.001;
/// Beyond this pitch yaw is ill-defined: cos(1.55) = 0.02.
const STEEPEST_PITCH: f64 = 1.55;

impl Kinematics {
    /// The arm of a generation with the large needle driver of that generation.
    pub fn new(psm: Psm) -> Self {
        let wrist = [-1.39626, 1.39626];
        let roll = [-4.53786, 4.53786];
        let (carriage, instrument, [yaw, pitch, insertion]) = match psm {
            Psm::Classic => (
                0.4318,
                Instrument::LARGE_NEEDLE_DRIVER_400006,
                [[-1.588, 1.588], [-0.925, 0.925], [0.0, 0.240]],
            ),
            Psm::Si => (
                0.4826,
                Instrument::LARGE_NEEDLE_DRIVER_420006,
                [[-2.964, 2.964], [-1.265, 1.301], [0.0, 0.290]],
            ),
        };
        Self {
            carriage,
            instrument,
            limits: [yaw, pitch, insertion, roll, wrist, wrist],
            min_wrist_distance: MIN_WRIST_DISTANCE,
        }
    }

    /// The same with another instrument.
    ///
    /// # Errors
    /// A length that is not in [0, 1] m, or a wrist of less than 0.1 mm.
    pub fn with_instrument(self, instrument: Instrument) -> Result<Self, Error> {
        let range = |what, value: f64, least: f64, expected| {
            if (least..=1.0).contains(&value) {
                Ok(())
            } else {
                Err(Error::OutOfRange {
                    what,
                    value,
                    expected,
                })
            }
        };
        range("shaft", instrument.shaft, 0.0, "must be 0 to 1 m")?;
        range(
            "wrist link",
            instrument.wrist,
            1e-4,
            "must be 0.0001 to 1 m",
        )?;
        range("jaw length", instrument.jaw, 0.0, "must be 0 to 1 m")?;
        Ok(Self { instrument, ..self })
    }

    /// The same with other joint limits, `[lower, upper]` for each of [`Joint::ALL`]. The maintainers' simulators have
    /// tighter limits than the robot; so has a cell with obstacles.
    ///
    /// # Errors
    /// A limit that is not finite or beyond ±100, an empty range, a pitch beyond ±1.55 rad (where yaw is
    /// ill-defined) or a wrist pitch beyond ±π/2 (where the wrist is singular).
    pub fn with_limits(self, limits: [[f64; 2]; 6]) -> Result<Self, Error> {
        for (joint, [lower, upper]) in Joint::ALL.into_iter().zip(limits) {
            let (bound, expected) = match joint {
                Joint::Pitch => (STEEPEST_PITCH, "must be within ±1.55 rad, lower ≤ upper"),
                Joint::WristPitch => (FRAC_PI_2, "must be within ±π/2 rad, lower ≤ upper"),
                _ => (100.0, "must be within ±100, lower ≤ upper"),
            };
            let inside = |value: f64| value.abs() <= bound;
            if !(inside(lower) && inside(upper) && lower <= upper) {
                return Err(Error::OutOfRange {
                    what: joint.name(),
                    value: if inside(lower) { upper } else { lower },
                    expected,
                });
            }
        }
        Ok(Self { limits, ..self })
    }

    /// The same with another least distance between remote centre and wrist pitch axis, metres. At the default, 45 mm,
    /// the robot itself silently moves the goal.
    ///
    /// # Errors
    /// Less than 1 mm, where the robot rejects goals, or more than 1 m.
    pub fn with_min_wrist_distance(self, distance: f64) -> Result<Self, Error> {
        if !(REFUSED_DISTANCE..=1.0).contains(&distance) {
            return Err(Error::OutOfRange {
                what: "least distance of the wrist from the remote centre",
                value: distance,
                expected: "must be 0.001 to 1 m",
            });
        }
        Ok(Self {
            min_wrist_distance: distance,
            ..self
        })
    }

    /// Lengths of the instrument.
    pub fn instrument(&self) -> Instrument {
        self.instrument
    }

    /// `[lower, upper]` for each of [`Joint::ALL`]: radians, metres for the insertion.
    pub fn limits(&self) -> &[[f64; 2]; 6] {
        &self.limits
    }

    /// Least distance between remote centre and wrist pitch axis, metres.
    pub fn min_wrist_distance(&self) -> f64 {
        self.min_wrist_distance
    }

    /// Insertion minus the distance of the wrist pitch axis from the remote centre, metres: 15.6 mm for
    /// both generations with their own instruments.
    pub(crate) fn wrist_before_insertion(&self) -> f64 {
        self.carriage - self.instrument.shaft
    }
}
