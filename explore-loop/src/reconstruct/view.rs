//! The data of a frame, prepared once: points, normals, search tree, depth image.

use crate::Error;
use crate::canonical::graph;
use crate::cell::Observation;
use crate::visibility::DepthGrid;
use nalgebra::{Point3, UnitVector3};

/// Fewest points of a frame.
pub(crate) const FEWEST: usize = 20;
/// Largest depth of a point, in multiples of the median.
const FARTHEST: f64 = 10.0;
/// Number of neighbours to which a normal is fitted.
const NORMAL_NEIGHBOURS: usize = 16;
/// Number of neighbours by which the boundary of the seen surface is found, and the gap of their directions there, radians.
const RIM_NEIGHBOURS: usize = 16;
const RIM_ANGLE: f64 = 1.9;

/// The cloud of a frame: thinned to half a spacing, with normals.
#[derive(serde::Deserialize)]
#[serde(try_from = "Seen")]
pub(crate) struct FrameView {
    pub points: Vec<Point3<f64>>,
    pub normals: Vec<UnitVector3<f64>>,
    /// Whether each point lies on the boundary of the seen surface.
    pub rim: Vec<bool>,
    /// Depth image of the whole cloud.
    pub depth: DepthGrid,
    pub tree: graph::Tree,
}

impl FrameView {
    /// Position of the camera.
    pub fn eye(&self) -> Point3<f64> {
        self.depth.eye()
    }

    /// Prepares an observation; `None` when it shows too little of the object.
    pub fn new(observation: &Observation, spacing: f64) -> Result<Option<Self>, Error> {
        let points = usable(observation);
        if points.len() < FEWEST {
            return Ok(None);
        }
        let Some(depth) = DepthGrid::new(&points, 0.6 * spacing, &observation.fixed_from_camera())
        else {
            return Ok(None);
        };
        let normals =
            nonrigid_reg::estimate_normals(&points, NORMAL_NEIGHBOURS, &observation.eye())?;
        let thin = nonrigid_reg::voxel_downsample(&points, &normals, 0.5 * spacing)?;
        let cloud = nonrigid_reg::Cloud {
            points: &thin.points,
            normals: &thin.normals,
        };
        let rim = nonrigid_reg::boundary_points(&cloud, RIM_NEIGHBOURS, RIM_ANGLE)?;
        let Some(tree) = graph::tree(&thin.points).filter(|_| thin.points.len() >= FEWEST) else {
            return Ok(None);
        };
        Ok(Some(Self {
            points: thin.points,
            normals: thin.normals,
            rim,
            depth,
            tree,
        }))
    }
}

/// Finite points, without outliers at many times the median distance: their depth image would be as large as they are far away.
fn usable(observation: &Observation) -> Vec<Point3<f64>> {
    let finite = |p: &&Point3<f64>| p.coords.iter().all(|x| x.is_finite());
    let mut points: Vec<Point3<f64>> = observation.points.iter().filter(finite).copied().collect();
    let camera_from_fixed = observation.fixed_from_camera().inverse();
    let depth = |p: &Point3<f64>| (camera_from_fixed * p).z.abs();
    let mut depths: Vec<f64> = points.iter().map(depth).collect();
    let middle = depths.len() / 2;
    if !depths.is_empty() {
        let middle = *depths.select_nth_unstable_by(middle, f64::total_cmp).1;
        points.retain(|p| depth(p) <= FARTHEST * middle);
    }
    points
}

/// The saved part of a view; the tree is rebuilt.
type Seen = (
    Vec<Point3<f64>>,
    Vec<UnitVector3<f64>>,
    Vec<bool>,
    DepthGrid,
);

impl serde::Serialize for FrameView {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        (&self.points, &self.normals, &self.rim, &self.depth).serialize(serializer)
    }
}

impl TryFrom<Seen> for FrameView {
    type Error = &'static str;

    fn try_from(seen: Seen) -> Result<Self, Self::Error> {
        let (points, normals, rim, depth) = seen;
        let tree = graph::tree(&points).ok_or("a view without points")?;
        if normals.len() != points.len() || rim.len() != points.len() {
            return Err("a view with more points than normals");
        }
        Ok(Self {
            points,
            normals,
            rim,
            depth,
            tree,
        })
    }
}
