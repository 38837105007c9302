//! Tables of numbers: one row per line, with a fixed number of columns.
//!
//! Numbers are separated by commas, semicolons, tabs or spaces. The first line may name the columns; empty lines, lines that begin with `#`
//! and a separator at the end of a line are ignored. Anything else is an error that gives line, column and text.

#[cfg(feature = "serde")]
use crate::serialised::Written;
use crate::text::{Lines, number, shown};
use crate::{Error, Format};

/// Rows of `N` numbers, and whether the first line names the columns.
#[derive(Debug, Clone, PartialEq, Default)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(into = "Written", try_from = "Written")
)]
pub struct Table<const N: usize> {
    /// The numbers.
    pub rows: Vec<[f64; N]>,
    /// Line of each row, from 1.
    pub lines: Vec<usize>,
    /// Whether the first line was a heading.
    pub headed: bool,
}

/// Reads a table with the given columns.
///
/// # Errors
/// [`Error::Syntax`] with the line: a wrong number of values, something that is not a finite number, or a heading with the columns in another
/// order.
pub fn read_table<const N: usize>(bytes: &[u8], columns: [&str; N]) -> Result<Table<N>, Error> {
    crate::text::is_single_byte(bytes, Format::Xyz)?;
    let mut table = Table {
        rows: Vec::new(),
        lines: Vec::new(),
        headed: false,
    };
    let mut lines = Lines::new(bytes);
    while let Some(line) = lines.next_filled() {
        if line.trim_ascii_start().starts_with(b"#") {
            continue;
        }
        let cells = cells(line);
        let error = |reason| Error::Syntax {
            format: Format::Xyz,
            place: lines.place(),
            reason,
        };
        if cells.len() != N {
            let found = cells.len();
            return Err(error(format!("{found} values, but there are {N} columns")));
        }
        if table.rows.is_empty() && !table.headed && cells.iter().all(|cell| is_name(cell)) {
            check_heading(&cells, columns).map_err(error)?;
            table.headed = true;
            continue;
        }
        table.rows.push(row(&cells, columns).map_err(error)?);
        table.lines.push(lines.number());
    }
    Ok(table)
}

fn cells(line: &[u8]) -> Vec<&[u8]> {
    let line = line.trim_ascii();
    let separator = [b',', b';', b'\t'].into_iter().find(|s| line.contains(s));
    let Some(separator) = separator else {
        return crate::text::words(line).collect();
    };
    let line = line.strip_suffix(&[separator]).unwrap_or(line);
    line.split(|b| *b == separator)
        .map(<[u8]>::trim_ascii)
        .collect()
}

fn name(cell: &[u8]) -> String {
    String::from_utf8_lossy(cell)
        .trim_matches('"')
        .to_lowercase()
}

/// Whether a cell is a name rather than a misspelt number.
fn is_name(cell: &[u8]) -> bool {
    number(cell).is_none() && name(cell).starts_with(char::is_alphabetic)
}

/// Unknown names are accepted, but known ones in another order would be read wrongly.
fn check_heading<const N: usize>(cells: &[&[u8]], columns: [&str; N]) -> Result<(), String> {
    for (cell, expected) in cells.iter().zip(columns) {
        let found = name(cell);
        if found != expected && columns.contains(&found.as_str()) {
            return Err(format!(
                "column {found:?} stands where {expected:?} belongs"
            ));
        }
    }
    Ok(())
}

fn row<const N: usize>(cells: &[&[u8]], columns: [&str; N]) -> Result<[f64; N], String> {
    let mut row = [0.0; N];
    for ((value, cell), column) in row.iter_mut().zip(cells).zip(columns) {
        let finite = number(cell).filter(|v| v.is_finite());
        *value = finite
            .ok_or_else(|| format!("column {column}: {:?} is not a finite number", shown(cell)))?;
    }
    Ok(row)
}
