//! Columns of numbers and the meaning of their names: `x y z`, `nx ny nz`, `red green blue`, and others.
//!
//! PLY, PCD and tables with a heading name their columns; the names are interpreted here only.

use nalgebra::{Point3, Vector3};

use crate::mesh::Property;
use crate::raw::Raw;

/// How a colour is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shade {
    /// 0 to 255.
    Byte,
    /// 0 to 65535.
    Word,
    /// 0 to 1.
    Share,
}

impl Shade {
    fn byte(self, value: f64) -> u8 {
        let scaled = match self {
            Self::Byte => value,
            Self::Word => value / 257.0,
            Self::Share => 255.0 * value,
        };
        // NaN becomes 0; values out of range become the nearest limit.
        scaled.round() as u8
    }
}

/// Meaning of a column.
#[derive(Debug, Clone, PartialEq)]
enum Role {
    Position(usize),
    Normal(usize),
    Colour(usize),
    /// Red, green and blue as the bytes of one number.
    Packed(Packed),
    Other(usize),
    /// Ignored.
    Nothing,
}

/// Type of the number whose bytes are a colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Packed {
    Float,
    Whole,
}

/// A column as a file names it.
#[derive(Debug, Clone)]
pub struct Column<'a> {
    pub name: &'a str,
    pub shade: Shade,
    /// Type of the packed `rgb`, if the column is one.
    pub packed: Packed,
    /// Whether it has one number per point, and so can be kept.
    pub single: bool,
}

/// The destination of each column of a row.
pub struct Columns {
    roles: Vec<Role>,
    shades: [Shade; 3],
    others: Vec<(String, Vec<f64>)>,
    normals: bool,
    colours: bool,
    missing: Option<&'static str>,
}

const POSITION: [&str; 3] = ["x", "y", "z"];
const NORMAL: [[&str; 3]; 2] = [["nx", "ny", "nz"], ["normal_x", "normal_y", "normal_z"]];
const COLOUR: [[&str; 3]; 3] = [
    ["red", "green", "blue"],
    ["diffuse_red", "diffuse_green", "diffuse_blue"],
    ["r", "g", "b"],
];

impl Columns {
    pub fn new(columns: &[Column]) -> Self {
        let at = |name: &str| {
            let is = |c: &Column| c.single && c.name.eq_ignore_ascii_case(name);
            columns.iter().position(is)
        };
        let triple = |names: [&str; 3]| Some([at(names[0])?, at(names[1])?, at(names[2])?]);
        let mut this = Self {
            roles: vec![Role::Nothing; columns.len()],
            shades: [Shade::Byte; 3],
            others: Vec::new(),
            normals: false,
            colours: false,
            missing: POSITION.into_iter().find(|name| at(name).is_none()),
        };
        for (k, name) in POSITION.iter().enumerate() {
            this.set(at(name), Role::Position(k));
        }
        if let Some(found) = NORMAL.into_iter().find_map(triple) {
            this.normals = true;
            (0..3).for_each(|k| this.set(Some(found[k]), Role::Normal(k)));
        }
        if let Some(found) = COLOUR.into_iter().find_map(triple) {
            this.colours = true;
            for k in 0..3 {
                this.shades[k] = columns[found[k]].shade;
                this.set(Some(found[k]), Role::Colour(k));
            }
        } else if let Some(column) = at("rgb").or_else(|| at("rgba")) {
            this.colours = true;
            this.set(Some(column), Role::Packed(columns[column].packed));
        }
        for (k, column) in columns.iter().enumerate() {
            if this.roles[k] == Role::Nothing && column.single && column.name != "_" {
                this.roles[k] = Role::Other(this.others.len());
                this.others.push((column.name.to_owned(), Vec::new()));
            }
        }
        this
    }

    fn set(&mut self, column: Option<usize>, role: Role) {
        if let Some(column) = column {
            self.roles[column] = role;
        }
    }

    /// The first coordinate without a column.
    pub fn missing(&self) -> Option<&'static str> {
        self.missing
    }

    /// The point of a row.
    pub fn point(&self, row: &[f64]) -> Point3<f64> {
        let mut point = Point3::origin();
        for (role, value) in self.roles.iter().zip(row) {
            if let Role::Position(k) = role {
                point[*k] = *value;
            }
        }
        point
    }

    /// Adds a row to the columns of `raw`.
    pub fn add(&mut self, row: &[f64], raw: &mut Raw) {
        let (mut point, mut normal, mut colour) = (Point3::origin(), Vector3::zeros(), [0; 3]);
        for (role, &value) in self.roles.iter().zip(row) {
            match *role {
                Role::Position(k) => point[k] = value,
                Role::Normal(k) => normal[k] = value,
                Role::Colour(k) => colour[k] = self.shades[k].byte(value),
                Role::Packed(packed) => colour = unpacked(packed, value),
                Role::Other(k) => self.others[k].1.push(value),
                Role::Nothing => {}
            }
        }
        raw.points.push(point);
        if self.normals {
            raw.normals.push(normal);
        }
        if self.colours {
            raw.colours.push(colour);
        }
    }

    /// Moves the other columns to `raw`.
    pub fn finish(self, raw: &mut Raw) {
        let others = self.others.into_iter();
        raw.properties
            .extend(others.map(|(name, values)| Property::new(&name, values)));
    }
}

/// Red is the third byte, blue the first.
fn unpacked(packed: Packed, value: f64) -> [u8; 3] {
    let bits = match packed {
        Packed::Float => (value as f32).to_bits(),
        Packed::Whole => value as u32,
    };
    let [blue, green, red, _] = bits.to_le_bytes();
    [red, green, blue]
}
