//! Stretching: pull the two sides of a hole apart, across its long axis and slightly up.
//!
//! A loop that the camera sees inside the outline is the mouth of a fold or a pocket. With `c` the mean of its points, `u` their first
//! principal direction and `n` the mean normal there, the way across is `v = n × u`: defined for a slit without width
//! too, where the second principal direction is not. On either side of `u` the grip is the candidate with the least
//! distance to the loop along the surface, plus half its distance from the middle of the slit along `u`.

use nalgebra::{Isometry3, Matrix3, Point3, SymmetricEigen, Translation3, UnitVector3, Vector3};

use crate::assign::assign;
use crate::check::check;
use crate::grips::{grip, retreat};
use crate::model::Adjacency;
use crate::motion::{Pace, times};
use crate::scene::{not_negative, positive, within};
use crate::{
    ArmPath, Candidate, Error, Grip, Keyframe, Model, Motion, Options, Refusal, Role, Scene,
    candidates_among,
};

/// Settings of [`stretch`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StretchOptions {
    /// How much farther apart the grips get, metres. Default 0.04.
    pub distance: f64,
    /// How much they rise meanwhile, metres. Default 0.015.
    pub lift: f64,
    /// Grips are at most this far from the loop along the surface, metres. Default 0.03.
    pub reach: f64,
    /// How long the hole is held open, seconds. Default 2.
    pub hold: f64,
    /// What is left of the stretch when the jaws open, 0 to 1. Default 0.5: cloth stays open, tissue does not mind.
    pub keep: f64,
    /// Largest speed of a tip, m/s. Default 0.02.
    pub speed: f64,
    /// How fast that speed is reached and left, m/s². Default 0.02.
    pub acceleration: f64,
    /// How far the tips back off after the release, metres. Default 0.05.
    pub retreat_distance: f64,
}

impl Default for StretchOptions {
    fn default() -> Self {
        Self {
            distance: 0.04,
            lift: 0.015,
            reach: 0.03,
            hold: 2.0,
            keep: 0.5,
            speed: 0.02,
            acceleration: 0.02,
            retreat_distance: 0.05,
        }
    }
}

impl StretchOptions {
    fn check(&self) -> Result<(), Error> {
        positive("distance", self.distance)?;
        not_negative("lift", self.lift)?;
        positive("reach", self.reach)?;
        not_negative("hold", self.hold)?;
        within("keep", self.keep, 0.0, 1.0, "between 0 and 1")?;
        positive("speed", self.speed)?;
        positive("acceleration", self.acceleration)?;
        positive("retreat_distance", self.retreat_distance)
    }
}

/// Two grips beside a hole and the motion that opens it.
#[derive(Debug, Clone, PartialEq)]
pub struct Stretch {
    /// The grips, one on each side.
    pub grips: Vec<Grip>,
    /// Out, hold, part of the way back.
    pub motion: Motion,
    /// The direction of the pull, from the first grip to the second.
    pub across: UnitVector3<f64>,
}

/// Opens the hole that `hole`, a loop of vertices, runs round.
///
/// # Errors
/// A loop that spans nothing, no grip on one side, or a motion that cannot be done.
pub fn stretch(
    model: &Model,
    scene: &Scene,
    hole: &[u32],
    options: &Options,
    stretch: &StretchOptions,
) -> Result<Stretch, Refusal> {
    model.check()?;
    stretch.check()?;
    let mouth = Mouth::new(model, scene, hole)?;
    let distance = Adjacency::new(model.points.len(), model.edges).distances(
        model.points,
        hole,
        stretch.reach,
    );
    let near: Vec<u32> = (0..model.points.len() as u32)
        .filter(|&v| distance[v as usize] <= stretch.reach)
        .collect();
    let found = candidates_among(model, scene, options, &near)?.accepted;
    let [a, b] = mouth.sides(&found, &distance, scene)?;
    let arms =
        assign(scene, [a, b], &[[a.tip, b.tip]]).ok_or(Refusal::NoGripBesideHole { side: 1 })?;
    let grips: Vec<Grip> = [(arms[0], a), (arms[1], b)]
        .map(|(arm, c)| grip(arm, c, Role::Lift, scene, options))
        .into();
    let motion = pull(&grips, &mouth.across, scene, stretch);
    check(&motion, scene, options.shaft_length)?;
    Ok(Stretch {
        grips,
        motion,
        across: mouth.across,
    })
}

struct Mouth {
    center: Point3<f64>,
    long: Vector3<f64>,
    across: UnitVector3<f64>,
}

impl Mouth {
    fn new(model: &Model, scene: &Scene, hole: &[u32]) -> Result<Self, Refusal> {
        let points = model.points.len();
        if let Some(&vertex) = hole.iter().find(|&&v| v as usize >= points) {
            return Err(Error::NoSuchVertex { vertex, points }.into());
        }
        let flat = Refusal::NotAHole {
            vertices: hole.len(),
        };
        if hole.len() < 3 {
            return Err(flat);
        }
        let at = |v: &u32| model.points[*v as usize].coords;
        let center = hole.iter().map(at).sum::<Vector3<f64>>() / hole.len() as f64;
        let scatter: Matrix3<f64> = hole
            .iter()
            .map(|v| at(v) - center)
            .map(|d| d * d.transpose())
            .sum();
        let eigen = SymmetricEigen::new(scatter);
        let longest = eigen.eigenvalues.imax();
        // Shorter than a nanometre is rounding, not a loop.
        if eigen.eigenvalues[longest] <= 1e-18 {
            return Err(flat);
        }
        let long = eigen.eigenvectors.column(longest).into_owned();
        let faces: Vector3<f64> = hole
            .iter()
            .map(|v| model.normals[*v as usize].into_inner())
            .sum();
        let normal = faces
            .try_normalize(1e-6)
            .unwrap_or(scene.table.normal.into_inner());
        // The pull is along the table: up is what `lift` is for.
        let across =
            UnitVector3::try_new(scene.table.along(&normal.cross(&long)), 1e-6).ok_or(flat)?;
        Ok(Self {
            center: Point3::from(center),
            long,
            across,
        })
    }

    /// The pair of candidates on either side that is cheapest and that two arms can take.
    fn sides<'c>(
        &self,
        found: &'c [Candidate],
        distance: &[f64],
        scene: &Scene,
    ) -> Result<[&'c Candidate; 2], Refusal> {
        let cost = |c: &Candidate| {
            distance[c.vertex as usize] + 0.5 * self.long.dot(&(c.point - self.center)).abs()
        };
        let side = |sign: f64| -> Vec<&'c Candidate> {
            found
                .iter()
                .filter(|c| sign * self.across.dot(&(c.point - self.center)) > 0.0)
                .collect()
        };
        let sides = [side(-1.0), side(1.0)];
        if let Some(side) = (0..2).find(|&k| sides[k].is_empty()) {
            return Err(Refusal::NoGripBesideHole { side });
        }
        let mut best: Option<(f64, [&Candidate; 2])> = None;
        for &a in &sides[0] {
            for &b in &sides[1] {
                let sum = cost(a) + cost(b);
                let apart = (a.point - b.point).norm() >= scene.jaw_separation;
                if apart
                    && best.as_ref().is_none_or(|(least, _)| sum < *least)
                    && assign(scene, [a, b], &[[a.tip, b.tip]]).is_some()
                {
                    best = Some((sum, [a, b]));
                }
            }
        }
        best.map(|(_, pair)| pair)
            .ok_or(Refusal::NoGripBesideHole { side: 1 })
    }
}

/// Way points on the way out and on the way back.
const STEPS: usize = 12;

fn pull(
    grips: &[Grip],
    across: &UnitVector3<f64>,
    scene: &Scene,
    options: &StretchOptions,
) -> Motion {
    let limit = grips
        .iter()
        .map(|g| scene.arms[g.arm].max_speed)
        .fold(options.speed, f64::min);
    let pace = Pace {
        speed: limit,
        acceleration: options.acceleration,
        turn_rate: 1.0,
    };
    // `open` of the stretch, `raised` of the lift.
    let pose = |k: usize, open: f64, raised: f64| -> Isometry3<f64> {
        let sign = if k == 0 { -0.5 } else { 0.5 };
        let shift = across.as_ref() * (sign * options.distance * open)
            + scene.table.normal.as_ref() * (options.lift * raised);
        Translation3::from(shift) * grips[k].camera_from_tip
    };
    let share = |i: usize| i as f64 / STEPS as f64;
    let out = [0, 1].map(|k| {
        (0..=STEPS)
            .map(|i| pose(k, share(i), share(i)))
            .collect::<Vec<_>>()
    });
    let closing = |i: usize| 1.0 - (1.0 - options.keep) * share(i);
    let back = [0, 1].map(|k| {
        (0..=STEPS)
            .map(|i| pose(k, closing(i), 1.0 - share(i)))
            .collect::<Vec<_>>()
    });
    let mut clock = times(&out, &pace);
    let held = clock.last().copied().unwrap_or(0.0) + options.hold;
    clock.extend(times(&back, &pace).iter().map(|t| held + t));
    let duration = clock.last().copied().unwrap_or(0.0);
    let arm = |k: usize| {
        let poses = out[k].iter().chain(&back[k]);
        let keyframes = clock
            .iter()
            .zip(poses)
            .map(|(&time, &camera_from_tip)| Keyframe {
                time,
                camera_from_tip,
            })
            .collect();
        let end = pose(k, options.keep, 0.0);
        ArmPath {
            arm: grips[k].arm,
            role: Role::Lift,
            keyframes,
            release: duration,
            camera_from_retreat: retreat(&end, scene, options.retreat_distance),
        }
    };
    Motion {
        arms: vec![arm(0), arm(1)],
        duration,
    }
}
