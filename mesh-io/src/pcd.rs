//! PCD, the format of the Point Cloud Library: a header in text, then values as text, as little-endian bytes (`binary`), or field after field and
//! compressed by LZF (`binary_compressed`).
//!
//! Fields are `x y z`, `normal_x normal_y normal_z`, `rgb` (packed into one number), and others. A point whose `x y z` are all NaN is a pixel of
//! a depth camera without a measurement: it is left out and counted.
//!
//! Own code: `pcd-rs` 0.13 allocates as much memory as a header claims and panics if a compressed block is shorter than its points. LZF comes from
//! the crate `lzf`.

mod header;
mod write;

pub use write::write;

use nalgebra::Point3;

use crate::columns::{Column, Columns};
use crate::raw::{Raw, finite};
use crate::scalar::Order;
use crate::text::{Lines, number, shown, words};
use crate::{Error, Format, Place};
use header::{Data, Field, Header};

/// LZF makes at most 264 bytes from three.
const MOST_EXPANSION: usize = 88;

/// Reads a file.
pub fn read(bytes: &[u8]) -> Result<Raw, Error> {
    let header = Header::read(bytes)?;
    let list: Vec<Column> = header.fields.iter().map(Field::column).collect();
    let mut columns = Columns::new(&list);
    if let Some(name) = columns.missing() {
        return Err(header.error(format!("there is no field {name}")));
    }
    let mut raw = Raw::default();
    match header.data {
        Data::Text => text(&header, bytes, &mut columns, &mut raw)?,
        Data::Binary => {
            let body = &bytes[header.bytes..];
            header.must_hold(body.len(), header.bytes)?;
            let at = |point: usize, field: usize| point * header.stride() + header.offset(field);
            packed(&header, body, at, &mut columns, &mut raw)?;
        }
        Data::Compressed => {
            let body = decompressed(&header, bytes)?;
            header.must_hold(body.len(), header.bytes)?;
            let at = |point: usize, field: usize| {
                header.points * header.offset(field) + point * header.fields[field].size()
            };
            packed(&header, &body, at, &mut columns, &mut raw)?;
        }
    }
    columns.finish(&mut raw);
    Ok(raw)
}

fn syntax(place: Place, reason: String) -> Error {
    Error::Syntax {
        format: Format::Pcd,
        place,
        reason,
    }
}

/// Adds a row, unless the point has no position.
fn add(row: &[f64], columns: &mut Columns, raw: &mut Raw, place: Place) -> Result<(), Error> {
    let point: Point3<f64> = columns.point(row);
    if point.iter().all(|c| c.is_nan()) {
        raw.left_out += 1;
        return Ok(());
    }
    finite(&point, raw.points.len() + raw.left_out, place)?;
    columns.add(row, raw);
    Ok(())
}

fn text(header: &Header, bytes: &[u8], columns: &mut Columns, raw: &mut Raw) -> Result<(), Error> {
    let mut lines = Lines::from_line(&bytes[header.bytes..], header.lines);
    let mut row = Vec::new();
    for index in 0..header.points {
        let line = lines.next_filled().ok_or_else(|| {
            syntax(
                lines.place(),
                format!(
                    "the file ends at point {index}, the header says {}",
                    header.points
                ),
            )
        })?;
        let place = lines.place();
        let mut words = words(line);
        row.clear();
        for field in &header.fields {
            for k in 0..field.count {
                let missing = || syntax(place, format!("point {index}: {} is missing", field.name));
                let word = words.next().ok_or_else(missing)?;
                let value = number(word).ok_or_else(|| {
                    syntax(
                        place,
                        format!(
                            "point {index}: {} is not a number: {:?}",
                            field.name,
                            shown(word)
                        ),
                    )
                })?;
                if k == 0 {
                    row.push(value);
                }
            }
        }
        if words.next().is_some() {
            return Err(syntax(
                place,
                format!("point {index}: more values than fields"),
            ));
        }
        add(&row, columns, raw, place)?;
    }
    Ok(())
}

/// Points whose field `f` stands at byte `at(point, f)`.
fn packed(
    header: &Header,
    body: &[u8],
    at: impl Fn(usize, usize) -> usize,
    columns: &mut Columns,
    raw: &mut Raw,
) -> Result<(), Error> {
    let mut row = vec![0.0; header.fields.len()];
    raw.points.reserve(header.points);
    for point in 0..header.points {
        for (k, field) in header.fields.iter().enumerate() {
            let value = body
                .get(at(point, k)..)
                .and_then(|b| field.scalar.read(b, Order::Little));
            row[k] = value.unwrap_or(f64::NAN);
        }
        add(&row, columns, raw, Place::Byte(header.bytes + at(point, 0)))?;
    }
    Ok(())
}

fn decompressed(header: &Header, bytes: &[u8]) -> Result<Vec<u8>, Error> {
    let body = &bytes[header.bytes..];
    let error = |reason: String| syntax(Place::Byte(header.bytes), reason);
    let size = |at: usize| {
        let size = body.get(at..).and_then(|b| b.first_chunk());
        size.map(|b| u32::from_le_bytes(*b) as usize)
    };
    let (Some(small), Some(large)) = (size(0), size(4)) else {
        return Err(error(
            "the file ends before the sizes of the compressed block".into(),
        ));
    };
    let block = body.get(8..).and_then(|b| b.get(..small)).ok_or_else(|| {
        error(format!(
            "the header says {small} compressed bytes, but {} follow",
            body.len() - 8
        ))
    })?;
    if large == 0 {
        return Ok(Vec::new());
    }
    if large > small.saturating_mul(MOST_EXPANSION) {
        return Err(error(format!(
            "{small} compressed bytes cannot hold {large}"
        )));
    }
    match lzf::decompress(block, large) {
        Ok(block) if block.len() == large => Ok(block),
        _ => Err(error("the compressed block is damaged".into())),
    }
}
