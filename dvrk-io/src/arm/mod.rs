//! A patient-side manipulator as a client drives it: CRTK over ROS 2, on any [`Transport`](crate::transport::Transport).
//!
//! ```text
//! read       measured_cp  setpoint_cp  local/measured_cp  measured_cv  measured_js  setpoint_js  jaw/measured_js  jaw/setpoint_js
//!            operating_state  tool_type  arm_clutch  goal_reached  error  warning  status  info  console: teleop/enabled
//! written    state_command  servo_cp  move_cp  jaw/servo_jp  hold
//!
//!             enable              home                 start_line, start_jaw (servo_cp, jaw/servo_jp) · start_move (move_cp)
//! DISABLED ─────────► ENABLED ─────────► homed ─────────────────────────────────────────────────────────► Arrived
//!     ▲  disable         │ a fault         │    guided by hand · silence · fault · divergence · another writer · … ──► Stop, hold
//!     └───────────────── FAULT ── clear_fault
//! ```
//! A dVRK executes a `servo_cp` as it is: no interpolation, no check of speed or step, no timeout. It clips joint values at
//! their limits, pushes goals away from the remote centre and drops unreachable ones, mostly without a message. This module adds
//! the missing checks:
//!
//! | check | item |
//! |---|---|
//! | nothing is sent before every stream is there and every command has a listener | [`Arm::connect`] |
//! | speed, acceleration and step of set-points | [`Profile`], [`ArmOptions::motion`] |
//! | goals within reach, with margins, and the path to them | [`Arm::start_line`] |
//! | the set-point is the one sent | [`Stop::Diverged`] |
//! | the arm follows its set-point | [`Stop::Blocked`] |
//! | feedback is fresh | [`Stop::Stale`] |
//! | no other commander: ROS, a hand at the clutch, the console | [`Stop::OtherWriter`], [`Stop::Clutched`], [`Stop::Teleoperation`] |
//! | frames are the expected ones, and do not move | [`Arm::check`], [`Stop::BaseMoved`] |
//! | tips and wrist are not confused | [`RcmFromTip`](crate::kinematics::RcmFromTip), [`ControlPoint`] |
//!
//! Goals are poses of the *tips* in the frame of the remote centre. From the camera: `camera_from_rcm.rcm_from_tip(&goal)`, with
//! [`CameraFromRcm`] from a [`Calibration`](crate::calibration::Calibration).
//!
//! A simulated arm on an in-process bus, enabled, homed and moved in simulated time:
//!
//! ```
//! use std::sync::Arc;
//! use std::time::Duration;
//!
//! use dvrk_io::arm::{Arm, ArmOptions};
//! use dvrk_io::nalgebra::Translation3;
//! use dvrk_io::serve::{ArmServer, KinematicArm, ServeOptions};
//! use dvrk_io::transport::Bus;
//!
//! # fn main() -> Result<(), dvrk_io::Error> {
//! let bus = Bus::new();
//! let mut server = ArmServer::new(&bus.node(), "PSM1", KinematicArm::default(), ServeOptions::default())?;
//! bus.every(Duration::from_millis(1), move |now| server.tick(now));
//!
//! let (six, ten) = (Duration::from_secs(6), Duration::from_secs(10));
//! let mut arm = Arm::connect(Arc::new(bus.node()), "PSM1", ArmOptions::default(), six)?;
//! arm.enable(six)?;
//! arm.home(ten)?;
//!
//! let mut goal = arm.rcm_from_tip().ok_or(dvrk_io::Error::NoMarker)?.value;
//! goal.0 = Translation3::new(0.0, 0.0, -0.01) * goal.0;
//! arm.start_line(&goal, 0.02)?;
//! arm.start_jaw(0.5)?;
//! arm.wait(ten)?;
//! let tip = arm.rcm_from_tip().ok_or(dvrk_io::Error::NoMarker)?.value;
//! assert!((tip.0.translation.vector - goal.0.translation.vector).norm() < 1e-4);
//! arm.release();
//! # Ok(())
//! # }
//! ```
//!
//! *Limits.* Commands and feedback travel over a network: events on the robot are known some milliseconds later. If a client
//! is killed, the arm stays at its last set-point, as a dVRK has no timeout. Forces are not controlled.

mod check;
mod commands;
mod drive;
mod driver;
mod feedback;
mod frames;
mod line;
mod monitor;
mod motion;
mod options;
mod power;
mod profile;
mod readings;
mod state;
mod stop;
mod stream;
mod thread;
mod tick;
pub(crate) mod topics;

pub use check::FrameCheck;
pub(crate) use commands::{header, stamped};
pub use driver::Arm;
pub use feedback::MissingStream;
pub use frames::{CameraFromRcm, CameraFromTip, CameraFromWrist, ReferenceFromRcm};
pub use options::{ArmOptions, LocalPose, OtherWriters, Tolerance};
pub use profile::{Profile, ProfileLimits};
pub use readings::JawState;
pub use state::{ArmStatus, ControlPoint, Dialect, Event, EventKind, Mode};
pub use stop::Stop;
pub use stream::{Absence, Sample, Velocity};
pub(crate) use stream::{Measurement, unheard};
pub use thread::ArmThread;
