//! Points and normals from a PLY file (Turk, *The PLY polygon file format*, 1994): ASCII or binary little-endian.
//!
//! ```text
//! ply / format ascii 1.0 / element vertex N / property float x … / element face M / property list uchar int v / end_header
//! ```
//!
//! Elements come in the order of the header. Those before the vertices are read and dropped, those after are not looked at; extra
//! properties of the vertices, lists included, are skipped.

use cech_complex::nalgebra::{Point3, UnitVector3, Vector3};
use std::fs;

/// What a vertex has to have, in the order in which it is used.
const WANTED: [&str; 6] = ["x", "y", "z", "nx", "ny", "nz"];

pub struct Cloud {
    pub points: Vec<Point3<f64>>,
    pub normals: Vec<UnitVector3<f64>>,
}

/// Reads a file; every complaint starts with its name.
pub fn read(path: &str) -> Result<Cloud, String> {
    let bytes = fs::read(path).map_err(|error| format!("{path}: {error}"))?;
    cloud(&bytes).map_err(|complaint| format!("{path}: {complaint}"))
}

fn cloud(bytes: &[u8]) -> Result<Cloud, String> {
    let header = Header::read(bytes)?;
    let mut body = header.body(bytes);
    let mut cloud = Cloud {
        points: Vec::new(),
        normals: Vec::new(),
    };
    let mut row = Vec::new();
    for element in &header.elements {
        let columns = element.columns()?;
        for index in 0..element.count {
            body.row(element, index, &mut row)?;
            if let Some(columns) = columns {
                let value = |k: usize| row[columns[k]];
                let place = || body.place(element, index);
                for (k, name) in WANTED.iter().enumerate() {
                    if !value(k).is_finite() {
                        return Err(format!("{}: {name} is {}", place(), value(k)));
                    }
                }
                let normal = Vector3::new(value(3), value(4), value(5));
                let unit = UnitVector3::try_new(normal, 0.0).filter(|n| n.norm().is_finite());
                let unit = unit.filter(|n| (n.norm() - 1.0).abs() < 1e-6);
                cloud.points.push(Point3::new(value(0), value(1), value(2)));
                cloud.normals.push(unit.ok_or_else(|| {
                    format!(
                        "{}: normal {:?} has no direction",
                        place(),
                        normal.as_slice()
                    )
                })?);
            }
        }
        if columns.is_some() {
            return Ok(cloud);
        }
    }
    Err("the header names no element vertex".to_owned())
}

/// Type of a number.
#[derive(Clone, Copy)]
enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
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

    /// Takes one number off the front of little-endian bytes.
    fn take(self, bytes: &mut &[u8]) -> Option<f64> {
        Some(match self {
            Self::I8 => i8::from_le_bytes(first(bytes)?).into(),
            Self::U8 => u8::from_le_bytes(first(bytes)?).into(),
            Self::I16 => i16::from_le_bytes(first(bytes)?).into(),
            Self::U16 => u16::from_le_bytes(first(bytes)?).into(),
            Self::I32 => i32::from_le_bytes(first(bytes)?).into(),
            Self::U32 => u32::from_le_bytes(first(bytes)?).into(),
            Self::F32 => f32::from_le_bytes(first(bytes)?).into(),
            Self::F64 => f64::from_le_bytes(first(bytes)?),
        })
    }
}

fn first<const N: usize>(bytes: &mut &[u8]) -> Option<[u8; N]> {
    let (head, tail) = bytes.split_first_chunk()?;
    *bytes = tail;
    Some(*head)
}

/// One column of an element: a number, or a list with a count of its own type.
struct Property {
    name: String,
    count: Option<Scalar>,
    scalar: Scalar,
}

struct Element {
    name: String,
    count: usize,
    properties: Vec<Property>,
}

impl Element {
    /// Where the wanted properties stand among all, or `None` for an element other than the vertices.
    fn columns(&self) -> Result<Option<[usize; 6]>, String> {
        if self.name != "vertex" {
            return Ok(None);
        }
        let mut columns = [0; 6];
        for (column, name) in columns.iter_mut().zip(WANTED) {
            let is = |p: &Property| p.name == name && p.count.is_none();
            let found = self.properties.iter().position(is);
            *column = found.ok_or_else(|| format!("element vertex has no property {name}"))?;
        }
        Ok(Some(columns))
    }
}

struct Header {
    ascii: bool,
    elements: Vec<Element>,
    /// Lines and bytes of the header itself.
    lines: usize,
    length: usize,
}

impl Header {
    fn read(bytes: &[u8]) -> Result<Self, String> {
        let mut header = Self {
            ascii: true,
            elements: Vec::new(),
            lines: 0,
            length: 0,
        };
        let mut format = None;
        loop {
            let rest = &bytes[header.length..];
            let Some(end) = rest.iter().position(|&byte| byte == b'\n') else {
                return Err(format!(
                    "line {}: the header has no end_header",
                    header.lines + 1
                ));
            };
            header.length += end + 1;
            header.lines += 1;
            let line = String::from_utf8_lossy(&rest[..end]);
            let words: Vec<&str> = line.split_whitespace().collect();
            let complain =
                |what: &str| Err(format!("line {}: {what}: {:?}", header.lines, line.trim()));
            match (header.lines, words.as_slice()) {
                (1, ["ply"]) => {}
                (1, _) => {
                    return Err("line 1: not a PLY file, it does not start with \"ply\"".to_owned());
                }
                (_, ["comment" | "obj_info", ..] | []) => {}
                (_, ["format", "ascii", "1.0"]) => format = Some(true),
                (_, ["format", "binary_little_endian", "1.0"]) => format = Some(false),
                (_, ["format", ..]) => {
                    return complain("not ascii 1.0 or binary_little_endian 1.0");
                }
                (_, ["element", name, count]) => match count.parse() {
                    Ok(count) => header.elements.push(Element {
                        name: (*name).to_owned(),
                        count,
                        properties: Vec::new(),
                    }),
                    Err(_) => return complain("not a number of elements"),
                },
                (_, ["property", kind @ .., name]) => {
                    let (Some((count, scalar)), Some(element)) =
                        (types(kind), header.elements.last_mut())
                    else {
                        return complain("not a property of an element");
                    };
                    element.properties.push(Property {
                        name: (*name).to_owned(),
                        count,
                        scalar,
                    });
                }
                (_, ["end_header"]) => break,
                _ => return complain("not a line of a PLY header"),
            }
        }
        header.ascii = format.ok_or("the header names no format")?;
        Ok(header)
    }

    fn body<'a>(&self, bytes: &'a [u8]) -> Body<'a> {
        let rest = &bytes[self.length..];
        if self.ascii {
            Body::Ascii {
                rest,
                line: self.lines,
            }
        } else {
            Body::Binary { rest }
        }
    }
}

fn types(words: &[&str]) -> Option<(Option<Scalar>, Scalar)> {
    match words {
        ["list", count, scalar] => Some((Some(Scalar::named(count)?), Scalar::named(scalar)?)),
        [scalar] => Some((None, Scalar::named(scalar)?)),
        _ => None,
    }
}

/// What follows the header, as far as it has not been read.
enum Body<'a> {
    Ascii { rest: &'a [u8], line: usize },
    Binary { rest: &'a [u8] },
}

impl Body<'_> {
    /// Reads one element into `row`, a value for each property; a list leaves its length there.
    fn row(&mut self, element: &Element, index: usize, row: &mut Vec<f64>) -> Result<(), String> {
        row.clear();
        match self {
            Self::Binary { rest } => {
                for property in &element.properties {
                    let value = binary_value(property, rest);
                    row.push(value.ok_or_else(|| {
                        format!(
                            "{} {index}: the file ends in it, the header promises {}",
                            element.name, element.count
                        )
                    })?);
                }
                Ok(())
            }
            Self::Ascii { rest, line } => {
                let text = next_line(rest, line).ok_or_else(|| {
                    format!(
                        "line {line}: the file ends at {} {index}, the header promises {}",
                        element.name, element.count
                    )
                })?;
                ascii_row(&text, &element.properties, row)
                    .map_err(|what| format!("line {line}: {} {index}: {what}", element.name))
            }
        }
    }

    fn place(&self, element: &Element, index: usize) -> String {
        match self {
            Self::Ascii { line, .. } => format!("line {line}: {} {index}", element.name),
            Self::Binary { .. } => format!("{} {index}", element.name),
        }
    }
}

/// The next line that is not blank; `number` counts all of them.
fn next_line(rest: &mut &[u8], number: &mut usize) -> Option<String> {
    while !rest.is_empty() {
        let end = rest.iter().position(|&byte| byte == b'\n');
        let (line, tail) = rest.split_at(end.map_or(rest.len(), |end| end + 1));
        *rest = tail;
        *number += 1;
        if !line.trim_ascii().is_empty() {
            return Some(String::from_utf8_lossy(line).into_owned());
        }
    }
    None
}

fn ascii_row(line: &str, properties: &[Property], row: &mut Vec<f64>) -> Result<(), String> {
    let mut words = line.split_whitespace();
    for property in properties {
        let mut value = || {
            let word = words
                .next()
                .ok_or_else(|| format!("{} is missing", property.name))?;
            let parsed = word.parse::<f64>();
            parsed.map_err(|_| format!("{} is no number: {word:?}", property.name))
        };
        let first = value()?;
        if property.count.is_some() {
            for _ in 0..first.max(0.0) as usize {
                value()?;
            }
        }
        row.push(first);
    }
    words.next().map_or(Ok(()), |extra| {
        Err(format!("one value too many: {extra:?}"))
    })
}

fn binary_value(property: &Property, rest: &mut &[u8]) -> Option<f64> {
    let first = property.count.unwrap_or(property.scalar).take(rest)?;
    if property.count.is_some() {
        for _ in 0..first.max(0.0) as usize {
            property.scalar.take(rest)?;
        }
    }
    Some(first)
}
