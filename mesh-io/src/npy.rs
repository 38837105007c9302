//! NPY, a NumPy array in a file: a header with a Python dictionary, then the numbers.
//!
//! Arrays of `n × 3` are points, those of `n × 6` points with normals; numbers of any type and either byte order, in C or Fortran order. Arrays of
//! any shape are read as [`Array`].
//!
//! Own code: `npyz` 0.9 has thirty dependencies for the sixty lines needed here.

use std::io::{self, Write};

use nalgebra::{Point3, Vector3};

use crate::raw::{Raw, finite};
use crate::scalar::{Order, Scalar};
use crate::write::{Options, Precision};
use crate::{Error, Format, Mesh, Place};

const MAGIC: &[u8] = b"\x93NUMPY";

/// An array of any shape.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Array {
    /// Size along each axis.
    pub shape: Vec<usize>,
    /// The numbers, the last axis fastest; NaN as in the file.
    pub values: Vec<f64>,
}

impl Array {
    /// Reads an array from the bytes of a NumPy file (`.npy`): numbers of any type and either byte order, in C or Fortran order.
    ///
    /// # Errors
    /// [`Error::Syntax`] with the byte: not a NumPy file, entries that are not numbers, or fewer numbers than the header says.
    pub fn parse(bytes: &[u8]) -> Result<Self, Error> {
        let header = Header::read(bytes)?;
        let count = header.count(bytes)?;
        let body = &bytes[header.bytes..];
        let size = header.scalar.size();
        let number = |index: usize| {
            let number = body.get(size * index..);
            number
                .and_then(|b| header.scalar.read(b, header.order))
                .unwrap_or(f64::NAN)
        };
        let place = |index| {
            if header.by_column {
                transposed(&header.shape, index)
            } else {
                index
            }
        };
        Ok(Self {
            values: (0..count).map(|index| number(place(index))).collect(),
            shape: header.shape,
        })
    }
}

/// Index in Fortran order of an element given by its index in C order.
fn transposed(shape: &[usize], mut index: usize) -> usize {
    let (mut place, mut stride) = (0, shape.iter().product::<usize>());
    for length in shape.iter().rev() {
        stride /= (*length).max(1);
        place += index % (*length).max(1) * stride;
        index /= (*length).max(1);
    }
    place
}

/// Reads points.
pub fn read(bytes: &[u8]) -> Result<Raw, Error> {
    let header = Header::read(bytes)?;
    let &[rows, columns @ (3 | 6)] = &header.shape[..] else {
        return Err(syntax(
            header.start,
            format!(
                "an array of the shape {:?}: expected (n, 3) or (n, 6)",
                header.shape
            ),
        ));
    };
    header.count(bytes)?;
    let array = Array::parse(bytes)?;
    let mut raw = Raw::default();
    for (row, numbers) in array.values.chunks_exact(columns).enumerate() {
        let point = Point3::new(numbers[0], numbers[1], numbers[2]);
        let index = row * columns;
        let index = if header.by_column {
            transposed(&[rows, columns], index)
        } else {
            index
        };
        let place = Place::Byte(header.bytes + header.scalar.size() * index);
        finite(&point, row, place)?;
        raw.points.push(point);
        if columns == 6 {
            raw.normals
                .push(Vector3::new(numbers[3], numbers[4], numbers[5]));
        }
    }
    Ok(raw)
}

fn syntax(byte: usize, reason: String) -> Error {
    Error::Syntax {
        format: Format::Npy,
        place: Place::Byte(byte),
        reason,
    }
}

struct Header {
    scalar: Scalar,
    order: Order,
    by_column: bool,
    shape: Vec<usize>,
    /// Offsets of the header text (`start`) and of the numbers (`bytes`).
    start: usize,
    bytes: usize,
}

impl Header {
    /// The number of entries, checked against the length of the file.
    fn count(&self, bytes: &[u8]) -> Result<usize, Error> {
        let follow = bytes.len() - self.bytes;
        let count = self
            .shape
            .iter()
            .try_fold(1_usize, |product, n| product.checked_mul(*n));
        let needed = count.and_then(|count| count.checked_mul(self.scalar.size()));
        match (count, needed) {
            (Some(count), Some(needed)) if needed <= follow => Ok(count),
            _ => Err(syntax(
                self.bytes,
                match self.shape[..] {
                    [rows, columns] => format!(
                        "the header says {rows} rows of {columns} numbers, but {follow} bytes follow"
                    ),
                    _ => format!(
                        "the header says an array of the shape {:?}, but {follow} bytes follow",
                        self.shape
                    ),
                },
            )),
        }
    }

    fn read(bytes: &[u8]) -> Result<Self, Error> {
        let Some(rest) = bytes.strip_prefix(MAGIC) else {
            return Err(syntax(
                0,
                "not a NumPy file, which begins with \\x93NUMPY".into(),
            ));
        };
        // Two bytes of version; the length takes two bytes in version 1, four later.
        let wide = rest.first().is_some_and(|major| *major >= 2);
        let short = rest
            .get(2..)
            .and_then(|b| b.first_chunk())
            .map(|b| u16::from_le_bytes(*b).into());
        let long = rest
            .get(2..)
            .and_then(|b| b.first_chunk())
            .map(|b| u32::from_le_bytes(*b) as usize);
        let start = MAGIC.len() + if wide { 6 } else { 4 };
        let end =
            if wide { long } else { short }.and_then(|length: usize| start.checked_add(length));
        let text = end.and_then(|end| bytes.get(start..end));
        let (Some(text), Some(end)) = (text, end) else {
            return Err(syntax(6, "the file ends in the header".into()));
        };
        let text = String::from_utf8_lossy(text);
        let entry = |key: &str| {
            let at = text.find(&format!("'{key}':"))?;
            Some(text[at + key.len() + 3..].trim_start())
        };
        let described = entry("descr")
            .and_then(|d| d.strip_prefix('\''))
            .and_then(|d| d.split('\'').next());
        let (scalar, order) = described.and_then(kind).ok_or_else(|| {
            syntax(
                start,
                format!(
                    "an array of {}: expected numbers",
                    described.unwrap_or("something else")
                ),
            )
        })?;
        let shape = entry("shape").and_then(|s| s.strip_prefix('(')?.split(')').next());
        let shape: Option<Vec<usize>> =
            shape.map(|s| s.split(',').filter_map(|n| n.trim().parse().ok()).collect());
        Ok(Self {
            scalar,
            order,
            by_column: entry("fortran_order").is_some_and(|f| f.starts_with("True")),
            shape: shape.unwrap_or_default(),
            start,
            bytes: end,
        })
    }
}

fn kind(text: &str) -> Option<(Scalar, Order)> {
    let order = if text.starts_with('>') {
        Order::Big
    } else {
        Order::Little
    };
    let scalar = match text.trim_start_matches(['<', '>', '|', '=']) {
        "f4" => Scalar::F32,
        "f8" => Scalar::F64,
        "i1" => Scalar::I8,
        "i2" => Scalar::I16,
        "i4" => Scalar::I32,
        "i8" => Scalar::I64,
        "u1" => Scalar::U8,
        "u2" => Scalar::U16,
        "u4" => Scalar::U32,
        "u8" => Scalar::U64,
        _ => return None,
    };
    Some((scalar, order))
}

/// Writes points, with normals if there are any.
pub fn write(out: &mut dyn Write, mesh: &Mesh, options: Options) -> io::Result<()> {
    let single = options.precision == Precision::Single;
    let columns = if mesh.normals.is_empty() { 3 } else { 6 };
    let kind = if single { "<f4" } else { "<f8" };
    let rows = mesh.points.len();
    let mut header =
        format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({rows}, {columns}), }}");
    // The numbers begin at a multiple of 64 bytes.
    let length = (MAGIC.len() + 4 + header.len() + 1).next_multiple_of(64) - MAGIC.len() - 4;
    header = format!("{header:<width$}\n", width = length - 1);
    out.write_all(MAGIC)?;
    out.write_all(&[1, 0])?;
    out.write_all(&(length as u16).to_le_bytes())?;
    out.write_all(header.as_bytes())?;
    for i in 0..mesh.points.len() {
        for v in mesh.numbers(i) {
            if single {
                out.write_all(&(*v as f32).to_le_bytes())?;
            } else {
                out.write_all(&v.to_le_bytes())?;
            }
        }
    }
    out.flush()
}
