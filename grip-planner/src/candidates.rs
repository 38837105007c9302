//! Grip candidates: which vertices an arm could take hold of, and how it would come.
//!
//! A candidate is on the boundary of the explored part, seen now, high enough above the table, within the reach of an
//! arm, and the way to it is free. The tool comes against the outward normal (pitch); where the normal is lower
//! than a tool may lean, it is tilted up to the least elevation in the same vertical plane. The jaws open along the
//! boundary tangent (roll), which keeps both at the same height, away from the table.

use nalgebra::{
    Isometry3, Matrix3, Point3, Rotation3, SymmetricEigen, Translation3, UnitQuaternion,
    UnitVector3, Vector3,
};

use crate::model::Adjacency;
use crate::options::CandidateSource;
use crate::{AgentBox, Error, Model, Options, Scene, agent_box};

/// A vertex that can be gripped.
#[derive(Debug, Clone, PartialEq)]
pub struct Candidate {
    /// The vertex.
    pub vertex: u32,
    /// Where it is.
    pub point: Point3<f64>,
    /// The way the tool comes: tip +z.
    pub approach: UnitVector3<f64>,
    /// The way the jaws open: tip ±y.
    pub roll: UnitVector3<f64>,
    /// Where the tip grips: a little beyond the vertex, never nearer to the table than the clearance.
    pub tip: Point3<f64>,
    /// The arms that reach the grip and the approach.
    pub arms: Vec<usize>,
    /// Whether it is on the boundary of the explored part (otherwise only visible).
    pub boundary: bool,
}

impl Candidate {
    /// The grasp pose, `camera_from_tip`.
    pub fn camera_from_tip(&self) -> Isometry3<f64> {
        pose(self.tip, &self.approach, &self.roll)
    }
}

/// Why a boundary vertex cannot be gripped.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Reason {
    /// The camera does not see it.
    #[error("not visible")]
    Hidden,
    /// The tip would be too near the table.
    #[error("{height} m above the table")]
    TooLow {
        /// Height of the tip above the table, metres.
        height: f64,
    },
    /// The surface faces the table.
    #[error("the normal dips {dip} rad under the horizon")]
    FacesTable {
        /// Angle between the normal and the horizon, radians.
        dip: f64,
    },
    /// No arm reaches it.
    #[error("out of the reach of every arm")]
    OutOfReach,
    /// The body is in the way of the tool.
    #[error("vertex {by} is in the way of the tool")]
    Blocked {
        /// The vertex in the way.
        by: u32,
    },
    /// Other candidates are near and there are enough of them.
    #[error("another candidate is near")]
    Thinned,
}

/// The vertices that can be gripped, and why the others cannot.
#[derive(Debug, Clone, PartialEq)]
pub struct Candidates {
    /// Accepted, in vertex order.
    pub accepted: Vec<Candidate>,
    /// Boundary vertices that were rejected, in vertex order.
    pub rejected: Vec<(u32, Reason)>,
}

/// Grip candidates of `model`.
///
/// # Errors
/// A model, scene or setting that is not usable.
///
/// # Complexity
/// `O(n)` per candidate that is looked at.
pub fn candidates(model: &Model, scene: &Scene, options: &Options) -> Result<Candidates, Error> {
    Ok(Search::new(model, scene, options)?.run())
}

/// The same judgement on vertices of one's own choice, whether they are on the boundary or not; none is thinned out while
/// there is room.
///
/// # Errors
/// A model, scene, setting or vertex that is not usable.
pub fn candidates_among(
    model: &Model,
    scene: &Scene,
    options: &Options,
    vertices: &[u32],
) -> Result<Candidates, Error> {
    let search = Search::new(model, scene, options)?;
    let points = model.points.len();
    if let Some(&vertex) = vertices.iter().find(|&&v| v as usize >= points) {
        return Err(Error::NoSuchVertex { vertex, points });
    }
    let mut wanted = vertices.to_vec();
    wanted.sort_unstable();
    wanted.dedup();
    let mut rejected = Vec::new();
    let reachable = search.examine(wanted.into_iter(), &mut rejected);
    let accepted = search.keep_free(&reachable, options.max_candidates, &[], &mut rejected);
    Ok(Candidates::sorted(accepted, rejected))
}

impl Candidates {
    fn sorted(mut accepted: Vec<Candidate>, mut rejected: Vec<(u32, Reason)>) -> Self {
        accepted.sort_by_key(|c| c.vertex);
        rejected.sort_by_key(|r| r.0);
        Self { accepted, rejected }
    }
}

struct Search<'a> {
    model: &'a Model<'a>,
    scene: &'a Scene<'a>,
    options: &'a Options,
    near: Adjacency,
    outline: AgentBox,
}

impl<'a> Search<'a> {
    fn new(
        model: &'a Model<'a>,
        scene: &'a Scene<'a>,
        options: &'a Options,
    ) -> Result<Self, Error> {
        model.check()?;
        scene.check()?;
        options.check()?;
        let near = Adjacency::new(model.points.len(), model.edges);
        let outline = agent_box(model.points, &scene.table)?;
        Ok(Self {
            model,
            scene,
            options,
            near,
            outline,
        })
    }

    fn run(&self) -> Candidates {
        let mut rejected = Vec::new();
        let rim = (0..self.model.points.len() as u32).filter(|&v| self.model.boundary[v as usize]);
        let reachable = self.examine(rim, &mut rejected);
        let fill = self.options.source == CandidateSource::BoundaryThenVisible;
        // A quarter is kept free for the outline: the boundary may lie on one side only.
        let room = if fill {
            self.options.max_candidates - self.options.max_candidates / 4
        } else {
            self.options.max_candidates
        };
        let mut accepted = self.keep_free(&reachable, room, &[], &mut rejected);
        if fill {
            // Why a vertex that is not on the boundary was passed over interests nobody.
            let mut ignored = Vec::new();
            let outline = self.examine(self.visible_outline(), &mut ignored);
            let more = self.keep_free(
                &outline,
                self.options.max_candidates - accepted.len(),
                &accepted,
                &mut ignored,
            );
            accepted.extend(more);
        }
        Candidates::sorted(accepted, rejected)
    }

    /// Visible vertices in the outer quarter of the footprint, not on the boundary.
    fn visible_outline(&self) -> impl Iterator<Item = u32> + '_ {
        let half = self.outline.half_extents;
        let outer = move |p: &Point3<f64>| {
            let q = self.outline.local(p);
            q.x.abs() >= 0.75 * half.x || q.y.abs() >= 0.75 * half.y
        };
        let wanted = move |v: usize| {
            !self.model.boundary[v] && self.model.visible[v] && outer(&self.model.points[v])
        };
        (0..self.model.points.len())
            .filter(move |&v| wanted(v))
            .map(|v| v as u32)
    }

    fn examine(
        &self,
        vertices: impl Iterator<Item = u32>,
        rejected: &mut Vec<(u32, Reason)>,
    ) -> Vec<Candidate> {
        let mut reachable = Vec::new();
        for v in vertices {
            match self.look_at(v) {
                Ok(candidate) => reachable.push(candidate),
                Err(reason) => rejected.push((v, reason)),
            }
        }
        reachable
    }

    /// Everything but the way of the tool, which is the costly part.
    fn look_at(&self, vertex: u32) -> Result<Candidate, Reason> {
        let v = vertex as usize;
        if !self.model.visible[v] {
            return Err(Reason::Hidden);
        }
        let table = &self.scene.table;
        let point = self.model.points[v];
        let normal = self.model.normals[v];
        let elevation = normal.dot(&table.normal).clamp(-1.0, 1.0).asin();
        if elevation < -self.options.max_dip {
            return Err(Reason::FacesTable { dip: -elevation });
        }
        let approach = self.approach(&normal, elevation);
        let tip = self.tip(point + approach.as_ref() * self.options.grip_depth)?;
        let roll = self.roll(v, &approach, &tip);
        let arms = self.reached_by(&pose(tip, &approach, &roll));
        if arms.is_empty() {
            return Err(Reason::OutOfReach);
        }
        Ok(Candidate {
            vertex,
            point,
            approach,
            roll,
            tip,
            arms,
            boundary: self.model.boundary[v],
        })
    }

    /// Against the normal, tilted up to the least elevation.
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

    /// A tip that is a little too low is raised: the jaws are wide enough to hold the vertex all the same.
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

    /// Along the boundary; along the table when there is no boundary or a jaw would meet the table.
    fn roll(&self, v: usize, approach: &UnitVector3<f64>, tip: &Point3<f64>) -> UnitVector3<f64> {
        let free = |d: &UnitVector3<f64>| {
            let drop = self.scene.table.normal.dot(d).abs() * self.scene.jaw_radius;
            self.scene.table.height(tip) - drop >= 0.0
        };
        let level = || {
            let across = self.scene.table.normal.cross(approach);
            // A tool that stands upright may have any roll: along the longer side of the box.
            UnitVector3::try_new(across, 1e-6).unwrap_or(self.outline.axes[0])
        };
        let tangent = self
            .tangent(v)
            .and_then(|t| UnitVector3::try_new(t - approach.as_ref() * approach.dot(&t), 1e-3));
        let roll = tangent.filter(free).unwrap_or_else(level);
        let roll =
            UnitVector3::new_normalize(roll.into_inner() - approach.as_ref() * approach.dot(&roll));
        // Both signs are the same grip; one is chosen so that the answer does not depend on an eigenvector's sign.
        let side = self.scene.table.normal.cross(approach);
        if roll.dot(&side) < 0.0 { -roll } else { roll }
    }

    /// Direction of the boundary at `v`: the principal direction of the edges to boundary neighbours.
    fn tangent(&self, v: usize) -> Option<Vector3<f64>> {
        let rim = self
            .near
            .of(v)
            .iter()
            .filter(|&&w| self.model.boundary[w as usize] && self.model.boundary[v]);
        let scatter: Matrix3<f64> = rim
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

    fn reached_by(&self, grasp: &Isometry3<f64>) -> Vec<usize> {
        let approach = backed_off(grasp, self.options.approach_distance);
        let reaches =
            |a: &crate::Arm| a.workspace.contains(grasp) && a.workspace.contains(&approach);
        (0..self.scene.arms.len())
            .filter(|&a| reaches(&self.scene.arms[a]))
            .collect()
    }

    /// Takes candidates one by one, each as far as possible from those already taken (farthest point sampling),
    /// when the way of the tool is free. The rest is thinned out.
    fn keep_free(
        &self,
        from: &[Candidate],
        room: usize,
        taken: &[Candidate],
        rejected: &mut Vec<(u32, Reason)>,
    ) -> Vec<Candidate> {
        let nearest = |c: &Candidate| {
            taken
                .iter()
                .map(|t| (t.point - c.point).norm())
                .fold(f64::INFINITY, f64::min)
        };
        let mut gap: Vec<f64> = from.iter().map(nearest).collect();
        if taken.is_empty() {
            // Without anything taken the first is the one farthest from the middle of the box.
            gap.iter_mut()
                .zip(from)
                .for_each(|(g, c)| *g = 1e3 + (c.point - self.outline.center).norm());
        }
        let mut open = vec![true; from.len()];
        let mut kept: Vec<Candidate> = Vec::new();
        while kept.len() < room {
            let farther = |a: &usize, b: &usize| gap[*a].total_cmp(&gap[*b]).then(b.cmp(a));
            let Some(i) = (0..from.len()).filter(|&i| open[i]).max_by(farther) else {
                break;
            };
            open[i] = false;
            if let Some(by) = self.blocked_by(&from[i]) {
                rejected.push((from[i].vertex, Reason::Blocked { by }));
                continue;
            }
            for (g, c) in gap.iter_mut().zip(from) {
                *g = g.min((c.point - from[i].point).norm());
            }
            kept.push(from[i].clone());
        }
        rejected.extend(
            (0..from.len())
                .filter(|&i| open[i])
                .map(|i| (from[i].vertex, Reason::Thinned)),
        );
        kept
    }

    /// The first vertex within half a jaw of the tool behind its jaws.
    fn blocked_by(&self, candidate: &Candidate) -> Option<u32> {
        let back = -candidate.approach.into_inner();
        // The jaws themselves straddle the surface; only what is behind them can be in the way.
        let from = 2.0 * self.scene.jaw_radius + self.options.grip_depth;
        let length = self.options.shaft_length - from;
        if length <= 0.0 {
            return None;
        }
        let start = candidate.tip + back * from;
        let limit = (0.5 * self.scene.jaw_radius).powi(2);
        let hit = |p: &Point3<f64>| {
            let d = p - start;
            (d - back * back.dot(&d).clamp(0.0, length)).norm_squared() < limit
        };
        self.model.points.iter().position(hit).map(|v| v as u32)
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
