//! A cell of dVRK arms and a depth camera over ROS 2, real or simulated.
//!
//! ```text
//! CELL.toml ─► preflight: network, arms, clocks, frames, other commanders, limits, camera, table, object     nothing moves
//!                 │ all checks passed
//!                 ▼
//!              start: power, home ─► DvrkCell: a thread drives and watches each arm
//!
//! observe    newest frame ─► find_object removes table and arms;  poses of the tips at the time of the frame
//! move_arm   straight line, starts within 10 ms;  close_jaw: holds something if the jaw stays open
//! ```
//!
//! | event | what the loop sees |
//! |---|---|
//! | FAULT, a missing instrument, a hand at the clutch, teleoperation, another commander, a moved base frame, a set-point that differs from the one sent | [`CellError::ArmFault`](super::CellError::ArmFault) at the next command: the exploration ends, jaws are not moved |
//! | something obstructs an arm | the arm holds and reports its pose; the loop waits, and gives the manipulation up |
//! | an arm is silent | its pose is not finite: the frame is skipped, the arms are stopped |
//! | the camera is silent | frames without points: the arms are stopped, what they hold is lowered |
//! | Ctrl-C ([`DvrkCell::stop_flag`]) | [`CellError::Failed`](super::CellError::Failed) from then on: arms hold their positions, jaws are not moved |
//!
//! Trouble of one arm, moving or at rest, and Ctrl-C stop all arms within 100 ms, whatever the loop computes meanwhile; an arm counts as silent
//! when nothing has arrived from it for 0.2 s.

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
