//! The checks of one arm: its entry in the file, and what it reports.

use std::time::Duration;

use dvrk_io::arm::{Arm, Mode};
use dvrk_io::calibration::CheckOptions;
use dvrk_io::kinematics::Joint;

use super::entries::ArmEntry;
use super::file::CellFile;

/// Age of a joint reading, in either direction, that indicates unsynchronised clocks, seconds.
const CLOCKS: f64 = 0.1;
/// The finding for an arm without power.
const NOT_YET: &str = "not reported before the arm is powered";

/// The calibration from camera to arm, and its residuals.
pub(super) fn calibration(file: &CellFile, entry: &ArmEntry) -> Result<String, String> {
    let Some(found) = &entry.calibrated else {
        return Ok("camera_from_base of the file, without residuals".into());
    };
    let (frame, camera) = (&found.camera_frame, &file.camera.frame);
    let text = format!(
        "{} samples, {} of them rejected, residuals {:.1} mm rms and {:.1} mm at most",
        found.samples,
        found.outliers.len(),
        1e3 * found.rms,
        1e3 * found.max
    );
    if frame != camera {
        Err(format!(
            "it is for the frame {frame}, but the camera has {camera}"
        ))
    } else if found.rms > CheckOptions::default().limit {
        Err(format!("{text}: calibrate anew"))
    } else {
        Ok(text)
    }
}

/// The speed limit of the arm, and the distance of its home from the limits of its joints.
pub(super) fn limits(file: &CellFile, entry: &ArmEntry) -> Result<String, String> {
    let margins = entry.kinematics().and_then(|arm| arm.margins(&entry.home));
    let margins = margins.map_err(|error| error.to_string())?;
    let joints = Joint::ALL.into_iter().zip(margins.joints);
    let beyond = joints.filter(|(_, margin)| *margin < 0.0);
    let names: Vec<&str> = beyond.map(|(joint, _)| joint.name()).collect();
    if !names.is_empty() {
        return Err(format!(
            "its home is beyond the limits of {}",
            names.join(", ")
        ));
    }
    let [yaw, pitch, insertion, turns @ ..] = margins.joints;
    let angle = turns
        .into_iter()
        .chain([yaw, pitch])
        .fold(f64::INFINITY, f64::min);
    Ok(format!(
        "at most {:.0} mm/s and {:.1} m/s²; at home {angle:.2} rad and {:.0} mm from the nearest limits of its joints",
        1e3 * file.limits.speed.get(),
        file.limits.acceleration.get(),
        1e3 * insertion
    ))
}

pub(super) fn state(arm: &Arm) -> Result<String, String> {
    let status = arm.status();
    if status.mode == Mode::Fault {
        return Err(format!(
            "{status}: find out why, and clear the fault at the console"
        ));
    }
    Ok(format!(
        "{status}, {}, instrument {}",
        arm.dialect(),
        arm.tool().unwrap_or("not reported")
    ))
}

pub(super) fn clocks(arm: &Arm, now: Duration) -> Result<String, String> {
    let Some(joints) = arm.joints() else {
        return Ok(NOT_YET.into());
    };
    let age = now.as_secs_f64() - joints.stamp.as_secs_f64();
    let text = format!("readings are {:.0} ms old", 1e3 * age);
    if age.abs() <= CLOCKS {
        Ok(text)
    } else {
        Err(format!("{text}: are the clocks synchronised?"))
    }
}

pub(super) fn empty(arm: &Arm, entry: &ArmEntry) -> Result<String, String> {
    let Some(jaw) = arm.jaw() else {
        return Ok(NOT_YET.into());
    };
    let (angle, gap) = (jaw.value.angle, jaw.value.gap());
    if gap > entry.jaw.holds_above.get() {
        return Err(format!(
            "it seems to hold something, {gap:.2} rad more open than commanded: an exploration begins by opening the jaws"
        ));
    }
    Ok(format!("{angle:.2} rad, holds nothing"))
}

pub(super) fn frames(arm: &mut Arm) -> Result<String, String> {
    if arm.status().mode != Mode::Enabled {
        return Ok("not reported before the arm is powered; checked then".into());
    }
    let found = arm.check().map_err(|error| error.to_string())?;
    Ok(format!(
        "pose and joints agree to {:.1} mm, control point: {}",
        1e3 * found.distance,
        found.control_point
    ))
}

pub(super) fn nobody_else(arm: &Arm) -> Result<String, String> {
    let others = arm.other_writers();
    if arm.is_teleoperated() {
        Err("teleoperation is enabled at the console: switch it off".into())
    } else if arm.is_clutched() {
        Err("the arm is guided by hand".into())
    } else if others.is_empty() {
        Ok("nobody".into())
    } else {
        Err(format!("another node publishes {}", others.join(", ")))
    }
}
