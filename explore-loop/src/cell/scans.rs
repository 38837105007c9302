//! A recording of everything in view, as frames of the object: table and arms are removed as in a cell of dVRK arms.
//!
//! ```text
//! joint values of the arms ─► their links ─┐
//! cloud or depth image ────────────────────┴─► find_object ─► points of the object
//! ```

use derive_setters::Setters;
use dvrk_io::depth::{Capsule, LengthUnit, UnitSource};
use dvrk_io::kinematics::Kinematics;
use dvrk_io::session::{ArmSample, Frame, RecordedScan, Role, Scans, Skipped};
use nalgebra::{Isometry3, Point3};

use super::see::{Eye, links};
use super::{CellError, Plane};

/// An arm whose joint values were recorded.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct RecordedArm {
    /// Its name, such as `PSM1`.
    pub name: String,
    /// Its kinematic lengths and limits.
    pub kinematics: Kinematics,
    /// Pose of the frame of its remote centre.
    pub camera_from_rcm: Isometry3<f64>,
    /// Half the width that fits between its open jaws, metres.
    pub jaw_radius: f64,
}

/// Prior knowledge about a recording.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct ScanOptions {
    /// The arms in view. Default: none.
    pub arms: Vec<RecordedArm>,
    /// The table. Default: the recorded one, else it is found in the first scan.
    pub table: Option<Plane>,
    /// Points within this distance of an arm are removed with it, metres. Default 0.005.
    pub arm_clearance: f64,
    /// A point on or next to the object, camera frame, metres. Default: the largest body is the object.
    pub seed: Option<Point3<f64>>,
}

impl Default for ScanOptions {
    fn default() -> Self {
        Self {
            arms: Vec::new(),
            table: None,
            arm_clearance: 0.005,
            seed: None,
        }
    }
}

/// An arm, and its latest joint values.
struct Arm {
    about: RecordedArm,
    joints: Option<[f64; 6]>,
}

/// Frames of the object, each found on demand.
pub(super) struct ObjectFrames {
    scans: Scans<'static>,
    eye: Eye,
    arms: Vec<Arm>,
    table: Plane,
    unit: Option<(LengthUnit, UnitSource)>,
    /// The frame in which the table was found.
    first: Option<Frame>,
}

impl ObjectFrames {
    /// # Errors
    /// An arm without joint values; no table in view.
    pub fn new(scans: Scans<'static>, options: ScanOptions) -> Result<Self, CellError> {
        let recorded = |arm: &&RecordedArm| !scans.arm_names().contains(&arm.name);
        if let Some(arm) = options.arms.iter().find(recorded) {
            let topic = Role::Joints(arm.name.clone()).topic();
            return Err(CellError::Failed(format!(
                "{} has no joint values in the recording ({topic}): its links cannot be removed from the cloud",
                arm.name
            )));
        }
        let plane = |(normal, offset)| Plane { normal, offset };
        let table = options.table.or_else(|| scans.table().map(plane));
        let arms = options.arms.into_iter();
        let mut frames = Self {
            eye: Eye::new(table, options.arm_clearance, options.seed),
            arms: arms
                .map(|about| Arm {
                    about,
                    joints: None,
                })
                .collect(),
            // A placeholder until the table is found.
            table: table.unwrap_or(Plane {
                normal: -nalgebra::Vector3::z_axis(),
                offset: f64::INFINITY,
            }),
            scans,
            unit: None,
            first: None,
        };
        frames.find_table()?;
        Ok(frames)
    }

    /// Reads scans until one is usable and the table is known.
    fn find_table(&mut self) -> Result<(), CellError> {
        let mut why = None;
        while self.first.is_none() || self.eye.table().is_none() {
            let Some(scan) = self.scans.next() else {
                let unread = || "no scan of the recording can be read".to_owned();
                let found = |why| format!("no table was found: {why}");
                return Err(CellError::Failed(why.map_or_else(unread, found)));
            };
            let scan = scan.map_err(|error| CellError::Failed(error.to_string()))?;
            let (frame, error) = self.frame(&scan);
            self.first = Some(frame);
            why = error.map(|error| error.to_string()).or(why);
        }
        self.table = self.eye.table().unwrap_or(self.table);
        Ok(())
    }

    pub fn table(&self) -> Plane {
        self.table
    }

    pub fn names(&self) -> Vec<String> {
        self.arms.iter().map(|arm| arm.about.name.clone()).collect()
    }

    pub fn remaining(&self) -> usize {
        self.scans.stamps().len() + usize::from(self.first.is_some())
    }

    pub fn skipped(&self) -> &Skipped {
        self.scans.skipped()
    }

    pub fn on_table(&self) -> Option<f64> {
        self.eye.on_table()
    }

    pub fn unit(&self) -> Option<(LengthUnit, UnitSource)> {
        self.unit
    }

    /// The frame of a scan, and why nothing was found in it, if so; such a frame has no points.
    fn frame(&mut self, scan: &RecordedScan) -> (Frame, Option<dvrk_io::Error>) {
        self.unit = Some(scan.scan.unit());
        let mut arms = Vec::new();
        let mut capsules = Some(Vec::new());
        for arm in &mut self.arms {
            let sample = scan
                .arms
                .iter()
                .find(|sample| sample.name == arm.about.name);
            let joints = sample.and_then(|sample| sample.joints);
            arm.joints = joints.or(arm.joints);
            let hidden = arm.joints.and_then(|joints| arm.about.links(&joints));
            capsules = capsules
                .zip(hidden)
                .map(|(all, of_arm)| [all, of_arm].concat());
            arms.push(ArmSample {
                name: arm.about.name.clone(),
                pose: joints.and_then(|joints| arm.about.tip(&joints)),
                jaw: sample.and_then(|sample| sample.jaw),
                jaw_setpoint: sample.and_then(|sample| sample.jaw_setpoint),
                joints,
            });
        }
        // The visible links of an arm must be known, or they would be taken for the object.
        let seen = capsules.map(|capsules| self.eye.look(&scan.scan, &capsules));
        let (seen, why) = match seen {
            Some(Ok(seen)) => (seen, None),
            Some(Err(error)) => (super::see::Seen::default(), Some(error)),
            None => (super::see::Seen::default(), None),
        };
        let frame = Frame {
            camera: None,
            stamp: scan.stamp,
            points: seen.points,
            colours: seen.colours,
            features: seen.features,
            arms,
        };
        (frame, why)
    }
}

impl Iterator for ObjectFrames {
    type Item = Result<Frame, dvrk_io::Error>;

    fn next(&mut self) -> Option<Self::Item> {
        if let Some(first) = self.first.take() {
            return Some(Ok(first));
        }
        let scan = self.scans.next()?;
        Some(scan.map(|scan| self.frame(&scan).0))
    }
}

impl RecordedArm {
    /// The links that may be in view; `None` for joint values outside the range of the arm.
    fn links(&self, joints: &[f64; 6]) -> Option<Vec<Capsule>> {
        let found = links(
            &self.kinematics,
            &self.camera_from_rcm,
            joints,
            self.jaw_radius,
        );
        found.ok()
    }

    fn tip(&self, joints: &[f64; 6]) -> Option<Isometry3<f64>> {
        let tip = self.kinematics.rcm_from_tip(joints).ok()?;
        Some(self.camera_from_rcm * tip.0)
    }
}
