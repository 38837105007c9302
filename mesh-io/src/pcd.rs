//! PCD, the format of the Point Cloud Library: a header in text, then values as text, as little-endian bytes (`binary`), or field after field and
//! compressed by LZF (`binary_compressed`).
//!
//! Fields are `x y z`, `normal_x normal_y normal_z`, `rgb` (packed into one number), and others. A point whose `x y z` are all NaN is a pixel of
//! a depth camera that got no answer: it is left out and counted.
//!
//! Own code: `pcd-rs` 0.13 reserves as much memory as a header claims and panics where a compressed block is shorter than its points. LZF is
//! `lzf`.

use std::io::{self, Write};

use nalgebra::Point3;

use crate::columns::{Column, Columns, Packed, Shade};
use crate::raw::{Raw, finite};
use crate::scalar::{Order, Scalar};
use crate::text::{Lines, number, shown, whole, words};
use crate::write::{Encoding, Options, Precision};
use crate::{Error, Format, Mesh, Place};

/// LZF makes at most 264 bytes of three.
const MOST_EXPANSION: usize = 88;

/// Reads a file.
pub fn read(bytes: &[u8]) -> Result<Raw, Error> {
    let header = Header::read(bytes)?;
    let list: Vec<Column> = header.fields.iter().map(Field::column).collect();
    let mut columns = Columns::new(&list);
    if let Some(name) = columns.missing() {
        return Err(header.error(format!("there is no field {name}")));
    }
    let mut raw = Raw::default();
    match header.data {
        Data::Text => text(&header, bytes, &mut columns, &mut raw)?,
        Data::Binary => {
            let body = &bytes[header.bytes..];
            header.must_hold(body.len(), header.bytes)?;
            let at = |point: usize, field: usize| point * header.stride() + header.offset(field);
            packed(&header, body, at, &mut columns, &mut raw)?;
        }
        Data::Compressed => {
            let body = decompressed(&header, bytes)?;
            header.must_hold(body.len(), header.bytes)?;
            let at = |point: usize, field: usize| {
                header.points * header.offset(field) + point * header.fields[field].size()
            };
            packed(&header, &body, at, &mut columns, &mut raw)?;
        }
    }
    columns.finish(&mut raw);
    Ok(raw)
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Data {
    Text,
    Binary,
    Compressed,
}

#[derive(Debug)]
struct Field {
    name: String,
    scalar: Scalar,
    count: usize,
}

impl Field {
    fn size(&self) -> usize {
        self.scalar.size() * self.count
    }

    fn column(&self) -> Column<'_> {
        Column {
            name: &self.name,
            shade: if self.scalar.is_whole() {
                Shade::Byte
            } else {
                Shade::Share
            },
            packed: if self.scalar.is_whole() {
                Packed::Whole
            } else {
                Packed::Float
            },
            single: self.count == 1,
        }
    }
}

struct Header {
    fields: Vec<Field>,
    points: usize,
    data: Data,
    lines: usize,
    bytes: usize,
}

fn syntax(place: Place, reason: String) -> Error {
    Error::Syntax {
        format: Format::Pcd,
        place,
        reason,
    }
}

impl Header {
    fn read(bytes: &[u8]) -> Result<Self, Error> {
        let mut lines = Lines::new(bytes);
        let (mut names, mut sizes, mut types, mut counts) = (vec![], vec![], vec![], vec![]);
        let (mut width, mut height, mut points) = (None, None, None);
        loop {
            let Some(line) = lines.next() else {
                return Err(syntax(
                    lines.place(),
                    "the file ends in the header: there is no DATA".into(),
                ));
            };
            let list: Vec<&[u8]> = words(line).collect();
            let complain = |what: &str| syntax(lines.place(), format!("{what}: {:?}", shown(line)));
            let all =
                |list: &[&[u8]]| -> Option<Vec<usize>> { list.iter().map(|w| whole(w)).collect() };
            match list[..] {
                [] | [b"VERSION" | b"VIEWPOINT", ..] => {}
                [word, ..] if word.starts_with(b"#") => {}
                [b"FIELDS" | b"COLUMNS", ref rest @ ..] => names = rest.to_vec(),
                [b"SIZE", ref rest @ ..] => {
                    sizes = all(rest).ok_or_else(|| complain("not sizes"))?;
                }
                [b"TYPE", ref rest @ ..] => types = rest.to_vec(),
                [b"COUNT", ref rest @ ..] => {
                    counts = all(rest).ok_or_else(|| complain("not counts"))?;
                }
                [b"WIDTH", n] => width = whole::<usize>(n),
                [b"HEIGHT", n] => height = whole::<usize>(n),
                [b"POINTS", n] => points = whole::<usize>(n),
                [b"DATA", kind] => {
                    let data = match kind {
                        b"ascii" => Data::Text,
                        b"binary" => Data::Binary,
                        b"binary_compressed" => Data::Compressed,
                        _ => return Err(complain("none of ascii, binary, binary_compressed")),
                    };
                    let fields = fields(&names, &sizes, &types, &counts);
                    let mut fields = fields.map_err(|reason| syntax(lines.place(), reason))?;
                    if data != Data::Text {
                        // Some colours are floats that are no number: their bits would not survive being one.
                        let colours = fields
                            .iter_mut()
                            .filter(|f| f.name.starts_with("rgb") && f.scalar == Scalar::F32);
                        colours.for_each(|f| f.scalar = Scalar::U32);
                    }
                    let from_size = || width?.checked_mul(height.unwrap_or(1));
                    let points = points.or_else(from_size).ok_or_else(|| {
                        syntax(
                            lines.place(),
                            "the header says neither POINTS nor WIDTH and HEIGHT".into(),
                        )
                    })?;
                    return Ok(Self {
                        fields,
                        points,
                        data,
                        lines: lines.number(),
                        bytes: bytes.len() - lines.rest().len(),
                    });
                }
                _ if lines.number() == 1 => {
                    return Err(complain(
                        "not a PCD file, which begins with a remark, VERSION or FIELDS",
                    ));
                }
                _ => return Err(complain("not a line of a PCD header")),
            }
        }
    }

    fn error(&self, reason: String) -> Error {
        syntax(Place::Line(self.lines), reason)
    }

    /// Bytes of a point.
    fn stride(&self) -> usize {
        self.fields.iter().map(Field::size).sum()
    }

    /// Bytes of a point in front of a field.
    fn offset(&self, field: usize) -> usize {
        self.fields[..field].iter().map(Field::size).sum()
    }

    fn must_hold(&self, bytes: usize, start: usize) -> Result<(), Error> {
        let points = self.points;
        match points.checked_mul(self.stride()) {
            Some(needed) if needed <= bytes => Ok(()),
            _ => Err(syntax(
                Place::Byte(start),
                format!(
                    "{points} points of {} bytes are promised, there are {bytes} bytes",
                    self.stride()
                ),
            )),
        }
    }
}

/// No field of a point is longer.
const LONGEST: usize = 1 << 20;

fn fields(
    names: &[&[u8]],
    sizes: &[usize],
    types: &[&[u8]],
    counts: &[usize],
) -> Result<Vec<Field>, String> {
    let n = names.len();
    if n == 0 || sizes.len() != n || types.len() != n || !(counts.is_empty() || counts.len() == n) {
        let (s, t, c) = (sizes.len(), types.len(), counts.len());
        return Err(format!(
            "{n} FIELDS, {s} SIZE, {t} TYPE and {c} COUNT do not go together"
        ));
    }
    let field = |k: usize| {
        let scalar = match (types[k], sizes[k]) {
            (b"I", 1) => Scalar::I8,
            (b"I", 2) => Scalar::I16,
            (b"I", 4) => Scalar::I32,
            (b"I", 8) => Scalar::I64,
            (b"U", 1) => Scalar::U8,
            (b"U", 2) => Scalar::U16,
            (b"U", 4) => Scalar::U32,
            (b"U", 8) => Scalar::U64,
            (b"F", 4) => Scalar::F32,
            (b"F", 8) => Scalar::F64,
            (kind, size) => {
                return Err(format!(
                    "there is no number of TYPE {} and SIZE {size}",
                    shown(kind)
                ));
            }
        };
        Ok(Field {
            name: String::from_utf8_lossy(names[k]).into_owned(),
            scalar,
            // The Point Cloud Library takes 0 for 1.
            count: match counts.get(k).copied().unwrap_or(1).max(1) {
                count if count <= LONGEST => count,
                count => return Err(format!("a COUNT of {count}")),
            },
        })
    };
    (0..n).map(field).collect()
}

/// Adds a row, unless the point has no place.
fn add(row: &[f64], columns: &mut Columns, raw: &mut Raw, place: Place) -> Result<(), Error> {
    let point: Point3<f64> = columns.point(row);
    if point.iter().all(|c| c.is_nan()) {
        raw.left_out += 1;
        return Ok(());
    }
    finite(&point, raw.points.len() + raw.left_out, place)?;
    columns.add(row, raw);
    Ok(())
}

fn text(header: &Header, bytes: &[u8], columns: &mut Columns, raw: &mut Raw) -> Result<(), Error> {
    let mut lines = Lines::from_line(&bytes[header.bytes..], header.lines);
    let mut row = Vec::new();
    for index in 0..header.points {
        let line = lines.next_filled().ok_or_else(|| {
            syntax(
                lines.place(),
                format!(
                    "the file ends at point {index}, the header promises {}",
                    header.points
                ),
            )
        })?;
        let place = lines.place();
        let mut words = words(line);
        row.clear();
        for field in &header.fields {
            for k in 0..field.count {
                let missing = || syntax(place, format!("point {index}: {} is missing", field.name));
                let word = words.next().ok_or_else(missing)?;
                let value = number(word).ok_or_else(|| {
                    syntax(
                        place,
                        format!(
                            "point {index}: {} is no number: {:?}",
                            field.name,
                            shown(word)
                        ),
                    )
                })?;
                if k == 0 {
                    row.push(value);
                }
            }
        }
        if words.next().is_some() {
            return Err(syntax(
                place,
                format!("point {index}: more values than fields"),
            ));
        }
        add(&row, columns, raw, place)?;
    }
    Ok(())
}

/// Points whose field `f` stands at byte `at(point, f)`.
fn packed(
    header: &Header,
    body: &[u8],
    at: impl Fn(usize, usize) -> usize,
    columns: &mut Columns,
    raw: &mut Raw,
) -> Result<(), Error> {
    let mut row = vec![0.0; header.fields.len()];
    raw.points.reserve(header.points);
    for point in 0..header.points {
        for (k, field) in header.fields.iter().enumerate() {
            let value = body
                .get(at(point, k)..)
                .and_then(|b| field.scalar.read(b, Order::Little));
            row[k] = value.unwrap_or(f64::NAN);
        }
        add(&row, columns, raw, Place::Byte(header.bytes + at(point, 0)))?;
    }
    Ok(())
}

fn decompressed(header: &Header, bytes: &[u8]) -> Result<Vec<u8>, Error> {
    let body = &bytes[header.bytes..];
    let error = |reason: String| syntax(Place::Byte(header.bytes), reason);
    let size = |at: usize| {
        let size = body.get(at..).and_then(|b| b.first_chunk());
        size.map(|b| u32::from_le_bytes(*b) as usize)
    };
    let (Some(small), Some(large)) = (size(0), size(4)) else {
        return Err(error(
            "the file ends before the sizes of the compressed block".into(),
        ));
    };
    let block = body.get(8..).and_then(|b| b.get(..small)).ok_or_else(|| {
        error(format!(
            "{small} compressed bytes are promised, {} follow",
            body.len() - 8
        ))
    })?;
    if large == 0 {
        return Ok(Vec::new());
    }
    if large > small.saturating_mul(MOST_EXPANSION) {
        return Err(error(format!(
            "{small} compressed bytes cannot hold {large}"
        )));
    }
    match lzf::decompress(block, large) {
        Ok(block) if block.len() == large => Ok(block),
        _ => Err(error("the compressed block is damaged".into())),
    }
}

/// Writes position, normal, colour and every further number, as text or binary.
pub fn write(out: &mut dyn Write, mesh: &Mesh, options: Options) -> io::Result<()> {
    let mut names = vec!["x", "y", "z"];
    if !mesh.normals.is_empty() {
        names.extend(["normal_x", "normal_y", "normal_z"]);
    }
    names.extend(mesh.properties.iter().map(crate::Property::name));
    let size = if options.precision == Precision::Single {
        "4"
    } else {
        "8"
    };
    let (mut sizes, mut types) = (vec![size; names.len()], vec!["F"; names.len()]);
    if !mesh.colours.is_empty() {
        names.push("rgb");
        sizes.push("4");
        types.push("U");
    }
    let ones = vec!["1"; names.len()];
    let data = if options.encoding == Encoding::Text {
        "ascii"
    } else {
        "binary"
    };
    let count = mesh.points.len();
    writeln!(
        out,
        "# .PCD v0.7 - {}",
        options
            .comment
            .unwrap_or("Point Cloud Data")
            .replace(['\n', '\r'], " ")
    )?;
    writeln!(
        out,
        "VERSION 0.7\nFIELDS {}\nSIZE {}",
        names.join(" "),
        sizes.join(" ")
    )?;
    writeln!(out, "TYPE {}\nCOUNT {}", types.join(" "), ones.join(" "))?;
    writeln!(
        out,
        "WIDTH {count}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {count}\nDATA {data}"
    )?;
    for i in 0..mesh.points.len() {
        let further = mesh.properties.iter().filter_map(|p| p.values().get(i));
        let numbers = mesh.numbers(i).chain(further);
        let colour = mesh
            .colours
            .get(i)
            .map(|[r, g, b]| u32::from_le_bytes([*b, *g, *r, 0]));
        if options.encoding == Encoding::Text {
            let words = numbers.map(|v| options.precision.text(*v));
            let words: Vec<String> = words.chain(colour.map(|c| c.to_string())).collect();
            writeln!(out, "{}", words.join(" "))?;
        } else {
            for v in numbers {
                match options.precision {
                    Precision::Single => out.write_all(&(*v as f32).to_le_bytes())?,
                    Precision::Double => out.write_all(&v.to_le_bytes())?,
                }
            }
            colour.map_or(Ok(()), |c| out.write_all(&c.to_le_bytes()))?;
        }
    }
    out.flush()
}
