//! A recorded session as a cell: it can be observed but not commanded.

use super::noise::Noise;
use super::scans::ObjectFrames;
pub use super::scans::{RecordedArm, ScanOptions};
use super::{ArmInfo, ArmState, Cell, CellError, CellInfo, Observation, Plane};
use dvrk_io::depth::{LengthUnit, UnitSource};
use dvrk_io::session::{Frame, Frames, Scans, Session, Skipped};
use mesh_io::three_digits;
use nalgebra::{Isometry3, Point3, UnitVector3};

/// A jaw at an angle below this counts as holding something, rad.
const CLOSED: f64 = 0.05;
/// If the commanded jaw angle is known: a jaw that stays this much more open counts as holding something, rad.
const HOLDS_ABOVE: f64 = 0.08;
/// Distance of the assumed table where none was recorded, m.
const FAR_BELOW: f64 = 1e3;
/// Plausible distances of points from a depth camera, m.
const DISTANCES: std::ops::RangeInclusive<f64> = 0.01..=20.0;

/// Plays a session that `dvrk-io` has read, or reads while it is played.
///
/// ```
/// use dvrk_io::session::{SessionReader, SessionWriter};
/// use explore_loop::cell::replay::ReplayCell;
/// use explore_loop::cell::{Cell, CellError};
/// use explore_loop::nalgebra::Point3;
///
/// # let folder = tempfile::tempdir()?;
/// # let path = folder.path().join("session.mcap");
/// let mut writer = SessionWriter::create(&path)?;
/// writer.points(1.0, &[Point3::new(0.0, 0.0, 0.5)])?;
/// writer.points(1.1, &[Point3::new(0.0, 0.0, 0.5), Point3::new(0.01, 0.0, 0.5)])?;
/// writer.finish()?;
///
/// let mut cell = ReplayCell::new(SessionReader::open(&path)?)?;
/// assert_eq!((cell.remaining(), cell.has_table()), (2, false));
/// assert_eq!(cell.observe()?.points.len(), 1);
/// assert_eq!(cell.observe()?.points.len(), 2);
/// assert!(matches!(cell.observe(), Err(CellError::Ended)));
/// assert!(matches!(cell.home(), Err(CellError::ReadOnly)));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct ReplayCell {
    info: CellInfo,
    frames: Source,
    last: Vec<ArmState>,
    /// Whether a frame has shown that the points are in metres.
    in_metres: bool,
    noise: Option<Noise>,
}

impl std::fmt::Debug for ReplayCell {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ReplayCell")
            .field("info", &self.info)
            .finish_non_exhaustive()
    }
}

enum Source {
    Memory(std::vec::IntoIter<Frame>),
    File(Box<Frames<'static>>),
    Scans(Box<ObjectFrames>),
}

impl ReplayCell {
    /// A cell over the frames of `session`. Without a recorded table, one far below everything is assumed.
    ///
    /// # Errors
    /// A session without frames.
    pub fn new(session: Session) -> Result<Self, CellError> {
        let stamps = session.frames.iter().map(|frame| frame.stamp);
        let info = info(&session.arm_names, session.table, stamps)?;
        Ok(Self::of(info, Source::Memory(session.frames.into_iter())))
    }

    /// A cell over frames that are read from their file as they are observed.
    ///
    /// # Errors
    /// A session without frames.
    pub fn streamed(frames: Frames<'static>) -> Result<Self, CellError> {
        let info = info(frames.arm_names(), frames.table(), frames.stamps())?;
        Ok(Self::of(info, Source::File(Box::new(frames))))
    }

    /// A cell over scans of everything in view: table and arms are removed, and the object is found, when a scan is observed. Arms that the
    /// options do not list are not removed.
    ///
    /// # Errors
    /// A recording without scans, or in which no table is found; an arm without joint values.
    pub fn of_scans(scans: Scans<'static>, options: ScanOptions) -> Result<Self, CellError> {
        let stamps: Vec<f64> = scans.stamps().collect();
        let frames = ObjectFrames::new(scans, options)?;
        let table = Some((frames.table().normal, frames.table().offset));
        let info = info(&frames.names(), table, stamps.into_iter())?;
        Ok(Self::of(info, Source::Scans(Box::new(frames))))
    }

    fn of(info: CellInfo, frames: Source) -> Self {
        let last = info.arms.iter().map(|_| idle()).collect();
        Self {
            info,
            frames,
            last,
            in_metres: false,
            noise: None,
        }
    }

    /// Adds independent Gaussian noise of standard deviation `sigma`, m, to every coordinate of every point. A recording can be replayed only once otherwise;
    /// with noise far below that of its camera and a few seeds, one can tell an improvement of the reconstruction from chance. The same seed gives the same bits.
    ///
    /// # Errors
    /// A standard deviation that is negative or not finite.
    pub fn with_noise(mut self, sigma: f64, seed: u64) -> Result<Self, CellError> {
        let noise = Noise::new(sigma, seed).ok_or_else(|| {
            CellError::Failed(format!(
                "noise of {sigma} m: the standard deviation must be finite, and not negative"
            ))
        })?;
        self.noise = Some(noise);
        Ok(self)
    }

    /// Whether the pose of any arm was recorded.
    pub fn has_poses(&self) -> bool {
        match &self.frames {
            Source::Memory(frames) => {
                let mut arms = frames.as_slice().iter().flat_map(|frame| &frame.arms);
                arms.any(|arm| arm.pose.is_some())
            }
            Source::File(frames) => frames.has_poses(),
            Source::Scans(frames) => !frames.names().is_empty(),
        }
    }

    /// Whether a table was recorded.
    pub fn has_table(&self) -> bool {
        self.info.table.offset < FAR_BELOW
    }

    /// Frames not yet observed.
    pub fn remaining(&self) -> usize {
        match &self.frames {
            Source::Memory(frames) => frames.len(),
            Source::File(frames) => frames.stamps().len(),
            Source::Scans(frames) => frames.remaining(),
        }
    }

    /// What could not be read so far, if the session is read while it is played.
    pub fn skipped(&self) -> Option<&Skipped> {
        match &self.frames {
            Source::Memory(_) => None,
            Source::File(frames) => Some(frames.skipped()),
            Source::Scans(frames) => Some(frames.skipped()),
        }
    }

    /// The share of the points of the last scan, without arms, that lay on the table; `None` for a recording of the object alone.
    pub fn on_table(&self) -> Option<f64> {
        match &self.frames {
            Source::Memory(_) | Source::File(_) => None,
            Source::Scans(frames) => frames.on_table(),
        }
    }

    /// The unit of the last scan, and how it was determined; `None` for a recording of the object alone.
    pub fn unit(&self) -> Option<(LengthUnit, UnitSource)> {
        match &self.frames {
            Source::Memory(_) | Source::File(_) => None,
            Source::Scans(frames) => frames.unit(),
        }
    }

    fn next(&mut self) -> Result<Frame, CellError> {
        match &mut self.frames {
            Source::Memory(frames) => frames.next().ok_or(CellError::Ended),
            Source::File(frames) => read(frames.next()),
            Source::Scans(frames) => read(frames.next()),
        }
    }
}

fn read(frame: Option<Result<Frame, dvrk_io::Error>>) -> Result<Frame, CellError> {
    let frame = frame.ok_or(CellError::Ended)?;
    frame.map_err(|error| CellError::Failed(error.to_string()))
}

fn info(
    names: &[String],
    table: Option<(UnitVector3<f64>, f64)>,
    mut stamps: impl ExactSizeIterator<Item = f64>,
) -> Result<CellInfo, CellError> {
    let count = stamps.len();
    let Some(first) = stamps.next() else {
        return Err(CellError::Failed(
            "the session has no frames with points".into(),
        ));
    };
    let span = stamps.last().unwrap_or(first) - first;
    let far_below = (-nalgebra::Vector3::z_axis(), FAR_BELOW);
    let (normal, offset) = table.unwrap_or(far_below);
    Ok(CellInfo {
        arms: names.iter().map(|name| recorded_arm(name)).collect(),
        table: Plane { normal, offset },
        camera_rate: if span > 0.0 {
            (count - 1) as f64 / span
        } else {
            1.0
        },
    })
}

/// Median distance of the finite points from the camera, m; robust against outliers.
fn middle_distance(points: &[Point3<f64>]) -> Option<f64> {
    let distances = points.iter().map(|p| p.coords.norm());
    let mut distances: Vec<f64> = distances.filter(|d| d.is_finite() && *d > 0.0).collect();
    let middle = distances.len() / 2;
    (!distances.is_empty()).then(|| *distances.select_nth_unstable_by(middle, f64::total_cmp).1)
}

fn recorded_arm(name: &str) -> ArmInfo {
    ArmInfo {
        name: name.to_owned(),
        camera_from_home: Isometry3::identity(),
        base: Point3::origin(),
        reach: 0.0,
        poses: None,
        jaw_radius: 0.0,
        max_speed: 0.0,
    }
}

fn idle() -> ArmState {
    ArmState {
        camera_from_tip: Isometry3::identity(),
        jaw: 1.0,
        holding: false,
        moving: false,
    }
}

impl Cell for ReplayCell {
    fn info(&self) -> &CellInfo {
        &self.info
    }

    /// # Errors
    /// [`CellError::Ended`] after the last frame; [`CellError::Failed`] if the file can no longer be read, or if the first points cannot be in
    /// metres.
    fn observe(&mut self) -> Result<Observation, CellError> {
        let frame = self.next()?;
        if let Some(distance) = middle_distance(&frame.points).filter(|_| !self.in_metres) {
            if !DISTANCES.contains(&distance) {
                return Err(CellError::Failed(format!(
                    "the median distance of the points is {} m, outside the {} m to {} m of a depth camera: the points must be in metres",
                    three_digits(distance),
                    DISTANCES.start(),
                    DISTANCES.end()
                )));
            }
            self.in_metres = true;
        }
        for (info, state) in self.info.arms.iter().zip(&mut self.last) {
            let sample = frame.arms.iter().find(|a| a.name == info.name);
            let pose = sample.and_then(|s| s.pose);
            state.moving = pose.is_some_and(|p| p != state.camera_from_tip);
            state.camera_from_tip = pose.unwrap_or(state.camera_from_tip);
            state.jaw = sample.and_then(|s| s.jaw).unwrap_or(state.jaw);
            // A pose without a jaw angle comes from the recorder of a simulation, which published arms only while they held; joint values do not tell about jaws.
            let closed = match sample.and_then(|s| s.jaw) {
                Some(jaw) => jaw < CLOSED,
                None => !matches!(self.frames, Source::Scans(_)),
            };
            let kept_open = sample.and_then(|s| Some(s.jaw? - s.jaw_setpoint?));
            let holds = kept_open.map_or(closed, |gap| gap > HOLDS_ABOVE);
            state.holding = pose.is_some() && holds;
        }
        let mut points = frame.points;
        if let Some(noise) = &mut self.noise {
            noise.add(&mut points);
        }
        let measured = Observation {
            stamp: frame.stamp,
            camera: frame.camera,
            points,
            colours: frame.colours,
            features: frame.features,
            arms: self.last.clone(),
        };
        Ok(match &frame.camera {
            Some(fixed_from_camera) => measured.carried(fixed_from_camera),
            None => measured,
        })
    }

    fn move_arm(&mut self, _: usize, _: Isometry3<f64>, _: f64) -> Result<(), CellError> {
        Err(CellError::ReadOnly)
    }

    fn close_jaw(&mut self, _: usize) -> Result<(), CellError> {
        Err(CellError::ReadOnly)
    }

    fn open_jaw(&mut self, _: usize) -> Result<(), CellError> {
        Err(CellError::ReadOnly)
    }

    fn home(&mut self) -> Result<(), CellError> {
        Err(CellError::ReadOnly)
    }

    fn stop(&mut self) -> Result<(), CellError> {
        Err(CellError::ReadOnly)
    }
}
