//! OFF, the object file format of Geomview, as text: `OFF`, the numbers of vertices, faces and edges, then vertices and faces; `#` begins a comment.
//!
//! Letters in front of `OFF` announce what follows the coordinates: `N` a normal, `C` a colour; texture coordinates (`ST`) are ignored.
//! The rare binary form and points of more than three dimensions are refused.

use std::io::{self, Write};

use nalgebra::{Point3, Vector3};

use crate::raw::{Raw, finite};
use crate::text::{Lines, is_single_byte, number, shown, whole, words};
use crate::write::Options;
use crate::{Error, Format, Mesh, Place};

/// Reads a file.
pub fn read(bytes: &[u8]) -> Result<Raw, Error> {
    is_single_byte(bytes, Format::Off)?;
    let mut lines = Statements(Lines::new(bytes));
    let first = lines.next("its header")?;
    let mut head = words(first);
    let word = head.next().unwrap_or_default();
    let kind = word.strip_suffix(b"OFF");
    let kind = kind.filter(|k| {
        ["", "N", "C", "CN", "ST", "STN", "STC", "STCN"]
            .map(str::as_bytes)
            .contains(k)
    });
    let Some(kind) = kind else {
        let word = shown(word);
        return Err(lines.error(format!(
            "{word:?} is not OFF, or OFF preceded by N, C or ST"
        )));
    };
    let (normals, colours) = (kind.contains(&b'N'), kind.contains(&b'C'));
    // The counts may follow in the first line.
    let mut counts: Vec<&[u8]> = head.collect();
    if counts.is_empty() {
        counts = words(lines.next("the numbers of vertices and faces")?).collect();
    }
    let count = |k: usize| counts.get(k).and_then(|word| whole::<usize>(word));
    let (Some(vertices), Some(faces)) = (count(0), count(1)) else {
        return Err(lines.error("expected the numbers of vertices and faces".into()));
    };
    let mut raw = Raw::default();
    for vertex in 0..vertices {
        let row = numbers(&mut lines, "vertex", vertex, vertices)?;
        let wanted = if normals { 6 } else { 3 };
        if row.len() < wanted {
            return Err(lines.error(format!(
                "vertex {vertex}: expected {wanted} numbers, found {}",
                row.len()
            )));
        }
        let point = Point3::new(row[0], row[1], row[2]);
        finite(&point, vertex, lines.0.place())?;
        raw.points.push(point);
        if normals {
            raw.normals.push(Vector3::new(row[3], row[4], row[5]));
        }
        if let (true, Some(&[r, g, b])) = (
            colours,
            row.get(wanted..wanted + 3).and_then(|c| c.first_chunk()),
        ) {
            raw.colours
                .push(bytes_of([r, g, b], first_is_share(&row[wanted..])));
        }
    }
    if raw.colours.len() != raw.points.len() {
        raw.colours.clear();
    }
    for face in 0..faces {
        let row = numbers(&mut lines, "face", face, faces)?;
        let corners = row.first().copied().unwrap_or(0.0);
        let index = |v: &f64| *v >= 0.0 && v.fract() == 0.0 && *v <= f64::from(u32::MAX);
        if !index(&corners) || row.len() <= corners as usize {
            return Err(lines.error(format!(
                "face {face}: the line says {corners} corners, but {} numbers follow",
                row.len().saturating_sub(1)
            )));
        }
        // A colour of the face may follow.
        let corners = &row[1..=corners as usize];
        if let Some(bad) = corners.iter().find(|v| !index(v)) {
            return Err(lines.error(format!("face {face}: {bad} is not the index of a vertex")));
        }
        raw.polygons.push(corners.iter().map(|v| *v as u64));
    }
    Ok(raw)
}

/// Lines without comments.
struct Statements<'a>(Lines<'a>);

impl<'a> Statements<'a> {
    fn next(&mut self, what: &str) -> Result<&'a [u8], Error> {
        loop {
            let Some(line) = self.0.next_filled() else {
                return Err(self.error(format!("the file ends before {what}")));
            };
            let line = line.split(|b| *b == b'#').next().unwrap_or_default();
            if !line.trim_ascii().is_empty() {
                return Ok(line);
            }
        }
    }

    fn error(&self, reason: String) -> Error {
        Error::Syntax {
            format: Format::Off,
            place: Place::Line(self.0.number()),
            reason,
        }
    }
}

fn numbers(
    lines: &mut Statements,
    name: &str,
    index: usize,
    count: usize,
) -> Result<Vec<f64>, Error> {
    let line = lines.next(&format!("{name} {index}, the header says {count}"))?;
    let value = |word: &[u8]| {
        number(word).ok_or_else(|| {
            lines.error(format!("{name} {index}: {:?} is not a number", shown(word)))
        })
    };
    words(line).map(value).collect()
}

/// Whether 1 is full intensity: no value exceeds 1, and there are four values or one is not an integer.
fn first_is_share(colour: &[f64]) -> bool {
    colour.iter().all(|c| (0.0..=1.0).contains(c))
        && colour.iter().any(|c| c.fract() != 0.0 || colour.len() == 4)
}

fn bytes_of(colour: [f64; 3], shares: bool) -> [u8; 3] {
    let scale = if shares { 255.0 } else { 1.0 };
    colour.map(|c| (scale * c).round() as u8)
}

/// Writes positions, normals, colours, and triangles.
pub fn write(out: &mut dyn Write, mesh: &Mesh, options: Options) -> io::Result<()> {
    let (normals, colours) = (!mesh.normals.is_empty(), !mesh.colours.is_empty());
    let kind = match (colours, normals) {
        (true, true) => "CNOFF",
        (true, false) => "COFF",
        (false, true) => "NOFF",
        (false, false) => "OFF",
    };
    writeln!(out, "{kind}")?;
    if let Some(comment) = options.comment {
        writeln!(out, "# {}", comment.replace(['\n', '\r'], " "))?;
    }
    writeln!(out, "{} {} 0", mesh.points.len(), mesh.triangles.len())?;
    for i in 0..mesh.points.len() {
        let numbers = mesh.numbers(i);
        let words: Vec<String> = numbers.map(|v| options.precision.text(*v)).collect();
        write!(out, "{}", words.join(" "))?;
        if let Some([r, g, b]) = mesh.colours.get(i) {
            // Integers: 255 is full intensity.
            write!(out, " {r} {g} {b}")?;
        }
        writeln!(out)?;
    }
    for [a, b, c] in &mesh.triangles {
        writeln!(out, "3 {a} {b} {c}")?;
    }
    out.flush()
}
