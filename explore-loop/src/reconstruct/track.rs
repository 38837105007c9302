//! One hypothesis of the body, tracked frame by frame: the model, the elastic body that carries it, and what was observed.

use super::keyframe::Keyframes;
use super::landmark::{self, Landmarks};
use super::matching::{Gates, Look, Match};
use super::recognise::Recognised;
use super::view::FrameView;
use super::{Constraints, FrameParts, ReconstructOptions};
use crate::Error;
use crate::canonical::{CanonicalModel, NewVertex, graph};
use crate::cell::{ArmState, Plane};
use crate::visibility::{Sight, facing};
use nalgebra::{Point3, Rotation3, UnitVector3, Vector3};
use std::time::{Duration, Instant};
use topo_ekf::body::{
    AtRest, BodyFilter, BodyFrame, BodyInequality, BodyReport, Embedding, Lattice, Limits,
};

mod belief;
mod grips;
mod kept;
mod material;
mod opening;
mod own_contact;

use grips::Grip;
use material::filled;
pub(crate) use material::{Fill, embed_beside};
use own_contact::OwnContact;

/// A vertex is seen when its match is this close along the normal, metres, and this close across it, in spacings.
const SEEN: f64 = 0.0025;
const SEEN_ASIDE: f64 = 1.2;
/// Number of frames between two estimates of the weight while something is held.
const WEIGH_EVERY: u32 = 4;
/// Number of cells whose inverse map is tried for a point.
const CELLS_TRIED: usize = 24;

/// One hypothesis.
#[derive(serde::Serialize, serde::Deserialize)]
pub(crate) struct Track {
    pub model: CanonicalModel,
    pub body: BodyFilter,
    /// Coordinates of each vertex in the lattice.
    pub embeddings: Vec<Embedding>,
    pub keyframes: Keyframes,
    /// Landmarks recognised by colour; `None` where colours are not used.
    landmarks: Landmarks,
    /// Vertices measured in the last frame.
    pub seen: Vec<bool>,
    /// Mean distance along the normals of the matches, metres.
    pub residual: f64,
    /// Share of the vertices that face the camera and are seen.
    pub share: f64,
    /// Mean motion of the nodes in the last frame, metres.
    pub moved: f64,
    /// Number of consecutive frames without motion and without grips.
    pub still: usize,
    /// Outcome of the constraints in the last frame.
    pub constraints: Constraints,
    /// Force of the grips in the last frame, in weights of the body, while they hold it.
    pub grip_force: Option<Vector3<f64>>,
    /// Times of the parts of the last frame.
    #[serde(skip)]
    pub parts: FrameParts,
    /// Why the last frame was rejected, if it was.
    pub refused: Option<String>,
    /// Number of consecutive rejected frames.
    missed: usize,
    grips: Vec<Option<Grip>>,
    frame: u32,
    /// Innovation of every frame in which the body was held, metres.
    innovations: Vec<f64>,
    carried: f64,
    fill: Fill,
    own_contact: OwnContact,
    /// Number of vertices beyond the first view when the body was last filled.
    filled_with: usize,
    /// Loops at rest around the contacts at which the material is divided.
    pub walls: Vec<Vec<Point3<f64>>>,
}

impl Track {
    /// The first frame: the live positions are the rest positions.
    pub fn begin(
        view: &FrameView,
        table: &Plane,
        options: &ReconstructOptions,
        fill: Fill,
    ) -> Result<Self, Error> {
        let (lattice, feet) = filled(view, table, options, fill)?;
        let plane = topo_ekf::Plane {
            normal: table.normal,
            offset: table.offset,
        };
        let mut body = BodyFilter::new(lattice, plane, &options.body)?;
        body.set_feet(feet);
        let mut track = Self {
            model: CanonicalModel::default(),
            body,
            embeddings: Vec::new(),
            keyframes: Keyframes::default(),
            landmarks: Landmarks::default(),
            seen: Vec::new(),
            residual: 0.0,
            share: 1.0,
            moved: 0.0,
            still: 0,
            constraints: Constraints::default(),
            grip_force: None,
            parts: FrameParts::default(),
            refused: None,
            missed: 0,
            grips: Vec::new(),
            frame: 0,
            innovations: Vec::new(),
            carried: 0.0,
            fill,
            own_contact: OwnContact::default(),
            filled_with: 0,
            walls: Vec::new(),
        };
        // Poisson-disc thinning keeps the spacing even where the voxel grid does not.
        let apart = 0.85 * options.spacing;
        let mut taken: Vec<Point3<f64>> = Vec::new();
        for (point, normal) in view.points.iter().zip(&view.normals) {
            if facing(point, normal, &view.eye()) < 0.2
                || taken.iter().any(|t| (t - point).norm() < apart)
            {
                continue;
            }
            taken.push(*point);
            track.push(NewVertex::new(table.above(point), *normal));
        }
        track.model.join(options.spacing);
        track.seen = vec![true; track.model.len()];
        track.renew_contact(options.spacing);
        Ok(track)
    }

    /// Rejects a loaded state that is inconsistent.
    pub fn check_read(&self) -> Result<(), Error> {
        self.body.check_read()?;
        let (vertices, cells) = (self.model.len(), self.body.lattice().cells().len());
        let held = self.grips.iter().flatten().flatten().map(|(at, _)| at);
        let kept = self.keyframes.all().iter();
        let gripped = kept.flat_map(|k| k.grips.iter().map(|(at, _)| at));
        let mut places = self.embeddings.iter().chain(held).chain(gripped);
        let whole = self.embeddings.len() == vertices
            && self.seen.len() == vertices
            && self.own_contact.is_of(vertices)
            && places.all(|at| (at.cell as usize) < cells);
        if whole {
            Ok(())
        } else {
            Err(Error::Resume {
                reason: "the model and the body of the reconstruction do not fit together".into(),
            })
        }
    }

    /// Adds a vertex and its cell.
    pub fn push(&mut self, vertex: NewVertex) {
        let at = self.embed(&vertex.rest, &vertex.rest_normal);
        self.model.push(vertex, self.frame);
        self.embeddings.push(at);
        self.seen.push(true);
    }

    /// Registers the body to a frame and evaluates the fit; an implausible frame leaves everything unchanged.
    pub fn follow(
        &mut self,
        view: &FrameView,
        recognised: Option<&Recognised>,
        arms: &[ArmState],
        options: &ReconstructOptions,
    ) -> Result<(), Error> {
        let grips = self.grips_now(arms);
        let limits = self.limits_now(&options.limits);
        if let Some(why) = self.gone_too_far(view, &grips, &limits) {
            self.refuse(why);
            return Ok(());
        }
        let contacts = self.own_contacts(options.separation);
        self.recognise(recognised);
        let report = match self.step(&grips, &contacts, limits, view, options) {
            Err(error @ topo_ekf::Error::Beyond { .. }) => {
                self.refuse(format!("not believed: {error}"));
                return Ok(());
            }
            stepped => stepped?,
        };
        (self.refused, self.missed) = (None, 0);
        self.moved = report.moved;
        let felt = !grips.is_empty() && limits.pull.is_finite();
        self.grip_force = felt.then(|| self.body.grip_force_in_weights(&report));
        self.constraints = Constraints {
            active: report.pushing,
            near_itself: contacts.len(),
            infeasible: report.status == topo_ekf::Status::Infeasible,
            violation: report.violation[1],
            below_table: 0.0,
        };
        self.pose();
        self.judge(view, options);
        let rests = self.moved < options.rest_motion && grips.is_empty() && !self.body.is_falling();
        self.still = if rests { self.still + 1 } else { 0 };
        self.weigh(&grips);
        self.landmarks.judge(self.body.lattice(), self.body.pose());
        self.frame += 1;
        Ok(())
    }

    /// Recognises landmarks before the body is registered.
    fn recognise(&mut self, recognised: Option<&Recognised>) {
        let (lattice, pose) = (self.body.lattice(), self.body.pose());
        match recognised {
            Some(frame) => self.landmarks.recognise(frame, lattice, pose, self.frame),
            None => self.landmarks.lose(),
        }
    }

    /// Deforms the body until it fits the cloud and the landmarks, subject to grips, contacts and limits. While it is held, the prediction from
    /// these without the cloud is compared with the cloud first.
    fn step(
        &mut self,
        grips: &[(Embedding, Point3<f64>)],
        contacts: &[BodyInequality],
        limits: Limits,
        view: &FrameView,
        options: &ReconstructOptions,
    ) -> Result<BodyReport, topo_ekf::Error> {
        // A rejected frame is how a fall of a held body shows first.
        let frame = BodyFrame::new(grips, &self.embeddings)
            .with_inequalities(contacts)
            .with_limits(limits)
            .with_fell(self.missed > 0);
        let look = Look::new(&self.model, &self.embeddings, view, options);
        let met = landmark::embedded(&self.landmarks.sighted(), self.body.lattice());
        let mut innovation = None;
        let mut matching = Duration::ZERO;
        let report = self.body.step(
            &frame,
            &mut |lattice, pose, progress| {
                let gates = Gates::at(progress);
                let began = Instant::now();
                let mut rows = look.rows(lattice, pose, gates);
                matching += began.elapsed();
                rows.extend(landmark::rows(&met, lattice, pose, gates));
                rows
            },
            &mut |lattice, pose| {
                innovation = Some(mean_residual(&look.matches(
                    lattice,
                    pose,
                    Gates::PREDICTION,
                )));
            },
        )?;
        self.parts.matching = matching.as_secs_f64() * 1e3;
        if let Some(innovation) = innovation {
            self.innovations.push(innovation);
            self.carried += report.moved;
        }
        Ok(report)
    }

    /// Creates landmarks where the surface was measured in this frame.
    pub fn plant(&mut self, frame: &Recognised, spacing: f64) {
        let body = (self.body.lattice(), self.body.pose());
        let surface = (&self.model, &self.seen[..]);
        let number = self.frame;
        self.landmarks.plant(frame, body, surface, spacing, number);
    }

    /// Updates the estimate of the weight, in some of the frames that fit.
    fn weigh(&mut self, grips: &[(Embedding, Point3<f64>)]) {
        if self.frame.is_multiple_of(WEIGH_EVERY) && self.share > 0.6 && self.residual < 0.002 {
            let seen: Vec<(Embedding, UnitVector3<f64>)> = (0..self.model.len())
                .filter(|&i| self.seen[i])
                .map(|i| (self.embeddings[i], self.model.live_normal(i)))
                .collect();
            let frame = BodyFrame::new(grips, &self.embeddings);
            // If the weight cannot be estimated from it, the frame itself is still valid.
            let _unweighed = self.body.weigh(&frame, &seen);
        }
    }

    /// Live positions and rotations of the vertices from the body's pose.
    pub fn pose(&mut self) {
        let (lattice, pose) = (self.body.lattice(), self.body.pose());
        for (i, at) in self.embeddings.iter().enumerate() {
            self.model.live_mut()[i] = pose.position(lattice, at);
            let normal = pose.normal(lattice, at, &self.model.rest_normals()[i]);
            let turn = pose.turns[at.cell as usize];
            // The rotation that maps the rest normal to the live one and is otherwise that of the cell.
            let correction =
                Rotation3::rotation_between(&(turn * self.model.rest_normals()[i]), &normal)
                    .unwrap_or_else(Rotation3::identity);
            self.model.rotations_mut()[i] = *(correction * turn).matrix();
        }
    }

    /// Which vertices this frame measured, and how well it fits.
    fn judge(&mut self, view: &FrameView, options: &ReconstructOptions) {
        let (lattice, pose) = (self.body.lattice(), self.body.pose());
        let look = Look::new(&self.model, &self.embeddings, view, options);
        let found = look.matches(lattice, pose, Gates::JUDGE);
        let spacing = options.spacing;
        self.seen = vec![false; self.model.len()];
        for m in &found {
            self.seen[m.vertex] = m.residual.abs() < SEEN && m.aside < SEEN_ASIDE * spacing;
        }
        self.residual = mean_residual(&found);
        let eye = view.eye();
        let visible = (0..self.model.len()).filter(|&i| {
            let at = &self.model.live()[i];
            facing(at, &self.model.live_normal(i), &eye) > 0.3
                && !matches!(
                    view.depth.sight(at, f64::INFINITY, 3.0 * spacing),
                    Sight::Occluded
                )
        });
        let count = self.seen.iter().filter(|s| **s).count();
        self.share = count as f64 / visible.count().max(1) as f64;
        self.model.measured(&self.seen, self.frame);
    }

    /// Whether the frame fits well enough to update the model.
    pub fn fits(&self) -> bool {
        self.residual < 0.0012 && self.share > 0.75
    }

    /// Number of frames in which the body was held, so that it was predicted by grips, table and weight alone.
    pub fn held_frames(&self) -> usize {
        self.innovations.len()
    }

    /// Mean innovation over the second half of the held frames, metres.
    pub fn mean_innovation(&self) -> f64 {
        let late = &self.innovations[self.innovations.len() / 2..];
        late.iter().sum::<f64>() / late.len().max(1) as f64
    }

    /// How far the body was moved while held, metres.
    pub fn carried(&self) -> f64 {
        self.carried
    }

    /// Number of the next frame.
    pub fn frame(&self) -> u32 {
        self.frame
    }

    /// Search tree over the centres of the cells now.
    pub fn cell_tree(&self) -> Option<graph::Tree> {
        cell_tree(self.body.lattice(), &self.body.pose().live)
    }

    /// Carries a live point to rest.
    pub fn to_rest(&self, point: &Point3<f64>, cells: Option<&graph::Tree>) -> Option<AtRest> {
        to_rest(self.body.lattice(), self.body.pose(), point, cells)
    }

    /// Moves the body as little as necessary to bring its surface, some of which is new, above the table.
    pub fn lift_out(&mut self) {
        let frame = BodyFrame::new(&[], &self.embeddings);
        // If the projection fails the body is unchanged, and the next frame lifts it or fails.
        if self.body.project(&frame).is_ok() {
            self.pose();
        }
    }

    /// Gives the vertices identities that `other` has never used, except for those of the first frame, which are the same; and takes the colours
    /// that `other` has gathered at rest.
    pub fn renamed_after(&mut self, other: &Self) {
        self.model.rename_after(&other.model);
        self.model.take_colours_of(&other.model);
    }

    /// Keeps the marked vertices.
    pub fn retain(&mut self, keep: &[bool]) {
        let stays = self.model.retain(keep);
        self.embeddings = stays.iter().map(|&i| self.embeddings[i as usize]).collect();
        self.seen = stays.iter().map(|&i| self.seen[i as usize]).collect();
    }

    /// Recomputes the surface graph of the present vertices.
    pub fn settle_edges(&mut self, spacing: f64) {
        self.model.join(spacing);
    }
}

/// Search tree over the centres of all cells in a pose.
pub(crate) fn cell_tree(lattice: &Lattice, live: &[Point3<f64>]) -> Option<graph::Tree> {
    let centres: Vec<Point3<f64>> = (0..lattice.cells().len() as u32)
        .map(|c| lattice.centre(live, c))
        .collect();
    graph::tree(&centres)
}

/// Maps a live point to rest through the nearest cells that are stiff enough.
pub(crate) fn to_rest(
    lattice: &Lattice,
    pose: &topo_ekf::body::Pose,
    point: &Point3<f64>,
    cells: Option<&graph::Tree>,
) -> Option<AtRest> {
    let near = graph::near(cells?, point, 3.0 * lattice.size(), CELLS_TRIED);
    let firm = near
        .into_iter()
        .map(|(c, _)| c as u32)
        .filter(|&c| lattice.mass(c) >= 0.02);
    pose.inverse(lattice, point, firm)
}

fn mean_residual(found: &[Match]) -> f64 {
    let sum: f64 = found.iter().map(|m| m.residual.abs()).sum();
    sum / found.len().max(1) as f64
}
