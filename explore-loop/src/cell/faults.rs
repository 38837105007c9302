//! A cell that misbehaves: injects faults into any other cell, to test how a loop handles them.
//!
//! ```text
//! loop ──commands──► FaultyCell ──► cell          an arm may be stuck, be in a fault state, or close on nothing
//! loop ◄──frames──── FaultyCell ◄── cell          frames may be missing, late, frozen, out of order, not finite, dirty
//! ```
//!
//! A [`Fault`] has a kind, a beginning and a duration in frames. The same faults in the same cell give the same frames.

use super::{ArmState, Cell, CellError, CellInfo, Observation};
use nalgebra::{Isometry3, Point3, Translation3, Vector3};

/// The kind of a fault.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[non_exhaustive]
pub enum FaultKind {
    /// Frames without points.
    Empty,
    /// The cloud stays the same while stamps and arms go on.
    Frozen,
    /// Every other frame repeats the previous one, with its stamp.
    Duplicate,
    /// Every other frame is the one from two frames ago.
    OutOfOrder,
    /// This many frames are left out before each one.
    Late {
        /// Frames left out.
        frames: usize,
    },
    /// The clock jumps by this amount, and stays shifted.
    ClockJump {
        /// Seconds; negative is backwards.
        seconds: f64,
    },
    /// A share of the points, at regular intervals, is NaN.
    NonFinitePoints {
        /// From 0 to 1.
        share: f64,
    },
    /// An arm reports a pose that is not finite.
    NonFinitePose {
        /// The arm.
        arm: usize,
    },
    /// A patch of bare table beside the object is left in the cloud.
    Table,
    /// The tools are left in the cloud.
    Tools,
    /// The cloud is rotated about the vertical through its centre, and moved.
    Moved {
        /// Angle, radians.
        turn: f64,
        /// How far, metres, along x of the camera.
        shift: f64,
    },
    /// A jaw opens by itself.
    Slip {
        /// The arm.
        arm: usize,
    },
    /// A jaw closes on nothing.
    Miss {
        /// The arm.
        arm: usize,
    },
    /// An arm accepts commands, reports that it moves, and stays where it is.
    Stuck {
        /// The arm.
        arm: usize,
    },
    /// An arm refuses commands.
    ArmFault {
        /// The arm.
        arm: usize,
    },
    /// The cell fails.
    Failed,
}

/// When a fault begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum Begin {
    /// With this frame, counted from 0.
    Frame(usize),
    /// With this frame in which some jaw holds, counted from 0.
    Held(usize),
    /// With this frame in which some empty arm moves, counted from 0.
    Moving(usize),
}

/// A fault.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Fault {
    /// What goes wrong.
    pub kind: FaultKind,
    /// When it begins.
    pub begin: Begin,
    /// How many frames it lasts.
    pub frames: usize,
}

/// A cell with injected faults.
pub struct FaultyCell<C> {
    cell: C,
    faults: Vec<(Fault, Option<usize>)>,
    frame: usize,
    held: usize,
    moving: usize,
    clock: f64,
    cloud: Vec<Point3<f64>>,
    before: Vec<Observation>,
}

impl<C> std::fmt::Debug for FaultyCell<C> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("FaultyCell")
            .field("faults", &self.faults)
            .field("frame", &self.frame)
            .finish_non_exhaustive()
    }
}

impl<C: Cell> FaultyCell<C> {
    /// `cell` with `faults`.
    pub fn new(cell: C, faults: Vec<Fault>) -> Self {
        Self {
            cell,
            faults: faults.into_iter().map(|f| (f, None)).collect(),
            frame: 0,
            held: 0,
            moving: 0,
            clock: 0.0,
            cloud: Vec::new(),
            before: Vec::new(),
        }
    }

    /// The wrapped cell.
    pub fn inner(&self) -> &C {
        &self.cell
    }

    /// The first frame with each of the faults, counted from 0; `None` before it.
    pub fn began(&self) -> Vec<Option<usize>> {
        self.faults.iter().map(|(_, began)| *began).collect()
    }

    /// The active faults, and for how many frames each has been active.
    fn on(&self) -> Vec<(FaultKind, usize)> {
        let age = |(fault, began): &(Fault, Option<usize>)| {
            let age = self.frame - (*began)?;
            (age < fault.frames).then_some((fault.kind, age))
        };
        self.faults.iter().filter_map(age).collect()
    }

    fn is_on(&self, kind: FaultKind) -> bool {
        self.on().iter().any(|(on, _)| *on == kind)
    }

    fn begin(&mut self) {
        let (frame, held, moving) = (self.frame, self.held, self.moving);
        for (fault, began) in self.faults.iter_mut().filter(|(_, began)| began.is_none()) {
            let due = match fault.begin {
                Begin::Frame(at) => frame >= at,
                Begin::Held(at) => held > at,
                Begin::Moving(at) => moving > at,
            };
            if due {
                *began = Some(frame);
                if let FaultKind::ClockJump { seconds } = fault.kind {
                    self.clock += seconds;
                }
            }
        }
    }

    fn spoil(&mut self, frame: &mut Observation, kind: FaultKind, age: usize) {
        // What spoils the points also spoils the image: no features are recognised in it.
        let spoils = matches!(
            kind,
            FaultKind::Empty | FaultKind::Frozen | FaultKind::Moved { .. }
        );
        frame.features = frame.features.take().filter(|_| !spoils);
        match kind {
            FaultKind::Empty => frame.points.clear(),
            FaultKind::Frozen => frame.points.clone_from(&self.cloud),
            FaultKind::Duplicate | FaultKind::OutOfOrder => {
                let back = if kind == FaultKind::Duplicate { 1 } else { 2 };
                let old = self.before.len().checked_sub(back);
                if let Some(old) = old.filter(|_| age.is_multiple_of(2)) {
                    *frame = self.before[old].clone();
                }
            }
            FaultKind::NonFinitePoints { share } => {
                let mut sum = 0.0;
                for point in &mut frame.points {
                    sum += share;
                    if sum >= 1.0 {
                        sum -= 1.0;
                        point.y = f64::NAN;
                    }
                }
            }
            FaultKind::NonFinitePose { arm } => {
                if let Some(state) = frame.arms.get_mut(arm) {
                    state.camera_from_tip.translation.x = f64::NAN;
                }
            }
            FaultKind::Table => frame.points.extend(self.table(&frame.points)),
            FaultKind::Tools => {
                let tools: Vec<_> = frame.arms.iter().flat_map(tool).collect();
                frame.points.extend(tools);
            }
            FaultKind::Moved { turn, shift } => self.carry(&mut frame.points, turn, shift),
            FaultKind::Stuck { arm } => {
                if let Some(state) = frame.arms.get_mut(arm) {
                    state.moving = true;
                }
            }
            _ => {}
        }
    }

    /// A patch of the table, 5 cm beside the points.
    fn table(&self, points: &[Point3<f64>]) -> Vec<Point3<f64>> {
        let table = self.cell.info().table;
        let right = points.iter().map(|p| p.x).fold(f64::NEG_INFINITY, f64::max);
        let Some(near) = points.first().filter(|_| right.is_finite()) else {
            return Vec::new();
        };
        let at = |k: i32| {
            let (i, j) = (f64::from(k % 20), f64::from(k / 20));
            let p = Point3::new(right + 0.05 + 0.002 * i, near.y + 0.002 * j, near.z);
            p - table.normal.into_inner() * table.height(&p)
        };
        (0..400).map(at).collect()
    }

    fn carry(&self, points: &mut [Point3<f64>], turn: f64, shift: f64) {
        let sum: Vector3<f64> = points.iter().map(|p| p.coords).sum();
        let middle = sum / points.len().max(1) as f64;
        let up = self.cell.info().table.normal.into_inner();
        let moved = Translation3::from(middle + Vector3::x() * shift)
            * Isometry3::rotation(up * turn)
            * Translation3::from(-middle);
        for point in points {
            *point = moved * *point;
        }
    }
}

/// Points round the first 10 cm of a tool.
fn tool(arm: &ArmState) -> Vec<Point3<f64>> {
    let at = |k: i32| {
        let (sin, cos) = (f64::from(k % 8) * std::f64::consts::FRAC_PI_4).sin_cos();
        arm.camera_from_tip * Point3::new(0.004 * cos, 0.004 * sin, -0.0025 * f64::from(k / 8))
    };
    (0..320).map(at).collect()
}

impl<C: Cell> Cell for FaultyCell<C> {
    fn info(&self) -> &CellInfo {
        self.cell.info()
    }

    fn observe(&mut self) -> Result<Observation, CellError> {
        for (kind, _) in self.on() {
            match kind {
                FaultKind::Failed => return Err(CellError::Failed("as it was told to".into())),
                FaultKind::Late { frames } => {
                    for _ in 0..frames {
                        self.cell.observe()?;
                    }
                }
                FaultKind::Slip { arm } => self.cell.open_jaw(arm)?,
                _ => {}
            }
        }
        let mut frame = self.cell.observe()?;
        let on = self.on();
        self.frame += 1;
        let holds = frame.arms.iter().any(|a| a.holding);
        self.held += usize::from(holds);
        let last = self.before.last().map_or(&[][..], |f| &f.arms);
        let goes = |(a, b): (&ArmState, &ArmState)| a.camera_from_tip != b.camera_from_tip;
        self.moving += usize::from(!holds && last.iter().zip(&frame.arms).any(goes));
        self.begin();
        frame.stamp += self.clock;
        let whole = frame.clone();
        for (kind, age) in on {
            self.spoil(&mut frame, kind, age);
        }
        if !self.is_on(FaultKind::Frozen) {
            self.cloud.clone_from(&whole.points);
        }
        self.before.push(whole);
        if self.before.len() > 3 {
            self.before.remove(0);
        }
        Ok(frame)
    }

    fn move_arm(
        &mut self,
        arm: usize,
        camera_from_tip: Isometry3<f64>,
        speed: f64,
    ) -> Result<(), CellError> {
        if self.is_on(FaultKind::ArmFault { arm }) {
            let reason = "as it was told to".into();
            return Err(CellError::ArmFault { arm, reason });
        }
        if self.is_on(FaultKind::Stuck { arm }) {
            return Ok(());
        }
        self.cell.move_arm(arm, camera_from_tip, speed)
    }

    fn close_jaw(&mut self, arm: usize) -> Result<(), CellError> {
        if self.is_on(FaultKind::Miss { arm }) {
            return Err(CellError::NothingGrasped { arm });
        }
        self.cell.close_jaw(arm)
    }

    fn open_jaw(&mut self, arm: usize) -> Result<(), CellError> {
        self.cell.open_jaw(arm)
    }

    fn home(&mut self) -> Result<(), CellError> {
        self.cell.home()
    }

    fn stop(&mut self) -> Result<(), CellError> {
        self.cell.stop()
    }
}
