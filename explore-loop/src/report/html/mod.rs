//! `report.html`: a run as one page that opens offline.
//!
//! ```text
//! frames ─► live model, clouds, tools (every 2^k-th) ─┐
//! decisions ─► meshes, loops, bars, measures ─────────┼─► JSON, packed arrays in Base64 ─► page with viewer and curves
//! plans ─► grips, planned and real paths ─────────────┘
//! ```
//! [`Report`] collects data while a run goes on and stays small however long it lasts; [`Report::page`] writes the page. It loads nothing from
//! elsewhere, and all text from outside (file names, reasons of failures) is data that the page shows as text.
//!
//! | file | content |
//! |---|---|
//! | `live` | the moving model, frame by frame |
//! | `decisions` | the state before each decision, and the action taken |
//! | `packed`, `thinned` | compact arrays and lists |
//! | `page` | assembles the document |
//! | `page.html`, `page.css`, `*.js` | the parts of the page |
//! | `vendor/` | three.js, for 3-D drawing |

mod decisions;
mod live;
mod packed;
mod page;
mod thinned;

pub use decisions::{AgainstTruth, Mesh, Quantity};

use crate::canonical::CanonicalModel;
use crate::canonical::topology::Topology;
use crate::cell::{CellInfo, Observation};
use crate::explore::Phase;
use crate::reconstruct::FrameReport;
use decisions::Decisions;
use grip_planner::Plan;
use live::{Live, Moment};
use serde::{Deserialize, Serialize};
use thinned::Thinned;

/// Most points of the curves.
const MOST_SAMPLES: usize = 4_096;
/// Most notes: a fault in every frame must not fill the page.
const MOST_NOTES: usize = 200;

/// General information about the run.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct About {
    /// The explored object: a scene, a mesh file, a recording.
    pub subject: String,
    /// The command that made it.
    pub command: String,
    /// The version of the program.
    pub version: String,
    /// Spacing of the model, metres.
    pub spacing: f64,
    /// Names of the arms.
    pub arms: Vec<String>,
    /// Normal of the table, toward the free side.
    pub up: [f64; 3],
    /// Offset of the table, metres: `up · x + offset = 0` on it.
    pub offset: f64,
}

impl About {
    /// Takes the arms and the table from a cell.
    #[must_use]
    pub fn with_cell(self, cell: &CellInfo) -> Self {
        Self {
            arms: cell.arms.iter().map(|arm| arm.name.clone()).collect(),
            up: cell.table.normal.into_inner().into(),
            offset: cell.table.offset,
            ..self
        }
    }
}

/// How a run ended.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Closing {
    /// The closing table: names and formatted values.
    pub rows: Vec<(&'static str, String)>,
    metrics: serde_json::Value,
}

impl Closing {
    /// The closing table, and the content of `metrics.json`.
    ///
    /// # Errors
    /// Metrics that are no JSON.
    pub fn new(
        rows: Vec<(&'static str, String)>,
        metrics: &impl Serialize,
    ) -> Result<Self, std::io::Error> {
        let metrics = serde_json::to_value(metrics)?;
        Ok(Self { rows, metrics })
    }
}

/// A point of the curves.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Sample {
    time: f64,
    frame: u32,
    vertices: usize,
    measured: usize,
    residual: f64,
    overlap: f64,
    seen_error: Option<f64>,
    hidden_error: Option<f64>,
    failed: bool,
    registration_ms: f64,
    frame_ms: f64,
}

/// Collects the data of the page while a run goes on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Report {
    about: About,
    /// Stamp of the first frame, s, from which times are counted.
    began: Option<f64>,
    now: f64,
    phase: String,
    /// Number of the current or latest manipulation.
    manipulation: usize,
    live: Live,
    decisions: Decisions,
    samples: Thinned<Sample>,
    notes: Vec<(f64, String)>,
    more_notes: usize,
}

impl Default for Report {
    fn default() -> Self {
        Self::new(About::default())
    }
}

impl Report {
    /// An empty report.
    pub fn new(about: About) -> Self {
        Self {
            about,
            began: None,
            now: 0.0,
            phase: String::new(),
            manipulation: 0,
            live: Live::new(),
            decisions: Decisions::new(),
            samples: Thinned::new(MOST_SAMPLES),
            notes: Vec::new(),
            more_notes: 0,
        }
    }

    /// The run is resumed by another command.
    pub fn goes_on(&mut self, about: About) {
        self.about = about;
    }

    /// A phase begins.
    pub fn phase(&mut self, phase: Phase) {
        self.phase = match phase {
            Phase::Home => "arms go home",
            Phase::Look => "looking",
            Phase::Decide => "deciding",
            Phase::Reach => "reaching",
            Phase::Grasp => "grasping",
            Phase::Manipulate => "manipulating",
            Phase::Lower => "lowering",
            Phase::Release => "letting go",
        }
        .into();
    }

    /// Records a processed frame. `errors` are the distances of the vertices from their true positions, metres; empty where unknown.
    pub fn frame(
        &mut self,
        observation: &Observation,
        report: &FrameReport,
        model: &CanonicalModel,
        errors: &[f64],
    ) {
        let began = *self.began.get_or_insert(observation.stamp);
        self.now = observation.stamp - began;
        let moment = Moment {
            time: self.now,
            phase: &self.phase,
            manipulation: self.manipulation,
        };
        self.decisions.tips(self.now, observation);
        let spacing = self.about.spacing;
        self.live
            .push(&moment, observation, report, model, errors, spacing);
        self.samples.push(Sample {
            time: self.now,
            frame: report.frame,
            vertices: model.len(),
            measured: report.measured.iter().filter(|m| **m).count(),
            residual: report.residual,
            overlap: report.overlap,
            seen_error: mean(errors, &report.measured, true),
            hidden_error: mean(errors, &report.measured, false),
            failed: report.failure.is_some(),
            registration_ms: report.registration_ms,
            frame_ms: report.frame_ms,
        });
        if let Some(failure) = &report.failure {
            let frame = report.frame;
            self.note(format!("frame {frame} was not used: {failure}"));
        }
    }

    /// Records the topology before a decision, the surface by which it was judged, and the comparison with the truth.
    pub fn decision(
        &mut self,
        topology: &Topology,
        model: &CanonicalModel,
        mesh: &Mesh,
        truth: &AgainstTruth,
    ) {
        self.decisions
            .decision(self.now, self.manipulation, topology, model, mesh, truth);
    }

    /// Records a planned manipulation with its description `what`.
    pub fn planned(&mut self, what: String, plan: &Plan, model: &CanonicalModel) {
        self.manipulation += 1;
        self.decisions
            .planned(self.manipulation, self.now, what, plan, model);
    }

    /// Records a message for the reader.
    pub fn note(&mut self, text: String) {
        if self.notes.len() < MOST_NOTES {
            self.notes.push((self.now, text));
        } else {
            self.more_notes += 1;
        }
    }

    /// The page.
    pub fn page(&self, closing: &Closing) -> String {
        let (decisions, manipulations) = self.decisions.page();
        let samples = self.samples.kept();
        let column = |of: fn(&Sample) -> serde_json::Value| -> Vec<serde_json::Value> {
            samples.iter().map(of).collect()
        };
        let data = serde_json::json!({
            "about": &self.about,
            "decisions": decisions,
            "manipulations": manipulations,
            "live": self.live.page(),
            "notes": &self.notes,
            "more_notes": self.more_notes,
            "samples": {
                "every": self.samples.every(),
                "time": column(|s| rounded(s.time, 1e3)),
                "frame": column(|s| s.frame.into()),
                "vertices": column(|s| s.vertices.into()),
                "measured": column(|s| s.measured.into()),
                "residual_mm": column(|s| rounded(1e3 * s.residual, 1e4)),
                "overlap": column(|s| rounded(s.overlap, 1e4)),
                "seen_error_mm": column(|s| millimetres(s.seen_error)),
                "hidden_error_mm": column(|s| millimetres(s.hidden_error)),
                "failed": column(|s| s.failed.into()),
            },
        });
        // Values that differ between two otherwise equal runs are stored separately.
        let times = serde_json::json!({
            "rows": &closing.rows,
            "metrics": &closing.metrics,
            "registration_ms": column(|s| rounded(s.registration_ms, 1e2)),
            "frame_ms": column(|s| rounded(s.frame_ms, 1e2)),
        });
        page::document(&self.about.subject, &data, &times)
    }
}

/// Rounded to the decimals that the page needs; null if not finite.
fn rounded(value: f64, parts: f64) -> serde_json::Value {
    serde_json::json!((value * parts).round() / parts)
}

fn millimetres(metres: Option<f64>) -> serde_json::Value {
    metres.map_or(serde_json::Value::Null, |m| rounded(1e3 * m, 1e4))
}

/// Mean of the errors of the vertices for which `seen` equals `wanted`; `None` when there is none.
fn mean(errors: &[f64], seen: &[bool], wanted: bool) -> Option<f64> {
    let chosen = || errors.iter().zip(seen).filter(|(_, s)| **s == wanted);
    let count = chosen().count();
    let sum: f64 = chosen().map(|(e, _)| *e).sum();
    (count > 0).then(|| sum / count as f64)
}
