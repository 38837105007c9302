//! The layout of the viewer: the object now, the model at rest, curves by unit, events.
//!
//! The viewer calls this a blueprint. It consists of entities in a separate store: `view/ID` and `container/ID`, which refer to each other,
//! `viewport`, which refers to the outermost, and one for each panel.

use super::sinks::APPLICATION;
use crate::cell::Plane;
use nalgebra::{Point3, Vector3};
use re_sdk::external::re_log_types::BlueprintActivationCommand;
use re_sdk::log::LogMsg;
use re_sdk::{RecordingStream, RecordingStreamBuilder, RecordingStreamResult, StoreId, StoreKind};
use re_sdk_types::blueprint::archetypes::{
    ContainerBlueprint, EyeControls3D, PanelBlueprint, TextLogColumns, TimePanelBlueprint,
    ViewBlueprint, ViewContents, ViewportBlueprint,
};
use re_sdk_types::blueprint::components::{ContainerKind, PanelState};
use re_sdk_types::blueprint::datatypes::{TextLogColumn, TextLogColumnKind, TimelineColumn};
use re_sdk_types::external::uuid::Uuid;

/// Distance of the viewpoint from the object, in sizes of the object.
const AWAY: f64 = 1.0;

/// Class of a view that lists texts.
const EVENTS: &str = "TextLog";

/// The blueprint.
pub(super) struct Layout {
    messages: Vec<LogMsg>,
    id: StoreId,
}

impl Layout {
    /// The layout for an object with this centre and size, m, on its table.
    pub fn new(middle: &Point3<f64>, size: f64, table: &Plane) -> RecordingStreamResult<Self> {
        let id = StoreId::random(StoreKind::Blueprint, APPLICATION);
        let (stream, storage) = RecordingStreamBuilder::from_store_id(&id)
            .enabled(true)
            .memory()?;
        stream.set_time_sequence("blueprint", 0);
        let mut writer = Writer { stream, written: 0 };
        let root = writer.write(&parts(&eye(middle, size, table)))?;
        let viewport = ViewportBlueprint::new()
            .with_root_container(root)
            .with_auto_layout(false)
            .with_auto_views(false);
        writer.stream.log("viewport", &viewport)?;
        let aside = PanelBlueprint::new().with_state(PanelState::Collapsed);
        writer.stream.log("selection_panel", &aside)?;
        let time = TimePanelBlueprint::new()
            .with_state(PanelState::Collapsed)
            .with_timeline("frame");
        writer.stream.log("time_panel", &time)?;
        let messages = storage.take();
        Ok(Self { messages, id })
    }

    /// Sends the blueprint to a stream and activates it.
    pub fn send(&self, stream: &RecordingStream) {
        let use_it = BlueprintActivationCommand::make_active(self.id.clone());
        stream.send_blueprint(self.messages.clone(), use_it);
    }
}

/// A viewpoint on the near side of the object, halfway up.
fn eye(middle: &Point3<f64>, size: f64, table: &Plane) -> EyeControls3D {
    let up = table.normal.into_inner();
    let single = |v: Vector3<f64>| [v.x as f32, v.y as f32, v.z as f32];
    // The direction down in the image points toward a person in front of the cell.
    let near = Vector3::y() - up * up.y;
    let near = near.try_normalize(1e-3).unwrap_or_else(Vector3::x);
    EyeControls3D::new()
        .with_position(single(middle.coords + (up + near) * (AWAY * size)))
        .with_look_target(single(middle.coords))
        .with_eye_up(single(up))
}

/// Columns of the event list: time, severity, text.
fn event_columns() -> TextLogColumns {
    let times = [
        ("frame", true),
        ("time", true),
        ("log_tick", false),
        ("log_time", false),
    ];
    let times = times.map(|(timeline, visible)| TimelineColumn {
        timeline: timeline.into(),
        visible: visible.into(),
    });
    let texts = [TextLogColumnKind::LogLevel, TextLogColumnKind::Body];
    let texts = texts.map(|kind| TextLogColumn {
        kind,
        visible: true.into(),
    });
    TextLogColumns::new()
        .with_timeline_columns(times)
        .with_text_log_columns(texts)
}

/// A view, or several side by side or one below the other.
enum Part {
    View {
        class: &'static str,
        name: &'static str,
        origin: &'static str,
        eye: Option<Box<EyeControls3D>>,
    },
    Several {
        kind: ContainerKind,
        shares: Vec<f32>,
        parts: Vec<Part>,
    },
}

fn parts(eye: &EyeControls3D) -> Part {
    let view = |class, name, origin| Part::View {
        class,
        name,
        origin,
        eye: None,
    };
    let space = |name, origin| Part::View {
        class: "3D",
        name,
        origin,
        eye: Some(Box::new(eye.clone())),
    };
    let spaces = vec![space("Now", "live"), space("Model at rest", "rest")];
    let below = vec![
        view("TimeSeries", "Share", "curves/share"),
        view("TimeSeries", "Millimetres", "curves/mm"),
        view("TimeSeries", "Milliseconds", "curves/ms"),
        view(EVENTS, "Events", "events"),
    ];
    Part::Several {
        kind: ContainerKind::Vertical,
        shares: vec![2.0, 1.0],
        parts: vec![
            Part::Several {
                kind: ContainerKind::Horizontal,
                shares: vec![1.4, 1.0],
                parts: spaces,
            },
            Part::Several {
                kind: ContainerKind::Horizontal,
                shares: vec![1.0, 1.0, 1.0, 1.6],
                parts: below,
            },
        ],
    }
}

/// Writes parts with consecutive ids.
struct Writer {
    stream: RecordingStream,
    written: u128,
}

impl Writer {
    fn write(&mut self, part: &Part) -> RecordingStreamResult<Uuid> {
        self.written += 1;
        let id = Uuid::from_u128(self.written);
        let path = part.path(id);
        match part {
            Part::View {
                class,
                name,
                origin,
                eye,
            } => {
                let view = ViewBlueprint::new(*class)
                    .with_display_name(*name)
                    .with_space_origin(*origin);
                let all = ViewContents::new([format!("/{origin}/**")]);
                self.stream.log(path.as_str(), &view)?;
                self.stream.log(format!("{path}/ViewContents"), &all)?;
                if *class == EVENTS {
                    let columns = event_columns();
                    self.stream
                        .log(format!("{path}/TextLogColumns"), &columns)?;
                }
                if let Some(eye) = eye {
                    self.stream
                        .log(format!("{path}/EyeControls3D"), eye.as_ref())?;
                }
            }
            Part::Several {
                kind,
                shares,
                parts,
            } => {
                let mut paths = Vec::new();
                for part in parts {
                    let id = self.write(part)?;
                    paths.push(part.path(id));
                }
                let several = ContainerBlueprint::new(*kind).with_contents(paths);
                let several = if *kind == ContainerKind::Vertical {
                    several.with_row_shares(shares.iter().copied())
                } else {
                    several.with_col_shares(shares.iter().copied())
                };
                self.stream.log(path, &several)?;
            }
        }
        Ok(id)
    }
}

impl Part {
    /// Where it is written.
    fn path(&self, id: Uuid) -> String {
        match self {
            Self::View { .. } => format!("view/{id}"),
            Self::Several { .. } => format!("container/{id}"),
        }
    }
}
