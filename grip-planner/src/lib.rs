#![doc = include_str!("../README.md")]
//!
//! # Map
//!
//! | step | item | module |
//! |---|---|---|
//! | what is missing, `m = −Σ area_i n_i` | [`missing_vector_area`] | `model` |
//! | box round the body, one axis along the table normal | [`agent_box`] | `agent_box` |
//! | which vertices can be gripped, and how the tool comes | [`candidates`], [`candidates_among`] | `candidates` |
//! | stiffness `K`, target weights `S` | [`Stiffness`], [`target_weights`] | `stiffness` |
//! | null-space coverage, exact for every set | [`Coverage`] | `null_space`, `factor` |
//! | the four turns about the sides of the box | [`turns`], [`Turn`] | `turn` |
//! | sets of grips, ranked (Algorithm 2) | [`plan_grips`] | `grips`, `assign` |
//! | lift, retract, lower | [`turn_over`] | `turn_over`, `motion` |
//! | workspaces, table, other tools | [`Refusal`] | `check` |
//! | the best set whose motion can be done | [`plan`] | `plan` |
//! | opening a hole | [`stretch`] | `stretch` |
//! | `v_max = ξ F / max ‖J_i v̂‖`, ramp, slowing down | [`speed_limit`], [`SpeedGovernor`] | `speed` |
//!
//! # Guarantees
//!
//! The same input gives the same bits out: no randomness, no threads, no clock. No input panics; what cannot be used is named by its index
//! and value in an [`Error`], what cannot be done by arm and time in a [`Refusal`]. A [`Motion`] that is returned has every tip in its workspace and above
//! the table and every two tools apart at all way points and half-way between them.
//!
//! # Limits
//!
//! A tool is checked against the table and the other tools, not against the body it moves. The body is a membrane on
//! a bed of springs where grips are chosen and a tumbling block with slack where the motion is planned; neither knows folds or
//! self-contact, which is why the loop looks again after every turn.
mod agent_box;
mod assign;
mod candidates;
mod check;
mod error;
mod factor;
mod grips;
mod model;
mod motion;
mod null_space;
mod options;
mod plan;
mod scene;
mod speed;
mod stiffness;
mod stretch;
mod turn;
mod turn_over;

pub use agent_box::{AgentBox, agent_box};
pub use candidates::{Candidate, Candidates, Reason, candidates, candidates_among};
pub use check::Refusal;
pub use error::Error;
pub use grips::{Grip, GripSet, Role, plan_grips};
pub use model::{Model, missing_vector_area};
pub use motion::{ArmPath, Keyframe, Motion};
pub use nalgebra;
pub use null_space::Coverage;
pub use options::{CandidateSource, Options, Support};
pub use plan::{Plan, PlanOptions, RefusedSet, plan};
pub use scene::{Arm, Plane, PoseTest, Scene, Workspace};
pub use speed::{GovernorOptions, SpeedGovernor, speed_limit};
pub use stiffness::{CoverageOptions, Stiffness, target_weights};
pub use stretch::{Stretch, StretchOptions, stretch};
pub use turn::{Turn, turns};
pub use turn_over::{Recentre, TurnOptions, turn_over};
