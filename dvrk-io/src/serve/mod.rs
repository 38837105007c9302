//! The robot's side: serves a simulated arm and a simulated camera like those of a dVRK, for any CRTK client.
//!
//! ```text
//!            commands                                                         100 Hz                    latched
//! state_command · servo_cp · move_cp · jaw/servo_jp · jaw/move_jp · hold      measured_* · setpoint_*   operating_state · tool_type · arm_clutch
//!      │                                                                          ▲
//!      └─► ArmServer: states, inverse kinematics, limits, trajectories ──► set-point ──► ServedArm ──► where it is
//! ```
//! The simulation of the arm implements [`ServedArm`]: three functions. States, inverse kinematics, clipping and refusals
//! are those of a dVRK 2.4 ([`Dialect::Robot`](crate::arm::Dialect::Robot)), or of the simulators of its
//! maintainers, which differ:
//!
//! | | robot | simulator |
//! |---|---|---|
//! | at start | DISABLED | ENABLED and homed |
//! | reports and follows | the wrist | the tips of the jaws |
//! | joint limits | clips silently | refuses with an error |
//! | texts | `std_msgs/String` | `crtk_msgs/StringStamped` |
//! | a fault is left with | `enable` | `clear_fault` |
//!
//! *Limits.* No joint commands (`servo_jp`, `move_jp`), no services, no forces: only pose commands. Powering and homing
//! take the configured time, and fail only without an instrument.

mod camera;
mod machine;
mod options;
mod plant;
mod publish;
mod server;
mod trajectory;

pub use camera::{CloudServer, DepthServer};
pub use options::ServeOptions;
pub use plant::{KinematicArm, ServedArm};
pub use server::ArmServer;
