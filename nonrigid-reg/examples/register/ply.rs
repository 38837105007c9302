//! PLY point clouds, ascii or binary little-endian, vertices only: enough for the examples.

use std::error::Error;

use nalgebra::{Point3, UnitVector3, Vector3};

/// Points and, if the file has them, normals.
pub struct Ply {
    pub points: Vec<Point3<f64>>,
    pub normals: Vec<UnitVector3<f64>>,
}

/// Size in bytes of a PLY scalar type.
fn size(kind: &str) -> Result<usize, String> {
    match kind {
        "char" | "uchar" | "int8" | "uint8" => Ok(1),
        "short" | "ushort" | "int16" | "uint16" => Ok(2),
        "int" | "uint" | "float" | "int32" | "uint32" | "float32" => Ok(4),
        "double" | "float64" => Ok(8),
        other => Err(format!("PLY type {other} is not read here")),
    }
}

fn value(kind: &str, bytes: &[u8]) -> Result<f64, Box<dyn Error>> {
    Ok(match kind {
        "double" | "float64" => f64::from_le_bytes(bytes.try_into()?),
        "float" | "float32" => f64::from(f32::from_le_bytes(bytes.try_into()?)),
        "uchar" | "uint8" => f64::from(bytes[0]),
        // Other integers carry no coordinates.
        _ => 0.0,
    })
}

impl Ply {
    pub fn read(path: &str) -> Result<Self, Box<dyn Error>> {
        let bytes = std::fs::read(path).map_err(|e| format!("{path}: {e}"))?;
        let mark = b"end_header";
        let end = bytes
            .windows(mark.len())
            .position(|w| w == mark)
            .ok_or("no end_header")?;
        let newline = bytes[end..]
            .iter()
            .position(|&b| b == b'\n')
            .ok_or("no data")?;
        let (header, body) = (
            std::str::from_utf8(&bytes[..end])?,
            &bytes[end + newline + 1..],
        );
        let (mut count, mut inside, mut properties) = (0_usize, false, Vec::new());
        for line in header.lines() {
            match line.split_whitespace().collect::<Vec<_>>()[..] {
                ["element", "vertex", n] => (count, inside) = (n.parse()?, true),
                ["element", ..] => inside = false,
                ["property", kind, name] if inside => properties.push((kind, name)),
                _ => {}
            }
        }
        let rows = if header.contains("format ascii") {
            ascii_rows(std::str::from_utf8(body)?, count, properties.len())?
        } else if header.contains("format binary_little_endian") {
            binary_rows(body, count, &properties)?
        } else {
            return Err("only ascii and binary_little_endian PLY is read here".into());
        };
        let column = |name: &str| properties.iter().position(|p| p.1 == name);
        let triple = |names: [&str; 3]| -> Option<Vec<Vector3<f64>>> {
            let [a, b, c] = [column(names[0])?, column(names[1])?, column(names[2])?];
            Some(
                rows.iter()
                    .map(|r| Vector3::new(r[a], r[b], r[c]))
                    .collect(),
            )
        };
        let points = triple(["x", "y", "z"]).ok_or("no x, y, z")?;
        let normals = triple(["nx", "ny", "nz"]).unwrap_or_default();
        Ok(Self {
            points: points.into_iter().map(Point3::from).collect(),
            normals: normals
                .into_iter()
                .map(UnitVector3::new_normalize)
                .collect(),
        })
    }
}

fn ascii_rows(body: &str, count: usize, width: usize) -> Result<Vec<Vec<f64>>, Box<dyn Error>> {
    let mut rows = Vec::new();
    for line in body.lines().take(count) {
        let row: Vec<f64> = line
            .split_whitespace()
            .map(str::parse)
            .collect::<Result<_, _>>()?;
        if row.len() < width {
            return Err("a row is too short".into());
        }
        rows.push(row);
    }
    Ok(rows)
}

fn binary_rows(
    body: &[u8],
    count: usize,
    properties: &[(&str, &str)],
) -> Result<Vec<Vec<f64>>, Box<dyn Error>> {
    let sizes: Vec<usize> = properties
        .iter()
        .map(|p| size(p.0))
        .collect::<Result<_, _>>()?;
    let width: usize = sizes.iter().sum();
    if width == 0 || body.len() / width < count {
        return Err("the file is shorter than its header says".into());
    }
    let mut rows = Vec::new();
    for record in body.chunks_exact(width).take(count) {
        let (mut row, mut at) = (Vec::new(), 0);
        for ((kind, _), step) in properties.iter().zip(&sizes) {
            row.push(value(kind, &record[at..at + step])?);
            at += step;
        }
        rows.push(row);
    }
    Ok(rows)
}

/// Where a point was, and where it is.
pub type PointPair = (Point3<f64>, Point3<f64>);

/// Rows `sx,sy,sz,tx,ty,tz` after one header line.
pub fn read_pairs(path: &str) -> Result<Vec<PointPair>, Box<dyn Error>> {
    let text = std::fs::read_to_string(path).map_err(|e| format!("{path}: {e}"))?;
    let mut pairs = Vec::new();
    for line in text.lines().skip(1).filter(|l| !l.trim().is_empty()) {
        let v: Vec<f64> = line
            .split(',')
            .map(|f| f.trim().parse())
            .collect::<Result<_, _>>()?;
        let [a, b, c, d, e, f] = v[..] else {
            return Err(format!("{path}: a row needs six numbers: {line}").into());
        };
        pairs.push((Point3::new(a, b, c), Point3::new(d, e, f)));
    }
    Ok(pairs)
}
