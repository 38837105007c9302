//! A recorded session as a cell: it can be watched, not moved.

use super::{ArmInfo, ArmState, Cell, CellError, CellInfo, Observation, Plane};
use nalgebra::{Isometry3, Point3};

/// Jaw angles below this hold what is between the fingers, rad.
const CLOSED: f64 = 0.05;

/// Plays a session that `dvrk-io` read.
pub struct ReplayCell {
    info: CellInfo,
    frames: std::vec::IntoIter<dvrk_io::session::Frame>,
    last: Vec<ArmState>,
}

impl ReplayCell {
    /// A cell over the frames of `session`. Without a recorded table the plane lies far below everything.
    ///
    /// # Errors
    /// A session without frames.
    pub fn new(session: dvrk_io::session::Session) -> Result<Self, CellError> {
        if session.frames.is_empty() {
            return Err(CellError::Failed(
                "the session has no frames with points".into(),
            ));
        }
        let table = session.table.map_or(
            Plane {
                normal: -nalgebra::Vector3::z_axis(),
                offset: 1e3,
            },
            |(normal, offset)| Plane { normal, offset },
        );
        let arms: Vec<ArmInfo> = session
            .arm_names
            .iter()
            .map(|name| recorded_arm(name))
            .collect();
        let span = session.frames.last().map_or(0.0, |f| f.stamp) - session.frames[0].stamp;
        let camera_rate = if span > 0.0 {
            (session.frames.len() - 1) as f64 / span
        } else {
            1.0
        };
        let last = arms.iter().map(|_| idle()).collect();
        let info = CellInfo {
            arms,
            table,
            camera_rate,
        };
        Ok(Self {
            info,
            frames: session.frames.into_iter(),
            last,
        })
    }

    /// Frames not yet observed.
    pub fn remaining(&self) -> usize {
        self.frames.len()
    }
}

fn recorded_arm(name: &str) -> ArmInfo {
    ArmInfo {
        name: name.to_owned(),
        camera_from_home: Isometry3::identity(),
        base: Point3::origin(),
        reach: 0.0,
        jaw_radius: 0.0,
        max_speed: 0.0,
    }
}

fn idle() -> ArmState {
    ArmState {
        camera_from_tip: Isometry3::identity(),
        jaw: 1.0,
        holding: false,
        moving: false,
    }
}

impl Cell for ReplayCell {
    fn info(&self) -> &CellInfo {
        &self.info
    }

    fn observe(&mut self) -> Result<Observation, CellError> {
        let frame = self.frames.next().ok_or(CellError::Ended)?;
        for (info, state) in self.info.arms.iter().zip(&mut self.last) {
            let sample = frame.arms.iter().find(|a| a.name == info.name);
            let pose = sample.and_then(|s| s.pose);
            state.moving = pose.is_some_and(|p| p != state.camera_from_tip);
            state.camera_from_tip = pose.unwrap_or(state.camera_from_tip);
            state.jaw = sample.and_then(|s| s.jaw).unwrap_or(state.jaw);
            // A pose without a jaw angle is an arm that the recorder published while it held.
            let closed = sample.and_then(|s| s.jaw).is_none_or(|jaw| jaw < CLOSED);
            state.holding = pose.is_some() && closed;
        }
        Ok(Observation {
            stamp: frame.stamp,
            points: frame.points,
            arms: self.last.clone(),
        })
    }

    fn move_arm(&mut self, _: usize, _: Isometry3<f64>, _: f64) -> Result<(), CellError> {
        Err(CellError::ReadOnly)
    }

    fn close_jaw(&mut self, _: usize) -> Result<(), CellError> {
        Err(CellError::ReadOnly)
    }

    fn open_jaw(&mut self, _: usize) -> Result<(), CellError> {
        Err(CellError::ReadOnly)
    }

    fn home(&mut self) -> Result<(), CellError> {
        Err(CellError::ReadOnly)
    }

    fn stop(&mut self) -> Result<(), CellError> {
        Err(CellError::ReadOnly)
    }
}
