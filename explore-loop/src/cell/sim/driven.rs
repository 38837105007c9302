//! The simulated world driven by an external program: each step of the physics is given the poses of the tips.
//!
//! ```text
//! Cell        move_arm, observe:    the cell moves the tips; time passes from frame to frame
//! here        drive, depth_image:   the caller moves the tips; time passes one step at each call
//! ```
//! This is how the cell is served to clients of a robot. These steps are not recorded in the [`Journal`](super::Journal).

use dvrk_io::depth::{DepthImage, Intrinsics};
use dvrk_io::kinematics::Kinematics;
use nalgebra::Isometry3;

use super::SimCell;
use super::arms::{kinematics, remote_centres, waiting};
use super::gripper::Gripper;
use crate::cell::{Cell, CellError};

/// The base of a simulated PSM, and its waiting position.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct PsmStand {
    /// Its name.
    pub name: String,
    /// Pose of the frame of its remote centre in the camera frame.
    pub camera_from_rcm: Isometry3<f64>,
    /// Its lengths and joint limits.
    pub kinematics: Kinematics,
    /// Its joint values while it waits: radians, metres for the insertion.
    pub waiting: [f64; 6],
}

impl SimCell {
    /// The simulated PSMs; none for arms without joints ([`ArmModel::Free`](super::ArmModel::Free)).
    pub fn psms(&self) -> Vec<PsmStand> {
        let stands = remote_centres(&self.options, &self.camera_from_world);
        let arms = stands.into_iter().zip(&self.info.arms);
        arms.map(|(camera_from_rcm, info)| PsmStand {
            name: info.name.clone(),
            camera_from_rcm,
            kinematics: kinematics(),
            waiting: waiting(),
        })
        .collect()
    }

    /// Duration of a step of [`drive`](Self::drive), seconds.
    pub fn step_seconds(&self) -> f64 {
        self.step
    }

    /// Advances one step, with the tips at `camera_from_tip`, one for each arm. Held nodes move with their tips.
    ///
    /// # Errors
    /// The physics fails.
    pub fn drive(&mut self, camera_from_tip: &[Isometry3<f64>]) -> Result<(), CellError> {
        for (gripper, pose) in self.grippers.iter_mut().zip(camera_from_tip) {
            gripper.place(*pose);
        }
        self.step_body();
        match self.body.broken() {
            Some(reason) => Err(CellError::Failed(reason)),
            None => Ok(()),
        }
    }

    /// Whether the jaw of an arm holds something.
    pub fn holds(&self, arm: usize) -> bool {
        let gripper = self.grippers.get(arm).map(Gripper::state);
        gripper.is_some_and(|state| state.holding)
    }

    /// The depth image at present, table and arms included.
    ///
    /// # Errors
    /// None in practice: the image has the size of the camera.
    pub fn depth_image(&mut self) -> Result<DepthImage, CellError> {
        self.frame += 1;
        let view = self.view(0.0);
        self.sight.image(&view, self.frame)
    }

    /// Parameters of the depth camera.
    ///
    /// # Errors
    /// None in practice: the options were checked when the cell was built.
    pub fn intrinsics(&self) -> Result<Intrinsics, CellError> {
        let camera = &self.options.camera;
        let centre = [camera.width, camera.height].map(|n| 0.5 * n as f64 - 0.5);
        Intrinsics::new(camera.width, camera.height, [camera.focal; 2], centre)
            .map_err(|error| CellError::Failed(error.to_string()))
    }

    /// Frames each second.
    pub fn frame_rate(&self) -> f64 {
        self.info().camera_rate
    }
}
