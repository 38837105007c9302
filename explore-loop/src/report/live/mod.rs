//! Shows a run in the [Rerun](https://rerun.io) viewer while it goes on, and records it to a file that the viewer opens (feature `rerun`).
//!
//! | entity | content |
//! |---|---|
//! | `live/cloud` | points of the cloud, in their colours if they have any |
//! | `live/model` | the live model: each vertex green where its position is known to 0.5 mm, yellow to 1.1 mm, red where not to 2.5 mm (one standard deviation), grey where unknown |
//! | `live/table` | the table below the object |
//! | `live/arms/NAME` | a tool with its jaws, red while they hold something |
//! | `live/grips` | points that arms hold |
//! | `live/plan` | the planned paths of the tips |
//! | `rest/model` | the vertices of the canonical model, blue to yellow in the order in which they were seen |
//! | `rest/surface` | the surface through them, at every decision |
//! | `curves/share`, `curves/mm`, `curves/ms`, `curves/count` | figures of each frame, by unit; `curves/share/explored` if there is a ground truth |
//! | `events` | phases, plans, decisions and faults as text |
//!
//! `live` is the frame of the camera (x right, y down, z away), `rest` that of the first observation; lengths are in metres except in the curves.
//! Timelines: `frame`, its number, and `time`, its stamp in seconds. If a reconstruction does not estimate uncertainty, `live/model` is green where the
//! frame has measured it and grey elsewhere.
//!
//! A [`LiveView`] is a [`Watcher`]: no failure of a viewer or of a disk affects the run that it shows.
//!
//! ```no_run
//! use explore_loop::cell::Cell;
//! use explore_loop::explore::{ExploreOptions, Explorer};
//! use explore_loop::plan::CoveragePlanner;
//! use explore_loop::report::live::{LiveView, Viewer};
//!
//! fn watched(cell: &mut dyn Cell, options: ExploreOptions) -> Result<(), explore_loop::Error> {
//!     let mut planner = CoveragePlanner::default();
//!     let mut live = LiveView::open("run.rrd".as_ref(), &Viewer::Here, "a cell", cell.info(), options.spacing)?;
//!     let outcome = Explorer::new(cell, &mut planner, &mut live, options)?.run()?;
//!     for remark in live.finish() {
//!         eprintln!("{remark}");
//!     }
//!     println!("{} manipulations; rerun run.rrd", outcome.manipulations);
//!     Ok(())
//! }
//! ```

use crate::Error;
use crate::canonical::CanonicalModel;
use crate::canonical::surface::triangulate;
use crate::canonical::topology::Topology;
use crate::cell::{CellInfo, Observation};
use crate::explore::{Event, Watcher};
use crate::reconstruct::FrameReport;
use crate::report::colour::{Rgb, first_seen};
use grip_planner::Plan;
use layout::Layout;
use nalgebra::Point3;
use re_sdk_types::archetypes::{Scalars, TextLog, ViewCoordinates};
use re_sdk_types::components::TextLogLevel;
use sinks::Sinks;
pub use sinks::Viewer;
use std::path::Path;

mod draw;
mod layout;
mod sinks;

/// Shows a run in a viewer, and records it to a file.
pub struct LiveView {
    sinks: Sinks,
    spacing: f64,
    cell: CellInfo,
    /// Standard deviations for the next frame.
    sigmas: Option<Vec<f64>>,
    /// Rest positions of the vertices whose triangles are drawn.
    drawn: Vec<Point3<f64>>,
    /// Number and stamp of the last frame.
    at: (u32, f64),
    /// Whether table and viewpoint have been placed.
    placed: bool,
}

impl std::fmt::Debug for LiveView {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("LiveView")
            .field("spacing", &self.spacing)
            .field("at", &self.at)
            .finish_non_exhaustive()
    }
}

impl LiveView {
    /// Creates a file, and shows the same in a viewer; `title` is the name of the recording, `spacing` that of the model, metres.
    ///
    /// # Errors
    /// [`Error::LiveView`]: the file cannot be created, or the viewer is not available.
    pub fn open(
        file: &Path,
        viewer: &Viewer,
        title: &str,
        cell: &CellInfo,
        spacing: f64,
    ) -> Result<Self, Error> {
        let mut sinks = Sinks::open(file, viewer, title)?;
        for space in ["live", "rest"] {
            sinks.log_static(space, &ViewCoordinates::RDF());
        }
        Ok(Self {
            sinks,
            spacing,
            cell: cell.clone(),
            sigmas: None,
            drawn: Vec::new(),
            at: (0, 0.0),
            placed: false,
        })
    }

    /// Takes the standard deviations of the positions of the vertices after the next frame, m.
    pub fn uncertainty(&mut self, sigmas: &[f64]) {
        self.sigmas = Some(sigmas.to_vec());
    }

    /// Shows a frame.
    pub fn frame(
        &mut self,
        observation: &Observation,
        report: &FrameReport,
        model: &CanonicalModel,
    ) {
        self.at = (report.frame, observation.stamp);
        self.sinks.at(report.frame, observation.stamp);
        self.place(&observation.points);
        let cloud = draw::cloud(observation, self.spacing);
        self.sinks.log("live/cloud", &cloud);
        let sigmas = self.sigmas.take().filter(|s| s.len() == model.len());
        self.model(report, model, sigmas.as_deref());
        self.arms(observation);
        self.curves(report, model, sigmas);
        if let Some(failure) = &report.failure {
            let frame = report.frame;
            self.warn(&format!("frame {frame} was not used: {failure}"));
        }
    }

    /// Places the table under the first cloud, and the viewpoint in front of it.
    fn place(&mut self, points: &[Point3<f64>]) {
        let Some((middle, size)) = draw::extent(points).filter(|_| !self.placed) else {
            return;
        };
        self.placed = true;
        if let Some(table) = draw::table(&self.cell.table, &middle, size) {
            self.sinks.log_static("live/table", &table);
        }
        let layout = Layout::new(&middle, size, &self.cell.table);
        self.sinks.each(|stream| match &layout {
            Ok(layout) => {
                layout.send(stream);
                Ok(())
            }
            Err(error) => Err(error.to_string()),
        });
    }

    /// The live model; and the model at rest with new triangles, if it has changed.
    fn model(&mut self, report: &FrameReport, model: &CanonicalModel, sigmas: Option<&[f64]>) {
        let triangles = (self.drawn != model.rest())
            .then(|| triangulate(model.rest(), model.rest_normals(), self.spacing));
        let colours: Vec<Rgb> = match sigmas {
            Some(sigmas) => sigmas.iter().map(|s| draw::certainty(*s)).collect(),
            None => report.measured.iter().map(|m| draw::measured(*m)).collect(),
        };
        let now = draw::surface(model.live(), &model.live_normals(), triangles.as_deref())
            .with_vertex_colors(colours);
        self.sinks.log("live/model", &now);
        if triangles.is_some() {
            let share = |born: &u32| f64::from(*born) / f64::from(report.frame.max(1));
            let colours = model.born().iter().map(|b| first_seen(share(b))).collect();
            let rest = draw::vertices(model.rest(), colours, self.spacing);
            self.sinks.log("rest/model", &rest);
            model.rest().clone_into(&mut self.drawn);
        }
    }

    fn arms(&mut self, observation: &Observation) {
        let names = self.cell.arms.iter().map(|arm| arm.name.as_str());
        let arms: Vec<_> = names.zip(&observation.arms).collect();
        for (name, arm) in &arms {
            self.sinks
                .log(&format!("live/arms/{name}"), &draw::arm(arm));
        }
        self.sinks.log("live/grips", &draw::grips(arms.into_iter()));
    }

    fn curves(&mut self, report: &FrameReport, model: &CanonicalModel, sigmas: Option<Vec<f64>>) {
        let measured = report.measured.iter().filter(|m| **m).count();
        let sigma = sigmas.and_then(median);
        for (name, value) in [
            (
                "share/measured",
                Some(measured as f64 / model.len().max(1) as f64),
            ),
            ("share/overlap", Some(report.overlap)),
            ("mm/residual", Some(1e3 * report.residual)),
            ("mm/moved", Some(1e3 * report.moved)),
            ("mm/uncertainty", sigma.map(|s| 1e3 * s)),
            ("ms/registration", Some(report.registration_ms)),
            ("ms/frame", Some(report.frame_ms)),
            ("count/vertices", Some(model.len() as f64)),
        ] {
            if let Some(value) = value {
                self.curve(name, value);
            }
        }
    }

    fn curve(&mut self, name: &str, value: f64) {
        let entity = format!("curves/{name}");
        self.sinks.log(&entity, &Scalars::single(value));
    }

    /// Shows the explored share of the true surface.
    pub fn explored(&mut self, share: f64) {
        self.curve("share/explored", share);
    }

    /// Shows the topology before a decision, and at the end. Slow sinks are given up here, while the arms stand still.
    pub fn decision(&mut self, topology: &Topology) {
        if let Some(surface) = &topology.surface {
            let drawn = draw::surface(
                &surface.vertices,
                &surface.normals,
                Some(&surface.triangles),
            );
            self.sinks.log("rest/surface", &drawn);
        }
        self.curve("share/missing", topology.missing);
        self.say(&format!(
            "Betti numbers {:?} (persistent {:?}), boundary {:.1} %, missing {:.1} %",
            topology.betti,
            topology.persistent,
            100.0 * topology.boundary_share(),
            100.0 * topology.missing
        ));
        self.sinks.check();
    }

    fn plan(&mut self, plan: &Plan) {
        let ways = plan.motion.arms.iter();
        let ways = ways.map(|arm| arm.keyframes.iter().map(|k| &k.camera_from_tip).collect());
        self.sinks.log("live/plan", &draw::ways(ways));
        self.say(&format!(
            "planned: coverage {:.2}, score {:.2}, {:.1} s",
            plan.coverage, plan.score, plan.motion.duration
        ));
    }

    fn say(&mut self, text: &str) {
        self.log_text(text, TextLogLevel::INFO);
    }

    fn warn(&mut self, text: &str) {
        self.log_text(text, TextLogLevel::WARN);
    }

    fn log_text(&mut self, text: &str, level: &str) {
        let text = TextLog::new(text).with_level(level);
        self.sinks.log("events", &text);
    }

    /// Messages since the last call about sinks that failed.
    pub fn take_remarks(&mut self) -> Vec<String> {
        self.sinks.take_remarks()
    }

    /// Waits, at most half a minute, until everything is written and sent; returns messages about what is not.
    pub fn finish(self) -> Vec<String> {
        self.sinks.finish()
    }
}

impl Watcher for LiveView {
    fn event(&mut self, event: Event<'_>, model: &CanonicalModel) -> Result<(), Error> {
        match event {
            Event::Uncertainty(sigmas) => self.uncertainty(sigmas),
            Event::Frame(observation, report) => self.frame(observation, report, model),
            Event::Topology(topology) => self.decision(topology),
            Event::Planned(plan) => self.plan(plan),
            Event::Phase(phase) => self.say(&phase.to_string()),
            Event::Fault(fault) => self.warn(&fault.to_string()),
            Event::Trouble(trouble) => self.warn(&format!("arms stopped: {trouble}")),
            Event::Missed(arm) => self.warn(&format!("arm {arm} closed on nothing")),
            Event::Found => self.say("the body was found again"),
            Event::Restored(manipulations, _) => self.warn(&format!(
                "the model is that after {manipulations} manipulations: later ones have spoiled it"
            )),
            _ => {}
        }
        Ok(())
    }

    fn wants_uncertainty(&self) -> bool {
        true
    }
}

/// The median; `None` if it is not finite.
fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_unstable_by(f64::total_cmp);
    let middle = values.get(values.len() / 2).copied();
    middle.filter(|m| m.is_finite())
}
