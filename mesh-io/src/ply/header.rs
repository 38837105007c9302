//! The header: `ply`, `format`, then `element NAME COUNT` each with its `property` lines, and `end_header`.

use super::syntax;
use crate::Error;
use crate::scalar::{Order, Scalar};
use crate::text::{Lines, shown, whole, words};

/// How values are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Encoding {
    Text,
    Binary(Order),
}

/// A column of an element: a number, or a list with a count of its own type.
#[derive(Debug)]
pub struct Property {
    pub name: String,
    pub count: Option<Scalar>,
    pub scalar: Scalar,
}

#[derive(Debug)]
pub struct Element {
    pub name: String,
    pub count: usize,
    pub properties: Vec<Property>,
}

impl Element {
    /// The smallest number of bytes of this property in a row.
    pub fn least_bytes(&self) -> usize {
        let size = |p: &Property| p.count.unwrap_or(p.scalar).size();
        self.properties.iter().map(size).sum()
    }
}

#[derive(Debug)]
pub struct Header {
    pub encoding: Encoding,
    pub elements: Vec<Element>,
    /// Lines of the header itself.
    pub lines: usize,
    /// Bytes of the header itself.
    pub bytes: usize,
}

impl Header {
    pub fn read(bytes: &[u8]) -> Result<Self, Error> {
        let mut lines = Lines::new(bytes);
        let (mut encoding, mut elements) = (None, Vec::new());
        loop {
            let Some(line) = lines.next() else {
                return Err(syntax(
                    lines.place(),
                    "the file ends in the header: there is no end_header",
                ));
            };
            let list: Vec<&[u8]> = words(line).collect();
            let place = lines.place();
            let complain =
                |what: &str| syntax(place, format!("{what}: {:?}", shown(line.trim_ascii())));
            match list[..] {
                [b"ply"] if lines.number() == 1 => {}
                _ if lines.number() == 1 => {
                    return Err(complain("not a PLY file, which starts with \"ply\""));
                }
                [b"comment" | b"obj_info", ..] | [] => {}
                [b"format", name, b"1.0"] => {
                    encoding = Some(named(name).ok_or_else(|| {
                        complain(
                            "the format is none of ascii, binary_little_endian, binary_big_endian",
                        )
                    })?);
                }
                [b"format", ..] => return Err(complain("not a format of version 1.0")),
                [b"element", name, count] => {
                    let name = String::from_utf8_lossy(name).into_owned();
                    // Two vertex elements may have different columns, which one mesh cannot hold.
                    let again = |known: &Element| known.name == "vertex" && name == "vertex";
                    if elements.iter().any(again) {
                        return Err(complain("a second element vertex"));
                    }
                    elements.push(Element {
                        name,
                        count: whole(count).ok_or_else(|| complain("not a number of elements"))?,
                        properties: Vec::new(),
                    });
                }
                [b"property", ref kind @ .., name] => {
                    let (Some((count, scalar)), Some(element)) = (types(kind), elements.last_mut())
                    else {
                        return Err(complain("not a property of an element"));
                    };
                    element.properties.push(Property {
                        name: String::from_utf8_lossy(name).into_owned(),
                        count,
                        scalar,
                    });
                }
                [b"end_header"] => {
                    return Ok(Self {
                        encoding: encoding
                            .ok_or_else(|| syntax(place, "the header names no format"))?,
                        elements,
                        lines: lines.number(),
                        bytes: bytes.len() - lines.rest().len(),
                    });
                }
                _ => return Err(complain("not a line of a PLY header")),
            }
        }
    }
}

fn named(word: &[u8]) -> Option<Encoding> {
    Some(match word {
        b"ascii" => Encoding::Text,
        b"binary_little_endian" => Encoding::Binary(Order::Little),
        b"binary_big_endian" => Encoding::Binary(Order::Big),
        _ => return None,
    })
}

fn types(words: &[&[u8]]) -> Option<(Option<Scalar>, Scalar)> {
    match words {
        [b"list", count, scalar] => {
            let count = kind(count).filter(|count| count.is_whole())?;
            Some((Some(count), kind(scalar)?))
        }
        [scalar] => Some((None, kind(scalar)?)),
        _ => None,
    }
}

fn kind(word: &[u8]) -> Option<Scalar> {
    Some(match word {
        b"char" | b"int8" => Scalar::I8,
        b"uchar" | b"uint8" => Scalar::U8,
        b"short" | b"int16" => Scalar::I16,
        b"ushort" | b"uint16" => Scalar::U16,
        b"int" | b"int32" => Scalar::I32,
        b"uint" | b"uint32" => Scalar::U32,
        b"float" | b"float32" => Scalar::F32,
        b"double" | b"float64" => Scalar::F64,
        _ => return None,
    })
}
