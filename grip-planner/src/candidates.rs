//! Grip candidates: which vertices an arm could grip, and why the others cannot be gripped.
//!
//! A vertex on the boundary of the explored part (or, to fill up, on the visible outline) is a candidate when
//! 1. the camera sees it and the surface does not face the table;
//! 2. a tool can reach it with its tip above the table (module `orientation`);
//! 3. an arm reaches the approach, grasp and retreat poses;
//! 4. the open jaws fit around it: the surface beside it is not in the way;
//! 5. the body does not obstruct the tool at these poses;
//! 6. it is as far as possible from those already selected, while there is room.
//!
//! Every vertex that was tested and failed is returned with its [`Reason`].

use nalgebra::{Isometry3, Point3, UnitVector3};

use crate::body::{Body, Tool};
use crate::options::CandidateSource;
use crate::orientation::{Grasp, Orientation, backed_off, pose, retreat};
use crate::{Error, Model, Options, Reason, Scene, Waypoint};

/// A vertex that can be gripped.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Candidate {
    /// The vertex.
    pub vertex: u32,
    /// Its position.
    pub point: Point3<f64>,
    /// Approach direction: tip +z.
    pub approach: UnitVector3<f64>,
    /// Direction in which the jaws open: tip ±y.
    pub roll: UnitVector3<f64>,
    /// Position of the tip: slightly beyond the vertex, never nearer to the table than the clearance.
    pub tip: Point3<f64>,
    /// The arms that reach the approach, the grasp and the retreat.
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

/// The vertices that can be gripped, and why the others cannot.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Candidates {
    /// Accepted, in vertex order.
    pub accepted: Vec<Candidate>,
    /// Every other vertex that was tested, with its reason, in vertex order.
    pub rejected: Vec<(u32, Reason)>,
}

/// Grip candidates of `model`.
///
/// # Errors
/// An invalid model, scene or setting.
///
/// # Complexity
/// `O(n log n)` for the obstacle, `O(log n)` for each candidate where the body is not near its tool.
pub fn candidates(model: &Model, scene: &Scene, options: &Options) -> Result<Candidates, Error> {
    Ok(Search::new(model, scene, options)?.run())
}

/// The same tests on given vertices, whether they are on the boundary or not; none is thinned out while
/// there is room.
///
/// # Errors
/// An invalid model, scene, setting or vertex.
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
    orientation: Orientation<'a>,
    body: Body,
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
        Ok(Self {
            model,
            scene,
            options,
            orientation: Orientation::new(model, scene, options)?,
            body: Body::new(model.points, scene.tool_radius()),
        })
    }

    fn run(&self) -> Candidates {
        let mut rejected = Vec::new();
        let boundary =
            (0..self.model.points.len() as u32).filter(|&v| self.model.boundary[v as usize]);
        let reachable = self.examine(boundary, &mut rejected);
        let fill = self.options.source == CandidateSource::BoundaryThenVisible;
        // A quarter is reserved for the outline: the boundary may be on one side only.
        let room = if fill {
            self.options.max_candidates - self.options.max_candidates / 4
        } else {
            self.options.max_candidates
        };
        let mut accepted = self.keep_free(&reachable, room, &[], &mut rejected);
        if fill {
            let outline = self.examine(self.visible_outline(), &mut rejected);
            let more = self.keep_free(
                &outline,
                self.options.max_candidates - accepted.len(),
                &accepted,
                &mut rejected,
            );
            accepted.extend(more);
        }
        Candidates::sorted(accepted, rejected)
    }

    /// Visible vertices in the outer quarter of the footprint, not on the boundary.
    fn visible_outline(&self) -> impl Iterator<Item = u32> + '_ {
        let half = self.orientation.outline.half_extents;
        let outer = move |p: &Point3<f64>| {
            let q = self.orientation.outline.local(p);
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

    /// All tests except that of obstruction, which is the expensive one.
    fn look_at(&self, vertex: u32) -> Result<Candidate, Reason> {
        let v = vertex as usize;
        if !self.model.visible[v] {
            return Err(Reason::Hidden);
        }
        let Grasp {
            tip,
            approach,
            roll,
        } = self.orientation.at(v)?;
        let arms = self.reached_by(&pose(tip, &approach, &roll))?;
        Ok(Candidate {
            vertex,
            point: self.model.points[v],
            approach,
            roll,
            tip,
            arms,
            boundary: self.model.boundary[v],
        })
    }

    /// The poses of a grip, in order.
    fn waypoints(&self, grasp: &Isometry3<f64>) -> [(Waypoint, Isometry3<f64>); 3] {
        let distance = self.options.approach_distance;
        [
            (Waypoint::Approach, backed_off(grasp, distance)),
            (Waypoint::Grasp, *grasp),
            (Waypoint::Retreat, retreat(grasp, self.scene, distance)),
        ]
    }

    /// The arms that reach all poses of the grip, or the pose that the nearest arm does not reach.
    fn reached_by(&self, grasp: &Isometry3<f64>) -> Result<Vec<usize>, Reason> {
        let poses = self.waypoints(grasp);
        let missed = |arm: usize| {
            let workspace = &self.scene.arms[arm].workspace;
            poses.iter().find(|(_, pose)| !workspace.contains(pose))
        };
        let arms = 0..self.scene.arms.len();
        let reaching: Vec<usize> = arms.clone().filter(|&a| missed(a).is_none()).collect();
        if !reaching.is_empty() {
            return Ok(reaching);
        }
        let way = |arm: &usize| {
            (self.scene.arms[*arm].base.coords - grasp.translation.vector).norm_squared()
        };
        let nearest = arms.min_by(|a, b| way(a).total_cmp(&way(b))).unwrap_or(0);
        let at = (!self.scene.arms.is_empty())
            .then(|| missed(nearest))
            .flatten();
        Err(Reason::OutOfReach {
            arm: nearest,
            at: at.map_or(Waypoint::Grasp, |(at, _)| *at),
        })
    }

    /// Selects candidates one by one, each as far as possible from those already selected (farthest point sampling),
    /// if the tool is not obstructed. The others are thinned out.
    fn keep_free(
        &self,
        from: &[Candidate],
        room: usize,
        taken: &[Candidate],
        rejected: &mut Vec<(u32, Reason)>,
    ) -> Vec<Candidate> {
        // If none is selected yet, the first is the one farthest from the centre of the box.
        let middle = |c: &Candidate| 1e3 + (c.point - self.orientation.outline.center).norm();
        let mut gap: Vec<(f64, u32)> = from.iter().map(|c| (middle(c), c.vertex)).collect();
        let near = |gap: &mut [(f64, u32)], kept: &Candidate| {
            for (g, c) in gap.iter_mut().zip(from) {
                let d = (c.point - kept.point).norm();
                if d < g.0 {
                    *g = (d, kept.vertex);
                }
            }
        };
        for kept in taken {
            near(&mut gap, kept);
        }
        let mut open = vec![true; from.len()];
        let mut kept: Vec<Candidate> = Vec::new();
        while kept.len() < room {
            let farther = |a: &usize, b: &usize| gap[*a].0.total_cmp(&gap[*b].0).then(b.cmp(a));
            let Some(i) = (0..from.len()).filter(|&i| open[i]).max_by(farther) else {
                break;
            };
            open[i] = false;
            if let Err(reason) = self.check_way(&from[i]) {
                rejected.push((from[i].vertex, reason));
                continue;
            }
            near(&mut gap, &from[i]);
            kept.push(from[i].clone());
        }
        rejected.extend((0..from.len()).filter(|&i| open[i]).map(|i| {
            let (distance, near) = gap[i];
            (from[i].vertex, Reason::Thinned { near, distance })
        }));
        kept
    }

    /// Tests the space for the jaws and for the tool behind them.
    fn check_way(&self, candidate: &Candidate) -> Result<(), Reason> {
        let grasp = candidate.camera_from_tip();
        let (jaw, depth) = (self.scene.jaw_radius, self.options.grip_depth);
        for side in [-jaw, jaw] {
            // Tissue may bulge between the fingers by half the opening.
            let finger = [1.0, 2.0].map(|k| grasp * Point3::new(0.0, side, -depth - k * jaw));
            if let Some((by, _)) = self.body.hit(finger) {
                return Err(Reason::TooWide { by });
            }
        }
        for (at, pose) in self.waypoints(&grasp) {
            // The wrist link differs between arms and is tested when the path is planned.
            let tool = Tool::new(&pose, &candidate.tip, self.scene.shaft_length);
            let jaws = self.scene.jaw_length();
            if let Some((by, _)) = tool.shaft(jaws).and_then(|s| self.body.hit(s)) {
                return Err(Reason::Blocked { by, at });
            }
        }
        Ok(())
    }
}
