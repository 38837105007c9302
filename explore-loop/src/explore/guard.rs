//! What is wrong with a frame, and what of it can be used.
//!
//! ```text
//! stamp     earlier: dropped, until the clock has clearly been set back;  same: dropped;  much later: used, but the arms are stopped
//! poses     not finite: the frame is dropped, the arm stays where it was last known to be
//! cloud     same again, to the bit, while it should differ: dropped;  next to empty: dropped
//! points    not finite, on the bare table, on a tool: taken out; what is left is used
//! ```
//!
//! *Should differ*: a camera whose pictures of a resting object have differed is noisy, and never gives the same picture twice; before that is known, only
//! what a moving tip holds must differ. *Bare table* and *on a tool* are only points well away from the model: what is beside it may belong to it.

use crate::canonical::CanonicalModel;
use crate::canonical::graph;
use crate::cell::{ArmState, CellInfo, Observation};
use nalgebra::{Isometry3, Point3, Vector3};

/// What was wrong with a frame.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FrameFault {
    /// It shows (almost) nothing of the object.
    #[error("the frame shows {points} points of the object")]
    Empty {
        /// Points seen.
        points: usize,
    },
    /// The same cloud again, though it should differ.
    #[error("the cloud is the same as before, to the bit")]
    Frozen,
    /// The same stamp again.
    #[error("a second frame is stamped {stamp:.3} s")]
    Duplicate {
        /// The stamp, seconds.
        stamp: f64,
    },
    /// Stamped earlier than a frame before it, or not at all.
    #[error("a frame stamped {stamp:.3} s follows one of {after:.3} s")]
    OutOfOrder {
        /// Its stamp, seconds.
        stamp: f64,
        /// The latest stamp before it, seconds.
        after: f64,
    },
    /// It came late; it was used.
    #[error("no frame for {gap:.2} s")]
    Late {
        /// Time since the one before, seconds.
        gap: f64,
    },
    /// The clock was set; the frame was used.
    #[error("the clock jumped by {jump:.1} s")]
    ClockJump {
        /// By how much, seconds.
        jump: f64,
    },
    /// Most points are NaN or infinite.
    #[error("{count} of {points} points are not finite")]
    NonFinitePoints {
        /// How many.
        count: usize,
        /// Points in the frame.
        points: usize,
    },
    /// An arm does not say where it is.
    #[error("the pose of arm {arm} is not finite")]
    NonFinitePose {
        /// The arm.
        arm: usize,
    },
    /// Fewer or more arms than the cell has.
    #[error("the frame has {count} arms, the cell has {expected}")]
    WrongArms {
        /// Arms in the frame.
        count: usize,
        /// Arms of the cell.
        expected: usize,
    },
    /// Points that are not of the object were taken out; the rest was used.
    #[error("{points} points of table, tools or nowhere were taken out")]
    Foreign {
        /// How many.
        points: usize,
    },
    /// The body did not fit for several frames; the arms wait for it.
    #[error("{frames} frames in a row did not fit")]
    Misfits {
        /// How many.
        frames: usize,
    },
    /// The reconstruction refused it.
    #[error("the reconstruction refused the frame: {reason}")]
    Refused {
        /// What it said.
        reason: String,
    },
}

impl FrameFault {
    /// Whether what was left of the frame could be used.
    pub fn is_usable(&self) -> bool {
        matches!(
            self,
            Self::Late { .. }
                | Self::ClockJump { .. }
                | Self::Foreign { .. }
                | Self::Misfits { .. }
        )
    }

    /// Whether it leaves open where the arms are.
    pub fn is_of_arms(&self) -> bool {
        matches!(self, Self::NonFinitePose { .. } | Self::WrongArms { .. })
    }

    /// Whether the arms have to be stopped for it.
    pub fn is_serious(&self) -> bool {
        !matches!(self, Self::Foreign { .. })
    }
}

/// Fewest points that are worth a look.
const FEWEST: usize = 20;
/// A frame that comes after more than so many periods is late, and after so many seconds the clock was set.
const LATE: f64 = 2.6;
const JUMP: f64 = 2.0;
/// Frames stamped earlier in a row, each later than the one before, after which the clock has been set back.
const SET_BACK: usize = 3;
/// Mean difference of noisy pictures, metres, and how many tell a noisy camera.
const NOISE: f64 = 2e-5;
const NOISY: usize = 3;
/// A held tip that has gone this far must have changed the picture, metres.
const CHANGES: f64 = 0.002;
/// Points this near to the table may be of it, metres; points this far from the model, in spacings, are not of the object.
const ON_TABLE: f64 = 0.002;
const AWAY: f64 = 2.5;
/// Length of a tool behind its tip, metres.
const TOOL: f64 = 0.3;

/// Judges frames one after the other.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub(super) struct Guard {
    spacing: f64,
    last_stamp: Option<f64>,
    /// Latest of the frames stamped too early, and how many there were.
    early: Option<(f64, usize)>,
    cloud: Vec<Point3<f64>>,
    /// Where the arms were when this cloud was first seen.
    since: Vec<ArmState>,
    noisy: bool,
    /// Pictures of the resting object that differed as noise makes them differ.
    differences: usize,
    /// The arms where they were last known to be.
    arms: Vec<ArmState>,
}

/// A frame that was judged.
pub(super) struct Judged {
    /// What is left of it, with the arms where they are or were last known to be.
    pub observation: Observation,
    /// What was wrong.
    pub fault: Option<FrameFault>,
}

impl Guard {
    pub fn new(spacing: f64) -> Self {
        Self {
            spacing,
            last_stamp: None,
            early: None,
            cloud: Vec::new(),
            since: Vec::new(),
            noisy: false,
            differences: 0,
            arms: Vec::new(),
        }
    }

    /// Time may pass without frames now: a jaw closes, a plan is made.
    pub fn pause(&mut self) {
        self.last_stamp = None;
    }

    /// Judges a frame; `model` is the object as it was before.
    pub fn judge(
        &mut self,
        mut observation: Observation,
        model: &CanonicalModel,
        info: &CellInfo,
    ) -> Judged {
        let unknown = self.known_arms(&mut observation, info);
        let fault = unknown
            .or_else(|| self.stamp(observation.stamp, info))
            .filter(|f| !f.is_usable() || f.is_serious());
        let fault = match fault {
            Some(fault) if !fault.is_usable() => Some(fault),
            usable => self
                .cloud(&mut observation, model, info)
                .filter(|cloud| usable.is_none() || !cloud.is_usable())
                .or(usable),
        };
        Judged { observation, fault }
    }

    /// Puts arms that do not say where they are to where they were.
    fn known_arms(&mut self, observation: &mut Observation, info: &CellInfo) -> Option<FrameFault> {
        let (count, expected) = (observation.arms.len(), info.arms.len());
        if count != expected {
            observation.arms.clone_from(&self.arms);
            return Some(FrameFault::WrongArms { count, expected });
        }
        let mut fault = None;
        for (arm, state) in observation.arms.iter_mut().enumerate() {
            if finite(&state.camera_from_tip) {
                continue;
            }
            fault = fault.or(Some(FrameFault::NonFinitePose { arm }));
            let home = info.arms[arm].camera_from_home;
            state.camera_from_tip = self.arms.get(arm).map_or(home, |a| a.camera_from_tip);
        }
        self.arms.clone_from(&observation.arms);
        fault
    }

    fn stamp(&mut self, stamp: f64, info: &CellInfo) -> Option<FrameFault> {
        let Some(last) = self.last_stamp.filter(|_| stamp.is_finite()) else {
            let after = self.last_stamp.unwrap_or(0.0);
            if !stamp.is_finite() {
                return Some(FrameFault::OutOfOrder { stamp, after });
            }
            self.last_stamp = Some(stamp);
            return None;
        };
        let gap = stamp - last;
        if gap == 0.0 {
            return Some(FrameFault::Duplicate { stamp });
        }
        if gap < 0.0 {
            let (latest, count) = self.early.unwrap_or((f64::NEG_INFINITY, 0));
            let count = if stamp > latest { count + 1 } else { 1 };
            if count < SET_BACK {
                self.early = Some((stamp, count));
                return Some(FrameFault::OutOfOrder { stamp, after: last });
            }
        }
        self.early = None;
        self.last_stamp = Some(stamp);
        if !(0.0..=JUMP).contains(&gap) {
            Some(FrameFault::ClockJump { jump: gap })
        } else if gap * info.camera_rate > LATE {
            Some(FrameFault::Late { gap })
        } else {
            None
        }
    }

    fn cloud(
        &mut self,
        observation: &mut Observation,
        model: &CanonicalModel,
        info: &CellInfo,
    ) -> Option<FrameFault> {
        let seen = observation.points.len();
        if seen < FEWEST {
            return Some(FrameFault::Empty { points: seen });
        }
        if self.is_frozen(observation) {
            return Some(FrameFault::Frozen);
        }
        let finite = |p: &Point3<f64>| p.iter().all(|x| x.is_finite());
        observation.retain(finite);
        let count = seen - observation.points.len();
        if 2 * count > seen {
            let points = seen;
            return Some(FrameFault::NonFinitePoints { count, points });
        }
        self.take_out(observation, model, info);
        let left = observation.points.len();
        if left < FEWEST {
            Some(FrameFault::Empty { points: left })
        } else if left < seen {
            Some(FrameFault::Foreign {
                points: seen - left,
            })
        } else {
            None
        }
    }

    fn is_frozen(&mut self, observation: &Observation) -> bool {
        let bits = |p: &Point3<f64>| [p.x, p.y, p.z].map(f64::to_bits);
        let same = self.cloud.len() == observation.points.len()
            && self
                .cloud
                .iter()
                .zip(&observation.points)
                .all(|(a, b)| bits(a) == bits(b));
        if same {
            let carried = |(then, now): (&ArmState, &ArmState)| {
                let way = then.camera_from_tip.translation.vector
                    - now.camera_from_tip.translation.vector;
                now.holding && way.norm() > CHANGES
            };
            return self.noisy || self.since.iter().zip(&observation.arms).any(carried);
        }
        let rests = |(a, b): (&ArmState, &ArmState)| {
            !a.holding && !b.holding && a.camera_from_tip == b.camera_from_tip
        };
        if !self.noisy && self.since.iter().zip(&observation.arms).all(rests) {
            self.differences += usize::from(differ_by_noise(&self.cloud, &observation.points));
            self.noisy = self.differences >= NOISY;
        }
        self.cloud.clone_from(&observation.points);
        self.since.clone_from(&observation.arms);
        false
    }

    /// Points on the table or on a tool that are well away from the model.
    fn take_out(&self, observation: &mut Observation, model: &CanonicalModel, info: &CellInfo) {
        let tools: Vec<(Isometry3<f64>, f64)> = observation
            .arms
            .iter()
            .zip(&info.arms)
            .map(|(state, arm)| (state.camera_from_tip.inverse(), arm.jaw_radius))
            .collect();
        let on_tool = |p: &Point3<f64>| {
            tools.iter().any(|(tip_from_camera, radius)| {
                let q = tip_from_camera * p;
                (-TOOL..=*radius).contains(&q.z) && q.x.hypot(q.y) < 1.5 * radius
            })
        };
        let suspect = |p: &Point3<f64>| info.table.height(p).abs() < ON_TABLE || on_tool(p);
        if !observation.points.iter().any(suspect) {
            return;
        }
        let Some(tree) = graph::tree(model.live()) else {
            return;
        };
        let away = AWAY * self.spacing;
        observation.retain(|p| !suspect(p) || graph::nearest(&tree, p).1 < away);
    }
}

/// Whether points have moved to and fro, and not together as those of something that settles.
fn differ_by_noise(before: &[Point3<f64>], now: &[Point3<f64>]) -> bool {
    if before.is_empty() || before.len() != now.len() {
        return false;
    }
    let count = now.len() as f64;
    let moves = || before.iter().zip(now).map(|(a, b)| b - a);
    let together = (moves().sum::<Vector3<f64>>() / count).norm();
    let each = moves().map(|m| m.norm()).sum::<f64>() / count;
    each > NOISE && each > 3.0 * together
}

fn finite(pose: &Isometry3<f64>) -> bool {
    pose.to_homogeneous().iter().all(|x| x.is_finite())
}
