//! Checks each frame for faults, and decides which part of it can be used.
//!
//! ```text
//! stamp     earlier: dropped, unless the clock was evidently set back;  same: dropped;  much later: used, but the arms are stopped
//! poses     not finite: the frame is dropped, the arm keeps its last known pose
//! cloud     bit-identical to the last one although it should differ: dropped;  almost empty: dropped
//! points    not finite, on the bare table, on a tool: removed; the rest is used
//! ```
//!
//! *Should differ*: once images of a resting object have differed, the camera is known to be noisy and never repeats an image; before that, a cloud
//! must change only if a tip that holds something moves. *Bare table* and *on a tool* are only points well away from the model: nearer ones may belong to it.

use crate::canonical::CanonicalModel;
use crate::canonical::graph;
use crate::cell::{ArmState, CellInfo, Observation};
use nalgebra::{Isometry3, Point3, Vector3};

/// What was wrong with a frame.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FrameFault {
    /// It shows almost nothing of the object.
    #[error("the frame shows {points} points of the object")]
    Empty {
        /// Points seen.
        points: usize,
    },
    /// The same cloud again, although it should differ.
    #[error("the cloud is bit-identical to the one before")]
    Frozen,
    /// The same stamp again.
    #[error("a second frame is stamped {stamp:.3} s")]
    Duplicate {
        /// The stamp, seconds.
        stamp: f64,
    },
    /// Its stamp is earlier than that of a previous frame, or not finite.
    #[error("a frame stamped {stamp:.3} s follows one of {after:.3} s")]
    OutOfOrder {
        /// Its stamp, seconds.
        stamp: f64,
        /// The latest stamp before it, seconds.
        after: f64,
    },
    /// It came late, but was used.
    #[error("no frame for {gap:.2} s")]
    Late {
        /// Time since the previous frame, seconds.
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
    /// An arm does not report its pose.
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
    /// Points that do not belong to the object were removed; the rest was used.
    #[error("{points} points were removed: on the table, on tools, or not finite")]
    Foreign {
        /// How many.
        points: usize,
    },
    /// The body did not fit for several frames; the arms wait.
    #[error("{frames} frames in a row did not fit")]
    Misfits {
        /// How many.
        frames: usize,
    },
    /// The reconstruction rejected it.
    #[error("the reconstruction rejected the frame: {reason}")]
    Refused {
        /// The reason.
        reason: String,
    },
}

impl FrameFault {
    /// A keyword for tables.
    pub fn word(&self) -> &'static str {
        match self {
            Self::Empty { .. } => "empty",
            Self::Frozen => "frozen",
            Self::Duplicate { .. } => "duplicate",
            Self::OutOfOrder { .. } => "out_of_order",
            Self::Late { .. } => "late",
            Self::ClockJump { .. } => "clock_jump",
            Self::NonFinitePoints { .. } => "non_finite_points",
            Self::NonFinitePose { .. } => "non_finite_pose",
            Self::WrongArms { .. } => "wrong_arms",
            Self::Foreign { .. } => "foreign",
            Self::Misfits { .. } => "misfits",
            Self::Refused { .. } => "refused",
        }
    }

    /// Whether the rest of the frame could be used.
    pub fn is_usable(&self) -> bool {
        matches!(
            self,
            Self::Late { .. }
                | Self::ClockJump { .. }
                | Self::Foreign { .. }
                | Self::Misfits { .. }
        )
    }

    /// Whether the poses of the arms are uncertain because of it.
    pub fn is_of_arms(&self) -> bool {
        matches!(self, Self::NonFinitePose { .. } | Self::WrongArms { .. })
    }

    /// Whether the arms must be stopped.
    pub fn is_serious(&self) -> bool {
        !matches!(self, Self::Foreign { .. })
    }
}

/// Fewest points of a usable frame.
const FEWEST: usize = 20;
/// Number of periods without a frame after which the next one is late, and of seconds after which the clock must have been set.
const LATE: f64 = 2.6;
const JUMP: f64 = 2.0;
/// Number of consecutive frames with early but increasing stamps after which the clock counts as set back.
const SET_BACK: usize = 3;
/// Mean difference between noisy clouds, metres, and the number of such differences that prove a noisy camera.
const NOISE: f64 = 2e-5;
const NOISY: usize = 3;
/// Distance that a holding tip can move without changing the cloud, metres.
const CHANGES: f64 = 0.002;
/// Points this near to the table may lie on it, metres; points this far from the model, in spacings, do not belong to the object.
const ON_TABLE: f64 = 0.002;
const AWAY: f64 = 2.5;
/// Length of a tool behind its tip, metres.
const TOOL: f64 = 0.3;

/// Checks frames one after the other.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub(super) struct Guard {
    spacing: f64,
    last_stamp: Option<f64>,
    /// The latest of the frames with early stamps, and their number.
    early: Option<(f64, usize)>,
    cloud: Vec<Point3<f64>>,
    /// Poses of the arms when this cloud was first seen.
    since: Vec<ArmState>,
    noisy: bool,
    /// Number of clouds of the resting object that differed by noise.
    differences: usize,
    /// The last known states of the arms.
    arms: Vec<ArmState>,
}

/// A checked frame.
pub(super) struct Judged {
    /// The usable part, with the present or the last known poses of the arms.
    pub observation: Observation,
    /// What was wrong with it.
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

    /// The next frame may come late: a jaw closes, or a plan is computed.
    pub fn pause(&mut self) {
        self.last_stamp = None;
    }

    /// Checks a frame; `model` is the object before it.
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

    /// Replaces poses that are not finite by the last known ones.
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

    /// Removes points on the table or on a tool that are well away from the model.
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

/// Whether points have moved in different directions, unlike those of an object that settles.
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
