//! A cell of dVRK arms and a depth camera over ROS 2, real or served.
//!
//! ```text
//! CELL.toml ─► preflight: network, arms, clocks, frames, others who command, limits, camera, table, object     nothing moves
//!                 │ all is well
//!                 ▼
//!              start: power, home ─► DvrkCell: a thread drives and watches each arm
//!
//! observe    newest frame ─► find_object without table and arms;  tips as they were when it was taken
//! move_arm   straight line at the next 10 ms;  close_jaw: closed, and does it stay open?
//! ```
//!
//! | what happens | what the loop sees |
//! |---|---|
//! | FAULT, a missing instrument, a hand at the clutch, teleoperation, somebody else who commands, a moved base frame, a set-point that is not where it was sent | [`CellError::ArmFault`](super::CellError::ArmFault) at the next command: it ends, jaws stay as they are |
//! | something is in the way of an arm | the arm holds and reports where it is; the loop waits, and gives up what is under way |
//! | an arm is silent | its pose is not finite: the frame is not taken, the arms are stopped |
//! | the camera is silent | frames without points: the arms are stopped, what is held is lowered |
//! | Ctrl-C ([`DvrkCell::stop_flag`]) | [`CellError::Failed`](super::CellError::Failed), from then on: arms hold where they are, jaws stay as they are |
//!
//! Trouble of one arm, moving or at rest, and Ctrl-C stop all arms within 100 ms, whatever the loop computes meanwhile; an arm is silent once nothing
//! has come from it for 0.2 s.

mod cell;
mod checks;
mod entries;
mod file;
mod history;
mod interlock;
mod preflight;
mod values;

pub use cell::DvrkCell;
pub use entries::{
    ArmEntry, CameraEntry, JawEntry, Kind, LimitsEntry, NetworkEntry, TableEntry, ToolEntry,
};
pub use file::CellFile;
pub use preflight::{Check, Preflight};
pub use values::{Direction, PoseEntry, Positive};
