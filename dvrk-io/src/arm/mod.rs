//! A patient-side manipulator as a client drives it: CRTK over ROS 2, on any [`Transport`](crate::transport::Transport).
//!
//! ```text
//! read       measured_cp  setpoint_cp  local/measured_cp  measured_cv  measured_js  setpoint_js  jaw/measured_js  jaw/setpoint_js
//!            operating_state  tool_type  arm_clutch  goal_reached  error  warning  status  info  console: teleop/enabled
//! written    state_command  servo_cp  move_cp  jaw/servo_jp  hold
//!
//!             enable              home                 start_line, start_jaw (servo_cp, jaw/servo_jp) · start_move (move_cp)
//! DISABLED ─────────► ENABLED ─────────► homed ─────────────────────────────────────────────────────────► Arrived
//!     ▲  disable         │ a fault         │    hand · silence · fault · divergence · another writer · … ──► Stop, hold
//!     └───────────────── FAULT ── clear_fault
//! ```
//! A dVRK follows a `servo_cp` as it is: no interpolation, no check of speed or step, no timeout. It clips joint values at
//! their limits, pushes goals away from the remote centre and drops what it cannot reach, and says little of it. What it does
//! not do is done here:
//!
//! | what | where |
//! |---|---|
//! | nothing is sent before every stream is there and every command has a listener | [`Arm::connect`] |
//! | speed, acceleration and step of what is sent | [`Profile`], [`ArmOptions::motion`] |
//! | goals within reach, with margins, and the way to them | [`Arm::start_line`] |
//! | the set-point is where it was sent | [`Stop::Diverged`] |
//! | the arm follows its set-point | [`Stop::Blocked`] |
//! | feedback is fresh | [`Stop::Stale`] |
//! | nobody else commands: ROS, a hand at the clutch, the console | [`Stop::OtherWriter`], [`Stop::Clutched`], [`Stop::Teleoperation`] |
//! | frames are what they are taken for, and stay | [`Arm::check`], [`Stop::BaseMoved`] |
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
//! *Limits.* Commands and feedback travel over a network: what happens on the robot is known some milliseconds later. A client
//! that is killed leaves the arm where its last set-point is, as a dVRK has no timeout. Forces are not controlled.

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
