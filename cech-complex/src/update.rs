//! Updates of a complex: points are added, moved and removed, and only the simplices that contain one of them are decided again.
//!
//! ```text
//! CČC(P′) = { σ ∈ CČC(P) : σ has no changed vertex }  ∪  { σ : σ has one and f(σ) ≤ max_scale }
//! ```
//!
//! A value depends only on the cylinders of its own simplex, so the union is identical, bit for bit, to a new build of `P′`. Known values of the
//! first part are kept; the others are computed when they are asked for.

use crate::complex::{Adjacency, Complex};
use crate::error::Error;
use crate::filtration::check_cloud;
use crate::nerve::{self, Vertices};
use nalgebra::{Point3, UnitVector3};
use std::ops::Range;
use std::sync::OnceLock;

/// A change of one point of the cloud.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Change {
    /// A new vertex; its index is the next free one.
    Add {
        /// Position, m.
        point: Point3<f64>,
        /// Unit normal.
        normal: UnitVector3<f64>,
    },
    /// A vertex moves or rotates.
    Move {
        /// Index of the vertex.
        vertex: u32,
        /// New position, m.
        point: Point3<f64>,
        /// New unit normal.
        normal: UnitVector3<f64>,
    },
    /// A vertex is removed; its index stays as a gap.
    Remove {
        /// Index of the vertex.
        vertex: u32,
    },
}

/// Result of an update.
#[derive(Debug, Clone, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Updated {
    /// Indices of the added vertices, in the order in which they were given.
    pub added: Range<u32>,
    /// Numbers of simplices of dimension 1, 2, 3 that contain a changed vertex; all others were kept.
    pub renewed: [usize; 3],
}

impl Complex {
    /// Applies `changes` in order. The result is bit for bit the complex that [`Complex::build`] would give for the present points,
    /// except for the numbering (removed vertices leave gaps) and for edges removed by [`Complex::cut`]: between two vertices that
    /// neither move nor rotate, a cut remains.
    ///
    /// # Errors
    /// [`Error::NoSuchVertex`], [`Error::VertexRemoved`], [`Error::NonFinitePoint`], [`Error::NonUnitNormal`] (index of the vertex), and
    /// [`Error::TooManySimplices`] by the options of the build. The complex is then unchanged.
    ///
    /// # Complexity
    /// A test of a few points for nearly every simplex around the changed vertices, and one pass that copies the others. Values of the former are computed
    /// when they are asked for.
    ///
    /// ```
    /// use cech_complex::nalgebra::{Point3, Vector3};
    /// use cech_complex::{Change, Complex, Cylinder, Options};
    ///
    /// let corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)];
    /// let points = corners.map(|(x, y)| Point3::new(x, y, 0.0));
    /// let normals = [Vector3::z_axis(); 4];
    /// let cylinder = Cylinder::new(0.6, 0.2)?;
    /// let mut square = Complex::build(&points, &normals, cylinder, &Options::default())?;
    /// assert_eq!(square.betti(1.0), [1, 1, 0]); // the four sides
    ///
    /// let centre = Change::Add { point: Point3::new(0.5, 0.5, 0.0), normal: Vector3::z_axis() };
    /// let updated = square.update(&[centre])?;
    /// assert_eq!((updated.added, updated.renewed), (4..5, [4, 4, 0]));
    /// assert_eq!(square.betti(1.0), [1, 0, 0]);
    /// # Ok::<(), cech_complex::Error>(())
    /// ```
    pub fn update(&mut self, changes: &[Change]) -> Result<Updated, Error> {
        let (mut points, mut normals) = (self.points.clone(), self.normals.clone());
        let mut present = self.present.clone();
        let mut changed = vec![false; points.len()];
        let first = points.len() as u32;
        for change in changes {
            match *change {
                Change::Add { point, normal } => {
                    points.push(point);
                    normals.push(normal);
                    present.push(true);
                    changed.push(true);
                }
                Change::Move {
                    vertex,
                    point,
                    normal,
                } => {
                    let v = existing(&present, vertex)?;
                    (points[v], normals[v], changed[v]) = (point, normal, true);
                }
                Change::Remove { vertex } => {
                    let v = existing(&present, vertex)?;
                    (present[v], changed[v]) = (false, false);
                }
            }
        }
        let cloud = check_cloud(&points, &normals)?;
        let vertices = Vertices {
            cloud: &cloud,
            present: &present,
            changed: &changed,
            pairs: None,
        };
        let old = (&self.skeleton, &mut self.values);
        let (skeleton, values, renewed) =
            nerve::build(&vertices, old, self.cylinder, &self.options)?;
        let added = first..points.len() as u32;
        self.adjacency = Adjacency::new(&skeleton.edges, points.len());
        (self.points, self.normals, self.present) = (points, normals, present);
        (self.skeleton, self.values, self.barcode) = (skeleton, values, OnceLock::new());
        self.whole = OnceLock::new();
        Ok(Updated { added, renewed })
    }
}

/// Index of the vertex, if it exists.
fn existing(present: &[bool], vertex: u32) -> Result<usize, Error> {
    let (index, len) = (vertex as usize, present.len());
    match present.get(index) {
        Some(true) => Ok(index),
        Some(false) => Err(Error::VertexRemoved { index }),
        None => Err(Error::NoSuchVertex { index, len }),
    }
}
