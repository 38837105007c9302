//! The geometry of a hole: its centre, its long axis, and the direction in which it opens.
//!
//! ```text
//! c = mean of the loop,   u = first principal direction,   n = mean normal,   v = n × u  (projected to horizontal)
//! ```
//!
//! `v` is defined for a slit of zero width too, for which the second principal direction is not.

use nalgebra::{Matrix3, Point3, SymmetricEigen, UnitVector3, Vector3};

use crate::{Error, Model, Refusal, Scene};

/// A loop of vertices around the opening of a fold or pocket.
pub(crate) struct Hole {
    pub(crate) center: Point3<f64>,
    pub(crate) long: Vector3<f64>,
    pub(crate) across: UnitVector3<f64>,
}

/// Least sine of the angle between a slit and a grip that opens it: 20°.
const BESIDE: f64 = 0.34;

impl Hole {
    pub(crate) fn new(model: &Model, scene: &Scene, hole: &[u32]) -> Result<Self, Refusal> {
        let points = model.points.len();
        if let Some(&vertex) = hole.iter().find(|&&v| v as usize >= points) {
            return Err(Error::NoSuchVertex { vertex, points }.into());
        }
        let flat = Refusal::NotAHole {
            vertices: hole.len(),
        };
        if hole.len() < 3 {
            return Err(flat);
        }
        let at = |v: &u32| model.points[*v as usize].coords;
        let center = hole.iter().map(at).sum::<Vector3<f64>>() / hole.len() as f64;
        let scatter: Matrix3<f64> = hole
            .iter()
            .map(|v| at(v) - center)
            .map(|d| d * d.transpose())
            .sum();
        let eigen = SymmetricEigen::new(scatter);
        let longest = eigen.eigenvalues.imax();
        // Lengths below a nanometre are rounding.
        if eigen.eigenvalues[longest] <= 1e-18 {
            return Err(flat);
        }
        let long = eigen.eigenvectors.column(longest).into_owned();
        let faces: Vector3<f64> = hole
            .iter()
            .map(|v| model.normals[*v as usize].into_inner())
            .sum();
        let normal = faces
            .try_normalize(1e-6)
            .unwrap_or(scene.table.normal.into_inner());
        // The pull is horizontal; the vertical part is `lift`.
        let across =
            UnitVector3::try_new(scene.table.along(&normal.cross(&long)), 1e-6).ok_or(flat)?;
        Ok(Self {
            center: Point3::from(center),
            long,
            across,
        })
    }

    /// Signed distance of a point to the second side of the slit, metres; negative on the first side.
    pub(crate) fn side(&self, point: &Point3<f64>) -> f64 {
        self.across.dot(&(point - self.center))
    }

    /// How well grips that move apart along `axis` open the hole, 0 to 1; 0 if they are not on both sides of it: a grip in line with
    /// the slit pulls along it and does not open it.
    pub(crate) fn opened_by(&self, grips: [&Point3<f64>; 2], axis: &UnitVector3<f64>) -> f64 {
        let [a, b] = grips.map(|p| self.beside(p));
        let least = a.abs().min(b.abs());
        if a * b < 0.0 && least >= BESIDE {
            self.across.dot(axis).abs() * least
        } else {
            0.0
        }
    }

    /// Sine of the angle between the slit and the direction from its centre to a point, negative on the first side.
    fn beside(&self, point: &Point3<f64>) -> f64 {
        let d = point - self.center;
        let (side, along) = (self.across.dot(&d), self.long.dot(&d));
        let away = side.hypot(along);
        if away > 0.0 { side / away } else { 0.0 }
    }
}
