#![doc = include_str!("../README.md")]
//!
//! # Map
//!
//! | step | item | module |
//! |---|---|---|
//! | a model from a mesh, or from points and the graph that joins them | [`Surface`] | `surface` |
//! | vector area of the missing surface, `m = −Σ area_i n_i` | [`missing_vector_area`] | `model` |
//! | box around the body, one axis along the table normal | [`agent_box`] | `agent_box` |
//! | which vertices can be gripped, and the [`Reason`] why others cannot | [`candidates`], [`candidates_among`] | `candidates`, `orientation`, `reason` |
//! | stiffness `K`, target weights `S` | [`Stiffness`], [`target_weights`] | `stiffness` |
//! | null-space coverage, exact for every set | [`Coverage::score`], [`Coverage::pairs`] | `null_space`, `factor` |
//! | the best set of any size | [`Coverage::best_set`] | `select` |
//! | commanded field, null-space projector, map for pictures | [`Coverage::field`], [`Coverage::free_motion`], [`Coverage::map`] | `field` |
//! | the four turns about the sides of the box | [`turns`], [`Turn`] | `turn` |
//! | sets of grips, ranked (paper, Algorithm 2) | [`plan_grips`], [`GripSet`] | `grips`, `assign` |
//! | lift, retract, lower | [`turn_over`], [`TurnOptions`] | `turn_over`, `turn_options`, `motion` |
//! | opening a hole, parting what touches | [`Action::Stretch`], [`Action::Part`], [`StretchOptions`] | `stretch`, `hole` |
//! | to the grips and back home | [`Plan::reach`], [`Plan::withdraw`] | `reach` |
//! | from the present poses: put down, give up, go home | [`carry`], [`put_down`], [`lower`], [`go_home`] | `way` |
//! | workspaces, table, other tools, the moving body | [`Refusal`] | `check`, `body`, `refusal` |
//! | the best set with feasible motions | [`plan`], [`plan_set`] | `plan` |
//! | `v_max = ξ F / max ‖J_i v̂‖`, ramp, slowing down | [`speed_limit`], [`SpeedGovernor`] | `speed` |
//!
//! # Guarantees
//!
//! The same input gives the same bits: no randomness, no threads, no clock. No input panics; an [`Error`] has the index and value of
//! invalid input, a [`Refusal`] the stage, arm and time of an infeasible motion. In a returned [`Motion`], at all way points and half-way between them, every tip is
//! in its workspace and above the table, every two tools are apart, and no tool is in the body; no tip exceeds the speed limit.
//!
//! # Limits
//!
//! In the checks the body is rigid and moves with the tool that holds it; a base is a point, so only the straight part of a tool and the line to its base
//! are checked, not the rest of the arm. Grips are chosen for a membrane on a bed of springs, and motions are planned for a tumbling block with
//! slack; neither models folds or self-contact, so the scene must be observed again after every turn.
mod agent_box;
mod assign;
mod body;
mod candidates;
mod check;
mod error;
mod factor;
mod field;
mod grips;
mod hole;
mod model;
mod motion;
mod null_space;
mod options;
mod orientation;
mod plan;
mod reach;
mod reason;
mod refusal;
mod scene;
mod select;
mod speed;
mod stiffness;
mod stretch;
mod surface;
mod turn;
mod turn_options;
mod turn_over;
mod way;

pub use agent_box::{AgentBox, agent_box};
pub use candidates::{Candidate, Candidates, candidates, candidates_among};
pub use error::Error;
pub use grips::{Grip, GripSet, Ranked, Role, plan_grips};
pub use model::{Model, missing_vector_area};
pub use motion::{ArmPath, Keyframe, Leg, Motion, Stage};
pub use nalgebra;
pub use null_space::Coverage;
pub use options::{CandidateSource, Options, Support};
pub use plan::{Action, Plan, PlanOptions, Tracking, plan, plan_set};
pub use reach::ReachOptions;
pub use reason::{Reason, Waypoint};
pub use refusal::{Refusal, RefusedSet};
pub use scene::{Arm, Plane, PoseTest, Scene, Workspace};
pub use speed::{GovernorOptions, SpeedGovernor, speed_limit};
pub use stiffness::{CoverageOptions, Stiffness, target_weights};
pub use stretch::StretchOptions;
pub use surface::Surface;
pub use turn::{Turn, turns};
pub use turn_options::{Recentre, TurnOptions};
pub use turn_over::turn_over;
pub use way::{CarryOptions, Tip, carry, go_home, lower, put_down};
