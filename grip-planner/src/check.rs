//! Checks whether a motion is feasible.
//!
//! At every key frame and half-way between: each tip in its workspace; tip, jaws and wrist above the table; the tools apart; and no tool
//! in the body, which moves. For each tool the body is treated as rigid:
//!
//! ```text
//! at rest                   camera_from_body = constant
//! moved by a tip            camera_from_body = T(p(t)) · R(t) · T(−p(0))
//! ```
//!
//! with `R` the rotation of the body and `p` the tip of that tool, or the centre of the lifting tips for a tool that does not hold. A soft body hangs lower than
//! that, away from the tools, but where a tool holds it there is tissue in any case. The poses of the tools are transformed to the frame of the body at
//! rest, so the obstacle is built once.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, UnitVector3, Vector3};

use crate::body::{Body, Tool};
use crate::motion::between;
use crate::{ArmPath, Motion, Refusal, Role, Scene};

/// Tolerance for rounding of poses exactly at a bound (the grasp itself may be at the clearance).
const ROUNDING: f64 = 1e-9;

/// How the body moves with the tools.
pub(crate) enum Carried<'a> {
    /// It rests at `body_from_camera`; jaws are in it within `approach` metres of a grasp.
    Still {
        body_from_camera: Isometry3<f64>,
        grasps: &'a [Point3<f64>],
        approach: f64,
    },
    /// It is held, and rotated by these angles at every key frame.
    Turned {
        turned: &'a [UnitQuaternion<f64>],
        /// Distance from its release within which a supporting tool is still leaving its grip.
        leaving: f64,
    },
}

/// What a motion is checked against.
pub(crate) struct Surroundings<'a> {
    pub(crate) scene: &'a Scene<'a>,
    pub(crate) body: &'a Body,
    jaws: f64,
}

/// A moment of a motion: between two key frames, or at one.
#[derive(Clone, Copy)]
struct Moment {
    frame: usize,
    share: f64,
    time: f64,
}

impl<'a> Surroundings<'a> {
    pub(crate) fn new(scene: &'a Scene<'a>, body: &'a Body) -> Self {
        Self {
            scene,
            body,
            jaws: scene.jaw_length(),
        }
    }

    /// Rejects a motion that leaves a workspace, collides with the table or the body, or lets two tools collide.
    pub(crate) fn check(&self, motion: &Motion, carried: &Carried) -> Result<(), Refusal> {
        let Some(first) = motion.arms.first() else {
            return Ok(());
        };
        let frames = &first.keyframes;
        for (frame, key) in frames.iter().enumerate() {
            let at = |share: f64, time: f64| Moment { frame, share, time };
            self.check_moment(motion, carried, at(0.0, key.time))?;
            if let Some(next) = frames.get(frame + 1) {
                self.check_moment(motion, carried, at(0.5, 0.5 * (key.time + next.time)))?;
            }
        }
        Ok(())
    }

    fn check_moment(
        &self,
        motion: &Motion,
        carried: &Carried,
        moment: Moment,
    ) -> Result<(), Refusal> {
        let mut tools: Vec<(usize, Tool)> = Vec::with_capacity(motion.arms.len());
        for path in &motion.arms {
            let pose = pose_at(path, moment);
            let base = &self.scene.arms[path.arm].base;
            let tool = Tool::new(&pose, base, self.scene.shaft_length);
            self.check_tip(motion, path.arm, moment, &pose, &tool)?;
            for (other, o) in &tools {
                let distance = tool.distance(o) - 2.0 * self.scene.jaw_radius;
                if distance < self.scene.clearance {
                    return Err(Refusal::ArmsCollide {
                        stage: motion.stage_at(moment.time),
                        arms: [*other, path.arm],
                        time: moment.time,
                        distance,
                    });
                }
            }
            tools.push((path.arm, tool));
        }
        for (path, (_, tool)) in motion.arms.iter().zip(&tools) {
            self.check_body(motion, carried, path, moment, tool)?;
        }
        Ok(())
    }

    fn check_tip(
        &self,
        motion: &Motion,
        arm: usize,
        moment: Moment,
        pose: &Isometry3<f64>,
        tool: &Tool,
    ) -> Result<(), Refusal> {
        let (stage, time) = (motion.stage_at(moment.time), moment.time);
        if !self.scene.arms[arm].workspace.contains(pose) {
            return Err(Refusal::OutOfWorkspace {
                stage,
                arm,
                time,
                position: [tool.tip.x, tool.tip.y, tool.tip.z],
            });
        }
        let table = &self.scene.table;
        let opening = table.normal.dot(&(pose.rotation * Vector3::y())).abs();
        // The tip keeps the clearance; a jaw may touch the table.
        let lowest_jaw = table.height(&tool.tip) - opening * self.scene.jaw_radius;
        let height = table
            .height(&tool.tip)
            .min(lowest_jaw + self.scene.clearance)
            .min(table.height(&tool.wrist));
        if height < self.scene.clearance - ROUNDING {
            return Err(Refusal::HitsTable {
                stage,
                arm,
                time,
                height,
                clearance: self.scene.clearance,
            });
        }
        Ok(())
    }

    fn check_body(
        &self,
        motion: &Motion,
        carried: &Carried,
        path: &ArmPath,
        moment: Moment,
        tool: &Tool,
    ) -> Result<(), Refusal> {
        let (body_from_camera, jaws) = match carried {
            Carried::Still {
                body_from_camera,
                grasps,
                approach,
            } => {
                let near = |g: &Point3<f64>| (g - tool.tip).norm() <= approach + ROUNDING;
                let inside = grasps.iter().any(near);
                (*body_from_camera, if inside { self.jaws } else { 0.0 })
            }
            Carried::Turned { turned, leaving } => {
                let holds = path.role == Role::Lift || moment.time <= path.release;
                let let_go = path.at(path.release).unwrap_or_else(Isometry3::identity);
                let let_go = Point3::from(let_go.translation.vector);
                let near = holds || (let_go - tool.tip).norm() <= *leaving;
                // A released part of the body stays where it was released.
                let by = near.then_some((path, if holds { tool.tip } else { let_go }));
                let body = carried_by(motion, by, moment, turned_at(turned, moment));
                (body.inverse(), if near { self.jaws } else { 0.0 })
            }
        };
        let tool = tool.seen_from(&body_from_camera);
        let parts = tool.shaft(jaws).into_iter().chain([tool.link()]);
        for part in parts {
            if let Some((vertex, distance)) = self.body.hit(part) {
                return Err(Refusal::HitsBody {
                    stage: motion.stage_at(moment.time),
                    arm: path.arm,
                    time: moment.time,
                    vertex,
                    distance,
                });
            }
        }
        Ok(())
    }
}

/// Pose of a body that moves with a tip at a given point, or with the centre of the lifting tips.
fn carried_by(
    motion: &Motion,
    by: Option<(&ArmPath, Point3<f64>)>,
    moment: Moment,
    turned: UnitQuaternion<f64>,
) -> Isometry3<f64> {
    let start = |p: &ArmPath| p.keyframes[0].camera_from_tip.translation.vector;
    let now = |p: &ArmPath| pose_at(p, moment).translation.vector;
    let (from, to) = match by {
        Some((path, tip)) => (start(path), tip.coords),
        None => (
            mean_of_lifting(motion, &start),
            mean_of_lifting(motion, &now),
        ),
    };
    Translation3::from(to) * turned * Translation3::from(-from)
}

fn turned_at(turned: &[UnitQuaternion<f64>], moment: Moment) -> UnitQuaternion<f64> {
    let at = |frame: usize| turned.get(frame).or(turned.last()).copied();
    let [a, b] = [moment.frame, moment.frame + 1].map(|k| at(k).unwrap_or_default());
    // Way points are a few degrees apart, where slerp is defined.
    a.try_slerp(&b, moment.share, 1e-9).unwrap_or(a)
}

/// Pose of the body after a motion that rotated it by `angle` about `axis`, with the centre of the lifting tips.
pub(crate) fn laid_down(motion: &Motion, axis: &UnitVector3<f64>, angle: f64) -> Isometry3<f64> {
    let frames = motion.arms.first().map_or(1, |p| p.keyframes.len());
    let end = Moment {
        frame: frames.saturating_sub(1),
        share: 0.0,
        time: motion.duration,
    };
    let turned = UnitQuaternion::from_axis_angle(axis, angle);
    carried_by(motion, None, end, turned)
}

fn mean_of_lifting(motion: &Motion, at: &dyn Fn(&ArmPath) -> Vector3<f64>) -> Vector3<f64> {
    let lifting: Vec<_> = motion
        .arms
        .iter()
        .filter(|p| p.role == Role::Lift)
        .map(at)
        .collect();
    lifting.iter().sum::<Vector3<f64>>() / lifting.len().max(1) as f64
}

fn pose_at(path: &ArmPath, moment: Moment) -> Isometry3<f64> {
    let from = &path.keyframes[moment.frame].camera_from_tip;
    match path.keyframes.get(moment.frame + 1) {
        Some(to) if moment.share > 0.0 => between(from, &to.camera_from_tip, moment.share),
        _ => *from,
    }
}
