//! The values, element by element in the order of the header.

use super::header::{Element, Encoding, Header, Property};
use super::syntax;
use crate::columns::{Column, Columns, Packed, Shade};
use crate::raw::{Raw, finite};
use crate::scalar::{Cursor, Order, Scalar};
use crate::text::{Lines, number, shown, words};
use crate::{Error, Format, Place};

/// Reads all elements into `raw`.
pub fn read(header: &Header, bytes: &[u8], raw: &mut Raw) -> Result<(), Error> {
    if !header.elements.iter().any(|e| e.name == "vertex") {
        return Err(syntax(
            Place::Line(header.lines),
            "the header names no element vertex",
        ));
    }
    match header.encoding {
        Encoding::Text => {
            let lines = Lines::from_line(&bytes[header.bytes..], header.lines);
            each(header, &mut Text { lines }, raw)
        }
        Encoding::Binary(order) => {
            let cursor = Cursor::new(bytes, header.bytes, order, Format::Ply);
            each(header, &mut Binary { cursor }, raw)
        }
    }
}

/// Rows of values in any encoding.
trait Rows {
    /// Reads a row: numbers into `row`, one per property (the count for a list), and all values of the wanted list.
    fn row(&mut self, element: &Element, index: usize, row: &mut Row) -> Result<(), Error>;
    /// Place of the last row.
    fn place(&self) -> Place;
    /// Upper limit of the number of rows that can follow.
    fn most_rows(&self, element: &Element) -> usize;
}

/// One row: numbers, and the wanted list.
#[derive(Default)]
struct Row {
    numbers: Vec<f64>,
    /// The property whose list is kept.
    wanted: Option<usize>,
    list: Vec<f64>,
}

fn each(header: &Header, rows: &mut dyn Rows, raw: &mut Raw) -> Result<(), Error> {
    for element in &header.elements {
        // Rows without properties take no bytes, so that the count of the header alone would decide the running time.
        if element.properties.is_empty() {
            continue;
        }
        match element.name.as_str() {
            "vertex" => vertices(element, rows, raw)?,
            "face" => faces(element, rows, raw)?,
            "tristrips" => strips(element, rows, raw)?,
            _ => over(element, rows)?,
        }
    }
    Ok(())
}

fn vertices(element: &Element, rows: &mut dyn Rows, raw: &mut Raw) -> Result<(), Error> {
    let list: Vec<Column> = element.properties.iter().map(column).collect();
    let mut columns = Columns::new(&list);
    if let Some(name) = columns.missing() {
        return Err(syntax(
            rows.place(),
            format!("element vertex has no property {name}"),
        ));
    }
    raw.points
        .reserve(element.count.min(rows.most_rows(element)));
    let mut row = Row::default();
    for index in 0..element.count {
        rows.row(element, index, &mut row)?;
        finite(&columns.point(&row.numbers), raw.points.len(), rows.place())?;
        columns.add(&row.numbers, raw);
    }
    columns.finish(raw);
    Ok(())
}

fn column(property: &Property) -> Column<'_> {
    Column {
        name: &property.name,
        shade: match property.scalar {
            Scalar::F32 | Scalar::F64 => Shade::Share,
            Scalar::I16 | Scalar::U16 => Shade::Word,
            _ => Shade::Byte,
        },
        packed: if property.scalar.is_whole() {
            Packed::Whole
        } else {
            Packed::Float
        },
        single: property.count.is_none(),
    }
}

fn faces(element: &Element, rows: &mut dyn Rows, raw: &mut Raw) -> Result<(), Error> {
    let named = |p: &Property| matches!(p.name.as_str(), "vertex_indices" | "vertex_index");
    let lists = |p: &Property| p.count.is_some() && p.scalar.is_whole();
    let properties = &element.properties;
    let wanted = properties.iter().position(|p| lists(p) && named(p));
    let Some(wanted) = wanted.or_else(|| properties.iter().position(lists)) else {
        return if element.count == 0 {
            Ok(())
        } else {
            Err(syntax(
                rows.place(),
                "element face has no list vertex_indices of integers",
            ))
        };
    };
    let mut row = Row {
        wanted: Some(wanted),
        ..Row::default()
    };
    for index in 0..element.count {
        rows.row(element, index, &mut row)?;
        for &corner in &row.list {
            raw.polygons.corner(vertex(corner, index, rows.place())?);
        }
        raw.polygons.close();
    }
    Ok(())
}

fn vertex(corner: f64, face: usize, place: Place) -> Result<u64, Error> {
    if corner >= 0.0 && corner.fract() == 0.0 && corner <= f64::from(u32::MAX) {
        Ok(corner as u64)
    } else {
        Err(syntax(
            place,
            format!("face {face}: {corner} is not the index of a vertex"),
        ))
    }
}

/// Strips: every corner after the second makes a triangle with the two before it, with alternating orientation.
fn strips(element: &Element, rows: &mut dyn Rows, raw: &mut Raw) -> Result<(), Error> {
    let Some(wanted) = element.properties.iter().position(|p| p.count.is_some()) else {
        return over(element, rows);
    };
    let mut row = Row {
        wanted: Some(wanted),
        ..Row::default()
    };
    for index in 0..element.count {
        rows.row(element, index, &mut row)?;
        // A negative corner ends a strip.
        for strip in row.list.split(|corner| *corner < 0.0) {
            for (k, corners) in strip.windows(3).enumerate() {
                let [a, b, c] = [corners[0], corners[1], corners[2]];
                for corner in if k % 2 == 0 { [a, b, c] } else { [b, a, c] } {
                    raw.polygons.corner(vertex(corner, index, rows.place())?);
                }
                raw.polygons.close();
            }
        }
    }
    Ok(())
}

/// Skips an element.
fn over(element: &Element, rows: &mut dyn Rows) -> Result<(), Error> {
    let mut row = Row::default();
    (0..element.count).try_for_each(|index| rows.row(element, index, &mut row))
}

/// One row per line.
struct Text<'a> {
    lines: Lines<'a>,
}

impl Rows for Text<'_> {
    fn row(&mut self, element: &Element, index: usize, row: &mut Row) -> Result<(), Error> {
        let Element { name, count, .. } = element;
        let Some(line) = self.lines.next_filled() else {
            return Err(syntax(
                self.place(),
                format!("the file ends at {name} {index}, the header says {count}"),
            ));
        };
        let place = self.place();
        let complain = |what: String| syntax(place, format!("{name} {index}: {what}"));
        let mut words = words(line);
        row.numbers.clear();
        row.list.clear();
        for (k, property) in element.properties.iter().enumerate() {
            let mut value = || {
                let word = words
                    .next()
                    .ok_or_else(|| complain(format!("{} is missing", property.name)))?;
                number(word).ok_or_else(|| {
                    complain(format!(
                        "{} is not a number: {:?}",
                        property.name,
                        shown(word)
                    ))
                })
            };
            let first = value()?;
            row.numbers.push(first);
            if property.count.is_some() {
                for _ in 0..length(first).ok_or_else(|| complain(bad_length(property, first)))? {
                    let item = value()?;
                    if row.wanted == Some(k) {
                        row.list.push(item);
                    }
                }
            }
        }
        // Some programs add values of their own to faces. After a vertex, further values mean that the columns do not have the meaning they are named for.
        match words.next().filter(|_| name == "vertex") {
            Some(extra) => Err(complain(format!("an extra value: {:?}", shown(extra)))),
            None => Ok(()),
        }
    }

    fn place(&self) -> Place {
        self.lines.place()
    }

    fn most_rows(&self, element: &Element) -> usize {
        // Every value takes at least a digit and a separator.
        self.lines.rest().len() / (2 * element.properties.len()) + 1
    }
}

/// Binary rows.
struct Binary<'a> {
    cursor: Cursor<'a>,
}

impl Rows for Binary<'_> {
    fn row(&mut self, element: &Element, index: usize, row: &mut Row) -> Result<(), Error> {
        let Element { name, count, .. } = element;
        let ends = |cursor: &Cursor| {
            cursor.error(format!(
                "the file ends in {name} {index}, the header says {count}"
            ))
        };
        row.numbers.clear();
        row.list.clear();
        for (k, property) in element.properties.iter().enumerate() {
            let first = self
                .cursor
                .number(property.count.unwrap_or(property.scalar));
            let first = first.ok_or_else(|| ends(&self.cursor))?;
            row.numbers.push(first);
            if property.count.is_none() {
                continue;
            }
            let length = length(first).ok_or_else(|| {
                self.cursor
                    .error(format!("{name} {index}: {}", bad_length(property, first)))
            })?;
            let size = property.scalar.size();
            let list = length
                .checked_mul(size)
                .and_then(|bytes| self.cursor.take(bytes));
            let list = list.ok_or_else(|| ends(&self.cursor))?;
            if row.wanted == Some(k) {
                let order = self.cursor.order();
                row.list.extend(numbers(list, property.scalar, order));
            }
        }
        Ok(())
    }

    fn place(&self) -> Place {
        self.cursor.place()
    }

    fn most_rows(&self, element: &Element) -> usize {
        self.cursor.left() / element.least_bytes().max(1)
    }
}

fn numbers(bytes: &[u8], scalar: Scalar, order: Order) -> impl Iterator<Item = f64> {
    bytes
        .chunks_exact(scalar.size())
        .filter_map(move |chunk| scalar.read(chunk, order))
}

fn length(value: f64) -> Option<usize> {
    (value >= 0.0 && value.fract() == 0.0 && value <= f64::from(u32::MAX)).then_some(value as usize)
}

fn bad_length(property: &Property, value: f64) -> String {
    format!("{} cannot have {value} values", property.name)
}
