//! PLY, the polygon file format (Turk, *The PLY polygon file format*, 1994): a header in text that names elements and their properties, then
//! their values, as text or as bytes of either order.
//!
//! From the element `vertex` come position, normal, colour and every other number; from `face` the list of corners; from `tristrips` strips of
//! triangles separated by −1. Everything else is skipped.
//!
//! Own code: `ply-rs-bw` 4.0 needs UTF-8 in comments and refuses byte-order marks, blank lines and `nan`, which occur in practice.

mod header;
mod rows;
mod write;

pub use write::write;

use crate::raw::Raw;
use crate::{Error, Format, Place};
use header::Header;

/// Reads a file.
pub fn read(bytes: &[u8]) -> Result<Raw, Error> {
    let header = Header::read(bytes)?;
    let mut raw = Raw::default();
    rows::read(&header, bytes, &mut raw)?;
    Ok(raw)
}

fn syntax(place: Place, reason: impl Into<String>) -> Error {
    Error::Syntax {
        format: Format::Ply,
        place,
        reason: reason.into(),
    }
}
