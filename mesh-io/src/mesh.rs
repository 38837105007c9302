//! Points with their attributes, and triangles.
//!
//! Every list is either empty or as long as the list of points, and every triangle uses existing points: this is checked once, where
//! a mesh is made.

use nalgebra::{Point3, UnitVector3, Vector3};

use crate::Error;

/// A number for every vertex, under its name in the file, such as `confidence`.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Property {
    name: String,
    values: Vec<f64>,
}

impl Property {
    /// A name and a value for every vertex. Most formats need a single word as name: every character except letters, digits and `_` becomes `_`.
    pub fn new(name: &str, values: Vec<f64>) -> Self {
        let plain = |c: char| if c.is_ascii_alphanumeric() { c } else { '_' };
        Self {
            name: name.chars().map(plain).collect(),
            values,
        }
    }

    /// The name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// One value for each vertex.
    pub fn values(&self) -> &[f64] {
        &self.values
    }
}

/// A triangle mesh, or a cloud of points if it has no triangles.
#[derive(Debug, Clone, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Mesh {
    pub(crate) points: Vec<Point3<f64>>,
    pub(crate) normals: Vec<Vector3<f64>>,
    pub(crate) colours: Vec<[u8; 3]>,
    pub(crate) properties: Vec<Property>,
    pub(crate) triangles: Vec<[u32; 3]>,
    pub(crate) left_out: usize,
}

impl Mesh {
    /// A cloud of points.
    ///
    /// # Errors
    /// [`Error::NotFinite`] (with the index of the vertex as place).
    pub fn new(points: Vec<Point3<f64>>) -> Result<Self, Error> {
        for (vertex, point) in points.iter().enumerate() {
            crate::raw::finite(point, vertex, crate::Place::Line(vertex + 1))?;
        }
        Ok(Self {
            points,
            ..Self::default()
        })
    }

    /// The same with triangles, counter-clockwise seen from outside.
    ///
    /// # Errors
    /// [`Error::NoSuchVertex`].
    pub fn with_triangles(mut self, triangles: Vec<[u32; 3]>) -> Result<Self, Error> {
        let count = self.points.len();
        for (face, triangle) in triangles.iter().enumerate() {
            if let Some(&vertex) = triangle.iter().find(|v| **v as usize >= count) {
                return Err(Error::NoSuchVertex {
                    face,
                    vertex: vertex.into(),
                    count,
                });
            }
        }
        self.triangles = triangles;
        Ok(self)
    }

    /// The same with a normal for every vertex, of any length.
    ///
    /// # Errors
    /// [`Error::Length`].
    pub fn with_normals(mut self, normals: Vec<Vector3<f64>>) -> Result<Self, Error> {
        self.as_many("normals", normals.len())?;
        self.normals = normals;
        Ok(self)
    }

    /// The same with a colour for every vertex: red, green, blue.
    ///
    /// # Errors
    /// [`Error::Length`].
    pub fn with_colours(mut self, colours: Vec<[u8; 3]>) -> Result<Self, Error> {
        self.as_many("colours", colours.len())?;
        self.colours = colours;
        Ok(self)
    }

    /// The same with one more number for every vertex.
    ///
    /// # Errors
    /// [`Error::Length`].
    pub fn with_property(mut self, property: Property) -> Result<Self, Error> {
        self.as_many("values", property.values.len())?;
        self.properties.push(property);
        Ok(self)
    }

    fn as_many(&self, what: &'static str, found: usize) -> Result<(), Error> {
        let expected = self.points.len();
        if found == expected {
            Ok(())
        } else {
            Err(Error::Length {
                what,
                found,
                expected,
            })
        }
    }

    /// The points, m if loaded with [`Load`](crate::Load).
    pub fn points(&self) -> &[Point3<f64>] {
        &self.points
    }

    /// Triangles, by the indices of their corners.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Normals as the file has them, of any length; empty if it has none.
    pub fn normals(&self) -> &[Vector3<f64>] {
        &self.normals
    }

    /// Red, green and blue of every point; empty if there are none.
    pub fn colours(&self) -> &[[u8; 3]] {
        &self.colours
    }

    /// Coordinates of a point, and its normal if there are normals: the first numbers of a row of a table.
    pub(crate) fn numbers(&self, point: usize) -> impl Iterator<Item = &f64> {
        let normal = self.normals.get(point).into_iter();
        self.points[point].coords.iter().chain(normal.flatten())
    }

    /// The other numbers of the points.
    pub fn properties(&self) -> &[Property] {
        &self.properties
    }

    /// The values under a name.
    pub fn property(&self, name: &str) -> Option<&[f64]> {
        let found = self.properties.iter().find(|p| p.name == name);
        found.map(|p| &p.values[..])
    }

    /// Number of points of the file without a position (pixels of a depth camera without a measurement; PCD only), which are left out.
    pub fn left_out(&self) -> usize {
        self.left_out
    }

    /// Normals as unit vectors; empty if the file has none.
    ///
    /// # Errors
    /// [`Error::NoDirection`] for the first normal that is zero or not finite.
    pub fn unit_normals(&self) -> Result<Vec<UnitVector3<f64>>, Error> {
        let direction = |(vertex, normal): (usize, &Vector3<f64>)| {
            let unit = normal / normal.amax();
            let unit = UnitVector3::try_new(unit, 0.0).filter(|u| u.iter().all(|c| c.is_finite()));
            unit.ok_or(Error::NoDirection {
                vertex,
                normal: (*normal).into(),
            })
        };
        self.normals.iter().enumerate().map(direction).collect()
    }

    /// Both corners of the bounding box; `None` without points.
    pub fn bounds(&self) -> Option<(Point3<f64>, Point3<f64>)> {
        let first = *self.points.first()?;
        let grown =
            |(low, high): (Point3<f64>, Point3<f64>), p: &Point3<f64>| (low.inf(p), high.sup(p));
        Some(self.points.iter().fold((first, first), grown))
    }

    /// Diagonal of the bounding box, m.
    pub fn diagonal(&self) -> f64 {
        self.bounds().map_or(0.0, |(low, high)| (high - low).norm())
    }

    /// Points and triangles alone.
    pub fn into_parts(self) -> (Vec<Point3<f64>>, Vec<[u32; 3]>) {
        (self.points, self.triangles)
    }

    /// The given vertices, in that order, and the triangles all of whose corners are among them.
    pub(crate) fn keep(&self, vertices: &[u32]) -> Self {
        let mut place = vec![None; self.points.len()];
        for (new, &old) in vertices.iter().enumerate() {
            place[old as usize] = Some(new as u32);
        }
        let property = |p: &Property| Property {
            name: p.name.clone(),
            values: of(&p.values, vertices),
        };
        let corners = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|v| place[v as usize]);
            Some([a?, b?, c?])
        };
        Self {
            points: of(&self.points, vertices),
            normals: of(&self.normals, vertices),
            colours: of(&self.colours, vertices),
            properties: self.properties.iter().map(property).collect(),
            triangles: self.triangles.iter().filter_map(corners).collect(),
            left_out: self.left_out,
        }
    }
}

/// The entries of a list, if there is one.
fn of<T: Copy>(list: &[T], vertices: &[u32]) -> Vec<T> {
    let known = vertices.iter().filter_map(|&v| list.get(v as usize));
    known.copied().collect()
}
