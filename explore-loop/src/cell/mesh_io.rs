//! Closed meshes from files: OBJ, PLY, STL.
//!
//! A file is first read as a soup, positions and polygons as they stand. Then corners that coincide become one vertex
//! (STL repeats every corner in every triangle, and texture seams repeat vertices in the others): two corners are the same if they
//! are within a millionth of the bounding box's diagonal of each other. Polygons are halved into fans, triangles that collapsed
//! are dropped, and vertices that nothing uses are forgotten. Whether the result bounds a solid is for
//! [`TriangleMesh::into_solid`] to say.

use std::collections::HashMap;
use std::path::Path;

use nalgebra::{Point3, Vector3};

use super::sim::{SimError, TriangleMesh};

mod obj;
mod ply;
mod stl;

/// Corners nearer than this share of the diagonal are one.
const SAME: f64 = 1e-6;

/// Positions and polygons as a file has them.
#[derive(Debug, Default)]
struct Soup {
    positions: Vec<Point3<f64>>,
    polygons: Vec<Vec<usize>>,
}

/// Reads a mesh; the ending of the name tells the format.
///
/// # Errors
/// [`SimError::Unreadable`] when the file cannot be read or its ending is unknown, [`SimError::BadFile`] with the place and the
/// reason when it is not what its ending says.
pub fn read(path: &Path) -> Result<TriangleMesh, SimError> {
    let unreadable = |reason: String| SimError::Unreadable {
        path: path.to_path_buf(),
        reason,
    };
    let ending = path
        .extension()
        .and_then(|e| e.to_str())
        .unwrap_or("")
        .to_ascii_lowercase();
    let format = match ending.as_str() {
        "obj" => Format::Obj,
        "ply" => Format::Ply,
        "stl" => Format::Stl,
        _ => {
            return Err(unreadable(format!(
                "the ending {ending:?} is none of obj, ply, stl"
            )));
        }
    };
    let bytes = std::fs::read(path).map_err(|error| unreadable(error.to_string()))?;
    parse(&bytes, format)
}

/// A mesh file format.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// Wavefront OBJ: `v` and `f` lines, faces of any number of corners, negative indices.
    Obj,
    /// PLY, ascii or binary little endian, with any properties.
    Ply,
    /// STL, ascii or binary.
    Stl,
}

/// Reads a mesh from memory.
///
/// # Errors
/// [`SimError::BadFile`] with the place and the reason.
///
/// # Examples
/// ```
/// use explore_loop::cell::mesh_io::{Format, parse};
///
/// let tetrahedron = b"v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0 0 0.1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n";
/// let mesh = parse(tetrahedron, Format::Obj)?.into_solid()?;
/// assert!((mesh.volume() - 1e-3 / 6.0).abs() < 1e-12);
/// # Ok::<(), explore_loop::cell::sim::SimError>(())
/// ```
pub fn parse(bytes: &[u8], format: Format) -> Result<TriangleMesh, SimError> {
    let soup = match format {
        Format::Obj => obj::parse(bytes),
        Format::Ply => ply::parse(bytes),
        Format::Stl => stl::parse(bytes),
    }?;
    soup.weld()
}

impl Soup {
    fn weld(self) -> Result<TriangleMesh, SimError> {
        let mut low = Point3::from(Vector3::repeat(f64::INFINITY));
        let mut high = Point3::from(Vector3::repeat(f64::NEG_INFINITY));
        for (index, p) in self.positions.iter().enumerate() {
            if !p.iter().all(|c| c.is_finite()) {
                return Err(SimError::NonFiniteVertex { index, point: *p });
            }
            low = low.inf(p);
            high = high.sup(p);
        }
        let mut weld = Weld {
            same: ((high - low).norm() * SAME).max(f64::MIN_POSITIVE),
            low,
            cells: HashMap::new(),
            mesh: TriangleMesh::default(),
        };
        for (index, polygon) in self.polygons.iter().enumerate() {
            let mut corners = Vec::with_capacity(polygon.len());
            for &v in polygon {
                let count = self.positions.len();
                let p = self.positions.get(v).ok_or(SimError::NoSuchVertex {
                    triangle: index,
                    vertex: v,
                    count,
                })?;
                corners.push(weld.vertex(*p));
            }
            for k in 2..corners.len() {
                let t = [corners[0], corners[k - 1], corners[k]];
                if t[0] != t[1] && t[1] != t[2] && t[2] != t[0] {
                    weld.mesh.triangles.push(t);
                }
            }
        }
        Ok(weld.mesh)
    }
}

struct Weld {
    same: f64,
    low: Point3<f64>,
    cells: HashMap<[i64; 3], Vec<usize>>,
    mesh: TriangleMesh,
}

impl Weld {
    /// The vertex at `p`, a new one if there is none.
    fn vertex(&mut self, p: Point3<f64>) -> usize {
        let cell = [0, 1, 2].map(|k| ((p[k] - self.low[k]) / self.same).floor() as i64);
        for shift in 0..27 {
            let near = [
                cell[0] + shift % 3 - 1,
                cell[1] + shift / 3 % 3 - 1,
                cell[2] + shift / 9 - 1,
            ];
            let found = self.cells.get(&near).and_then(|c| {
                c.iter()
                    .find(|&&v| (self.mesh.vertices[v] - p).norm() <= self.same)
            });
            if let Some(&v) = found {
                return v;
            }
        }
        self.cells
            .entry(cell)
            .or_default()
            .push(self.mesh.vertices.len());
        self.mesh.vertices.push(p);
        self.mesh.vertices.len() - 1
    }
}

fn bad(format: &'static str, place: String, reason: impl Into<String>) -> SimError {
    SimError::BadFile {
        format,
        place,
        reason: reason.into(),
    }
}

/// The bytes as text; mesh files in other encodings keep to ASCII where it matters.
fn text<'a>(bytes: &'a [u8], format: &'static str) -> Result<&'a str, SimError> {
    std::str::from_utf8(bytes).map_err(|error| {
        bad(
            format,
            format!("byte {}", error.valid_up_to()),
            "this is not text",
        )
    })
}

fn point<'a>(
    words: impl Iterator<Item = &'a str>,
    format: &'static str,
    line: usize,
) -> Result<Point3<f64>, SimError> {
    let mut coordinates = words.map(|w| {
        w.parse::<f64>().map_err(|_| {
            bad(
                format,
                format!("line {line}"),
                format!("{w:?} is not a number"),
            )
        })
    });
    let mut next = || {
        coordinates.next().unwrap_or_else(|| {
            Err(bad(
                format,
                format!("line {line}"),
                "a vertex needs three coordinates",
            ))
        })
    };
    Ok(Point3::new(next()?, next()?, next()?))
}
