//! STL: triangles one by one, as text (`vertex x y z` lines) or as 50-byte records after an 84-byte head.
//!
//! Every triangle has its own corners; corners with the same coordinates become one vertex, in the order of first occurrence. Facet normals
//! are ignored, since the corners determine them. Binary files may also begin with the word `solid`, so the length decides:
//! `84 + 50 n` bytes, with `n` at byte 80.
//!
//! Own code: `stl_io` 0.11 refuses text with a facet normal of `nan`, accepts a header with a count of zero as true, and gives no
//! place in its errors.

use std::collections::HashMap;
use std::io::{self, Write};

use nalgebra::Point3;

use crate::raw::{Raw, finite};
use crate::text::{Lines, is_single_byte, number, shown, words};
use crate::write::{Encoding, Options};
use crate::{Error, Format, Mesh, Place};

const HEAD: usize = 84;
const RECORD: usize = 50;

/// Reads a file.
pub fn read(bytes: &[u8]) -> Result<Raw, Error> {
    is_single_byte(bytes, Format::Stl)?;
    let count = bytes.get(80..).and_then(|b| b.first_chunk());
    let count = count.map(|b| u32::from_le_bytes(*b) as usize);
    match count {
        Some(count) if bytes.len() - HEAD == RECORD * count => binary(&bytes[HEAD..]),
        _ if is_text(bytes) => text(bytes),
        // Some programs append other bytes.
        Some(count @ 1..) if bytes.len() - HEAD > RECORD * count => {
            binary(&bytes[HEAD..][..RECORD * count])
        }
        Some(count) => Err(syntax(
            Place::Byte(80),
            format!(
                "the header says {count} triangles, which take {} bytes; the file has {}",
                HEAD + RECORD * count,
                bytes.len()
            ),
        )),
        None => Err(syntax(
            Place::Byte(0),
            "neither text that begins with \"solid\" nor long enough to be binary".into(),
        )),
    }
}

fn syntax(place: Place, reason: String) -> Error {
    Error::Syntax {
        format: Format::Stl,
        place,
        reason,
    }
}

/// Whether the second non-empty line begins a facet or ends the solid.
fn is_text(bytes: &[u8]) -> bool {
    let mut lines = Lines::new(bytes);
    let begins = |line: Option<&[u8]>, keywords: &[&str]| {
        let word = line.and_then(|line| words(line).next()).unwrap_or_default();
        keywords
            .iter()
            .any(|k| word.eq_ignore_ascii_case(k.as_bytes()))
    };
    begins(lines.next_filled(), &["solid"]) && {
        let rest = lines.next_filled();
        rest.is_none() && bytes.len() < HEAD || begins(rest, &["facet", "endsolid"])
    }
}

/// Corners merged to vertices.
#[derive(Default)]
struct Corners {
    raw: Raw,
    known: HashMap<[u64; 3], u64>,
    facet: Vec<u64>,
}

impl Corners {
    fn add(&mut self, point: Point3<f64>, place: Place) -> Result<(), Error> {
        finite(&point, self.raw.points.len(), place)?;
        // Adding zero gives both signed zeros the same key.
        let key = [0, 1, 2].map(|k| (point[k] + 0.0).to_bits());
        let points = &mut self.raw.points;
        let vertex = *self.known.entry(key).or_insert_with(|| {
            points.push(point);
            points.len() as u64 - 1
        });
        self.facet.push(vertex);
        Ok(())
    }

    fn close(&mut self) {
        self.raw.polygons.push(self.facet.drain(..));
    }
}

fn binary(records: &[u8]) -> Result<Raw, Error> {
    let mut corners = Corners::default();
    for (index, record) in records.chunks_exact(RECORD).enumerate() {
        // Twelve bytes of normal, twelve for each corner, and two unused ones.
        for (k, bytes) in record[12..48].chunks_exact(12).enumerate() {
            let place = Place::Byte(HEAD + RECORD * index + 12 * (k + 1));
            let number = |at: usize| {
                let bytes = bytes.get(at..).and_then(|b| b.first_chunk());
                bytes.map_or(f64::NAN, |b| f32::from_le_bytes(*b).into())
            };
            corners.add(Point3::new(number(0), number(4), number(8)), place)?;
        }
        corners.close();
    }
    Ok(corners.raw)
}

fn text(bytes: &[u8]) -> Result<Raw, Error> {
    let mut corners = Corners::default();
    let mut lines = Lines::new(bytes);
    while let Some(line) = lines.next() {
        let place = lines.place();
        let mut words = words(line);
        let first = words.next().unwrap_or_default().to_ascii_lowercase();
        match &first[..] {
            b"vertex" => {
                let mut point = Point3::origin();
                for k in 0..3 {
                    let word = words
                        .next()
                        .ok_or_else(|| syntax(place, "a vertex needs three coordinates".into()))?;
                    point[k] = number(word).ok_or_else(|| {
                        syntax(place, format!("{:?} is not a number", shown(word)))
                    })?;
                }
                corners.add(point, place)?;
            }
            b"endloop" if corners.facet.len() == 3 => corners.close(),
            b"endloop" => {
                let count = corners.facet.len();
                return Err(syntax(place, format!("a facet with {count} corners")));
            }
            _ => {}
        }
    }
    if corners.facet.is_empty() {
        Ok(corners.raw)
    } else {
        Err(syntax(lines.place(), "the file ends in a facet".into()))
    }
}

/// Writes the triangles with their normals.
pub fn write(out: &mut dyn Write, mesh: &Mesh, options: Options) -> io::Result<()> {
    let name = options.comment.unwrap_or("mesh").replace(['\n', '\r'], " ");
    let facet = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|v| mesh.points[v as usize]);
        let normal = (b - a).cross(&(c - a));
        let normal = normal.try_normalize(0.0).unwrap_or_default();
        [normal, a.coords, b.coords, c.coords]
    };
    if options.encoding == Encoding::Text {
        writeln!(out, "solid {name}")?;
        for t in &mesh.triangles {
            let [normal, corners @ ..] = facet(t).map(|v| {
                let words = v.iter().map(|c| options.precision.text(*c));
                words.collect::<Vec<_>>().join(" ")
            });
            writeln!(out, "facet normal {normal}\nouter loop")?;
            for corner in corners {
                writeln!(out, "vertex {corner}")?;
            }
            writeln!(out, "endloop\nendfacet")?;
        }
        writeln!(out, "endsolid {name}")?;
    } else {
        let mut head = [b' '; 80];
        // Does not begin with "solid", by which some readers recognise text.
        let title = format!("binary STL: {name}");
        let length = title.len().min(80);
        head[..length].copy_from_slice(&title.as_bytes()[..length]);
        out.write_all(&head)?;
        out.write_all(&(mesh.triangles.len() as u32).to_le_bytes())?;
        for t in &mesh.triangles {
            for v in facet(t).iter().flat_map(|v| v.iter()) {
                out.write_all(&(*v as f32).to_le_bytes())?;
            }
            out.write_all(&[0, 0])?;
        }
    }
    out.flush()
}
