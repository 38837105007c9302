//! The paths to the grips and back home, with empty jaws.
//!
//! ```text
//! reach      home, rotate in place ─► approach ─► grasp       orientation first, then translation
//! withdraw   end ─► retreat ─► home, rotate back in place
//! ```
//!
//! Three routes are tried, each more careful than the one before: straight, all arms together; up, across at the height of the highest home, and
//! down, together; the same one arm after the other. Where an arm cannot reach a pose of the first, the arms rotate on the way, or at the
//! body, instead of at home; and where a tool cannot back off along itself, it goes straight up. The body at rest is an obstacle all the way, except
//! for the jaws on the straight last part.

use derive_setters::Setters;
use nalgebra::{Isometry3, Point3, Translation3};

use crate::check::{Carried, Surroundings};
use crate::motion::{Pace, assemble, between, times, travelled};
use crate::orientation::retreat;
use crate::scene::positive;
use crate::{Error, Grip, Leg, Motion, Refusal, Scene, Stage};

/// Options of motions of empty arms.
#[derive(Debug, Clone, Copy, PartialEq, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ReachOptions {
    /// Largest speed of an empty tip, m/s; an arm's own limit counts too. Default 0.1.
    pub speed: f64,
    /// Acceleration and deceleration, m/s². Default 0.2.
    pub acceleration: f64,
    /// Largest rotation rate of a tip, rad/s. Default 1.5.
    pub turn_rate: f64,
}

impl Default for ReachOptions {
    fn default() -> Self {
        Self {
            speed: 0.1,
            acceleration: 0.2,
            turn_rate: 1.5,
        }
    }
}

impl ReachOptions {
    pub(crate) fn check(&self) -> Result<(), Error> {
        positive("reach speed", self.speed)?;
        positive("reach acceleration", self.acceleration)?;
        positive("reach turn_rate", self.turn_rate)
    }

    pub(crate) fn pace(&self, grips: &[Grip], scene: &Scene) -> Pace {
        let limit = |most: f64, g: &Grip| most.min(scene.arms[g.arm].max_speed);
        Pace {
            speed: grips.iter().fold(self.speed, limit),
            acceleration: self.acceleration,
            turn_rate: self.turn_rate,
        }
    }
}

/// The route of the arms.
#[derive(Clone, Copy)]
enum Route {
    Straight,
    Over,
    OneByOne,
    /// Rotating on the way.
    Turning,
    /// Rotating at the body, where the tool has backed off.
    TurningThere,
}

/// Largest step between two way points, metres and radians.
const STEP: (f64, f64) = (0.01, 0.1);

/// From home to the grasp.
pub(crate) fn reach(
    around: &Surroundings,
    grips: &[Grip],
    options: &ReachOptions,
) -> Result<Motion, Refusal> {
    let scene = around.scene;
    let level = level(grips, scene);
    let way = |grip: &Grip, route: Route| {
        let home = scene.arms[grip.arm].home;
        if matches!(route, Route::Turning) {
            return vec![home, grip.camera_from_approach, grip.camera_from_tip];
        }
        if matches!(route, Route::TurningThere) {
            let there = with_rotation(&grip.camera_from_approach, &home);
            return vec![home, there, grip.camera_from_approach, grip.camera_from_tip];
        }
        let turned = with_rotation(&home, &grip.camera_from_tip);
        let mut way = vec![home, turned];
        if !matches!(route, Route::Straight) {
            way.push(raised(&turned, scene, level));
            way.push(raised(&grip.camera_from_approach, scene, level));
        }
        way.extend([grip.camera_from_approach, grip.camera_from_tip]);
        way
    };
    let grasps: Vec<Point3<f64>> = grips.iter().map(Grip::tip).collect();
    let approach = grips.iter().map(|g| (g.camera_from_approach, g.tip()));
    let carried = Carried::Still {
        body_from_camera: Isometry3::identity(),
        grasps: &grasps,
        approach: longest(approach),
    };
    first_free(around, grips, options, Stage::Reach, &carried, &way)
}

/// From the end of a motion to home, with the body at `camera_from_body`.
pub(crate) fn withdraw(
    around: &Surroundings,
    grips: &[Grip],
    done: &Motion,
    camera_from_body: &Isometry3<f64>,
    options: &ReachOptions,
) -> Result<Motion, Refusal> {
    let end = |grip: &Grip| {
        let path = done.arms.iter().find(|p| p.arm == grip.arm);
        let last = path.and_then(|p| p.keyframes.last());
        let retreat = path.map_or(grip.camera_from_retreat, |p| p.camera_from_retreat);
        (
            last.map_or(grip.camera_from_tip, |k| k.camera_from_tip),
            retreat,
        )
    };
    let leaving = Leaving {
        around,
        grips,
        camera_from_body,
        options,
    };
    leaving.home(&grips.iter().map(end).collect::<Vec<_>>())
}

/// The same from any pose, with the body at rest: first `distance` back along the tool.
pub(crate) fn withdraw_from(
    around: &Surroundings,
    grips: &[Grip],
    distance: f64,
    options: &ReachOptions,
) -> Result<Motion, Refusal> {
    let back = |g: &Grip| {
        let here = g.camera_from_tip;
        (here, retreat(&here, around.scene, distance))
    };
    let leaving = Leaving {
        around,
        grips,
        camera_from_body: &Isometry3::identity(),
        options,
    };
    leaving.home(&grips.iter().map(back).collect::<Vec<_>>())
}

/// Tools that leave a body at `camera_from_body`.
struct Leaving<'a> {
    around: &'a Surroundings<'a>,
    grips: &'a [Grip],
    camera_from_body: &'a Isometry3<f64>,
    options: &'a ReachOptions,
}

impl Leaving<'_> {
    /// From each end via its retreat pose to home; where joints do not allow that, straight up instead, or home at once.
    fn home(&self, ends: &[(Isometry3<f64>, Isometry3<f64>)]) -> Result<Motion, Refusal> {
        let normal = self.around.scene.table.normal;
        let instead = |retreat: &dyn Fn(&Isometry3<f64>, f64) -> Isometry3<f64>| {
            let end = |(end, back): &(Isometry3<f64>, Isometry3<f64>)| {
                (*end, retreat(end, travelled(end, back)))
            };
            self.via(&ends.iter().map(end).collect::<Vec<_>>())
        };
        let up = |end: &Isometry3<f64>, far: f64| Translation3::from(normal.as_ref() * far) * end;
        self.via(ends).or_else(|reason| match reason {
            Refusal::OutOfWorkspace { .. } => instead(&up)
                .or_else(|_| instead(&|end, _| *end))
                .map_err(|_| reason),
            reason => Err(reason),
        })
    }

    /// From each end via its retreat pose to home.
    fn via(&self, ends: &[(Isometry3<f64>, Isometry3<f64>)]) -> Result<Motion, Refusal> {
        let (grips, scene) = (self.grips, self.around.scene);
        let level = level(grips, scene);
        let way = |grip: &Grip, route: Route| {
            let home = scene.arms[grip.arm].home;
            let at = grips.iter().position(|g| g.arm == grip.arm);
            let (end, retreat) = at.map_or((home, home), |at| ends[at]);
            if matches!(route, Route::Turning) {
                return vec![end, retreat, home];
            }
            if matches!(route, Route::TurningThere) {
                return vec![end, retreat, with_rotation(&retreat, &home), home];
            }
            let turned = with_rotation(&home, &retreat);
            let mut way = vec![end, retreat];
            if !matches!(route, Route::Straight) {
                way.push(raised(&retreat, scene, level));
                way.push(raised(&turned, scene, level));
            }
            way.extend([turned, home]);
            way
        };
        let grasps: Vec<Point3<f64>> = ends
            .iter()
            .map(|(pose, _)| Point3::from(pose.translation.vector))
            .collect();
        let carried = Carried::Still {
            body_from_camera: self.camera_from_body.inverse(),
            approach: longest(
                ends.iter()
                    .zip(&grasps)
                    .map(|((_, retreat), &tip)| (*retreat, tip)),
            ),
            grasps: &grasps,
        };
        first_free(
            self.around,
            grips,
            self.options,
            Stage::Withdraw,
            &carried,
            &way,
        )
    }
}

/// The first route that passes the check, or why the straight one does not.
fn first_free(
    around: &Surroundings,
    grips: &[Grip],
    options: &ReachOptions,
    stage: Stage,
    carried: &Carried,
    way: &dyn Fn(&Grip, Route) -> Vec<Isometry3<f64>>,
) -> Result<Motion, Refusal> {
    let along = |route: Route| {
        let ways: Vec<_> = grips.iter().map(|g| way(g, route)).collect();
        let stations = match route {
            Route::OneByOne => one_by_one(&ways, stage),
            _ => ways,
        };
        let paths = dense(&stations);
        let times = times(&paths, &options.pace(grips, around.scene));
        let until = times.last().copied().unwrap_or(0.0);
        let mut motion = assemble(grips, &paths, &times, vec![Leg { stage, until }]);
        motion.arms.iter_mut().for_each(|p| p.release = 0.0);
        around.check(&motion, carried).map(|()| motion)
    };
    along(Route::Straight).or_else(|reason| {
        along(Route::Over)
            .or_else(|_| along(Route::OneByOne))
            .or_else(|other| match reason {
                // An orientation may be reachable at one position and not at another.
                Refusal::OutOfWorkspace { .. } => {
                    along(Route::Turning).or_else(|_| along(Route::TurningThere))
                }
                _ => Err(other),
            })
            .map_err(|_| reason)
    })
}

/// Each arm moves its whole path while the others stay at their beginning or end. Arms withdraw in the opposite order of their reach.
fn one_by_one(ways: &[Vec<Isometry3<f64>>], stage: Stage) -> Vec<Vec<Isometry3<f64>>> {
    let turn = |arm: usize| match stage {
        Stage::Withdraw => ways.len() - 1 - arm,
        _ => arm,
    };
    let stations = |(arm, way): (usize, &Vec<Isometry3<f64>>)| {
        (0..ways.len())
            .flat_map(|now| (0..way.len()).map(move |k| (now, k)))
            .map(|(now, k)| match turn(arm).cmp(&now) {
                std::cmp::Ordering::Less => way[way.len() - 1],
                std::cmp::Ordering::Equal => way[k],
                std::cmp::Ordering::Greater => way[0],
            })
            .collect()
    };
    ways.iter().enumerate().map(stations).collect()
}

/// Way points dense enough for the check, the same number for every arm.
pub(crate) fn dense(stations: &[Vec<Isometry3<f64>>]) -> Vec<Vec<Isometry3<f64>>> {
    let legs = stations.first().map_or(0, Vec::len).saturating_sub(1);
    let mut paths: Vec<Vec<_>> = stations.iter().map(|s| s[..1].to_vec()).collect();
    for leg in 0..legs {
        let steps = stations
            .iter()
            .map(|s| (s[leg], s[leg + 1]))
            .map(|(a, b)| {
                (travelled(&a, &b) / STEP.0).max(a.rotation.angle_to(&b.rotation) / STEP.1)
            })
            .fold(1.0, f64::max)
            .ceil() as usize;
        for (path, s) in paths.iter_mut().zip(stations) {
            let part = |k: usize| between(&s[leg], &s[leg + 1], k as f64 / steps as f64);
            path.extend((1..=steps).map(part));
        }
    }
    paths
}

/// The height at which arms cross: that of the highest home or approach.
fn level(grips: &[Grip], scene: &Scene) -> f64 {
    let height = |p: &Isometry3<f64>| scene.table.height(&Point3::from(p.translation.vector));
    grips
        .iter()
        .map(|g| height(&scene.arms[g.arm].home).max(height(&g.camera_from_approach)))
        .fold(0.0, f64::max)
}

fn raised(pose: &Isometry3<f64>, scene: &Scene, level: f64) -> Isometry3<f64> {
    let height = scene.table.height(&Point3::from(pose.translation.vector));
    let up = scene.table.normal.as_ref() * (level - height).max(0.0);
    Translation3::from(up) * pose
}

fn with_rotation(place: &Isometry3<f64>, of: &Isometry3<f64>) -> Isometry3<f64> {
    Isometry3::from_parts(place.translation, of.rotation)
}

fn longest(pairs: impl Iterator<Item = (Isometry3<f64>, Point3<f64>)>) -> f64 {
    pairs
        .map(|(pose, tip)| (pose.translation.vector - tip.coords).norm())
        .fold(0.0, f64::max)
}
