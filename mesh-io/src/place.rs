//! Unit, size and upward axis, which files do not specify.

use std::str::FromStr;

use nalgebra::{Rotation3, Vector3};

use crate::{Error, Mesh};

/// Unit of the coordinates in a file.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(into = "f64", try_from = "f64")
)]
pub struct Units {
    metres: f64,
}

impl From<Units> for f64 {
    /// Length of one unit, m.
    fn from(units: Units) -> Self {
        units.metres
    }
}

impl TryFrom<f64> for Units {
    type Error = Error;

    /// The unit of a length in metres, which has to be finite and positive.
    fn try_from(metres: f64) -> Result<Self, Error> {
        if metres.is_finite() && metres > 0.0 {
            Ok(Self { metres })
        } else {
            Err(not_a_unit(&metres.to_string()))
        }
    }
}

fn not_a_unit(value: &str) -> Error {
    Error::BadOption {
        option: "--units",
        value: value.to_owned(),
        expected: "m, cm, mm or the length of a unit in metres",
    }
}

impl Units {
    /// Metres.
    pub const METRES: Self = Self { metres: 1.0 };
    /// Centimetres.
    pub const CENTIMETRES: Self = Self { metres: 1e-2 };
    /// Millimetres.
    pub const MILLIMETRES: Self = Self { metres: 1e-3 };

    /// Length of one unit, m.
    pub fn metres(self) -> f64 {
        self.metres
    }
}

impl Default for Units {
    fn default() -> Self {
        Self::METRES
    }
}

/// `m`, `cm`, `mm`, or the length of a unit in metres for others: `0.0254`.
impl FromStr for Units {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self, Error> {
        match text {
            "m" => Ok(Self::METRES),
            "cm" => Ok(Self::CENTIMETRES),
            "mm" => Ok(Self::MILLIMETRES),
            other => {
                let metres: Result<f64, _> = other.parse();
                let unit = metres.ok().and_then(|metres| Self::try_from(metres).ok());
                unit.ok_or_else(|| not_a_unit(other))
            }
        }
    }
}

/// The axis of the file that points up.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Up {
    /// x.
    X,
    /// y, as in most animation programs.
    Y,
    /// z, as in this workspace.
    #[default]
    Z,
}

impl Up {
    /// The rotation that takes this axis to z, permuting the axes cyclically.
    fn to_z(self) -> Rotation3<f64> {
        let [x, y, z] = [Vector3::x(), Vector3::y(), Vector3::z()];
        let rows = match self {
            Self::X => [y, z, x],
            Self::Y => [z, x, y],
            Self::Z => [x, y, z],
        };
        Rotation3::from_matrix_unchecked(nalgebra::Matrix3::from_rows(&rows.map(|r| r.transpose())))
    }
}

impl FromStr for Up {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self, Error> {
        match text {
            "x" => Ok(Self::X),
            "y" => Ok(Self::Y),
            "z" => Ok(Self::Z),
            _ => Err(Error::BadOption {
                option: "--up",
                value: text.to_owned(),
                expected: "x, y or z",
            }),
        }
    }
}

impl Mesh {
    /// All lengths times `factor`.
    #[must_use]
    pub fn scaled(mut self, factor: f64) -> Self {
        self.points.iter_mut().for_each(|p| *p *= factor);
        self
    }

    /// Rotated so that `up` becomes z.
    #[must_use]
    pub fn turned_up(mut self, up: Up) -> Self {
        if up != Up::Z {
            let turn = up.to_z();
            self.points.iter_mut().for_each(|p| *p = turn * *p);
            self.normals.iter_mut().for_each(|n| *n = turn * *n);
        }
        self
    }

    /// Scaled about the origin so that its longest extent along an axis is `size`, m.
    #[must_use]
    pub fn sized(self, size: f64) -> Self {
        let longest = self.bounds().map_or(0.0, |(low, high)| (high - low).amax());
        if longest > 0.0 {
            self.scaled(size / longest)
        } else {
            self
        }
    }
}
