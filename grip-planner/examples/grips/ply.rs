//! Vertices and faces from a PLY file (Turk, *The PLY polygon file format*, 1994): ASCII, or binary of either byte order.
//!
//! Polygons are cut into fans of triangles; other properties and elements are read over.

use grip_planner::nalgebra::Point3;

/// Vertices and triangles.
pub struct Mesh {
    pub points: Vec<Point3<f64>>,
    pub triangles: Vec<[u32; 3]>,
}

/// Reads a file; every complaint starts with its name.
pub fn read(path: &str) -> Result<Mesh, String> {
    let bytes = std::fs::read(path).map_err(|error| format!("{path}: {error}"))?;
    parse(&bytes).map_err(|complaint| format!("{path}: {complaint}"))
}

fn parse(bytes: &[u8]) -> Result<Mesh, String> {
    let (header, body) = Header::read(bytes)?;
    let mut numbers = header.numbers(body)?;
    let mut mesh = Mesh {
        points: Vec::new(),
        triangles: Vec::new(),
    };
    for element in &header.elements {
        for index in 0..element.count {
            let row = element.row(&mut numbers, index)?;
            match element.name.as_str() {
                "vertex" => mesh.points.push(vertex(element, &row, index)?),
                "face" => mesh.triangles.extend(face(element, &row, index)?),
                _ => {}
            }
        }
    }
    check(&mesh)?;
    Ok(mesh)
}

fn check(mesh: &Mesh) -> Result<(), String> {
    if mesh.points.is_empty() {
        return Err("no vertices".into());
    }
    if mesh.triangles.is_empty() {
        return Err("no faces: grips are planned on a surface".into());
    }
    let count = mesh.points.len();
    match mesh
        .triangles
        .iter()
        .flatten()
        .find(|&&v| v as usize >= count)
    {
        Some(v) => Err(format!("a face names vertex {v} of {count}")),
        None => Ok(()),
    }
}

fn vertex(element: &Element, row: &[Vec<f64>], index: usize) -> Result<Point3<f64>, String> {
    let mut point = Point3::origin();
    for (k, name) in ["x", "y", "z"].iter().enumerate() {
        let column = element.column(name)?;
        point[k] = row[column].first().copied().unwrap_or(f64::NAN);
        if !point[k].is_finite() {
            return Err(format!("vertex {index}: {name} is {}", point[k]));
        }
    }
    Ok(point)
}

fn face(element: &Element, row: &[Vec<f64>], index: usize) -> Result<Vec<[u32; 3]>, String> {
    let column = element
        .column("vertex_indices")
        .or_else(|_| element.column("vertex_index"))?;
    let corners = &row[column];
    let whole = |x: &f64| *x >= 0.0 && *x < f64::from(u32::MAX) && x.fract() == 0.0;
    if corners.len() < 3 || !corners.iter().all(whole) {
        return Err(format!("face {index}: {corners:?} is no polygon"));
    }
    let at = |k: usize| corners[k] as u32;
    Ok((2..corners.len())
        .map(|k| [at(0), at(k - 1), at(k)])
        .filter(|[a, b, c]| a != b && b != c && c != a)
        .collect())
}

struct Property {
    name: String,
    /// Type of the count when it is a list.
    count: Option<Scalar>,
    scalar: Scalar,
}

struct Element {
    name: String,
    count: usize,
    properties: Vec<Property>,
}

impl Element {
    fn column(&self, name: &str) -> Result<usize, String> {
        let column = self.properties.iter().position(|p| p.name == name);
        column.ok_or(format!("element {} has no property {name}", self.name))
    }

    fn row(&self, numbers: &mut Numbers, index: usize) -> Result<Vec<Vec<f64>>, String> {
        let ends = || format!("the file ends in {} {index} of {}", self.name, self.count);
        let mut row = Vec::with_capacity(self.properties.len());
        for property in &self.properties {
            let count = match property.count {
                Some(scalar) => numbers.next(scalar).ok_or_else(ends)?,
                None => 1.0,
            };
            let list = (0..count.max(0.0) as usize).map(|_| numbers.next(property.scalar));
            row.push(list.collect::<Option<Vec<_>>>().ok_or_else(ends)?);
        }
        Ok(row)
    }
}

struct Header {
    format: String,
    elements: Vec<Element>,
}

impl Header {
    fn read(bytes: &[u8]) -> Result<(Self, &[u8]), String> {
        let mut header = Self {
            format: String::new(),
            elements: Vec::new(),
        };
        let mut rest = bytes;
        let mut first = true;
        loop {
            let end = rest
                .iter()
                .position(|b| *b == b'\n')
                .ok_or("not a PLY file")?;
            let line = String::from_utf8_lossy(&rest[..end]).trim().to_owned();
            rest = &rest[end + 1..];
            if std::mem::take(&mut first) && line != "ply" {
                return Err("not a PLY file".into());
            }
            if line == "end_header" {
                return Ok((header, rest));
            }
            header.line(&line)?;
        }
    }

    fn line(&mut self, line: &str) -> Result<(), String> {
        let bad = || format!("header line '{line}'");
        let scalar = |name: &str| Scalar::named(name).ok_or_else(bad);
        match line.split_whitespace().collect::<Vec<_>>()[..] {
            ["format", format, _] => format.clone_into(&mut self.format),
            ["element", name, count] => self.elements.push(Element {
                name: name.to_owned(),
                count: count.parse().map_err(|_| bad())?,
                properties: Vec::new(),
            }),
            ["property", "list", count, kind, name] => {
                let property = Property {
                    name: name.to_owned(),
                    count: Some(scalar(count)?),
                    scalar: scalar(kind)?,
                };
                self.elements
                    .last_mut()
                    .ok_or_else(bad)?
                    .properties
                    .push(property);
            }
            ["property", kind, name] => {
                let property = Property {
                    name: name.to_owned(),
                    count: None,
                    scalar: scalar(kind)?,
                };
                self.elements
                    .last_mut()
                    .ok_or_else(bad)?
                    .properties
                    .push(property);
            }
            ["ply" | "comment" | "obj_info", ..] | [] => {}
            _ => return Err(bad()),
        }
        Ok(())
    }

    fn numbers<'a>(&self, body: &'a [u8]) -> Result<Numbers<'a>, String> {
        match self.format.as_str() {
            "ascii" => {
                let text = std::str::from_utf8(body).map_err(|_| "the body is not text")?;
                Ok(Numbers::Text(text.split_ascii_whitespace()))
            }
            "binary_little_endian" => Ok(Numbers::Bytes(body, true)),
            "binary_big_endian" => Ok(Numbers::Bytes(body, false)),
            other => Err(format!("format '{other}'")),
        }
    }
}

/// The numbers of the body, one after the other.
enum Numbers<'a> {
    Text(std::str::SplitAsciiWhitespace<'a>),
    /// Bytes, and whether the least comes first.
    Bytes(&'a [u8], bool),
}

impl Numbers<'_> {
    fn next(&mut self, scalar: Scalar) -> Option<f64> {
        match self {
            Self::Text(words) => words.next()?.parse().ok(),
            Self::Bytes(bytes, little) => {
                let (head, tail) = bytes.split_at_checked(scalar.size())?;
                *bytes = tail;
                let mut word = [0; 8];
                word[..head.len()].copy_from_slice(head);
                if !*little {
                    word[..head.len()].reverse();
                }
                Some(scalar.value(word))
            }
        }
    }
}

#[derive(Clone, Copy)]
enum Scalar {
    Signed(usize),
    Unsigned(usize),
    Float,
    Double,
}

impl Scalar {
    fn named(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::Signed(1),
            "short" | "int16" => Self::Signed(2),
            "int" | "int32" => Self::Signed(4),
            "uchar" | "uint8" => Self::Unsigned(1),
            "ushort" | "uint16" => Self::Unsigned(2),
            "uint" | "uint32" => Self::Unsigned(4),
            "float" | "float32" => Self::Float,
            "double" | "float64" => Self::Double,
            _ => return None,
        })
    }

    fn size(self) -> usize {
        match self {
            Self::Signed(size) | Self::Unsigned(size) => size,
            Self::Float => 4,
            Self::Double => 8,
        }
    }

    /// The value of little-endian bytes.
    #[allow(clippy::cast_possible_wrap, reason = "the bits of a signed number")]
    fn value(self, bytes: [u8; 8]) -> f64 {
        let word = u64::from_le_bytes(bytes);
        match self {
            // Shifted up and back down, the sign fills the upper bits.
            Self::Signed(size) => {
                let unused = 64 - 8 * size;
                ((word << unused) as i64 >> unused) as f64
            }
            Self::Unsigned(_) => word as f64,
            Self::Float => f32::from_bits(word as u32).into(),
            Self::Double => f64::from_bits(word),
        }
    }
}
