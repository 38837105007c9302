//! Stamps, frames, poses and planes: `std_msgs/Header`, `geometry_msgs/PoseStamped`, `shape_msgs/Plane`.

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, UnitVector3, Vector3};

use super::{Decoder, Encoder, Message};
use crate::Error;

const NANOSECONDS: f64 = 1e9;

/// A `builtin_interfaces/Time`: seconds and nanoseconds since the epoch (or since a simulation started).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Time {
    /// Whole seconds.
    pub sec: i32,
    /// Nanoseconds on top.
    pub nanosec: u32,
}

impl Time {
    /// The same instant in seconds. Exact to 0.3 µs for dates of this century.
    pub fn seconds(self) -> f64 {
        f64::from(self.sec) + f64::from(self.nanosec) / NANOSECONDS
    }

    /// The instant `seconds` after zero, rounded to nanoseconds.
    ///
    /// # Errors
    /// Negative, not finite, or beyond the 31 bits of a ROS 2 stamp (the year 2038).
    ///
    /// ```
    /// use dvrk_io::cdr::Time;
    ///
    /// assert_eq!(Time::from_seconds(1.5)?, Time { sec: 1, nanosec: 500_000_000 });
    /// // A fraction that rounds up to a whole second is carried over.
    /// assert_eq!(Time::from_seconds(1.999_999_999_9)?, Time { sec: 2, nanosec: 0 });
    /// assert!(Time::from_seconds(-1.0).is_err());
    /// # Ok::<(), dvrk_io::Error>(())
    /// ```
    pub fn from_seconds(seconds: f64) -> Result<Self, Error> {
        let bad = Error::OutOfRange {
            what: "stamp",
            value: seconds,
            expected: "must be between 0 and 2³¹ s",
        };
        if !(0.0..f64::from(i32::MAX)).contains(&seconds) {
            return Err(bad);
        }
        // Below 2³¹ s the product stays under 2⁶²; a fraction that rounds up to a full second carries over.
        #[allow(clippy::cast_sign_loss, reason = "checked to be positive above")]
        let nanoseconds =
            seconds.trunc() as u64 * 1_000_000_000 + (seconds.fract() * NANOSECONDS).round() as u64;
        Ok(Self::from_nanoseconds(nanoseconds))
    }

    /// Nanoseconds since zero; a stamp before zero counts as zero.
    pub fn nanoseconds(self) -> u64 {
        u64::try_from(self.sec).unwrap_or(0) * 1_000_000_000 + u64::from(self.nanosec)
    }

    /// From nanoseconds since zero; the year 2038 is the end of time.
    pub fn from_nanoseconds(nanoseconds: u64) -> Self {
        let sec = i32::try_from(nanoseconds / 1_000_000_000).unwrap_or(i32::MAX);
        Self {
            sec,
            nanosec: (nanoseconds % 1_000_000_000) as u32,
        }
    }
}

/// A `std_msgs/Header`.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Header {
    /// When the data was taken.
    pub stamp: Time,
    /// The frame it is expressed in.
    pub frame_id: String,
}

impl Header {
    pub(crate) fn read(decoder: &mut Decoder<'_>) -> Result<Self, Error> {
        let stamp = Time {
            sec: decoder.i32("header.stamp.sec")?,
            nanosec: decoder.u32("header.stamp.nanosec")?,
        };
        Ok(Self {
            stamp,
            frame_id: decoder.string("header.frame_id")?,
        })
    }

    pub(super) fn write(&self, encoder: &mut Encoder) -> Result<(), Error> {
        encoder.i32(self.stamp.sec);
        encoder.u32(self.stamp.nanosec);
        encoder.string("header.frame_id", &self.frame_id)
    }
}

/// A `geometry_msgs/Pose`, as sent: the quaternion need not have length 1.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Pose {
    /// x, y, z in metres.
    pub position: [f64; 3],
    /// x, y, z, w.
    pub orientation: [f64; 4],
}

impl Pose {
    /// The rigid transform this pose means.
    ///
    /// # Errors
    /// A coordinate that is not finite, or a quaternion whose length is not within 1 % of 1:
    /// a zero quaternion is how an uninitialised pose looks.
    pub fn isometry(&self) -> Result<Isometry3<f64>, Error> {
        let [x, y, z] = self.position;
        if let Some(&value) = self.position.iter().find(|value| !value.is_finite()) {
            return Err(Error::OutOfRange {
                what: "pose.position",
                value,
                expected: "must be finite",
            });
        }
        let [i, j, k, w] = self.orientation;
        let quaternion = Quaternion::new(w, i, j, k);
        let value = quaternion.norm();
        if !(0.99..=1.01).contains(&value) {
            let expected = "the length of a quaternion must be 1";
            return Err(Error::OutOfRange {
                what: "pose.orientation",
                value,
                expected,
            });
        }
        Ok(Isometry3::from_parts(
            Translation3::new(x, y, z),
            UnitQuaternion::new_normalize(quaternion),
        ))
    }
}

impl From<&Isometry3<f64>> for Pose {
    fn from(isometry: &Isometry3<f64>) -> Self {
        let (t, q) = (isometry.translation.vector, isometry.rotation.quaternion());
        Self {
            position: [t.x, t.y, t.z],
            orientation: [q.i, q.j, q.k, q.w],
        }
    }
}

/// A `geometry_msgs/PoseStamped`.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct PoseStamped {
    /// When, and in which frame.
    pub header: Header,
    /// The pose.
    pub pose: Pose,
}

impl Message for PoseStamped {
    const TYPE: &'static str = "geometry_msgs/msg/PoseStamped";

    fn read(decoder: &mut Decoder<'_>) -> Result<Self, Error> {
        let header = Header::read(decoder)?;
        let position = decoder.f64_array("pose.position")?;
        Ok(Self {
            header,
            pose: Pose {
                position,
                orientation: decoder.f64_array("pose.orientation")?,
            },
        })
    }

    fn write(&self, encoder: &mut Encoder) -> Result<(), Error> {
        self.header.write(encoder)?;
        encoder.f64_array(&self.pose.position);
        encoder.f64_array(&self.pose.orientation);
        Ok(())
    }
}

/// A `shape_msgs/Plane`: a·x + b·y + c·z + d = 0.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Plane {
    /// a, b, c, d.
    pub coef: [f64; 4],
}

impl Plane {
    /// Unit normal and offset (metres) of the same plane: `normal · x + offset ≥ 0` on the free side.
    ///
    /// # Errors
    /// A coefficient that is not finite, or a normal of length zero.
    pub fn normalized(&self) -> Result<(UnitVector3<f64>, f64), Error> {
        let [a, b, c, d] = self.coef;
        let (normal, length) = UnitVector3::new_and_get(Vector3::new(a, b, c));
        let offset = d / length;
        if length > 0.0 && length.is_finite() && offset.is_finite() {
            return Ok((normal, offset));
        }
        let expected = "the normal needs a length, and all of it must be finite";
        Err(Error::OutOfRange {
            what: "plane",
            value: if length > 0.0 { offset } else { length },
            expected,
        })
    }
}

impl Message for Plane {
    const TYPE: &'static str = "shape_msgs/msg/Plane";

    fn read(decoder: &mut Decoder<'_>) -> Result<Self, Error> {
        Ok(Self {
            coef: decoder.f64_array("coef")?,
        })
    }

    fn write(&self, encoder: &mut Encoder) -> Result<(), Error> {
        encoder.f64_array(&self.coef);
        Ok(())
    }
}
