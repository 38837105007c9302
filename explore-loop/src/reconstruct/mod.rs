//! The canonical model from a stream of frames.
//!
//! ```text
//! cloud ─► view ─► registration of the body ─► evaluation ─► growth at rest ─► keyframes ─► whenever at rest: re-fusion
//! ```
//! The object is an elastic body on a table. In every frame it is deformed, always from its rest shape, until it fits the cloud; points of
//! the cloud beyond the known surface are moved back to rest and extend it; whenever the object has come to rest, and before it is
//! gripped again, the rest shape is fused anew from all keyframes.
//!
//! | file | question |
//! |---|---|
//! | `options` | what can be set, and what left out? |
//! | `view` | what does the frame show? |
//! | `matching` | which point does each vertex match? |
//! | `fill` | where is material assumed? |
//! | `pieces` | which parts are connected within a cell? |
//! | `recognise` | which colour features were in the frame before? |
//! | `landmark` | which points of the material are they? |
//! | `track` | what is the body's pose? |
//! | `hollow` | is it solid or hollow? |
//! | `grow` | which points extend it, and where are they at rest? |
//! | `keyframe` | which frames are kept? |
//! | `locate` | where is a lost body? |
//! | `relocate` | how does a lost body continue after it was found again? |
//! | `fuse` | what rest shape do all of them give? |
//! | `uncertainty` | how accurately is each position known? |
//! | `report` | what happened in the frame? |
//! | `stage` | what does the loop require of any reconstruction? |

use crate::Error;
use crate::canonical::CanonicalModel;
use crate::cell::{ArmState, Observation, Plane};
use crate::visibility::{DepthGrid, visible};
use hollow::Evidence;
pub use options::{ColourFeatures, Material, ReconstructOptions};
use recognise::{Before, Recognised};
pub use report::{Constraints, FrameParts, FrameReport};
pub use stage::{Reconstruct, RestSurface};
use std::sync::Arc;
use std::time::{Duration, Instant};
use track::{Fill, Track};
use view::FrameView;

mod fill;
mod fuse;
mod grow;
mod hollow;
mod keyframe;
mod landmark;
pub mod locate;
mod matching;
mod options;
mod pieces;
mod recognise;
mod relocate;
mod report;
mod stage;
mod track;
mod uncertainty;
mod view;

/// Number of frames at rest after which the shape is fused.
const STILL: usize = 3;
/// Residual above which the body counts as lost in this frame, metres, and the least share of it that must be seen.
const LOST: f64 = 0.004;
const LOST_SHARE: f64 = 0.3;

/// Builds the canonical model frame by frame.
#[derive(serde::Serialize, serde::Deserialize)]
pub struct Reconstructor {
    options: ReconstructOptions,
    empty: CanonicalModel,
    track: Option<Track>,
    /// The same frames tracked as a hollow body, until one of the two has predicted them better.
    rival: Option<Track>,
    first: Option<DepthGrid>,
    /// The last frame, if it had colour features.
    before: Option<Before>,
    frame: u32,
    /// Whether the body was held since the last fusion.
    handled: bool,
    /// Whether the shape was ever fused.
    fused: bool,
    free: bool,
}

impl std::fmt::Debug for Reconstructor {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Reconstructor")
            .field("options", &self.options)
            .field("frame", &self.frame)
            .field("vertices", &self.model().len())
            .finish_non_exhaustive()
    }
}

impl Reconstructor {
    /// An empty model.
    ///
    /// # Errors
    /// A spacing that is not positive and finite.
    pub fn new(options: ReconstructOptions) -> Result<Self, Error> {
        let spacing = options.spacing;
        if !(spacing.is_finite() && spacing > 0.0) {
            return Err(Error::BadSpacing { spacing });
        }
        Ok(Self {
            options,
            empty: CanonicalModel::default(),
            track: None,
            rival: None,
            first: None,
            before: None,
            frame: 0,
            handled: false,
            fused: false,
            free: true,
        })
    }

    /// The model so far.
    pub fn model(&self) -> &CanonicalModel {
        self.track.as_ref().map_or(&self.empty, |t| &t.model)
    }

    /// Weight over stiffness `ρ g / E` of the object, 1/m, and its standard deviation, once something was tracked.
    pub fn weight_over_stiffness(&self) -> Option<(f64, f64)> {
        let body = &self.track.as_ref()?.body;
        Some((
            body.weight_over_stiffness(),
            body.weight_over_stiffness_sigma(),
        ))
    }

    /// Stiffness over weight `E / (ρ g)` of the object, m, estimated from its sag; `None` before it was lifted.
    pub fn stiffness_over_weight(&self) -> Option<f64> {
        let body = &self.track.as_ref().filter(|t| t.held_frames() > 0)?.body;
        Some(1.0 / body.weight_over_stiffness())
    }

    /// Volume of the assumed material, m³: filled under the first view, and later from the closed surface.
    pub fn volume(&self) -> f64 {
        self.track.as_ref().map_or(0.0, |t| {
            let lattice = t.body.lattice();
            let cells = 0..lattice.cells().len() as u32;
            cells.map(|c| lattice.mass(c)).sum::<f64>() * lattice.size().powi(3)
        })
    }

    /// Processes one frame.
    ///
    /// # Errors
    /// A stage rejects its input.
    pub fn process(
        &mut self,
        observation: &Observation,
        table: &Plane,
    ) -> Result<FrameReport, Error> {
        let start = Instant::now();
        let view = FrameView::new(observation, self.options.spacing)?;
        let prepare = start.elapsed().as_secs_f64() * 1e3;
        let mut report = FrameReport {
            frame: self.frame,
            ..FrameReport::default()
        };
        match (view, self.track.take()) {
            (Some(view), None) => {
                let track = self.begin(view, observation, table)?;
                report.added = track.model.len();
                report.measured.clone_from(&track.seen);
                self.track = Some(track);
            }
            (Some(view), Some(mut track)) => {
                let outcome = self.follow(&mut track, view, observation, table, &mut report);
                self.track = Some(track);
                outcome?;
            }
            (None, track) => {
                let points = observation.points.len();
                report.failure = Some(format!("only {points} points of the object in view"));
                report.measured = vec![false; track.as_ref().map_or(0, |t| t.model.len())];
                self.track = track;
                self.before = None;
            }
        }
        if let Some(track) = self.track.as_mut().filter(|_| report.failure.is_none()) {
            let spacing = self.options.spacing;
            track
                .model
                .take_colours(observation, &report.measured, spacing);
        }
        self.frame += 1;
        let heights = self.model().live().iter().map(|p| table.height(p));
        report.constraints.below_table = -heights.fold(0.0, f64::min);
        report.parts.prepare = prepare;
        report.frame_ms = start.elapsed().as_secs_f64() * 1e3 - report.fusion_ms;
        Ok(report)
    }

    /// Fuses the rest shape anew if the object was handled since the last fusion: before a decision, and at the end of a recording. A fusion
    /// that fails leaves the model unchanged.
    pub fn consolidate(&mut self, table: &Plane) {
        let Some(mut track) = self.track.take() else {
            return;
        };
        if self.handled {
            self.decide(&mut track, true);
            fuse::refuse(&mut track, table, &self.options);
            self.fused = true;
            self.handled = track.is_held();
        }
        self.track = Some(track);
    }

    /// Divides the material where parts touch, before they are pulled apart: joined fingers could not come apart in the model. At the next fusion what did not
    /// move apart is joined again.
    pub fn divide(&mut self) {
        if let Some(track) = &mut self.track {
            fuse::divide(track, &self.options);
        }
    }

    /// Vertices that the camera can see now, by the model alone (for planning).
    pub fn visible_now(&self, observation: &Observation) -> Vec<bool> {
        visible(self.model(), observation, self.options.spacing)
    }

    /// Rejects a loaded state that is inconsistent.
    fn check_read(&self) -> Result<(), Error> {
        let tracks = self.track.iter().chain(&self.rival);
        tracks.into_iter().try_for_each(Track::check_read)
    }

    /// The first frame.
    fn begin(
        &mut self,
        view: FrameView,
        observation: &Observation,
        table: &Plane,
    ) -> Result<Track, Error> {
        let mut track = Track::begin(&view, table, &self.options, Fill { inner: 1.0 })?;
        self.first = Some(view.depth.clone());
        let hollow = self.options.hollow.map(|inner| Fill { inner });
        let rival = hollow.map(|fill| Track::begin(&view, table, &self.options, fill));
        self.rival = rival.transpose()?;
        let view = Arc::new(view);
        let recognised = self.recognise(&view, observation);
        for hypothesis in std::iter::once(&mut track).chain(self.rival.as_mut()) {
            if let Some(features) = &recognised {
                hypothesis.plant(features, self.options.spacing);
            }
            hypothesis.keep_keyframe(Arc::clone(&view), &observation.arms, true);
            hypothesis.take_grips(&observation.arms, self.options.grip_radius);
        }
        Ok(track)
    }

    /// Every later frame, with both hypotheses as long as there are two.
    fn follow(
        &mut self,
        track: &mut Track,
        view: FrameView,
        observation: &Observation,
        table: &Plane,
        report: &mut FrameReport,
    ) -> Result<(), Error> {
        let started = Instant::now();
        report.added = self.follow_all(track, view, observation, table)?;
        report.registration_ms = started.elapsed().as_secs_f64() * 1e3;
        report.parts = track.parts;
        report.hollow_over_solid = self.hollow_over_solid(track);
        self.decide(track, false);
        report.residual = track.residual;
        report.overlap = track.share.min(1.0);
        report.moved = track.moved;
        report.constraints = track.constraints;
        report.grip_force = track.grip_force.filter(|_| track.refused.is_none());
        report.failure = failure(track);
        let arms = &observation.arms;
        if self.is_due(track, arms) {
            let started = Instant::now();
            self.decide(track, true);
            fuse::refuse(track, table, &self.options);
            report.fusion_ms = started.elapsed().as_secs_f64() * 1e3;
            report.fused = self.options.fusion_rounds > 0;
            self.fused = true;
            self.handled = false;
        }
        for hypothesis in std::iter::once(&mut *track).chain(self.rival.as_mut()) {
            hypothesis.take_grips(arms, self.options.grip_radius);
        }
        self.free = !track.is_held();
        self.handled |= track.is_held();
        report.measured.clone_from(&track.seen);
        Ok(())
    }

    /// Registers the hypotheses to a frame; returns how many vertices were added to the first.
    fn follow_all(
        &mut self,
        track: &mut Track,
        view: FrameView,
        observation: &Observation,
        table: &Plane,
    ) -> Result<usize, Error> {
        let view = Arc::new(view);
        let recognised = self.recognise(&view, observation);
        let frame = Frame {
            view: &view,
            recognised: recognised.as_ref(),
            observation,
            table,
            first: self.first.as_ref(),
            fused: self.fused,
            options: &self.options,
        };
        let rival = &mut self.rival;
        // Each hypothesis runs on its own thread with its own data, so the bits do not depend on the threads.
        let (own, other) = std::thread::scope(|scope| {
            let other = rival
                .as_mut()
                .map(|rival| scope.spawn(|| follow_one(rival, &frame)));
            let own = follow_one(track, &frame);
            let other = other.map(std::thread::ScopedJoinHandle::join);
            (own, other)
        });
        // A hypothesis that cannot follow is rejected, and one that continued alone is a frame ahead.
        if own.is_err() || !matches!(other, Some(Ok(Ok(_)))) {
            self.rival = None;
        }
        own
    }

    /// Whether the shape is to be fused anew: the object was handled, and has come to rest or is gripped again.
    fn is_due(&self, track: &Track, arms: &[ArmState]) -> bool {
        let rests = track.still == STILL;
        let again = self.free && track.takes_hold(arms);
        self.handled && (rests || again) && track.keyframes.all().len() > 3
    }

    /// The colour features of a frame, if it has any and they are requested, matched with those of the last frame.
    fn recognise(&mut self, view: &Arc<FrameView>, now: &Observation) -> Option<Recognised> {
        let used = self.options.features == ColourFeatures::Landmarks;
        let features = now.features.as_ref().filter(|_| used);
        let before = self.before.take();
        let mut features = features?.clone();
        features.retain(|f| f.point.iter().all(|x| x.is_finite()));
        let (motion, spacing) = (self.options.limits.motion, self.options.spacing);
        let after = |b: &Before| Recognised::after(b, view, &features, motion, spacing);
        let recognised = before
            .as_ref()
            .map_or_else(|| Recognised::first(view, &features), after);
        let view = Arc::clone(view);
        self.before = Some(Before { view, features });
        Some(recognised)
    }

    /// Ratio of the prediction error of the hollow hypothesis to that of the solid one.
    fn hollow_over_solid(&self, track: &Track) -> Option<f64> {
        let rival = self.rival.as_ref()?;
        let ratio = rival.mean_innovation() / track.mean_innovation();
        ratio.is_finite().then_some(ratio)
    }

    /// Keeps one of the hypotheses, solid or hollow, as soon as it is known which is right; at the `end` of a manipulation at the latest.
    fn decide(&mut self, track: &mut Track, end: bool) {
        let Some(ratio) = self.hollow_over_solid(track) else {
            if end {
                self.rival = None;
            }
            return;
        };
        let evidence = Evidence {
            ratio,
            share: track.share,
            held: track.held_frames(),
            carried: track.carried(),
            end,
        };
        let Some(hollow) = evidence.is_hollow() else {
            return;
        };
        if let Some(rival) = self.rival.take().filter(|_| hollow) {
            let old = std::mem::replace(track, rival);
            track.renamed_after(&old);
        }
    }
}

/// Why a frame cannot be used, if it cannot.
fn failure(track: &Track) -> Option<String> {
    let lost = track.residual > LOST || track.share < LOST_SHARE;
    track.refused.clone().or_else(|| {
        lost.then(|| {
            format!(
                "lost: {:.1} mm off, {:.0} % of the expected part is seen",
                1e3 * track.residual,
                100.0 * track.share
            )
        })
    })
}

/// The input of both hypotheses.
struct Frame<'a> {
    view: &'a Arc<FrameView>,
    recognised: Option<&'a Recognised>,
    observation: &'a Observation,
    table: &'a Plane,
    first: Option<&'a DepthGrid>,
    /// Whether the body was filled from a closed surface.
    fused: bool,
    options: &'a ReconstructOptions,
}

/// Registers one hypothesis to a frame, grows it, and stores a keyframe if it is due; returns how many vertices were added.
fn follow_one(track: &mut Track, frame: &Frame<'_>) -> Result<usize, Error> {
    let (options, arms) = (frame.options, &frame.observation.arms);
    let spent = track.body.spent();
    track.follow(frame.view, frame.recognised, arms, options)?;
    let now = track.body.spent();
    let ms = |time: Duration| time.as_secs_f64() * 1e3;
    track.parts.assemble = ms(now.assembling.saturating_sub(spent.assembling));
    track.parts.factor = ms(now.factoring.saturating_sub(spent.factoring));
    let started = Instant::now();
    let learns = track.refused.is_none() && track.fits() && !track.body.is_falling();
    let mut added = 0;
    if learns {
        track.cut_opened(options.spacing);
    }
    if let Some(first) = frame.first.filter(|_| learns) {
        let (seen, spacing) = (&track.seen, options.spacing);
        for vertex in grow::grown(track, frame.view, seen, first, frame.table, spacing) {
            track.push(vertex);
            added += 1;
        }
        if added > 0 {
            track.settle_edges(spacing);
            if !frame.fused {
                track.refill_as_seen(options);
            }
        }
    }
    track.parts.grow = ms(started.elapsed());
    if let Some(features) = frame.recognised.filter(|_| learns) {
        track.plant(features, options.spacing);
    }
    let travelled = track.keyframes.travel(track.moved);
    let moved_on = learns && travelled > options.keyframe_motion;
    if track.still == STILL || (track.still < STILL && moved_on) {
        track.keep_keyframe(Arc::clone(frame.view), arms, track.still >= STILL);
    }
    Ok(added)
}
