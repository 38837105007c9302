//! Tables of numbers in comma-separated files.
//!
//! One row a line, as many numbers as the table has columns. The first line may name the columns; empty lines and lines that start with `#`
//! are passed over. Whatever else stands there is an error that names line, column and text.

use std::fmt;

/// What is wrong with a table, and where.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum TableError {
    /// A line with another number of values than the table has columns.
    Width {
        /// Line of the file, from 1.
        line: usize,
        /// Columns of the table.
        expected: usize,
        /// Values found.
        found: usize,
    },
    /// Something that is not a finite number.
    Value {
        /// Line of the file, from 1.
        line: usize,
        /// Name of the column.
        column: &'static str,
        /// What stands there.
        text: String,
    },
    /// A heading that gives the columns in another order.
    Heading {
        /// Line of the file, from 1.
        line: usize,
        /// Name that belongs there.
        expected: &'static str,
        /// Name that stands there.
        found: String,
    },
}

impl fmt::Display for TableError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Width {
                line,
                expected,
                found,
            } => {
                write!(
                    f,
                    "line {line}: {found} values, but there are {expected} columns"
                )
            }
            Self::Value { line, column, text } => {
                write!(
                    f,
                    "line {line}, column {column}: `{text}` is not a finite number"
                )
            }
            Self::Heading {
                line,
                expected,
                found,
            } => {
                write!(
                    f,
                    "line {line}: column `{found}` stands where `{expected}` belongs"
                )
            }
        }
    }
}

impl std::error::Error for TableError {}

/// Rows of `N` numbers, and whether the file named its columns.
#[derive(Debug, Clone, PartialEq)]
pub struct Table<const N: usize> {
    /// The numbers.
    pub rows: Vec<[f64; N]>,
    /// Whether the first line was a heading.
    pub headed: bool,
}

/// Reads a table with the given columns.
pub fn read<const N: usize>(
    text: &str,
    columns: [&'static str; N],
) -> Result<Table<N>, TableError> {
    let mut table = Table {
        rows: Vec::new(),
        headed: false,
    };
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    for (index, content) in text.lines().enumerate() {
        let (line, content) = (index + 1, content.trim());
        if content.is_empty() || content.starts_with('#') {
            continue;
        }
        let cells: Vec<&str> = content.split(',').map(str::trim).collect();
        if cells.len() != N {
            return Err(TableError::Width {
                line,
                expected: N,
                found: cells.len(),
            });
        }
        let first = table.rows.is_empty() && !table.headed;
        if first && cells.iter().all(|cell| is_name(cell)) {
            check_heading(line, &cells, columns)?;
            table.headed = true;
        } else {
            table.rows.push(row(line, &cells, columns)?);
        }
    }
    Ok(table)
}

/// A word, and not something that was meant as a number.
fn is_name(cell: &str) -> bool {
    cell.parse::<f64>().is_err()
        && cell
            .trim_matches('"')
            .starts_with(|c: char| c.is_alphabetic())
}

/// Other names are the author's business, but ours in another order would be read wrongly.
fn check_heading<const N: usize>(
    line: usize,
    cells: &[&str],
    columns: [&'static str; N],
) -> Result<(), TableError> {
    for (cell, expected) in cells.iter().zip(columns) {
        let found = cell.trim_matches('"').to_lowercase();
        if found != expected && columns.contains(&found.as_str()) {
            return Err(TableError::Heading {
                line,
                expected,
                found,
            });
        }
    }
    Ok(())
}

fn row<const N: usize>(
    line: usize,
    cells: &[&str],
    columns: [&'static str; N],
) -> Result<[f64; N], TableError> {
    let mut row = [0.0; N];
    for ((value, cell), column) in row.iter_mut().zip(cells).zip(columns) {
        let number = cell.parse::<f64>().ok().filter(|v| v.is_finite());
        *value = number.ok_or_else(|| TableError::Value {
            line,
            column,
            text: (*cell).to_owned(),
        })?;
    }
    Ok(row)
}
