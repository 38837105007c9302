//! Where is a resting body that was lost? Candidates come from its shape, and from the poses in which it can lie on the table; the camera decides.
//!
//! ```text
//! candidates   rigid motions that bring the model, or the part of it that was seen lately, onto the cloud;
//!              and of all rotations, with the lowest vertex on the table and the outline on the outline of the cloud, those that agree best
//! agreement    s / (s + c + u) / (1 + (h/8)²)      over a pose of the model and a frame
//!   s          vertices that face the camera and have the cloud within two spacings of them along their ray
//!   c          vertices that the camera sees through, or outside of the outline of the cloud, or under the table
//!   u          a quarter of the places of the cloud, one per spacing, without a vertex near
//!   h          height of the lowest vertex above the table, in spacings
//! ```
//! Aligning shapes is not enough: half of a body faces the camera, part of that may never have been seen, and a dome fits onto itself in every rotation.
//! Surface of the cloud that the model lacks counts less than surface of the model that the cloud contradicts.

use crate::canonical::{CanonicalModel, graph, tangent};
use crate::cell::{Observation, Plane};
use crate::visibility::{DepthGrid, facing};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, UnitVector3, Vector3};
use nonrigid_reg::{
    Alignment, Cloud, estimate_normals, even_rotations, refine_rigid, rigid_alignments,
    voxel_downsample,
};

/// A vertex counts as seen lately if it was seen within this many frames before the last sight of the body.
const LATELY: u32 = 5;
/// Number of neighbours to which the normals of the cloud are fitted.
const NEIGHBOURS: usize = 16;
/// Least cosine between normal and ray of a vertex that the camera should see.
const FACING: f64 = 0.2;
/// Depth below the table at which a vertex contradicts a pose, in spacings.
const SUNK: f64 = 1.5;
/// Weight of surface that the model lacks.
const UNKNOWN: f64 = 0.25;
/// Height above the table, in spacings, that halves the agreement.
const HOVERS: f64 = 8.0;
/// Number of rotations in which the body is put onto the table, and how many of them are fitted to the cloud.
const ROTATIONS: usize = 600;
const FITTED: usize = 12;

/// A place where the body may be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Located {
    /// Motion of the model as it was last estimated.
    pub found_from_lost: Isometry3<f64>,
    /// How well the frame agrees with it, 0 to 1; see the [module](self).
    pub agreement: f64,
}

/// Places where the body may be, in the order of their agreement with a frame; empty without a model or without a cloud.
///
/// # Complexity
/// Two searches for rigid alignments, and 600 poses that are compared with the frame: about a second in all for a thousand vertices and 5,000 points.
///
/// ```
/// use explore_loop::canonical::{CanonicalModel, NewVertex};
/// use explore_loop::cell::{Observation, Plane};
/// use explore_loop::nalgebra::{Isometry3, Point3, UnitVector3, Vector3};
/// use explore_loop::reconstruct::locate::locate;
/// use explore_loop::visibility::facing;
///
/// // An egg, all of which is known, on a table half a metre under the camera.
/// let axes = Vector3::new(0.06, 0.045, 0.03);
/// let golden = std::f64::consts::PI * (3.0 - 5_f64.sqrt());
/// let on_ball = |k: i32| {
///     let z = 1.0 - (2.0 * f64::from(k) + 1.0) / 1200.0;
///     let (sin, cos) = (golden * f64::from(k)).sin_cos();
///     Vector3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z)
/// };
/// let normal = |k: i32| UnitVector3::new_normalize(on_ball(k).component_div(&axes));
/// let point = |k: i32| Point3::from(on_ball(k).component_mul(&axes)) + Vector3::z() * 0.47;
/// let mut model = CanonicalModel::default();
/// (0..1200).for_each(|k| model.push(NewVertex::new(point(k), normal(k)), 0));
///
/// // It has slipped, and lies 5 cm away, turned by a radian.
/// let slipped = Isometry3::new(Vector3::new(0.05, 0.0, 0.0), Vector3::z());
/// let moved = |k: i32| (slipped * point(k), slipped.rotation * normal(k));
/// let faces = |(p, n): &(Point3<f64>, UnitVector3<f64>)| facing(p, n, &Point3::origin()) > 0.1;
/// let seen = Observation {
///     stamp: 0.0,
///     camera: None,
///     points: (0..1200).map(moved).filter(faces).map(|(p, _)| p).collect(),
///     colours: None,
///     features: None,
///     arms: Vec::new(),
/// };
/// let table = Plane { normal: -Vector3::z_axis(), offset: 0.5 };
/// let places = locate(&model, &seen, &table, 0.005);
/// let centre = Point3::new(0.0, 0.0, 0.47);
/// assert!(places[0].agreement > 0.9);
/// assert!((places[0].found_from_lost * centre - slipped * centre).norm() < 0.003);
/// ```
pub fn locate(
    model: &CanonicalModel,
    seen: &Observation,
    table: &Plane,
    spacing: f64,
) -> Vec<Located> {
    let normals: Vec<UnitVector3<f64>> = (0..model.len()).map(|i| model.live_normal(i)).collect();
    let Some(frame) = Frame::new(seen, table, spacing) else {
        return Vec::new();
    };
    let cloud = Cloud {
        points: &seen.points,
        normals: &frame.normals,
    };
    let body = Cloud {
        points: model.live(),
        normals: &normals,
    };
    let last = model.last_seen().iter().copied().max().unwrap_or(0);
    let lately: Vec<usize> = (0..model.len())
        .filter(|&i| model.last_seen()[i] + LATELY >= last)
        .collect();
    let points: Vec<Point3<f64>> = lately.iter().map(|&i| model.live()[i]).collect();
    let part: Vec<UnitVector3<f64>> = lately.iter().map(|&i| normals[i]).collect();
    let lately = Cloud {
        points: &points,
        normals: &part,
    };
    let resting = frame.resting(model.live(), &normals);
    // Fewer than four vertices, or points, have no place of their own.
    let alignments = [
        rigid_alignments(&lately, &cloud),
        rigid_alignments(&body, &cloud),
        refine_rigid(&body, &cloud, &resting),
    ];
    let located = |found: Alignment| Located {
        found_from_lost: found.target_from_source,
        agreement: frame.agreement(model.live(), &normals, &found.target_from_source),
    };
    let alignments = alignments.into_iter().flat_map(Result::unwrap_or_default);
    let mut found: Vec<Located> = alignments.map(located).collect();
    found.sort_by(|a, b| b.agreement.total_cmp(&a.agreement));
    found
}

/// How well a frame agrees with the model moved by a rigid motion, 0 to 1; 0 without a cloud. See the [module](self).
pub fn agreement(
    model: &CanonicalModel,
    seen: &Observation,
    table: &Plane,
    spacing: f64,
    found_from_lost: &Isometry3<f64>,
) -> f64 {
    let normals: Vec<UnitVector3<f64>> = (0..model.len()).map(|i| model.live_normal(i)).collect();
    Frame::new(seen, table, spacing).map_or(0.0, |frame| {
        frame.agreement(model.live(), &normals, found_from_lost)
    })
}

/// What a frame shows of the body.
struct Frame {
    depth: DepthGrid,
    eye: Point3<f64>,
    /// Normals of the cloud.
    normals: Vec<UnitVector3<f64>>,
    /// The cloud, thinned to the spacing of the model.
    places: Vec<Point3<f64>>,
    table: Plane,
    spacing: f64,
}

impl Frame {
    fn new(seen: &Observation, table: &Plane, spacing: f64) -> Option<Self> {
        let normals = estimate_normals(&seen.points, NEIGHBOURS, &seen.eye()).ok()?;
        let thinned = voxel_downsample(&seen.points, &normals, spacing).ok()?;
        Some(Self {
            depth: DepthGrid::new(&seen.points, 0.6 * spacing, &seen.fixed_from_camera())?,
            eye: seen.eye(),
            normals,
            places: thinned.points,
            table: *table,
            spacing,
        })
    }

    /// Agreement of the frame with a model moved by `pose`.
    fn agreement(
        &self,
        points: &[Point3<f64>],
        normals: &[UnitVector3<f64>],
        pose: &Isometry3<f64>,
    ) -> f64 {
        let moved: Vec<Point3<f64>> = points.iter().map(|p| pose * p).collect();
        let (mut supported, mut contradicted) = (0.0, 0.0);
        for (p, n) in moved.iter().zip(normals) {
            let faces = facing(p, &(pose.rotation * n), &self.eye) > FACING;
            let outside = || self.depth.nearest_seen(p, 2.0 * self.spacing).is_none();
            match self.depth.behind(p) {
                Some(behind) if behind < -2.0 * self.spacing => contradicted += 1.0,
                Some(behind) if faces && behind < 2.0 * self.spacing => supported += 1.0,
                None if outside() => contradicted += 1.0,
                _ if self.table.height(p) < -SUNK * self.spacing => contradicted += 1.0,
                _ => {}
            }
        }
        let unknown = graph::tree(&moved).map_or(self.places.len(), |tree| {
            let lacks = |p: &&Point3<f64>| graph::near(&tree, p, 1.5 * self.spacing, 1).is_empty();
            self.places.iter().filter(lacks).count()
        });
        let all = supported + contradicted + UNKNOWN * unknown as f64;
        let heights = moved.iter().map(|p| self.table.height(p));
        let hovers = heights.fold(f64::INFINITY, f64::min).max(0.0) / (HOVERS * self.spacing);
        supported / f64::max(all, 1.0) / (1.0 + hovers * hovers)
    }

    /// Motions of the model after which it lies on the table within the outline of the cloud: of all rotations those that agree best.
    fn resting(&self, points: &[Point3<f64>], normals: &[UnitVector3<f64>]) -> Vec<Isometry3<f64>> {
        let mut poses: Vec<(f64, Isometry3<f64>)> = even_rotations(ROTATIONS)
            .map(|turn| {
                let pose = self.laid(points, turn);
                (self.agreement(points, normals, &pose), pose)
            })
            .collect();
        poses.sort_by(|a, b| b.0.total_cmp(&a.0));
        poses.truncate(FITTED);
        poses.into_iter().map(|(_, pose)| pose).collect()
    }

    /// Rotates the model, puts its lowest vertex on the table, and centres it along the table on the cloud.
    fn laid(&self, points: &[Point3<f64>], turn: UnitQuaternion<f64>) -> Isometry3<f64> {
        let turned: Vec<Point3<f64>> = points.iter().map(|p| turn * p).collect();
        let shift = middle(&self.places, &self.table.normal) - middle(&turned, &self.table.normal);
        let heights = turned.iter().map(|p| self.table.height(&(p + shift)));
        let lowest = heights.fold(f64::INFINITY, f64::min);
        Translation3::from(shift - self.table.normal.scale(lowest)) * turn
    }
}

/// Middle of the extent of `points` along a plane with this normal.
fn middle(points: &[Point3<f64>], normal: &UnitVector3<f64>) -> Vector3<f64> {
    let mut middle = Vector3::zeros();
    for axis in <[Vector3<f64>; 2]>::from(tangent::tangents(normal)) {
        let along = points.iter().map(|p| axis.dot(&p.coords));
        let (low, high) = along.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| {
            (low.min(x), high.max(x))
        });
        middle += axis * (0.5 * (low + high));
    }
    middle
}
