//! The robot's side: a simulated arm and a simulated camera as those of a dVRK, for any CRTK client.
//!
//! ```text
//!            commands                                                         100 Hz                    latched
//! state_command · servo_cp · move_cp · jaw/servo_jp · jaw/move_jp · hold      measured_* · setpoint_*   operating_state · tool_type · arm_clutch
//!      │                                                                          ▲
//!      └─► ArmServer: states, inverse kinematics, limits, trajectories ──► set-point ──► ServedArm ──► where it is
//! ```
//! What simulates the arm implements [`ServedArm`]: three functions. States, inverse kinematics, what is clipped and what is
//! refused are those of a dVRK 2.4 ([`Dialect::Robot`](crate::arm::Dialect::Robot)), or of the simulators of its
//! maintainers, which differ:
//!
//! | | robot | simulator |
//! |---|---|---|
//! | at start | DISABLED | ENABLED and homed |
//! | reports and follows | the wrist | the tips of the jaws |
//! | joint limits | clips without a word | refuses with an error |
//! | texts | `std_msgs/String` | `crtk_msgs/StringStamped` |
//! | a fault is left with | `enable` | `clear_fault` |
//!
//! *Limits.* No joint commands (`servo_jp`, `move_jp`), no services, no forces: what a client of poses needs. Powering and homing
//! take the time that they are given, and nothing can go wrong in them but a missing instrument.

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
