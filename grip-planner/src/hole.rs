//! The geometry of a hole, or of a neck between parts that touch: its centre, its long axis, and the direction in which it opens.
//!
//! ```text
//! hole   c = mean of the loop,   u = first principal direction,    n = mean normal,   v = n × u      (projected to horizontal)
//! neck   c = mean of the loop,   a = given direction from one part to the other,      v = a          (projected to horizontal),   u = vertical × v
//! ```
//!
//! For a hole `v` is defined for a slit of zero width too, for which the second principal direction is not. The normals around a neck face in all
//! directions.

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

/// The middle of a loop of at least three vertices.
fn middle(model: &Model, around: &[u32]) -> Result<Vector3<f64>, Refusal> {
    let points = model.points.len();
    if let Some(&vertex) = around.iter().find(|&&v| v as usize >= points) {
        return Err(Error::NoSuchVertex { vertex, points }.into());
    }
    if around.len() < 3 {
        return Err(Refusal::NotAHole {
            vertices: around.len(),
        });
    }
    let sum: Vector3<f64> = around
        .iter()
        .map(|&v| model.points[v as usize].coords)
        .sum();
    Ok(sum / around.len() as f64)
}

/// Least sine of the angle between the direction from one part to the other and the vertical: what lies on top of something cannot be pulled off it
/// sideways. 30°.
const SIDEWAYS: f64 = 0.5;

impl Hole {
    /// The neck between two parts that lie beside each other along `axis`, with a loop around it.
    pub(crate) fn neck(
        model: &Model,
        scene: &Scene,
        neck: &[u32],
        axis: &UnitVector3<f64>,
    ) -> Result<Self, Refusal> {
        let center = middle(model, neck)?;
        let sideways = scene.table.along(axis);
        let across = UnitVector3::try_new(sideways, SIDEWAYS).ok_or(Refusal::NotBeside)?;
        Ok(Self {
            center: Point3::from(center),
            long: scene.table.normal.cross(&across),
            across,
        })
    }

    pub(crate) fn new(model: &Model, scene: &Scene, hole: &[u32]) -> Result<Self, Refusal> {
        let center = middle(model, hole)?;
        let flat = Refusal::NotAHole {
            vertices: hole.len(),
        };
        let at = |v: &u32| model.points[*v as usize].coords;
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
