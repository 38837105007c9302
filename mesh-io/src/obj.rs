//! Wavefront OBJ: lines `v x y z`, `vn x y z` and `f v/t/n …`; indices count from 1, negative ones from the last line backwards.
//!
//! A vertex takes the normal of the first corner that uses it. Colours follow the coordinates, from 0 to 1 or to 255. A `\` at
//! the end of a line continues it, and `#` begins a comment anywhere. Texture coordinates, groups and materials are ignored.
//!
//! Own code: `tobj` 4.0 needs UTF-8, refuses a face over two lines and a comment behind one, gives no line in its errors, and triangulates
//! concave faces as fans, which fill their notches.

use std::io::{self, Write};

use nalgebra::{Point3, Vector3};

use crate::raw::{Raw, finite};
use crate::text::{Lines, is_single_byte, number, shown, words};
use crate::write::Options;
use crate::{Error, Format, Mesh, Place};

/// Reads a file.
pub fn read(bytes: &[u8]) -> Result<Raw, Error> {
    is_single_byte(bytes, Format::Obj)?;
    let mut file = File::default();
    let mut lines = Lines::new(bytes);
    let mut statement = Vec::new();
    while let Some(line) = lines.next() {
        let line = line.split(|b| *b == b'#').next().unwrap_or_default();
        if let Some(part) = line.trim_ascii_end().strip_suffix(b"\\") {
            statement.extend_from_slice(part);
            statement.push(b' ');
            continue;
        }
        if statement.is_empty() {
            file.statement(line, lines.place())?;
        } else {
            statement.extend_from_slice(line);
            file.statement(&std::mem::take(&mut statement), lines.place())?;
        }
    }
    if !statement.is_empty() {
        file.statement(&statement, lines.place())?;
    }
    if file.raw.points.is_empty() {
        return Err(syntax(
            lines.place(),
            "there is no vertex (a line that begins with v)".into(),
        ));
    }
    Ok(file.finish())
}

fn syntax(place: Place, reason: String) -> Error {
    Error::Syntax {
        format: Format::Obj,
        place,
        reason,
    }
}

/// The content read so far.
#[derive(Default)]
struct File {
    raw: Raw,
    /// Colours as in the file; `None` for vertices without.
    colours: Vec<Option<[f64; 3]>>,
    normals: Vec<Vector3<f64>>,
    /// Index of the normal of each vertex, from the first corner that uses it.
    chosen: Vec<Option<usize>>,
}

impl File {
    fn statement(&mut self, line: &[u8], place: Place) -> Result<(), Error> {
        let mut words = words(line);
        match words.next() {
            Some(b"v") => self.vertex(&numbers(words, place)?, place),
            Some(b"vn") => {
                let values = numbers(words, place)?;
                let &[x, y, z, ..] = &values[..] else {
                    return Err(syntax(place, "a normal needs three numbers".into()));
                };
                self.normals.push(Vector3::new(x, y, z));
                Ok(())
            }
            Some(b"f" | b"fo") => self.face(words, place),
            _ => Ok(()),
        }
    }

    fn vertex(&mut self, values: &[f64], place: Place) -> Result<(), Error> {
        let &[x, y, z, ..] = values else {
            return Err(syntax(place, "a vertex needs three coordinates".into()));
        };
        let point = Point3::new(x, y, z);
        finite(&point, self.raw.points.len(), place)?;
        self.raw.points.push(point);
        // A fourth number alone is a weight, which only curves use; three more are a colour.
        self.colours.push(match values[3..] {
            [r, g, b] => Some([r, g, b]),
            _ => None,
        });
        self.chosen.push(None);
        Ok(())
    }

    fn face<'a>(
        &mut self,
        corners: impl Iterator<Item = &'a [u8]>,
        place: Place,
    ) -> Result<(), Error> {
        let count = self.raw.points.len();
        for word in corners {
            let mut parts = word.split(|b| *b == b'/');
            let at = parts.next().and_then(|part| index(part, count));
            let at = at.ok_or_else(|| {
                let word = shown(word);
                syntax(
                    place,
                    format!("{word:?} is not the index of a vertex ({count} so far)"),
                )
            })?;
            self.raw.polygons.corner(at as u64);
            let normal = parts.nth(1).filter(|part| !part.is_empty());
            if let (Some(part), Some(chosen)) = (normal, self.chosen.get_mut(at)) {
                let known = self.normals.len();
                let normal = index(part, known).filter(|n| *n < known).ok_or_else(|| {
                    let part = shown(part);
                    syntax(
                        place,
                        format!("{part:?} is not the index of a normal ({known} so far)"),
                    )
                })?;
                chosen.get_or_insert(normal);
            }
        }
        match self.raw.polygons.close() {
            corners @ 0..3 => Err(syntax(place, format!("a face with {corners} corners"))),
            _ => Ok(()),
        }
    }

    fn finish(mut self) -> Raw {
        if self.chosen.iter().all(Option::is_none) && self.normals.len() == self.raw.points.len() {
            // A cloud: normals in the order of the points.
            self.raw.normals = self.normals;
        } else if self.chosen.iter().any(Option::is_some) {
            // Vertices that no face uses have no normal.
            let normal = |n: &Option<usize>| n.map_or_else(Vector3::zeros, |n| self.normals[n]);
            self.raw.normals = self.chosen.iter().map(normal).collect();
        }
        let colours: Option<Vec<[f64; 3]>> = self.colours.into_iter().collect();
        if let Some(colours) = colours {
            let bytes = colours.iter().flatten().any(|c| *c > 1.0);
            let scale = if bytes { 1.0 } else { 255.0 };
            let byte = |c: [f64; 3]| c.map(|c| (scale * c).round() as u8);
            self.raw.colours = colours.into_iter().map(byte).collect();
        }
        self.raw
    }
}

fn numbers<'a>(words: impl Iterator<Item = &'a [u8]>, place: Place) -> Result<Vec<f64>, Error> {
    let value = |word| {
        number(word).ok_or_else(|| syntax(place, format!("{:?} is not a number", shown(word))))
    };
    words.map(value).collect()
}

/// Index from 0; it may refer to a vertex further down.
fn index(word: &[u8], count: usize) -> Option<usize> {
    let index: i64 = crate::text::whole(word)?;
    let distance = usize::try_from(index.unsigned_abs()).ok()?;
    if index < 0 {
        count.checked_sub(distance)
    } else {
        distance.checked_sub(1)
    }
}

/// Writes positions with colours, normals, and triangles.
pub fn write(out: &mut dyn Write, mesh: &Mesh, options: Options) -> io::Result<()> {
    let word = |v: &f64| options.precision.text(*v);
    let three = |v: &[f64]| v.iter().map(word).collect::<Vec<_>>().join(" ");
    if let Some(comment) = options.comment {
        writeln!(out, "# {}", comment.replace(['\n', '\r'], " "))?;
    }
    for (i, p) in mesh.points.iter().enumerate() {
        write!(out, "v {}", three(p.coords.as_slice()))?;
        if let Some(colour) = mesh.colours.get(i) {
            // Eight bits as a decimal from 0 to 1, which reads back as the same byte.
            for c in colour {
                write!(out, " {:.4}", f64::from(*c) / 255.0)?;
            }
        }
        writeln!(out)?;
    }
    for n in &mesh.normals {
        writeln!(out, "vn {}", three(n.as_slice()))?;
    }
    for t in &mesh.triangles {
        let [a, b, c] = t.map(|v| v + 1);
        if mesh.normals.is_empty() {
            writeln!(out, "f {a} {b} {c}")?;
        } else {
            writeln!(out, "f {a}//{a} {b}//{b} {c}//{c}")?;
        }
    }
    out.flush()
}
