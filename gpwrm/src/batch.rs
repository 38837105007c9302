//! Whole-field evaluation: many points at once, on all cores with the feature `rayon`.
//!
//! Every point is evaluated independently, in the same order of operations as alone, so that threads change only the time and not a bit
//! of the result.

use nalgebra::{Matrix3, Point3, Unit, UnitVector3, Vector3};

use crate::error::{Error, check_length};
use crate::field::Field;
use crate::options::Sample;
use crate::partition::Part;
use crate::rotation::nearest_rotation;

/// Points that one thread processes at a time: enough to outweigh the overhead (a point takes about a microsecond).
#[cfg(feature = "rayon")]
const SHARE: usize = 256;

/// `f(0), f(1), …, f(count − 1)`.
pub(crate) fn map_indexed<T: Send>(count: usize, f: impl Fn(usize) -> T + Sync + Send) -> Vec<T> {
    map_with_room(count, |i, _| f(i))
}

/// [`map_indexed`] with a buffer for the parts of an evaluation, reused from one index to the next.
fn map_with_room<T: Send>(
    count: usize,
    f: impl Fn(usize, &mut Vec<Part>) -> T + Sync + Send,
) -> Vec<T> {
    #[cfg(feature = "rayon")]
    {
        use rayon::prelude::*;
        (0..count)
            .into_par_iter()
            .with_min_len(SHARE)
            .map_init(|| Vec::with_capacity(32), |room, i| f(i, room))
            .collect()
    }
    #[cfg(not(feature = "rayon"))]
    {
        let mut room = Vec::with_capacity(32);
        (0..count).map(|i| f(i, &mut room)).collect()
    }
}

impl Field {
    /// [`Field::evaluate`] at every point, in the order of the points.
    ///
    /// # Complexity
    /// `O(n (log N + k))` for `n` points, `N` nodes and `k` nodes in reach, divided among the cores with the feature `rayon`.
    ///
    /// ```
    /// use gpwrm::{Field, FieldOptions, nalgebra::{Matrix3, Point3, Rotation3, Vector3}};
    /// # let nodes: Vec<_> = (0..36).map(|k| Point3::new(f64::from(k % 6), f64::from(k / 6), 0.0) * 0.01).collect();
    /// # let turn = Rotation3::from_axis_angle(&Vector3::x_axis(), 2.5);
    /// # let motion: Vec<_> = nodes.iter().map(|p| turn * p - p).collect();
    /// // A sheet of nodes that turns.
    /// let field = Field::new(&nodes, &motion, &FieldOptions::default())?;
    /// let samples = field.evaluate_all(&[Point3::new(0.021, 0.033, 0.0), Point3::new(0.02, 0.03, 1.0)]);
    /// assert!((samples[0].gradient - (turn.matrix() - Matrix3::identity())).amax() < 1e-6);
    /// assert!(!samples[0].extrapolated);
    /// // The second point is one metre above the sheet.
    /// assert!(samples[1].extrapolated && (samples[1].extrapolation - 1.0).abs() < 1e-9);
    /// # Ok::<(), gpwrm::Error>(())
    /// ```
    pub fn evaluate_all(&self, points: &[Point3<f64>]) -> Vec<Sample> {
        map_with_room(points.len(), |i, room| self.evaluate_with(&points[i], room))
    }

    /// [`Field::displacement`] at every point, in the order of the points.
    pub fn displacements(&self, points: &[Point3<f64>]) -> Vec<Vector3<f64>> {
        map_with_room(points.len(), |i, room| {
            self.displacement_with(&points[i], room)
        })
    }

    /// `p + u(p)` for every point.
    ///
    /// ```
    /// use gpwrm::{Field, FieldOptions, nalgebra::{Point3, Rotation3, Vector3}};
    /// # let nodes: Vec<_> = (0..36).map(|k| Point3::new(f64::from(k % 6), f64::from(k / 6), 0.0) * 0.01).collect();
    /// let turn = Rotation3::from_axis_angle(&Vector3::x_axis(), 2.5);
    /// let motion: Vec<_> = nodes.iter().map(|p| turn * p - p).collect();
    /// let field = Field::new(&nodes, &motion, &FieldOptions::default())?;
    /// let cloud = [Point3::new(0.021, 0.033, 0.0), Point3::new(0.012, 0.04, 0.01)];
    /// for (moved, p) in field.warp(&cloud).iter().zip(&cloud) {
    ///     assert!((moved - turn * p).norm() < 1e-12);
    /// }
    /// # Ok::<(), gpwrm::Error>(())
    /// ```
    pub fn warp(&self, points: &[Point3<f64>]) -> Vec<Point3<f64>> {
        map_with_room(points.len(), |i, room| {
            points[i] + self.displacement_with(&points[i], room)
        })
    }

    /// Normals transformed by the field: `n' ∝ F⁻ᵀ n`, at the points before the motion.
    ///
    /// Computed with the cofactor matrix, `det F · F⁻ᵀ`, which exists even where the field folds; where the result is zero,
    /// the local rotation is applied instead.
    ///
    /// # Errors
    /// Slices of different lengths.
    ///
    /// ```
    /// use gpwrm::{Field, FieldOptions, nalgebra::{Point3, UnitVector3, Vector3}};
    /// # let nodes: Vec<_> = (0..64).map(|k| Point3::new(f64::from(k % 4), f64::from(k / 4 % 4), f64::from(k / 16))).collect();
    /// // A block of nodes, stretched along x to twice its length.
    /// let stretch: Vec<_> = nodes.iter().map(|p| Vector3::new(p.x, 0.0, 0.0)).collect();
    /// let field = Field::new(&nodes, &stretch, &FieldOptions::default())?;
    /// let normal = UnitVector3::new_normalize(Vector3::new(1.0, 1.0, 0.0));
    /// let turned = field.warp_normals(&[Point3::new(1.5, 1.5, 1.5)], &[normal])?[0];
    /// // It turns away from x, where a direction in the material would turn towards it.
    /// assert!((turned.into_inner() - Vector3::new(1.0, 2.0, 0.0).normalize()).norm() < 0.02);
    /// # Ok::<(), gpwrm::Error>(())
    /// ```
    pub fn warp_normals(
        &self,
        points: &[Point3<f64>],
        normals: &[UnitVector3<f64>],
    ) -> Result<Vec<UnitVector3<f64>>, Error> {
        check_length("normals", points.len(), normals.len())?;
        Ok(map_with_room(points.len(), |i, room| {
            let f = Matrix3::identity() + self.evaluate_with(&points[i], room).gradient;
            carry_normal(&f, &normals[i])
        }))
    }
}

/// `F⁻ᵀ n`, normalised.
fn carry_normal(f: &Matrix3<f64>, n: &UnitVector3<f64>) -> UnitVector3<f64> {
    let carried = cofactor(f) * n.as_ref() * f.determinant().signum();
    Unit::try_new(carried, 1e-12).unwrap_or_else(|| nearest_rotation(f) * n)
}

/// The cofactor matrix, `det F · F⁻ᵀ`.
fn cofactor(f: &Matrix3<f64>) -> Matrix3<f64> {
    let (a, b, c) = (f.column(0), f.column(1), f.column(2));
    Matrix3::from_columns(&[b.cross(&c), c.cross(&a), a.cross(&b)])
}
