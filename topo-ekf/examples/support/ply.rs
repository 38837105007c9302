//! Vertices and triangles of a PLY file, ASCII or binary, whatever other elements and properties it carries.

use std::error::Error;

use nalgebra::Point3;

/// A triangle mesh; faces with more corners are cut into fans.
pub struct Mesh {
    pub points: Vec<Point3<f64>>,
    pub faces: Vec<[u32; 3]>,
}

#[derive(Clone, Copy)]
enum Format {
    Ascii,
    Little,
    Big,
}

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

struct Property {
    name: String,
    /// Type of the count, for lists.
    list: Option<Scalar>,
    scalar: Scalar,
}

struct Element {
    name: String,
    count: usize,
    properties: Vec<Property>,
}

/// Reads a file; every message names it.
pub fn read(path: &str) -> Result<Mesh, Box<dyn Error>> {
    let bytes = std::fs::read(path).map_err(|e| format!("{path}: {e}"))?;
    Ok(parse(&bytes).map_err(|e| format!("{path}: {e}"))?)
}

fn parse(bytes: &[u8]) -> Result<Mesh, String> {
    let (format, elements, start) = header(bytes)?;
    let mut body = Body {
        bytes: &bytes[start..],
        format,
    };
    let mut mesh = Mesh {
        points: vec![],
        faces: vec![],
    };
    for element in &elements {
        for index in 0..element.count {
            let mut row = vec![];
            for property in &element.properties {
                let values = body.property(property).ok_or(format!(
                    "{} {index} is cut short or no number",
                    element.name
                ))?;
                row.push((property.name.as_str(), values));
            }
            match element.name.as_str() {
                "vertex" => mesh
                    .points
                    .push(point(&row).ok_or("a vertex needs x, y and z")?),
                "face" => fan(&row, index, &mut mesh.faces)?,
                _ => {}
            }
        }
    }
    let count = mesh.points.len();
    match mesh.faces.iter().flatten().find(|v| **v as usize >= count) {
        Some(v) => Err(format!("a face names vertex {v}, there are {count}")),
        None => Ok(mesh),
    }
}

fn header(bytes: &[u8]) -> Result<(Format, Vec<Element>, usize), String> {
    let (mut at, mut format, mut elements) = (0, None, Vec::<Element>::new());
    loop {
        let length = bytes[at..]
            .iter()
            .position(|b| *b == b'\n')
            .ok_or("no PLY header")?;
        let line = String::from_utf8_lossy(&bytes[at..at + length]);
        let first = at == 0;
        at += length + 1;
        let words: Vec<&str> = line.split_whitespace().collect();
        match words[..] {
            ["ply"] if first => {}
            _ if first => return Err("not a PLY file".into()),
            ["format", "ascii", _] => format = Some(Format::Ascii),
            ["format", "binary_little_endian", _] => format = Some(Format::Little),
            ["format", "binary_big_endian", _] => format = Some(Format::Big),
            ["element", name, count] => elements.push(Element {
                name: name.into(),
                count: count.parse().map_err(|_| format!("`{line}`: no count"))?,
                properties: vec![],
            }),
            ["property", "list", count, of, name] => {
                let list = Some(scalar(count)?);
                add(&mut elements, name, list, scalar(of)?)?;
            }
            ["property", of, name] => add(&mut elements, name, None, scalar(of)?)?,
            ["end_header"] => {
                return Ok((format.ok_or("the format is missing")?, elements, at));
            }
            ["comment" | "obj_info", ..] | [] => {}
            _ => return Err(format!("`{line}` is no line of a PLY header")),
        }
    }
}

fn add(
    elements: &mut [Element],
    name: &str,
    list: Option<Scalar>,
    scalar: Scalar,
) -> Result<(), String> {
    let element = elements.last_mut().ok_or("a property before any element")?;
    element.properties.push(Property {
        name: name.into(),
        list,
        scalar,
    });
    Ok(())
}

fn scalar(name: &str) -> Result<Scalar, String> {
    Ok(match name {
        "char" | "int8" => Scalar::I8,
        "uchar" | "uint8" => Scalar::U8,
        "short" | "int16" => Scalar::I16,
        "ushort" | "uint16" => Scalar::U16,
        "int" | "int32" => Scalar::I32,
        "uint" | "uint32" => Scalar::U32,
        "float" | "float32" => Scalar::F32,
        "double" | "float64" => Scalar::F64,
        other => return Err(format!("unknown type `{other}`")),
    })
}

struct Body<'a> {
    bytes: &'a [u8],
    format: Format,
}

impl Body<'_> {
    fn property(&mut self, property: &Property) -> Option<Vec<f64>> {
        let count = match property.list {
            Some(of) => self.value(of)? as usize,
            None => 1,
        };
        (0..count).map(|_| self.value(property.scalar)).collect()
    }

    fn value(&mut self, scalar: Scalar) -> Option<f64> {
        if let Format::Ascii = self.format {
            let start = self.bytes.iter().position(|b| !b.is_ascii_whitespace())?;
            let rest = &self.bytes[start..];
            let end = rest
                .iter()
                .position(u8::is_ascii_whitespace)
                .unwrap_or(rest.len());
            self.bytes = &rest[end..];
            return std::str::from_utf8(&rest[..end]).ok()?.parse().ok();
        }
        Some(match scalar {
            Scalar::I8 => f64::from(i8::from_le_bytes(self.take()?)),
            Scalar::U8 => f64::from(u8::from_le_bytes(self.take()?)),
            Scalar::I16 => f64::from(i16::from_le_bytes(self.take()?)),
            Scalar::U16 => f64::from(u16::from_le_bytes(self.take()?)),
            Scalar::I32 => f64::from(i32::from_le_bytes(self.take()?)),
            Scalar::U32 => f64::from(u32::from_le_bytes(self.take()?)),
            Scalar::F32 => f64::from(f32::from_le_bytes(self.take()?)),
            Scalar::F64 => f64::from_le_bytes(self.take()?),
        })
    }

    /// The next bytes, little end first.
    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (head, rest) = self.bytes.split_first_chunk::<N>()?;
        self.bytes = rest;
        let mut bytes = *head;
        if let Format::Big = self.format {
            bytes.reverse();
        }
        Some(bytes)
    }
}

fn point(row: &[(&str, Vec<f64>)]) -> Option<Point3<f64>> {
    let of = |name: &str| {
        row.iter()
            .find(|(n, _)| *n == name)
            .and_then(|(_, v)| v.first().copied())
    };
    Some(Point3::new(of("x")?, of("y")?, of("z")?))
}

fn fan(row: &[(&str, Vec<f64>)], index: usize, faces: &mut Vec<[u32; 3]>) -> Result<(), String> {
    let corners = row
        .iter()
        .find(|(name, _)| matches!(*name, "vertex_indices" | "vertex_index"))
        .map(|(_, v)| v)
        .ok_or("a face needs vertex_indices")?;
    let whole = |v: &f64| v.fract() == 0.0 && (0.0..f64::from(u32::MAX)).contains(v);
    if corners.len() < 3 || !corners.iter().all(whole) {
        return Err(format!("face {index} has no three vertices: {corners:?}"));
    }
    let id = |k: usize| corners[k] as u32;
    faces.extend((1..corners.len() - 1).map(|k| [id(0), id(k), id(k + 1)]));
    Ok(())
}
