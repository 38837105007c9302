//! Kinematics of a patient-side manipulator (PSM): the pose of the tip, joint values for a pose, and distances
//! from limits and singularities.
//!
//! ```text
//! forward    q ↦ rcm_from_wrist ↦ rcm_from_tip = rcm_from_wrist · TransZ(jaw)
//! inverse    rcm_from_tip ↦ rcm_from_wrist ↦ q      one solution, up to whole turns of the roll
//! ```
//! | frame | origin | axes |
//! |---|---|---|
//! | `rcm` | remote centre of motion, the point that the shaft always passes through; the robot's `PSMn_base` | +x where +yaw moves the tip, −y where +pitch moves it, the shaft along −z at zero joints |
//! | `wrist` | the control point, on the wrist yaw axis: what the robot calls `local/measured_cp` | +z along the approach (closed jaws), jaws turn about x |
//! | `tip` | tips of the closed jaws, 10.2 mm further along +z | those of `wrist` |
//!
//! The robot does not know the `tip`. A grip planned for the tips but sent as a wrist pose goes 10 mm too deep,
//! so the two poses are different types here: [`RcmFromWrist`] and [`RcmFromTip`].
//!
//! ```
//! use dvrk_io::Psm;
//! use dvrk_io::kinematics::{Joint, Kinematics, Unreachable};
//! use dvrk_io::Error;
//!
//! # fn main() -> Result<(), Error> {
//! let arm = Kinematics::new(Psm::Classic);
//! let joints = [0.2, -0.3, 0.15, 0.4, -0.5, 0.6];
//! let wrist = arm.rcm_from_wrist(&joints)?;
//! let reach = arm.inverse(&wrist)?;
//! assert!((0..6).all(|i| (reach.joints[i] - joints[i]).abs() < 1e-12));
//! // The nearest limit is that of the pitch, which ends at ±0.925 rad.
//! assert!((reach.margins.joints[1] - (0.925 - 0.3)).abs() < 1e-12);
//!
//! // 20 cm further along the shaft is out of reach, and the answer says why.
//! let mut far = wrist;
//! far.0.translation.vector *= 2.5;
//! let Err(Error::Unreachable(Unreachable::JointLimit { joint, value, range })) = arm.inverse(&far) else {
//!     panic!("out of reach");
//! };
//! assert_eq!((joint, range), (Joint::Insertion, [0.0, 0.24]));
//! assert!(value > 0.3);
//! # Ok(())
//! # }
//! ```
//!
//! *Limits.* Lengths and joint limits are those of the robot's configuration files, not of a measured
//! instrument: cables stretch, and a real tip is millimetres away from its computed position. Collisions between arms are
//! not considered.

mod arm;
mod forward;
mod inverse;
mod pose;
mod workspace;

pub(crate) use forward::check_joints;
pub(crate) use pose::check_pose;

pub use arm::{Instrument, Joint, Kinematics};
pub use inverse::{Margins, Reach, Unreachable};
pub use pose::{RcmFromTip, RcmFromWrist};
pub use workspace::{PsmWorkspace, SafetyMargins};
