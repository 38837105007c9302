//! PLY: a header that declares elements and their properties, then their values, as text or as little-endian bytes.
//!
//! Only `x`, `y`, `z` of `vertex` and the index list of `face` are kept; everything else is read past, which takes knowing the
//! size of every property.

// A count is checked to be a whole number from 0 up before it becomes one.
#![allow(clippy::cast_sign_loss)]

use nalgebra::Point3;

use super::{Soup, bad, text};
use crate::cell::sim::SimError;

pub(super) fn parse(bytes: &[u8]) -> Result<Soup, SimError> {
    let (header, body) = Header::read(bytes)?;
    if header.binary {
        header.values(&mut Binary { bytes: body, at: 0 })
    } else {
        header.values(&mut Ascii {
            words: text(body, "PLY")?.split_whitespace(),
            read: 0,
        })
    }
}

struct Header {
    binary: bool,
    elements: Vec<Element>,
}

struct Element {
    name: String,
    count: usize,
    properties: Vec<Property>,
}

struct Property {
    name: String,
    /// Type of the length, if this is a list.
    list: Option<Kind>,
    kind: Kind,
}

#[derive(Clone, Copy)]
enum Kind {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Kind {
    fn named(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }
}

/// Values one after the other, whatever they are written as.
trait Values {
    fn next(&mut self, kind: Kind) -> Result<f64, SimError>;

    fn count(&mut self, kind: Kind) -> Result<usize, SimError> {
        let value = self.next(kind)?;
        if value >= 0.0 && value.fract() == 0.0 && value <= f64::from(u32::MAX) {
            Ok(value as usize)
        } else {
            Err(self.wrong(format!("{value} is neither a count nor an index")))
        }
    }

    fn wrong(&self, reason: String) -> SimError;
}

struct Ascii<'a> {
    words: std::str::SplitWhitespace<'a>,
    read: usize,
}

impl Values for Ascii<'_> {
    fn next(&mut self, _: Kind) -> Result<f64, SimError> {
        let word = self
            .words
            .next()
            .ok_or_else(|| self.wrong("the file ends too early".into()))?;
        self.read += 1;
        word.parse()
            .map_err(|_| self.wrong(format!("{word:?} is not a number")))
    }

    fn wrong(&self, reason: String) -> SimError {
        bad(
            "PLY",
            format!("value {} after the header", self.read),
            reason,
        )
    }
}

struct Binary<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl Binary<'_> {
    fn take<const N: usize>(&mut self) -> Result<[u8; N], SimError> {
        let taken = self
            .bytes
            .get(self.at..self.at + N)
            .and_then(|b| b.try_into().ok());
        self.at += N;
        taken.ok_or_else(|| self.wrong("the file ends too early".into()))
    }
}

impl Values for Binary<'_> {
    fn next(&mut self, kind: Kind) -> Result<f64, SimError> {
        Ok(match kind {
            Kind::I8 => f64::from(i8::from_le_bytes(self.take()?)),
            Kind::U8 => f64::from(u8::from_le_bytes(self.take()?)),
            Kind::I16 => f64::from(i16::from_le_bytes(self.take()?)),
            Kind::U16 => f64::from(u16::from_le_bytes(self.take()?)),
            Kind::I32 => f64::from(i32::from_le_bytes(self.take()?)),
            Kind::U32 => f64::from(u32::from_le_bytes(self.take()?)),
            Kind::F32 => f64::from(f32::from_le_bytes(self.take()?)),
            Kind::F64 => f64::from_le_bytes(self.take()?),
        })
    }

    fn wrong(&self, reason: String) -> SimError {
        bad("PLY", format!("byte {} after the header", self.at), reason)
    }
}

impl Header {
    fn read(bytes: &[u8]) -> Result<(Self, &[u8]), SimError> {
        let mut header = Self {
            binary: false,
            elements: Vec::new(),
        };
        let mut rest = bytes;
        for number in 1.. {
            let place = format!("line {number}");
            let Some(end) = rest.iter().position(|&b| b == b'\n') else {
                return Err(bad("PLY", place, "the header does not end"));
            };
            let line = text(&rest[..end], "PLY")?;
            rest = &rest[end + 1..];
            let words: Vec<&str> = line.split_whitespace().collect();
            match words.as_slice() {
                ["ply"] if number == 1 => {}
                _ if number == 1 => return Err(bad("PLY", place, "the first line is not \"ply\"")),
                ["format", "ascii", _] => header.binary = false,
                ["format", "binary_little_endian", _] => header.binary = true,
                ["format", other, ..] => {
                    return Err(bad(
                        "PLY",
                        place,
                        format!(
                            "format {other} is not supported, ascii and binary_little_endian are"
                        ),
                    ));
                }
                ["element", name, count] => {
                    let count = count
                        .parse()
                        .map_err(|_| bad("PLY", place, format!("{count:?} is not a count")))?;
                    header.elements.push(Element {
                        name: (*name).to_owned(),
                        count,
                        properties: Vec::new(),
                    });
                }
                ["property", description @ ..] => {
                    let property = property(description)
                        .ok_or_else(|| bad("PLY", place.clone(), format!("what is {line:?}?")))?;
                    let element = header
                        .elements
                        .last_mut()
                        .ok_or_else(|| bad("PLY", place, "a property before the first element"))?;
                    element.properties.push(property);
                }
                ["end_header"] => break,
                _ => {}
            }
        }
        Ok((header, rest))
    }

    fn values(&self, values: &mut dyn Values) -> Result<Soup, SimError> {
        let mut soup = Soup::default();
        for element in &self.elements {
            // Without properties nothing would be read, and a count from the header alone would decide how long that takes.
            let rows = if element.properties.is_empty() {
                0
            } else {
                element.count
            };
            for _ in 0..rows {
                element.row(values, &mut soup)?;
            }
        }
        Ok(soup)
    }
}

impl Element {
    fn row(&self, values: &mut dyn Values, soup: &mut Soup) -> Result<(), SimError> {
        let mut position = Point3::new(f64::NAN, f64::NAN, f64::NAN);
        for property in &self.properties {
            if let Some(length) = property.list {
                let corners = values.count(length)?;
                let is_face = self.name == "face"
                    && matches!(property.name.as_str(), "vertex_indices" | "vertex_index");
                let mut polygon = Vec::new();
                for _ in 0..corners {
                    if is_face {
                        polygon.push(values.count(property.kind)?);
                    } else {
                        values.next(property.kind)?;
                    }
                }
                if is_face {
                    soup.polygons.push(polygon);
                }
            } else {
                let value = values.next(property.kind)?;
                match property.name.as_str() {
                    "x" => position.x = value,
                    "y" => position.y = value,
                    "z" => position.z = value,
                    _ => {}
                }
            }
        }
        if self.name == "vertex" {
            soup.positions.push(position);
        }
        Ok(())
    }
}

fn property(words: &[&str]) -> Option<Property> {
    match words {
        ["list", length, kind, name] => Some(Property {
            name: (*name).to_owned(),
            list: Some(Kind::named(length)?),
            kind: Kind::named(kind)?,
        }),
        [kind, name] => Some(Property {
            name: (*name).to_owned(),
            list: None,
            kind: Kind::named(kind)?,
        }),
        _ => None,
    }
}
