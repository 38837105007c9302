//! Wavefront OBJ: lines `v x y z` and `f i/t/n …`; indices count from 1, negative ones from the last vertex backwards.

use super::{Soup, bad, point, text};
use crate::cell::sim::SimError;

pub(super) fn parse(bytes: &[u8]) -> Result<Soup, SimError> {
    let mut soup = Soup::default();
    for (number, line) in text(bytes, "OBJ")?.lines().enumerate() {
        let number = number + 1;
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => soup.positions.push(point(words.take(3), "OBJ", number)?),
            Some("f") => {
                let count = soup.positions.len();
                let polygon: Vec<usize> = words
                    .map(|w| index(w, count, number))
                    .collect::<Result<_, _>>()?;
                if polygon.len() < 3 {
                    return Err(bad(
                        "OBJ",
                        format!("line {number}"),
                        format!("a face of {} corners", polygon.len()),
                    ));
                }
                soup.polygons.push(polygon);
            }
            // Normals, texture coordinates, groups, materials, comments.
            _ => {}
        }
    }
    Ok(soup)
}

fn index(word: &str, count: usize, line: usize) -> Result<usize, SimError> {
    let wrong = || {
        bad(
            "OBJ",
            format!("line {line}"),
            format!("{word:?} is not the index of a vertex (there are {count} so far)"),
        )
    };
    let index: i64 = word
        .split('/')
        .next()
        .and_then(|i| i.parse().ok())
        .ok_or_else(wrong)?;
    let back = usize::try_from(index.unsigned_abs()).map_err(|_| wrong())?;
    let from_zero = if index < 0 {
        count.checked_sub(back)
    } else {
        back.checked_sub(1)
    };
    from_zero.ok_or_else(wrong)
}
