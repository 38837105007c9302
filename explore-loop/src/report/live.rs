//! A run for the Rerun viewer, frame by frame while it goes on (feature `rerun`).
//!
//! | entity | what it shows |
//! |---|---|
//! | `live/cloud` | points of the camera, in its colours where it has some |
//! | `live/model` | vertices of the model, where they are now; green where the frame measured them, the redder the longer they have not been seen |
//! | `live/table` | the table below the object |
//! | `live/arms/NAME` | the tip: an arrow along the tool, red while the jaw holds |
//! | `live/plan` | where the tips are going to go |
//! | `rest/surface` | the closed surface at rest, at every decision |
//! | `curves/…` | vertices, seen share, residual, times of each frame |
//! | `events` | phases, faults, decisions in words |
//!
//! Everything is in the camera frame (x right, y down, z away), metres, but for `rest`, the frame of the first observation. Timelines: `time`
//! (stamps of the camera, s) and `frame`. A file that is written opens with `rerun FILE.rrd`.

use crate::Error;
use crate::canonical::CanonicalModel;
use crate::canonical::topology::Topology;
use crate::cell::{CellInfo, Observation};
use crate::explore::{Event, Watcher};
use crate::reconstruct::FrameReport;
use grip_planner::Plan;
use nalgebra::{Isometry3, Point3, Vector3};
use rerun::{RecordingStream, RecordingStreamBuilder, RecordingStreamError};
use std::path::Path;

/// What recordings are called in the viewer.
const NAME: &str = "explore";
/// Seconds after which a vertex that is not seen is drawn in full red.
const LONG_AGO: f64 = 5.0;
/// Half the side of the table that is drawn, and the length of a tool, m.
const TABLE: f64 = 0.25;
const TOOL: f64 = 0.05;
/// Radii of points of the cloud and of vertices, of the spacing.
const RADII: [f64; 2] = [0.15, 0.35];

/// Red, green, blue.
type Rgb = [u8; 3];
const GREY: Rgb = [150, 150, 160];
const HOLDING: Rgb = [220, 60, 50];
const IDLE: Rgb = [60, 110, 200];
const PLANNED: Rgb = [240, 190, 60];

/// Sends what happens to a viewer or to a file.
pub struct LiveView {
    stream: RecordingStream,
    spacing: f64,
    cell: CellInfo,
    /// Stamp at which each vertex was last measured, s, by its identity: the model may lose vertices.
    seen: std::collections::BTreeMap<u64, f64>,
    stamp: f64,
    began: bool,
}

impl std::fmt::Debug for LiveView {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("LiveView")
            .field("spacing", &self.spacing)
            .field("stamp", &self.stamp)
            .finish_non_exhaustive()
    }
}

impl LiveView {
    /// Writes a file that the viewer opens; `spacing` is that of the model, metres.
    ///
    /// # Errors
    /// A file that cannot be created.
    pub fn file(path: &Path, cell: &CellInfo, spacing: f64) -> Result<Self, Error> {
        let stream = RecordingStreamBuilder::new(NAME).save(path);
        let stream = stream.map_err(|error| Error::LiveView {
            reason: format!("{}: {error}", path.display()),
        })?;
        Self::new(stream, cell, spacing)
    }

    /// Shows it in the viewer that listens on this machine, or starts one.
    ///
    /// # Errors
    /// No viewer listens, and none is installed.
    pub fn viewer(cell: &CellInfo, spacing: f64) -> Result<Self, Error> {
        let stream = RecordingStreamBuilder::new(NAME).spawn();
        let stream = stream.map_err(|error| Error::LiveView {
            reason: match error {
                RecordingStreamError::SpawnViewer(_) => format!(
                    "no viewer listens here and none is installed: pip install rerun-sdk=={}, or write a file with --rrd FILE.rrd",
                    rerun::build_info().version
                ),
                other => other.to_string(),
            },
        })?;
        Self::new(stream, cell, spacing)
    }

    fn new(stream: RecordingStream, cell: &CellInfo, spacing: f64) -> Result<Self, Error> {
        stream.log_static("live", &rerun::ViewCoordinates::RDF())?;
        Ok(Self {
            stream,
            spacing,
            cell: cell.clone(),
            seen: std::collections::BTreeMap::new(),
            stamp: 0.0,
            began: false,
        })
    }

    fn frame(
        &mut self,
        observation: &Observation,
        report: &FrameReport,
        model: &CanonicalModel,
    ) -> Result<(), Error> {
        self.stamp = observation.stamp;
        self.stream.set_duration_secs("time", self.stamp);
        self.stream
            .set_time_sequence("frame", i64::from(report.frame));
        if !self.began {
            self.table(&observation.points)?;
            self.began = !observation.points.is_empty();
        }
        let colours = observation.colours().map(<[Rgb]>::to_vec);
        let cloud = rerun::Points3D::new(observation.points.iter().map(single))
            .with_radii([(RADII[0] * self.spacing) as f32])
            .with_colors(colours.unwrap_or_else(|| vec![GREY]));
        self.stream.log("live/cloud", &cloud)?;
        let vertices = rerun::Points3D::new(model.live.iter().map(single))
            .with_radii([(RADII[1] * self.spacing) as f32])
            .with_colors(self.certainty(report, model));
        self.stream.log("live/model", &vertices)?;
        for (info, arm) in self.cell.arms.iter().zip(&observation.arms) {
            let colour = if arm.holding { HOLDING } else { IDLE };
            let tool = tool(&arm.camera_from_tip).with_colors([colour]);
            self.stream.log(format!("live/arms/{}", info.name), &tool)?;
        }
        self.curves(report, model)
    }

    /// Green where the frame measured a vertex, the redder the longer ago that was.
    fn certainty(&mut self, report: &FrameReport, model: &CanonicalModel) -> Vec<Rgb> {
        let measured = report.measured.iter().chain(std::iter::repeat(&false));
        let colour = |(id, measured): (&u64, &bool)| {
            let seen = self.seen.entry(*id).or_insert(self.stamp);
            if *measured {
                *seen = self.stamp;
            }
            let share = ((self.stamp - *seen) / LONG_AGO).clamp(0.0, 1.0);
            [
                (60.0 + 180.0 * share) as u8,
                (180.0 - 130.0 * share) as u8,
                70,
            ]
        };
        model.ids.iter().zip(measured).map(colour).collect()
    }

    fn curves(&self, report: &FrameReport, model: &CanonicalModel) -> Result<(), Error> {
        let seen = report.measured.iter().filter(|m| **m).count();
        for (name, value) in [
            ("vertices", model.len() as f64),
            ("seen_share", seen as f64 / model.len().max(1) as f64),
            ("residual_mm", 1e3 * report.residual),
            ("overlap", report.overlap),
            ("moved_mm", 1e3 * report.moved),
            ("registration_ms", report.registration_ms),
            ("frame_ms", report.frame_ms),
        ] {
            let scalar = rerun::Scalars::single(value);
            self.stream.log(format!("curves/{name}"), &scalar)?;
        }
        match &report.failure {
            Some(failure) => self.say(&format!("frame {} was not used: {failure}", report.frame)),
            None => Ok(()),
        }
    }

    /// A square of the table below what is seen.
    fn table(&self, points: &[Point3<f64>]) -> Result<(), Error> {
        let table = &self.cell.table;
        let middle = points.iter().map(|p| p.coords).sum::<Vector3<f64>>();
        let middle = Point3::from(middle / points.len().max(1) as f64);
        let normal = table.normal.into_inner();
        let foot = middle - normal * table.height(&middle);
        // No table was recorded: it was assumed far away.
        if (foot - middle).norm() > 10.0 * TABLE {
            return Ok(());
        }
        let side = normal.cross(&Vector3::y()).try_normalize(1e-3);
        let side = side.unwrap_or_else(|| normal.cross(&Vector3::x()).normalize()) * TABLE;
        let other = normal.cross(&side);
        let corners = [-side - other, side - other, side + other, other - side];
        let mesh = rerun::Mesh3D::new(corners.map(|c| single(&(foot + c))))
            .with_triangle_indices([[0, 1, 2], [0, 2, 3]])
            .with_vertex_colors([[90u8, 80, 70]; 4]);
        Ok(self.stream.log_static("live/table", &mesh)?)
    }

    fn plan(&self, plan: &Plan) -> Result<(), Error> {
        let way = |path: &grip_planner::ArmPath| -> Vec<[f32; 3]> {
            let tips = path.keyframes.iter().map(|k| k.camera_from_tip);
            tips.map(|tip| single(&tip.translation.vector.into()))
                .collect()
        };
        let strips = rerun::LineStrips3D::new(plan.motion.arms.iter().map(way));
        self.stream
            .log("live/plan", &strips.with_colors([PLANNED]))?;
        self.say(&format!(
            "planned: coverage {:.2}, score {:.2}, {:.1} s",
            plan.coverage, plan.score, plan.motion.duration
        ))
    }

    /// The topology before a decision.
    fn decision(&self, topology: &Topology) -> Result<(), Error> {
        if let Some(surface) = &topology.surface {
            let normals = surface
                .normals
                .iter()
                .map(|n| single(&n.into_inner().into()));
            let mesh = rerun::Mesh3D::new(surface.vertices.iter().map(single))
                .with_vertex_normals(normals)
                .with_triangle_indices(surface.triangles.iter().copied());
            self.stream.log("rest/surface", &mesh)?;
        }
        self.say(&format!(
            "Betti numbers {:?} (persistent {:?}), boundary {:.1} %, missing {:.1} %",
            topology.betti,
            topology.persistent,
            100.0 * topology.boundary_share(),
            100.0 * topology.missing
        ))
    }

    fn say(&self, text: &str) -> Result<(), Error> {
        Ok(self.stream.log("events", &rerun::TextLog::new(text))?)
    }

    /// Sends what is still waiting.
    ///
    /// # Errors
    /// A viewer that went away, or a full disk.
    pub fn finish(self) -> Result<(), Error> {
        self.stream
            .flush_blocking()
            .map_err(|error| Error::LiveView {
                reason: error.to_string(),
            })
    }
}

impl Watcher for LiveView {
    fn event(&mut self, event: Event<'_>, model: &CanonicalModel) -> Result<(), Error> {
        match event {
            Event::Frame(observation, report) => self.frame(observation, report, model),
            Event::Topology(topology) => self.decision(topology),
            Event::Planned(plan) => self.plan(plan),
            Event::Phase(phase) => self.say(&format!("{phase:?}")),
            Event::Fault(fault) => self.say(&fault.to_string()),
            Event::Trouble(trouble) => self.say(&format!("{trouble}: the arms are stopped")),
            Event::Missed(arm) => self.say(&format!("arm {arm} closed on nothing")),
            Event::Found => self.say("the body was found again"),
            _ => Ok(()),
        }
    }
}

impl From<RecordingStreamError> for Error {
    fn from(error: RecordingStreamError) -> Self {
        Self::LiveView {
            reason: error.to_string(),
        }
    }
}

fn single(p: &Point3<f64>) -> [f32; 3] {
    [p.x as f32, p.y as f32, p.z as f32]
}

/// An arrow that ends at the tip.
fn tool(camera_from_tip: &Isometry3<f64>) -> rerun::Arrows3D {
    let tip = Point3::from(camera_from_tip.translation.vector);
    let along = camera_from_tip.rotation * Vector3::z() * TOOL;
    rerun::Arrows3D::from_vectors([single(&along.into())]).with_origins([single(&(tip - along))])
}
