//! Points as text, one per line, with numbers separated by spaces, commas or semicolons.
//!
//! A first line of names (`x,y,z,nx,ny,nz`, `//X Y Z R G B`) defines the columns. Without it the number of columns does:
//!
//! ```text
//! 3  x y z             6  x y z and a normal, or red green blue where all are whole numbers up to 255 and not all 0 or 1
//! 4  x y z value       7  x y z value red green blue
//! 9  x y z red green blue and a normal, or the normal first
//! ```
//!
//! A single number on the first line is the count of points (`.pts`). Lines that begin with `#` or `//` are comments.

use std::io::{self, Write};

use crate::columns::{Column, Columns, Packed, Shade};
use crate::raw::{Raw, finite};
use crate::text::{Lines, is_single_byte, number, shown, whole};
use crate::write::Options;
use crate::{Error, Format, Mesh, Place};

/// Reads a file.
pub fn read(bytes: &[u8]) -> Result<Raw, Error> {
    is_single_byte(bytes, Format::Xyz)?;
    let text = Text::read(bytes)?;
    if text.lines.is_empty() {
        return Ok(Raw::default());
    }
    let (names, shade) = text.columns()?;
    let list: Vec<Column> = names.iter().map(|name| column(name, shade)).collect();
    let mut columns = Columns::new(&list);
    if let Some(name) = columns.missing() {
        return Err(syntax(Place::Line(1), format!("there is no column {name}")));
    }
    let mut raw = Raw::default();
    for (row, line) in text.rows.chunks_exact(text.width).zip(text.lines) {
        finite(&columns.point(row), raw.points.len(), Place::Line(line))?;
        columns.add(row, &mut raw);
    }
    columns.finish(&mut raw);
    Ok(raw)
}

/// The numbers of a file, before their meaning is known.
#[derive(Default)]
struct Text {
    /// Names from the heading.
    names: Option<Vec<String>>,
    /// Number of points according to the first line.
    count: Option<usize>,
    /// All numbers, row after row.
    rows: Vec<f64>,
    /// Number of columns.
    width: usize,
    /// Line of each row.
    lines: Vec<usize>,
}

impl Text {
    fn read(bytes: &[u8]) -> Result<Self, Error> {
        let (mut text, mut lines) = (Self::default(), Lines::new(bytes));
        while let Some(line) = lines.next_filled() {
            text.line(line, lines.number())?;
        }
        let found = text.lines.len();
        match text.count {
            Some(promised) if promised != found => Err(syntax(
                lines.place(),
                format!("the first line says {promised} points, but there are {found}"),
            )),
            _ => Ok(text),
        }
    }

    fn line(&mut self, line: &[u8], number: usize) -> Result<(), Error> {
        let remark = line.trim_ascii_start();
        let remark = remark
            .strip_prefix(b"#")
            .or_else(|| remark.strip_prefix(b"//"));
        let cells: Vec<&[u8]> = cells(remark.unwrap_or(line)).collect();
        let first = self.lines.is_empty();
        if first && self.names.is_none() && is_heading(&cells) {
            self.names = Some(cells.iter().map(|c| column_name(c)).collect());
            return Ok(());
        }
        if remark.is_some() || cells.is_empty() {
            return Ok(());
        }
        let error = |reason| syntax(Place::Line(number), reason);
        if first && self.count.is_none() && cells.len() == 1 {
            let count = whole(cells[0]).ok_or_else(|| {
                let line = shown(line);
                error(format!(
                    "{line:?} is neither a point nor the number of points"
                ))
            })?;
            self.count = Some(count);
            return Ok(());
        }
        if first {
            self.width = self.names.as_ref().map_or(cells.len(), Vec::len);
        }
        if cells.len() != self.width {
            let (found, width) = (cells.len(), self.width);
            return Err(error(format!(
                "{found} values, but there are {width} columns"
            )));
        }
        for (k, cell) in cells.iter().enumerate() {
            let value = self::number(cell).ok_or_else(|| {
                error(format!(
                    "value {}: {:?} is not a number",
                    k + 1,
                    shown(cell)
                ))
            })?;
            self.rows.push(value);
        }
        self.lines.push(number);
        Ok(())
    }

    /// Names of the columns, and how colours are written.
    fn columns(&self) -> Result<(Vec<String>, Shade), Error> {
        if let Some(names) = &self.names {
            let shares = colours_are_shares(names, &self.rows);
            return Ok((
                names.clone(),
                if shares { Shade::Share } else { Shade::Byte },
            ));
        }
        let names = guess(&self.rows, self.width).ok_or_else(|| {
            let width = self.width;
            let wanted = "expected 3, 4, 6, 7 or 9 numbers, or a first line that names the columns";
            syntax(
                Place::Line(self.lines[0]),
                format!("{width} numbers a line: {wanted}"),
            )
        })?;
        Ok((names, Shade::Byte))
    }
}

fn column(name: &str, shade: Shade) -> Column<'_> {
    Column {
        name,
        shade,
        packed: Packed::Whole,
        single: true,
    }
}

fn syntax(place: Place, reason: String) -> Error {
    Error::Syntax {
        format: Format::Xyz,
        place,
        reason,
    }
}

fn cells(line: &[u8]) -> impl Iterator<Item = &[u8]> {
    let between = |b: &u8| b.is_ascii_whitespace() || matches!(b, b',' | b';');
    line.split(between).filter(|cell| !cell.is_empty())
}

fn is_heading(cells: &[&[u8]]) -> bool {
    let letter = |cell: &&[u8]| {
        let first = cell.iter().find(|b| **b != b'"');
        first.is_some_and(u8::is_ascii_alphabetic) && number(cell).is_none()
    };
    let names: Vec<String> = cells.iter().map(|c| column_name(c)).collect();
    let has = |name: &str| names.iter().any(|n| n.eq_ignore_ascii_case(name));
    cells.iter().all(letter) && has("x") && has("y") && has("z")
}

fn column_name(cell: &[u8]) -> String {
    String::from_utf8_lossy(cell).trim_matches('"').to_owned()
}

/// Names of the columns, guessed from their number and values.
fn guess(rows: &[f64], width: usize) -> Option<Vec<String>> {
    const COLOUR: &str = "red green blue";
    const NORMAL: &str = "nx ny nz";
    let colour = |from: usize| {
        let values = || {
            rows.chunks_exact(width)
                .flat_map(|row| &row[from..from + 3])
        };
        values().all(|v| v.fract() == 0.0 && (0.0..=255.0).contains(v))
            && values().any(|v| *v > 1.0)
    };
    let names = match width {
        3 => "x y z".to_owned(),
        4 => "x y z value".to_owned(),
        6 if colour(3) => format!("x y z {COLOUR}"),
        6 => format!("x y z {NORMAL}"),
        7 => format!("x y z value {COLOUR}"),
        9 if colour(6) && !colour(3) => format!("x y z {NORMAL} {COLOUR}"),
        9 => format!("x y z {COLOUR} {NORMAL}"),
        _ => return None,
    };
    Some(names.split(' ').map(str::to_owned).collect())
}

/// Whether named colours range to 1 and are not integers.
fn colours_are_shares(names: &[String], rows: &[f64]) -> bool {
    let is = |name: &String| {
        matches!(
            name.to_ascii_lowercase().as_str(),
            "r" | "g" | "b" | "red" | "green" | "blue"
        )
    };
    let columns: Vec<usize> = (0..names.len()).filter(|&k| is(&names[k])).collect();
    let values = || {
        rows.chunks_exact(names.len())
            .flat_map(|row| columns.iter().map(|&k| row[k]))
    };
    values().all(|v| (0.0..=1.0).contains(&v)) && values().any(|v| v.fract() != 0.0)
}

/// Writes a line of names and then the points, with numbers separated by spaces.
pub fn write(out: &mut dyn Write, mesh: &Mesh, options: Options) -> io::Result<()> {
    let mut names = vec!["x", "y", "z"];
    if !mesh.normals.is_empty() {
        names.extend(["nx", "ny", "nz"]);
    }
    if !mesh.colours.is_empty() {
        names.extend(["red", "green", "blue"]);
    }
    names.extend(mesh.properties.iter().map(crate::Property::name));
    writeln!(out, "# {}", names.join(" "))?;
    for i in 0..mesh.points.len() {
        let word = |v: &f64| options.precision.text(*v);
        let further = mesh.properties.iter().filter_map(|p| p.values().get(i));
        let colour = mesh.colours.get(i).into_iter().flatten().map(u8::to_string);
        let place = mesh.numbers(i).map(word);
        let words: Vec<String> = place.chain(colour).chain(further.map(word)).collect();
        writeln!(out, "{}", words.join(" "))?;
    }
    out.flush()
}
