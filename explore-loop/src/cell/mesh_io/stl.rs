//! STL: triangles one by one, as text (`vertex x y z` lines) or as 50-byte records after an 84-byte head.
//!
//! Binary files may start with the word `solid` too, so the length decides: `84 + 50 n` bytes, `n` at byte 80.

use nalgebra::Point3;

use super::{Soup, bad, point, text};
use crate::cell::sim::SimError;

const HEAD: usize = 84;
const RECORD: usize = 50;

pub(super) fn parse(bytes: &[u8]) -> Result<Soup, SimError> {
    let announced = bytes
        .get(80..HEAD)
        .and_then(|b| b.try_into().ok())
        .map(|b| u32::from_le_bytes(b) as usize);
    match announced {
        Some(count) if bytes.len() == HEAD + RECORD * count => Ok(binary(&bytes[HEAD..])),
        _ if bytes.trim_ascii_start().starts_with(b"solid") => ascii(bytes),
        Some(count) => {
            let reason = format!(
                "{count} triangles announced take {} bytes, the file has {}",
                HEAD + RECORD * count,
                bytes.len()
            );
            Err(bad("STL", "byte 80".into(), reason))
        }
        None => Err(bad(
            "STL",
            "byte 0".into(),
            "neither text that starts with \"solid\" nor long enough to be binary",
        )),
    }
}

fn binary(records: &[u8]) -> Soup {
    let mut soup = Soup::default();
    for record in records.chunks_exact(RECORD) {
        // A normal, which the corners give better, comes first.
        let number = |at: usize| {
            f64::from(f32::from_le_bytes([
                record[at],
                record[at + 1],
                record[at + 2],
                record[at + 3],
            ]))
        };
        for corner in 0..3 {
            let at = 12 + 12 * corner;
            soup.positions
                .push(Point3::new(number(at), number(at + 4), number(at + 8)));
        }
        soup.polygons.push(last_three(&soup));
    }
    soup
}

fn ascii(bytes: &[u8]) -> Result<Soup, SimError> {
    let mut soup = Soup::default();
    let mut corners = 0;
    for (number, line) in text(bytes, "STL")?.lines().enumerate() {
        let mut words = line.split_whitespace();
        match words.next() {
            Some("vertex") => {
                soup.positions
                    .push(point(words.take(3), "STL", number + 1)?);
                corners += 1;
            }
            Some("endloop") if corners == 3 => {
                soup.polygons.push(last_three(&soup));
                corners = 0;
            }
            Some("endloop") => {
                return Err(bad(
                    "STL",
                    format!("line {}", number + 1),
                    format!("a facet of {corners} corners"),
                ));
            }
            _ => {}
        }
    }
    if corners == 0 {
        Ok(soup)
    } else {
        Err(bad(
            "STL",
            "its end".into(),
            "the last facet is not finished",
        ))
    }
}

fn last_three(soup: &Soup) -> Vec<usize> {
    let count = soup.positions.len();
    (count - 3..count).collect()
}
