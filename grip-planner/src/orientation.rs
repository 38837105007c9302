//! The pose of a tool at a vertex: pitch, roll, and the poses before and after the grasp.
//!
//! ```text
//! approach z = −n, tilted up to the least elevation in the vertical plane of n        (pitch)
//! jaws     y = boundary tangent, made perpendicular to z                              (roll)
//! grasp    G = (y × z, y, z | p + depth·z, raised to the clearance)
//! approach   = G · (0, 0, −d)            retreat = n_table · d/2 + approach
//! ```
//!
//! The jaws open along the boundary, so that both have the same height above the table.

use nalgebra::{
    Isometry3, Matrix3, Point3, Rotation3, SymmetricEigen, Translation3, UnitQuaternion,
    UnitVector3, Vector3,
};

use crate::model::Adjacency;
use crate::{AgentBox, Error, Model, Options, Reason, Scene, agent_box};

/// The orientation of a tool that holds.
pub(crate) struct Grasp {
    pub(crate) tip: Point3<f64>,
    /// Tip +z.
    pub(crate) approach: UnitVector3<f64>,
    /// Tip ±y.
    pub(crate) roll: UnitVector3<f64>,
}

/// Poses of tools at the vertices of a model.
pub(crate) struct Orientation<'a> {
    model: &'a Model<'a>,
    scene: &'a Scene<'a>,
    options: &'a Options,
    near: Adjacency,
    pub(crate) outline: AgentBox,
}

impl<'a> Orientation<'a> {
    pub(crate) fn new(
        model: &'a Model<'a>,
        scene: &'a Scene<'a>,
        options: &'a Options,
    ) -> Result<Self, Error> {
        Ok(Self {
            model,
            scene,
            options,
            near: Adjacency::new(model.points.len(), model.edges),
            outline: agent_box(model.points, &scene.table)?,
        })
    }

    /// The grasp at vertex `v`.
    pub(crate) fn at(&self, v: usize) -> Result<Grasp, Reason> {
        let normal = self.model.normals[v];
        let elevation = normal.dot(&self.scene.table.normal).clamp(-1.0, 1.0).asin();
        if elevation < -self.options.max_dip {
            return Err(Reason::FacesTable { dip: -elevation });
        }
        let approach = self.approach(&normal, elevation);
        let tip = self.tip(self.model.points[v] + approach.as_ref() * self.options.grip_depth)?;
        let roll = self.roll(v, &approach, &tip);
        Ok(Grasp {
            tip,
            approach,
            roll,
        })
    }

    /// Against the normal, raised to the least elevation.
    fn approach(&self, normal: &UnitVector3<f64>, elevation: f64) -> UnitVector3<f64> {
        if elevation >= self.options.min_elevation {
            return -*normal;
        }
        let up = self.scene.table.normal;
        let out = self
            .scene
            .table
            .along(normal)
            .try_normalize(1e-9)
            .unwrap_or(*self.outline.axes[1]);
        let (sin, cos) = self.options.min_elevation.sin_cos();
        -UnitVector3::new_normalize(out * cos + up.as_ref() * sin)
    }

    /// A tip that is slightly too low is raised: the jaws are wide enough to hold the vertex nevertheless.
    fn tip(&self, tip: Point3<f64>) -> Result<Point3<f64>, Reason> {
        let height = self.scene.table.height(&tip);
        let missing = self.scene.clearance - height;
        if missing <= 0.0 {
            return Ok(tip);
        }
        if missing > self.scene.jaw_radius {
            return Err(Reason::TooLow { height });
        }
        Ok(tip + self.scene.table.normal.as_ref() * missing)
    }

    /// Along the boundary; along the table if there is no boundary or a jaw would collide with the table.
    fn roll(&self, v: usize, approach: &UnitVector3<f64>, tip: &Point3<f64>) -> UnitVector3<f64> {
        let free = |d: &UnitVector3<f64>| {
            let drop = self.scene.table.normal.dot(d).abs() * self.scene.jaw_radius;
            self.scene.table.height(tip) - drop >= 0.0
        };
        let level = || {
            let across = self.scene.table.normal.cross(approach);
            // The roll of a vertical tool is arbitrary: the longer side of the box is used.
            UnitVector3::try_new(across, 1e-6).unwrap_or(self.outline.axes[0])
        };
        let tangent = self
            .tangent(v)
            .and_then(|t| UnitVector3::try_new(t - approach.as_ref() * approach.dot(&t), 1e-3));
        let roll = tangent.filter(free).unwrap_or_else(level);
        let roll =
            UnitVector3::new_normalize(roll.into_inner() - approach.as_ref() * approach.dot(&roll));
        // Both signs are the same grip; the choice must not depend on an eigenvector's sign.
        let side = self.scene.table.normal.cross(approach);
        if roll.dot(&side) < 0.0 { -roll } else { roll }
    }

    /// Direction of the boundary at `v`: the principal direction of the edges to boundary neighbours.
    fn tangent(&self, v: usize) -> Option<Vector3<f64>> {
        let boundary = self
            .near
            .of(v)
            .iter()
            .filter(|&&w| self.model.boundary[w as usize] && self.model.boundary[v]);
        let scatter: Matrix3<f64> = boundary
            .filter_map(|&w| {
                (self.model.points[w as usize] - self.model.points[v]).try_normalize(0.0)
            })
            .map(|d| d * d.transpose())
            .sum();
        if scatter.trace() == 0.0 {
            return None;
        }
        let eigen = SymmetricEigen::new(scatter);
        Some(
            eigen
                .eigenvectors
                .column(eigen.eigenvalues.imax())
                .into_owned(),
        )
    }
}

/// Tip pose from its origin, approach (+z) and jaw direction (+y), which are perpendicular.
pub(crate) fn pose(
    tip: Point3<f64>,
    approach: &UnitVector3<f64>,
    roll: &UnitVector3<f64>,
) -> Isometry3<f64> {
    let (z, y) = (approach.into_inner(), roll.into_inner());
    let axes = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[y.cross(&z), y, z]));
    Isometry3::from_parts(
        Translation3::from(tip.coords),
        UnitQuaternion::from_rotation_matrix(&axes),
    )
}

/// The pose `distance` back along the tool.
pub(crate) fn backed_off(camera_from_tip: &Isometry3<f64>, distance: f64) -> Isometry3<f64> {
    camera_from_tip * Translation3::new(0.0, 0.0, -distance)
}

/// Back along the tool, and half as far up.
pub(crate) fn retreat(
    camera_from_tip: &Isometry3<f64>,
    scene: &Scene,
    distance: f64,
) -> Isometry3<f64> {
    let up = Translation3::from(scene.table.normal.as_ref() * (0.5 * distance));
    up * backed_off(camera_from_tip, distance)
}
