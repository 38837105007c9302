//! Content of a file before triangulation.
//!
//! Every reader fills one of these: vertex columns by meaning, and polygons by their corners.

use nalgebra::{Point3, Vector3};

use crate::mesh::{Mesh, Property};
use crate::polygon::triangulate;
use crate::{Error, Place};

/// Columns and polygons.
#[derive(Debug, Default)]
pub struct Raw {
    pub points: Vec<Point3<f64>>,
    pub normals: Vec<Vector3<f64>>,
    pub colours: Vec<[u8; 3]>,
    pub properties: Vec<Property>,
    pub polygons: Polygons,
    pub left_out: usize,
}

/// Polygons, one after the other.
#[derive(Debug, Default)]
pub struct Polygons {
    corners: Vec<u64>,
    ends: Vec<usize>,
}

impl Polygons {
    /// Adds a corner to the current polygon.
    pub fn corner(&mut self, vertex: u64) {
        self.corners.push(vertex);
    }

    /// Ends the polygon and returns its number of corners.
    pub fn close(&mut self) -> usize {
        let start = self.ends.last().copied().unwrap_or(0);
        self.ends.push(self.corners.len());
        self.corners.len() - start
    }

    pub fn push(&mut self, corners: impl IntoIterator<Item = u64>) -> usize {
        self.corners.extend(corners);
        self.close()
    }

    fn iter(&self) -> impl Iterator<Item = &[u64]> {
        let starts = std::iter::once(0).chain(self.ends.iter().copied());
        starts.zip(&self.ends).map(|(a, b)| &self.corners[a..*b])
    }
}

/// Checks that the coordinates of a point are finite.
pub fn finite(point: &Point3<f64>, vertex: usize, place: Place) -> Result<(), Error> {
    match (0..3).find(|&k| !point[k].is_finite()) {
        Some(k) => Err(Error::NotFinite {
            place,
            vertex,
            coordinate: ['x', 'y', 'z'][k],
            value: point[k],
        }),
        None => Ok(()),
    }
}

impl Raw {
    /// Triangulates the polygons. Triangles with a repeated corner have no area and are left out.
    pub fn finish(self) -> Result<Mesh, Error> {
        let count = self.points.len();
        let mut triangles = Vec::with_capacity(self.polygons.ends.len());
        let mut polygon = Vec::new();
        for (face, corners) in self.polygons.iter().enumerate() {
            if let Some(&vertex) = corners.iter().find(|v| **v >= count as u64) {
                return Err(Error::NoSuchVertex {
                    face,
                    vertex,
                    count,
                });
            }
            polygon.clear();
            polygon.extend(corners.iter().map(|&v| v as u32));
            triangulate(&self.points, &polygon, &mut triangles);
        }
        Ok(Mesh {
            points: self.points,
            normals: self.normals,
            colours: self.colours,
            properties: self.properties,
            triangles,
            left_out: self.left_out,
        })
    }
}
