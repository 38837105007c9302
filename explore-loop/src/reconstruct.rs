//! One frame of reconstruction: register, filter, merge, close loops (METHOD §7).
//!
//! ```text
//! visible model ──register──► measured vertices ──filter──► all vertices ──merge──► longer model
//! ```
//! The visible part of the live model is registered onto the new cloud, with the grips as landmarks; the filter
//! fuses what was measured with the shape at rest and moves the hidden rest; points that no vertex accounts for are
//! carried to the rest frame and extend the model; where the front meets known surface, the mismatch is spread.

use crate::Error;
use crate::canonical::merge::FrameCloud;
use crate::canonical::{CanonicalModel, NewVertex, closure, cut, graph};
use crate::cell::{ArmState, Observation, Plane};
use crate::evidence::Evidence;
use crate::stages::{
    FieldGrow, FilterTrack, Grow, Landmark, Measured, NonrigidRegister, Register, RegisterInput,
    Track,
};
use crate::visibility::{DepthGrid, Sight, facing};
use nalgebra::{Isometry3, Matrix3, Point3, UnitVector3, Vector3};
use std::time::Instant;

/// Settings of the reconstruction; the defaults follow from the spacing.
#[derive(Debug, Clone, PartialEq)]
pub struct ReconstructOptions {
    /// Spacing ε of the model, metres.
    pub spacing: f64,
    /// Vertices within this distance of a tip when its jaw closes move with it, metres.
    pub grip_radius: f64,
    /// Standard deviation of a registered vertex with full confidence, metres.
    pub sigma: f64,
    /// Standard deviation of a gripped vertex, metres.
    pub grip_sigma: f64,
    /// Standard deviation of where a vertex is drawn that the camera should see but does not, metres.
    pub hidden_sigma: f64,
    /// Least cosine between normal and camera for a vertex to be matched.
    pub min_facing: f64,
    /// Whether loops are closed.
    pub closure: bool,
}

impl ReconstructOptions {
    /// Defaults at a spacing.
    pub fn new(spacing: f64) -> Self {
        Self {
            spacing,
            grip_radius: 0.012,
            sigma: 0.001,
            grip_sigma: 0.0003,
            hidden_sigma: 0.001,
            min_facing: 0.12,
            closure: true,
        }
    }
}

/// What happened in a frame.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct FrameReport {
    /// Number of the frame, from 0.
    pub frame: u32,
    /// Vertices measured in it.
    pub measured: Vec<bool>,
    /// Vertices added.
    pub added: usize,
    /// Pairs of vertices joined by a loop closure.
    pub closed: usize,
    /// Edges cut because they glued places that only touched.
    pub cut: usize,
    /// Registration residual, metres.
    pub residual: f64,
    /// Registration overlap.
    pub overlap: f64,
    /// Why the registration was not used, if so.
    pub failure: Option<String>,
    /// Registration time, ms.
    pub registration_ms: f64,
    /// Time of the whole frame, ms.
    pub frame_ms: f64,
}

/// Builds the canonical model frame by frame.
pub struct Reconstructor {
    /// The model so far.
    pub model: CanonicalModel,
    options: ReconstructOptions,
    register: Box<dyn Register>,
    track: Box<dyn Track>,
    grow: Box<dyn Grow>,
    frame: u32,
    /// What the last frame moved each vertex by: the guess for the next.
    velocity: Vec<Vector3<f64>>,
    grips: Vec<Option<Grip>>,
    /// Frames in a row in which the object rested.
    still: usize,
}

/// Frames of rest before the model is consolidated.
const STILL: usize = 5;

/// An arm that holds the object.
struct Grip {
    camera_from_tip: Isometry3<f64>,
    /// Stable ids of the vertices it holds and their places in the tip frame.
    held: Vec<(u64, Point3<f64>)>,
}

/// The cloud of a frame, thinned and with normals.
struct Prepared {
    points: Vec<Point3<f64>>,
    normals: Vec<UnitVector3<f64>>,
    depth: Option<DepthGrid>,
}

impl Reconstructor {
    /// With our stages.
    ///
    /// # Errors
    /// A spacing that is not positive and finite.
    pub fn new(options: ReconstructOptions) -> Result<Self, Error> {
        let spacing = options.spacing;
        if !(spacing.is_finite() && spacing > 0.0) {
            return Err(Error::BadSpacing { spacing });
        }
        let register = Box::new(NonrigidRegister::new(spacing)?);
        let track = Box::new(FilterTrack::default());
        Ok(Self::with_stages(
            options,
            register,
            track,
            Box::new(FieldGrow::new(spacing)),
        ))
    }

    /// With a user's stages.
    pub fn with_stages(
        options: ReconstructOptions,
        register: Box<dyn Register>,
        track: Box<dyn Track>,
        grow: Box<dyn Grow>,
    ) -> Self {
        Self {
            model: CanonicalModel::default(),
            options,
            register,
            track,
            grow,
            frame: 0,
            velocity: Vec::new(),
            grips: Vec::new(),
            still: 0,
        }
    }

    /// Takes one frame.
    ///
    /// # Errors
    /// A stage refuses its input; the model is then as before the frame.
    pub fn process(
        &mut self,
        observation: &Observation,
        table: &Plane,
    ) -> Result<FrameReport, Error> {
        let start = Instant::now();
        let cloud = self.prepare(observation)?;
        let mut report = FrameReport {
            frame: self.frame,
            ..FrameReport::default()
        };
        if self.model.is_empty() {
            self.begin(&cloud)?;
            report.added = self.model.len();
            report.measured = vec![true; self.model.len()];
        } else if cloud.points.len() < 20 {
            report.failure = Some(format!(
                "only {} points of the object in view",
                cloud.points.len()
            ));
            report.measured = vec![false; self.model.len()];
        } else {
            self.follow(observation, &cloud, table, &mut report)?;
        }
        self.take_grips(&observation.arms);
        self.frame += 1;
        report.frame_ms = start.elapsed().as_secs_f64() * 1e3;
        Ok(report)
    }

    /// Vertices that the camera can see now, judged by the model alone (for planning).
    pub fn visible_now(&self, observation: &Observation) -> Vec<bool> {
        let spacing = self.options.spacing;
        let grid = DepthGrid::new(&observation.points, 0.6 * spacing);
        (0..self.model.len())
            .map(|i| {
                let seen = grid
                    .as_ref()
                    .map(|g| g.sight(&self.model.live[i], 2.0 * spacing, 2.0 * spacing));
                facing(&self.model.live[i], &self.model.live_normal(i)) > 0.1
                    && matches!(seen, Some(Sight::Supported { .. }))
            })
            .collect()
    }

    fn prepare(&self, observation: &Observation) -> Result<Prepared, Error> {
        let spacing = self.options.spacing;
        let points: Vec<Point3<f64>> = observation
            .points
            .iter()
            .filter(|p| p.coords.iter().all(|x| x.is_finite()))
            .copied()
            .collect();
        if points.len() < 20 {
            return Ok(Prepared {
                points: Vec::new(),
                normals: Vec::new(),
                depth: None,
            });
        }
        let depth = DepthGrid::new(&points, 0.6 * spacing);
        let normals = nonrigid_reg::estimate_normals(&points, 16, &Point3::origin())?;
        let thin = nonrigid_reg::voxel_downsample(&points, &normals, 0.5 * spacing)?;
        Ok(Prepared {
            points: thin.points,
            normals: thin.normals,
            depth,
        })
    }

    /// The first frame: rest is where things are now.
    fn begin(&mut self, cloud: &Prepared) -> Result<(), Error> {
        let apart = 0.85 * self.options.spacing;
        let mut taken: Vec<Point3<f64>> = Vec::new();
        for (point, normal) in cloud.points.iter().zip(&cloud.normals) {
            // Poisson-disc thinning keeps the spacing even where the voxel grid does not.
            if facing(point, normal) < 0.2 || taken.iter().any(|t| (t - point).norm() < apart) {
                continue;
            }
            taken.push(*point);
            let vertex = NewVertex {
                rest: *point,
                rest_normal: *normal,
                live: *point,
                rotation: Matrix3::identity(),
            };
            self.model.push(vertex, 0);
        }
        self.model.edges = graph::surface_edges(&self.model, self.options.spacing);
        self.velocity = vec![Vector3::zeros(); self.model.len()];
        self.track
            .rebuild(&self.model, &vec![None; self.model.len()])
    }

    /// Every later frame.
    fn follow(
        &mut self,
        observation: &Observation,
        cloud: &Prepared,
        table: &Plane,
        report: &mut FrameReport,
    ) -> Result<(), Error> {
        let before = self.model.live.clone();
        let mut measured = self.measure(observation, cloud, report)?;
        let registered = measured.len();
        if report.failure.is_none() {
            let expected: Vec<Point3<f64>> = before
                .iter()
                .zip(&self.velocity)
                .map(|(p, v)| p + v)
                .collect();
            let evidence = Evidence {
                model: &self.model,
                expected: &expected,
                points: &cloud.points,
                normals: &cloud.normals,
                spacing: self.options.spacing,
            };
            let (sigma, hidden_sigma) = (self.options.sigma, self.options.hidden_sigma);
            evidence.reach_for_unexplained(&mut measured, sigma, self.options.grip_sigma);
            if let Some(depth) = &cloud.depth {
                evidence.keep_out_of_sight(depth, &observation.arms, &mut measured, hidden_sigma);
            }
        }
        self.track.step(&mut self.model, &measured, table)?;
        report.measured = self.confirm(&measured[..registered], cloud);
        self.velocity = self
            .model
            .live
            .iter()
            .zip(&before)
            .map(|(a, b)| a - b)
            .collect();
        for (i, seen) in report.measured.iter().enumerate() {
            if *seen {
                self.model.last_seen[i] = self.frame;
                self.model.times_seen[i] += 1;
            }
        }
        if report.failure.is_none() {
            self.extend(cloud, report)?;
            self.cut(report)?;
            self.consolidate(&before, report)?;
            if self.options.closure && self.frame.is_multiple_of(4) {
                self.close(report)?;
            }
        }
        Ok(())
    }

    /// Registers the visible part and returns what it measured, the grips included.
    fn measure(
        &mut self,
        observation: &Observation,
        cloud: &Prepared,
        report: &mut FrameReport,
    ) -> Result<Vec<Measured>, Error> {
        let source = self.visible_source(cloud);
        let (landmarks, held) = self.landmarks(&observation.arms);
        let points: Vec<Point3<f64>> = source.iter().map(|&i| self.model.live[i]).collect();
        let normals: Vec<UnitVector3<f64>> =
            source.iter().map(|&i| self.model.live_normal(i)).collect();
        let initial: Vec<Vector3<f64>> = source.iter().map(|&i| self.velocity[i]).collect();
        let mut measured = held;
        if source.len() < 12 {
            report.failure = Some(format!(
                "only {} vertices of the model in view",
                source.len()
            ));
            return Ok(measured);
        }
        let started = Instant::now();
        let output = self.register.register(&RegisterInput {
            source: &points,
            source_normals: &normals,
            target: &cloud.points,
            target_normals: &cloud.normals,
            landmarks: &landmarks,
            initial: &initial,
        })?;
        report.registration_ms = started.elapsed().as_secs_f64() * 1e3;
        report.residual = output.residual;
        report.overlap = output.overlap;
        report.failure = output.failure;
        if report.failure.is_none() {
            let gripped: std::collections::BTreeSet<u32> =
                measured.iter().map(|m| m.vertex).collect();
            for (k, &i) in source.iter().enumerate() {
                let trust = output.confidence[k];
                if trust > 0.2 && !gripped.contains(&(i as u32)) {
                    let position = points[k] + output.displacements[k];
                    measured.push(Measured {
                        vertex: i as u32,
                        position,
                        sigma: self.options.sigma / trust.sqrt(),
                    });
                }
            }
        }
        Ok(measured)
    }

    /// Vertices that face the camera and that the cloud does not hide.
    fn visible_source(&self, cloud: &Prepared) -> Vec<usize> {
        let tolerance = 3.0 * self.options.spacing;
        let Some(grid) = &cloud.depth else {
            return Vec::new();
        };
        (0..self.model.len())
            .filter(|&i| {
                facing(&self.model.live[i], &self.model.live_normal(i)) > self.options.min_facing
            })
            .filter(|&i| {
                let expected = self.model.live[i] + self.velocity[i];
                !matches!(
                    grid.sight(&expected, f64::INFINITY, tolerance),
                    Sight::Occluded | Sight::NoData
                )
            })
            .collect()
    }

    /// Known motions of what the arms hold: as landmarks for registration and as measurements for the filter.
    fn landmarks(&self, arms: &[ArmState]) -> (Vec<Landmark>, Vec<Measured>) {
        let index: std::collections::BTreeMap<u64, usize> = self
            .model
            .ids
            .iter()
            .enumerate()
            .map(|(i, id)| (*id, i))
            .collect();
        let mut landmarks = Vec::new();
        let mut held = Vec::new();
        for (arm, grip) in arms.iter().zip(&self.grips) {
            let Some(grip) = grip.as_ref().filter(|_| arm.holding) else {
                continue;
            };
            let moved = arm.camera_from_tip * grip.camera_from_tip.inverse();
            let tip = Point3::from(grip.camera_from_tip.translation.vector);
            landmarks.push(Landmark {
                source: tip,
                target: moved * tip,
                sigma: 0.0,
            });
            for (id, place) in &grip.held {
                let Some(&i) = index.get(id) else { continue };
                let position = arm.camera_from_tip * place;
                landmarks.push(Landmark {
                    source: self.model.live[i],
                    target: position,
                    sigma: 0.0,
                });
                held.push(Measured {
                    vertex: i as u32,
                    position,
                    sigma: self.options.grip_sigma,
                });
            }
        }
        (landmarks, held)
    }

    /// Of what registration measured, the vertices that the cloud indeed supports after filtering.
    fn confirm(&self, measured: &[Measured], cloud: &Prepared) -> Vec<bool> {
        let mut confirmed = vec![false; self.model.len()];
        let Some(tree) = graph::tree(&cloud.points) else {
            return confirmed;
        };
        for m in measured {
            let i = m.vertex as usize;
            let (nearest, distance) = graph::nearest(&tree, &self.model.live[i]);
            let off_plane = cloud.normals[nearest]
                .dot(&(self.model.live[i] - cloud.points[nearest]))
                .abs();
            confirmed[i] =
                distance < 1.2 * self.options.spacing && off_plane < 0.6 * self.options.spacing;
        }
        confirmed
    }

    fn extend(&mut self, cloud: &Prepared, report: &mut FrameReport) -> Result<(), Error> {
        let frame = FrameCloud {
            points: &cloud.points,
            normals: &cloud.normals,
        };
        let fresh = self.grow.grow(&self.model, frame, &report.measured)?;
        if fresh.is_empty() {
            return Ok(());
        }
        report.added = fresh.len();
        let old = self.model.len();
        for vertex in fresh {
            self.model.push(vertex, self.frame);
            report.measured.push(true);
        }
        let came_from: Vec<Option<u32>> = (0..self.model.len())
            .map(|i| (i < old).then_some(i as u32))
            .collect();
        self.velocity.resize(self.model.len(), Vector3::zeros());
        self.spread_velocity(old);
        self.regraph(&came_from)
    }

    /// New vertices move like their nearest older one.
    fn spread_velocity(&mut self, old: usize) {
        let Some(tree) = graph::tree(&self.model.live[..old]) else {
            return;
        };
        for i in old..self.model.len() {
            self.velocity[i] = self.velocity[graph::nearest(&tree, &self.model.live[i]).0];
        }
    }

    fn regraph(&mut self, came_from: &[Option<u32>]) -> Result<(), Error> {
        self.model.edges = graph::surface_edges(&self.model, self.options.spacing);
        self.track.rebuild(&self.model, came_from)
    }

    /// Cuts the edges that have opened (METHOD §6).
    fn cut(&mut self, report: &mut FrameReport) -> Result<(), Error> {
        let distorted = cut::distorted(&self.model, &report.measured, self.options.spacing);
        report.cut = self.model.cut(&distorted);
        if report.cut == 0 {
            return Ok(());
        }
        let keep: Vec<Option<u32>> = (0..self.model.len() as u32).map(Some).collect();
        self.regraph(&keep)
    }

    /// Once the object has come to rest after a motion, brings what was added on the way into place.
    fn consolidate(
        &mut self,
        before: &[Point3<f64>],
        report: &mut FrameReport,
    ) -> Result<(), Error> {
        let moved: Vec<f64> = before
            .iter()
            .zip(&self.model.live)
            .zip(&report.measured)
            .filter(|(_, seen)| **seen)
            .map(|((a, b), _)| (a - b).norm())
            .collect();
        let mean = moved.iter().sum::<f64>() / moved.len().max(1) as f64;
        self.still = if mean < 0.08 * self.options.spacing {
            self.still + 1
        } else {
            0
        };
        if self.still != STILL {
            return Ok(());
        }
        let anchored: Vec<bool> = self.model.born.iter().map(|b| *b == 0).collect();
        closure::refine(&mut self.model, &report.measured, &anchored)?;
        let keep: Vec<Option<u32>> = (0..self.model.len() as u32).map(Some).collect();
        self.regraph(&keep)
    }

    /// Where the front met known surface, spreads the mismatch and removes what lies twice.
    fn close(&mut self, report: &mut FrameReport) -> Result<(), Error> {
        let meetings = closure::meetings(&self.model, &report.measured, self.options.spacing);
        if meetings.len() < 6 {
            return Ok(());
        }
        let anchored: Vec<bool> = self.model.born.iter().map(|b| *b == 0).collect();
        closure::relax(&mut self.model, &meetings, &anchored)?;
        report.closed = meetings.len();
        let keep = self.without_doubles();
        let stays = self.model.retain(&keep);
        report.measured = stays.iter().map(|&i| report.measured[i as usize]).collect();
        self.velocity = stays.iter().map(|&i| self.velocity[i as usize]).collect();
        let came_from: Vec<Option<u32>> = stays.iter().map(|&i| Some(i)).collect();
        self.regraph(&came_from)
    }

    /// Marks all vertices but the newer of each pair that lies closer than half a spacing on one sheet.
    fn without_doubles(&self) -> Vec<bool> {
        let mut keep = vec![true; self.model.len()];
        let Some(tree) = graph::tree(&self.model.rest) else {
            return keep;
        };
        for i in 0..self.model.len() {
            for (j, _) in graph::near(&tree, &self.model.rest[i], 0.5 * self.options.spacing, 12) {
                let same_sheet = self.model.rest_normals[i].dot(&self.model.rest_normals[j]) > 0.3;
                let newer = (self.model.born[j], j) > (self.model.born[i], i);
                if newer && same_sheet && keep[i] {
                    keep[j] = false;
                }
            }
        }
        keep
    }

    /// Notes which arms hold what, for the next frame.
    fn take_grips(&mut self, arms: &[ArmState]) {
        self.grips.resize_with(arms.len(), || None);
        for (arm, grip) in arms.iter().zip(&mut self.grips) {
            if !arm.holding {
                *grip = None;
            } else if let Some(grip) = grip {
                grip.camera_from_tip = arm.camera_from_tip;
            } else {
                let tip = Point3::from(arm.camera_from_tip.translation.vector);
                let held = (0..self.model.len())
                    .filter(|&i| (self.model.live[i] - tip).norm() < self.options.grip_radius)
                    .map(|i| {
                        (
                            self.model.ids[i],
                            arm.camera_from_tip.inverse() * self.model.live[i],
                        )
                    })
                    .collect();
                *grip = Some(Grip {
                    camera_from_tip: arm.camera_from_tip,
                    held,
                });
            }
        }
    }
}
