//! CDR, the wire format of ROS 2, for the messages of sessions, arms and cameras.
//!
//! ```text
//! message = header(4 bytes: 0x00, endianness, 0x00, 0x00) · body
//! primitive of size s        starts at a multiple of s, counted from the first byte of the body
//! string                     u32 length with the NUL · bytes · NUL
//! sequence<T>                u32 count · T · T · …       (an empty one adds no padding)
//! T[n], struct               their parts one after the other
//! ```
//!
//! This is plain CDR, version 1 (the OMG's XCDR1 without mutable types), which every ROS 2 middleware
//! speaks. Both byte orders are read and written. The decoder does not trust the input: each length is compared
//! with the remaining bytes before anything is allocated, so random bytes give an [`Error`] with
//! offset and field, never a panic and never more memory than the message itself takes.

mod decoder;
mod encoder;
mod geometry;
mod image;
mod joint_state;
mod joy;
mod point_cloud;
mod standard;
mod state;
mod twist;

pub use decoder::Decoder;
pub use encoder::Encoder;
pub use geometry::{Header, Plane, Pose, PoseStamped, Time};
pub use image::{CameraInfo, Image};
pub use joint_state::JointState;
pub use joy::Joy;
pub use point_cloud::{PointCloud2, PointField};
pub use standard::{Bool, Empty, Float64, Text};
pub use state::{OperatingState, StringStamped};
pub use twist::{TwistStamped, WrenchStamped};

use crate::Error;

/// Order of the bytes of a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Endian {
    /// Most significant byte first.
    Big,
    /// Least significant byte first: what ROS 2 machines send.
    #[default]
    Little,
}

/// A ROS 2 message with a CDR body.
pub trait Message: Sized {
    /// Its ROS 2 type, `package/msg/Name`.
    const TYPE: &'static str;

    /// Reads the message at the position of the decoder.
    ///
    /// # Errors
    /// The bytes end early, or a string is malformed.
    fn read(decoder: &mut Decoder<'_>) -> Result<Self, Error>;

    /// Appends the message.
    ///
    /// # Errors
    /// A string or sequence with more than 2³² − 1 elements.
    fn write(&self, encoder: &mut Encoder) -> Result<(), Error>;
}

/// Reads one message with its encapsulation header. Bytes after the message are padding and ignored.
///
/// # Errors
/// See [`Message::read`]; also an encapsulation that is not plain CDR.
pub fn decode<M: Message>(bytes: &[u8]) -> Result<M, Error> {
    M::read(&mut Decoder::new(bytes)?)
}

/// Writes one message with its encapsulation header.
///
/// # Errors
/// See [`Message::write`].
///
/// ```
/// use dvrk_io::cdr::{Endian, Text, decode, encode};
///
/// let text = Text { data: "hi".into() };
/// let little = encode(&text, Endian::Little)?;
/// // Header, length with the NUL, bytes, NUL.
/// assert_eq!(little, [0, 1, 0, 0, 3, 0, 0, 0, b'h', b'i', 0]);
/// let big = encode(&text, Endian::Big)?;
/// assert_eq!(big[..8], [0, 0, 0, 0, 0, 0, 0, 3]);
/// assert_eq!((decode::<Text>(&little)?, decode::<Text>(&big)?), (text.clone(), text));
/// // A message that ends early is an error.
/// assert!(decode::<Text>(&little[..9]).is_err());
/// # Ok::<(), dvrk_io::Error>(())
/// ```
pub fn encode<M: Message>(message: &M, endian: Endian) -> Result<Vec<u8>, Error> {
    let mut encoder = Encoder::new(endian);
    message.write(&mut encoder)?;
    Ok(encoder.finish())
}
