//! The header: a line for each of `FIELDS SIZE TYPE COUNT WIDTH HEIGHT POINTS`, in any order, then `DATA`.

use super::syntax;
use crate::columns::{Column, Packed, Shade};
use crate::scalar::Scalar;
use crate::text::{Lines, shown, whole, words};
use crate::{Error, Place};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Data {
    Text,
    Binary,
    Compressed,
}

#[derive(Debug)]
pub struct Field {
    pub name: String,
    pub scalar: Scalar,
    pub count: usize,
}

impl Field {
    pub fn size(&self) -> usize {
        self.scalar.size() * self.count
    }

    pub fn column(&self) -> Column<'_> {
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

pub struct Header {
    pub fields: Vec<Field>,
    pub points: usize,
    pub data: Data,
    /// Lines of the header itself.
    pub lines: usize,
    /// Bytes of the header itself.
    pub bytes: usize,
}

/// The lines of a header, unparsed.
#[derive(Default)]
struct Entries<'a> {
    names: Vec<&'a [u8]>,
    sizes: Vec<usize>,
    types: Vec<&'a [u8]>,
    counts: Vec<usize>,
    width: Option<usize>,
    height: Option<usize>,
    points: Option<usize>,
}

impl<'a> Entries<'a> {
    /// Parses a line; returns the kind of data if the line is `DATA`.
    ///
    /// # Errors
    /// A description of the error.
    fn take(&mut self, list: &[&'a [u8]], first: bool) -> Result<Option<Data>, &'static str> {
        let all =
            |list: &[&[u8]]| -> Option<Vec<usize>> { list.iter().map(|w| whole(w)).collect() };
        match *list {
            [] | [b"VERSION" | b"VIEWPOINT", ..] => {}
            [word, ..] if word.starts_with(b"#") => {}
            [b"FIELDS" | b"COLUMNS", ref rest @ ..] => self.names = rest.to_vec(),
            [b"SIZE", ref rest @ ..] => self.sizes = all(rest).ok_or("not sizes")?,
            [b"TYPE", ref rest @ ..] => self.types = rest.to_vec(),
            [b"COUNT", ref rest @ ..] => self.counts = all(rest).ok_or("not counts")?,
            [b"WIDTH", n] => self.width = whole(n),
            [b"HEIGHT", n] => self.height = whole(n),
            [b"POINTS", n] => self.points = whole(n),
            [b"DATA", b"ascii"] => return Ok(Some(Data::Text)),
            [b"DATA", b"binary"] => return Ok(Some(Data::Binary)),
            [b"DATA", b"binary_compressed"] => return Ok(Some(Data::Compressed)),
            [b"DATA", _] => return Err("none of ascii, binary, binary_compressed"),
            _ if first => {
                return Err("not a PCD file, which begins with a remark, VERSION or FIELDS");
            }
            _ => return Err("not a line of a PCD header"),
        }
        Ok(None)
    }

    /// # Errors
    /// Lines that contradict each other.
    fn fields(&self, data: Data) -> Result<Vec<Field>, String> {
        let mut fields = fields(&self.names, &self.sizes, &self.types, &self.counts)?;
        if data != Data::Text {
            // Packed colours may be floats that are NaN: their bits would not survive a conversion to a number.
            let colours = fields
                .iter_mut()
                .filter(|f| f.name.starts_with("rgb") && f.scalar == Scalar::F32);
            colours.for_each(|f| f.scalar = Scalar::U32);
        }
        Ok(fields)
    }

    fn points(&self) -> Result<usize, String> {
        let from_size = || self.width?.checked_mul(self.height.unwrap_or(1));
        let points = self.points.or_else(from_size);
        points.ok_or_else(|| "the header says neither POINTS nor WIDTH and HEIGHT".into())
    }
}

impl Header {
    pub fn read(bytes: &[u8]) -> Result<Self, Error> {
        let mut lines = Lines::new(bytes);
        let mut entries = Entries::default();
        while let Some(line) = lines.next() {
            let list: Vec<&[u8]> = words(line).collect();
            let data = entries.take(&list, lines.number() == 1);
            let data =
                data.map_err(|what| syntax(lines.place(), format!("{what}: {:?}", shown(line))))?;
            if let Some(data) = data {
                let together = |reason| syntax(lines.place(), reason);
                return Ok(Self {
                    fields: entries.fields(data).map_err(together)?,
                    points: entries.points().map_err(together)?,
                    data,
                    lines: lines.number(),
                    bytes: bytes.len() - lines.rest().len(),
                });
            }
        }
        Err(syntax(
            lines.place(),
            "the file ends in the header: there is no DATA".into(),
        ))
    }

    pub fn error(&self, reason: String) -> Error {
        syntax(Place::Line(self.lines), reason)
    }

    /// Bytes of a point.
    pub fn stride(&self) -> usize {
        self.fields.iter().map(Field::size).sum()
    }

    /// Offset of a field in a point, in bytes.
    pub fn offset(&self, field: usize) -> usize {
        self.fields[..field].iter().map(Field::size).sum()
    }

    pub fn must_hold(&self, bytes: usize, start: usize) -> Result<(), Error> {
        let points = self.points;
        match points.checked_mul(self.stride()) {
            Some(needed) if needed <= bytes => Ok(()),
            _ => Err(syntax(
                Place::Byte(start),
                format!(
                    "the header says {points} points of {} bytes, but there are {bytes} bytes",
                    self.stride()
                ),
            )),
        }
    }
}

/// Largest length of a field of a point.
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
            "{n} FIELDS, {s} SIZE, {t} TYPE and {c} COUNT do not match"
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
                    "no number has TYPE {} and SIZE {size}",
                    shown(kind)
                ));
            }
        };
        Ok(Field {
            name: String::from_utf8_lossy(names[k]).into_owned(),
            scalar,
            // Like the Point Cloud Library, takes 0 for 1.
            count: match counts.get(k).copied().unwrap_or(1).max(1) {
                count if count <= LONGEST => count,
                count => return Err(format!("a COUNT of {count}")),
            },
        })
    };
    (0..n).map(field).collect()
}
