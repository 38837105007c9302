//! The reconstruction through its public interface: a rigid body is tracked, its model grows, and empty frames change nothing.
#![allow(missing_docs, clippy::unwrap_used)]

mod common;

use common::SPACING;
use explore_loop::canonical::CanonicalModel;
use explore_loop::cell::{ArmState, Observation, Plane};
use explore_loop::reconstruct::{FrameReport, ReconstructOptions, Reconstructor};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Half axes of the body, distance of the table from the camera, standard deviation of the depth, metres.
const AXES: [f64; 3] = [0.06, 0.045, 0.03];
const TABLE: f64 = 0.5;
const NOISE: f64 = 3e-4;
/// Turn in a frame, degrees, and frames of turning.
const STEP_DEG: f64 = 3.0;
const TURNING: u32 = 40;

fn table() -> Plane {
    Plane {
        normal: -Vector3::z_axis(),
        offset: TABLE,
    }
}

/// The body on the table, and `frame` steps after it was taken: lifted clear of the table and turned about its long axis.
fn motion(frame: u32) -> Isometry3<f64> {
    let angle = (f64::from(frame) * STEP_DEG).to_radians();
    // The half height of the turned ellipse above its lowest point: it always just touches the table.
    let height = (AXES[2] * angle.cos()).hypot(AXES[1] * angle.sin());
    Isometry3::from_parts(
        Translation3::new(0.0, 0.0, TABLE - height),
        UnitQuaternion::from_axis_angle(&Vector3::x_axis(), angle),
    )
}

/// What a pinhole at the origin sees of the body: each ray meets the ellipsoid where a quadratic has its first root.
fn render(camera_from_body: &Isometry3<f64>, seed: u64) -> Vec<Point3<f64>> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let scale = |v: Vector3<f64>| v.component_div(&Vector3::from(AXES));
    let inverse = camera_from_body.inverse();
    let eye = scale((inverse * Point3::origin()).coords);
    let mut points = Vec::new();
    for u in -80..80 {
        for v in -80..80 {
            let ray = Vector3::new(
                (f64::from(u) + 0.5) / 320.0,
                (f64::from(v) + 0.5) / 320.0,
                1.0,
            );
            let way = scale(inverse * ray);
            let (a, b, c) = (way.norm_squared(), way.dot(&eye), eye.norm_squared() - 1.0);
            if b * b < a * c {
                continue;
            }
            let depth = (-b - (b * b - a * c).sqrt()) / a;
            // The sum of twelve uniform numbers less six is normal enough.
            let normal: f64 = (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
            points.push(Point3::from(ray * (depth + NOISE * normal / ray.norm())));
        }
    }
    points
}

/// Two arms at the ends of the long axis, which turn with the body when they hold it.
fn arms(camera_from_body: &Isometry3<f64>, holding: bool) -> Vec<ArmState> {
    [1.0, -1.0]
        .map(|side| {
            let tip = Vector3::new(side * 0.056, 0.0, 0.0);
            let approach = Vector3::new(-side, 0.0, 0.0);
            let body_from_tip = Isometry3::from_parts(
                tip.into(),
                UnitQuaternion::face_towards(&approach, &Vector3::z()),
            );
            ArmState {
                camera_from_tip: camera_from_body * body_from_tip,
                jaw: if holding { 0.0 } else { 0.8 },
                holding,
                moving: holding,
            }
        })
        .into()
}

fn frame(turned: u32, holding: bool, number: u32) -> Observation {
    seen_from(None, turned, holding, number)
}

/// A frame of a camera that stands still, or has this pose in its frame at rest.
fn seen_from(
    camera: Option<Isometry3<f64>>,
    turned: u32,
    holding: bool,
    number: u32,
) -> Observation {
    let at = motion(turned);
    let pose = camera.unwrap_or_else(Isometry3::identity);
    let own = render(&(pose.inverse() * at), u64::from(number));
    Observation {
        stamp: 0.1 * f64::from(number),
        camera,
        points: own.iter().map(|p| pose * p).collect(),
        colours: None,
        features: None,
        arms: arms(&at, holding),
    }
}

/// Looked at, taken, turned, and held there.
fn film() -> Vec<(u32, Observation)> {
    film_from(|_| None)
}

/// The same by a camera in some pose in every frame.
fn film_from(camera: impl Fn(u32) -> Option<Isometry3<f64>>) -> Vec<(u32, Observation)> {
    let turned = |number: u32| number.saturating_sub(6).min(TURNING);
    (0..TURNING + 10)
        .map(|number| {
            let seen = seen_from(camera(number), turned(number), number >= 4, number);
            (turned(number), seen)
        })
        .collect()
}

/// Swings by 20 degrees about the body, and comes nearer by a tenth of the way, in 30 frames.
fn swinging(number: u32) -> Isometry3<f64> {
    let phase = std::f64::consts::TAU * f64::from(number) / 30.0;
    let about = Translation3::new(0.0, 0.0, TABLE);
    let turn = Vector3::new(0.5 * (2.0 * phase).sin(), phase.sin(), 0.0) * 20.0_f64.to_radians();
    let nearer = Translation3::new(0.0, 0.0, 0.05 * phase.sin());
    about * UnitQuaternion::from_scaled_axis(turn) * about.inverse() * nearer
}

fn reconstructor() -> Reconstructor {
    Reconstructor::new(ReconstructOptions::new(SPACING)).unwrap()
}

/// First-order distance of a point from the surface of the body.
fn off_surface(p: &Point3<f64>) -> f64 {
    let unit = p.coords.component_div(&Vector3::from(AXES)).norm();
    let slope = p
        .coords
        .component_div(&Vector3::from(AXES).map(|a| a * a))
        .norm();
    (unit * (unit - 1.0) / slope).abs()
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(s, n), v| (s + v, n + 1.0));
    sum / f64::max(count, 1.0)
}

fn same(a: &CanonicalModel, b: &CanonicalModel) -> bool {
    a.ids() == b.ids()
        && a.rest() == b.rest()
        && a.live() == b.live()
        && a.rotations() == b.rotations()
        && a.edges() == b.edges()
}

fn usable(report: &FrameReport) -> bool {
    report.failure.is_none()
}

/// What is seen lies on the body within a millimetre in every frame, material is where it was carried, and the model
/// grows around the side that turned up.
#[test]
fn a_rigid_body_is_followed_and_grows() {
    followed(film());
}

/// The same where the camera moves: its motion is not taken for that of the body.
#[test]
fn a_camera_that_moves_is_told_from_a_body_that_does() {
    followed(film_from(|number| Some(swinging(number))));
    let mut reconstructor = reconstructor();
    let mut first = 0;
    for number in 0..16 {
        let seen = seen_from(Some(swinging(number)), 0, false, number);
        let report = reconstructor.process(&seen, &table()).unwrap();
        assert!(usable(&report), "{report:?}");
        let model = reconstructor.model();
        let moved = mean((0..model.len()).map(|i| (model.live()[i] - model.rest()[i]).norm()));
        assert!(moved < 5e-4, "{moved} m");
        let visible = reconstructor.visible_now(&seen);
        let measured = report.measured.iter().zip(&visible).filter(|(m, _)| **m);
        let both = mean(measured.map(|(_, v)| f64::from(u8::from(*v))));
        assert!(both > 0.97, "{both} of what was measured can be seen");
        first = if number == 0 { model.len() } else { first };
    }
    // It sees the sides as well.
    let grown = reconstructor.model().len();
    assert!(grown > first + 10, "{first} to {grown}");
}

fn followed(film: Vec<(u32, Observation)>) {
    let mut reconstructor = reconstructor();
    let (mut first, mut worst) = (0, 0.0_f64);
    for (turned, observation) in film {
        let report = reconstructor.process(&observation, &table()).unwrap();
        assert!(usable(&report), "{report:?}");
        let model = reconstructor.model();
        if report.frame == 0 {
            first = model.len();
        }
        let body_from_camera = motion(turned).inverse();
        let seen = (0..model.len()).filter(|&i| report.measured[i]);
        worst = worst.max(mean(
            seen.map(|i| off_surface(&(body_from_camera * model.live()[i]))),
        ));
    }
    let model = reconstructor.model();
    let moved = motion(TURNING) * motion(0).inverse();
    let early = (0..model.len()).filter(|&i| model.born()[i] == 0);
    let slid = mean(early.map(|i| (model.live()[i] - moved * model.rest()[i]).norm()));
    let rest = mean(
        model
            .rest()
            .iter()
            .map(|p| off_surface(&(motion(0).inverse() * p))),
    );
    assert!(worst < 1e-3, "{worst} m off the surface");
    assert!(rest < 1e-3, "rest is {rest} m off the surface");
    assert!(
        model.len() as f64 > 1.3 * first as f64,
        "{first} to {}",
        model.len()
    );
    // An elastic body between two small grips lags behind them: a tenth of the 84 mm that its widest part travels.
    assert!(slid < 0.0084, "material {slid} m from where it was carried");
}

#[test]
fn the_same_frames_give_the_same_bits() {
    let run = || {
        let mut reconstructor = reconstructor();
        let mut reports = Vec::new();
        for (_, observation) in film().iter().take(20) {
            let report = reconstructor.process(observation, &table()).unwrap();
            reports.push((report.measured, report.added, report.residual.to_bits()));
        }
        (reconstructor.model().clone(), reports)
    };
    let ((a, first), (b, second)) = (run(), run());
    assert!(same(&a, &b));
    assert!(first == second);
}

/// Frames that show (almost) nothing leave the model as it was and say so; the next good one goes on.
#[test]
fn frames_that_show_nothing_leave_the_model_alone() {
    let mut reconstructor = reconstructor();
    for number in 0..4 {
        reconstructor
            .process(&frame(0, false, number), &table())
            .unwrap();
    }
    let good = frame(0, false, 4);
    let nan = Point3::new(f64::NAN, 0.0, 0.4);
    let mostly_nan = |k: usize| if k < 5 { good.points[k] } else { nan };
    let bad: [Vec<Point3<f64>>; 5] = [
        Vec::new(),
        good.points[..7].to_vec(),
        vec![nan; 500],
        (0..500).map(mostly_nan).collect(),
        vec![Point3::new(f64::INFINITY, 1.0, f64::NEG_INFINITY); 500],
    ];
    for points in bad {
        let before = reconstructor.model().clone();
        let observation = Observation {
            points,
            ..good.clone()
        };
        let report = reconstructor.process(&observation, &table()).unwrap();
        assert!(report.failure.is_some());
        assert!(!report.measured.contains(&true));
        assert_eq!(report.measured.len(), before.len());
        assert!(same(&before, reconstructor.model()));
    }
    let report = reconstructor.process(&good, &table()).unwrap();
    assert!(
        usable(&report) && report.measured.contains(&true),
        "{report:?}"
    );
}

/// Invalid points among valid ones are skipped.
#[test]
fn single_nan_points_are_passed_over() {
    let clean = [frame(0, false, 0), frame(0, false, 1)];
    let run = |dirty: bool| {
        let mut reconstructor = reconstructor();
        for observation in &clean {
            let mut observation = observation.clone();
            if dirty {
                observation
                    .points
                    .insert(100, Point3::new(f64::NAN, 0.0, f64::INFINITY));
            }
            assert!(usable(
                &reconstructor.process(&observation, &table()).unwrap()
            ));
        }
        reconstructor.model().clone()
    };
    assert!(same(&run(false), &run(true)));
}

/// While the body is held, a grip whose pose is no pose is an error or a reported failure; the next good frame goes on.
#[test]
fn a_grip_that_is_no_pose_does_not_spoil_the_model() {
    let film = film();
    for when in [5, 12] {
        for broken in [f64::NAN, f64::INFINITY] {
            let mut reconstructor = reconstructor();
            for (number, (turned, observation)) in film.iter().enumerate().take(16) {
                let mut observation = observation.clone();
                if number == when {
                    observation.arms = arms(&motion(*turned), true);
                    observation.arms[0].camera_from_tip.translation.vector.x = broken;
                }
                let outcome = reconstructor.process(&observation, &table());
                if number == when {
                    let reported = outcome.map_or(true, |r| r.failure.is_some());
                    assert!(reported, "frame {when} with a grip at {broken} was taken");
                } else {
                    let report = outcome.unwrap();
                    // A frame after the bad one the body may still be on its way.
                    let late = number != when + 1;
                    assert!(
                        !late || usable(&report),
                        "frame {number} after {when}: {report:?}"
                    );
                }
                let model = reconstructor.model();
                assert!(
                    model
                        .live()
                        .iter()
                        .chain(model.rest())
                        .all(|p| p.coords.iter().all(|c| c.is_finite()))
                );
            }
            assert!(reconstructor.model().len() > 100);
        }
    }
}

/// The reconstruction begins at the first frame that shows the object.
#[test]
fn empty_first_frames_are_skipped() {
    let empty = Observation {
        points: Vec::new(),
        ..frame(0, false, 0)
    };
    let mut late = reconstructor();
    for _ in 0..3 {
        let report = late.process(&empty, &table()).unwrap();
        assert!(report.failure.is_some() && report.measured.is_empty());
        assert!(late.model().is_empty());
    }
    let mut prompt = reconstructor();
    for number in 0..3 {
        let observation = frame(0, false, number);
        assert!(usable(&late.process(&observation, &table()).unwrap()));
        assert!(usable(&prompt.process(&observation, &table()).unwrap()));
    }
    assert_eq!(late.model().rest(), prompt.model().rest());
    assert_eq!(late.model().live(), prompt.model().live());
}

#[test]
fn a_spacing_that_is_no_length_is_refused() {
    for spacing in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(Reconstructor::new(ReconstructOptions::new(spacing)).is_err());
    }
}

/// Without data, fusion changes nothing.
#[test]
fn consolidating_nothing_is_harmless() {
    let mut reconstructor = reconstructor();
    reconstructor.consolidate(&table());
    reconstructor
        .process(&frame(0, false, 0), &table())
        .unwrap();
    reconstructor.consolidate(&table());
    assert!(!reconstructor.model().is_empty());
}

/// Disabled parts are not executed: no hollow body is followed, and the shape is not fused anew.
#[test]
fn a_hypothesis_and_the_fusion_can_be_left_out() {
    let mut without = ReconstructOptions::new(SPACING);
    (without.hollow, without.fusion_rounds) = (None, 0);
    let follow = |options: ReconstructOptions| {
        let mut reconstructor = Reconstructor::new(options).unwrap();
        let film = film();
        let reports = film
            .iter()
            .take(20)
            .map(|(_, frame)| reconstructor.process(frame, &table()).unwrap());
        let reports: Vec<FrameReport> = reports.collect();
        let before = reconstructor.model().clone();
        reconstructor.consolidate(&table());
        (reports, before.rest() == reconstructor.model().rest())
    };
    let (reports, as_it_grew) = follow(without);
    assert!(
        reports
            .iter()
            .all(|r| r.hollow_over_solid.is_none() && !r.fused)
            && as_it_grew
    );
    let (reports, as_it_grew) = follow(ReconstructOptions::new(SPACING));
    assert!(reports.iter().any(|r| r.hollow_over_solid.is_some()) && !as_it_grew);
}

/// What moves clearly farther than ξ = 15 mm between two frames is reported, and model and body stay as they were; what moves less is followed.
#[test]
fn motion_past_the_limit_is_reported_and_not_taken() {
    for (jump, followed) in [(0.006, true), (0.025, false), (0.04, false), (0.1, false)] {
        let mut reconstructor = reconstructor();
        for number in 0..6 {
            let seen = frame(0, false, number);
            assert!(usable(&reconstructor.process(&seen, &table()).unwrap()));
        }
        let before = reconstructor.model().clone();
        let at = Translation3::new(jump, 0.0, 0.0) * motion(0);
        let moved = Observation {
            camera: None,
            stamp: 0.6,
            points: render(&at, 6),
            colours: None,
            features: None,
            arms: arms(&at, false),
        };
        let report = reconstructor.process(&moved, &table()).unwrap();
        assert_eq!(report.failure.is_none(), followed, "{jump} m: {report:?}");
        let model = reconstructor.model();
        assert!(followed || model.rest() == before.rest(), "{jump} m");
        assert!(followed || model.live() == before.live(), "{jump} m");
    }
}

/// A held body that falls over within a frame: that frame is not taken, and in the next one the material is found where it fell, not only its surface.
#[test]
fn a_held_body_that_falls_over_is_found() {
    for jump in [14, 16, 18, 20] {
        let mut reconstructor = reconstructor();
        for number in 0..32 {
            // Looked at, taken, turned step by step, and then by many steps at once.
            let turned = match number {
                0..6 => 0,
                6..24 => number - 6,
                _ => 18 + jump,
            };
            let seen = frame(turned, number >= 4, number);
            let report = reconstructor.process(&seen, &table()).unwrap();
            assert_eq!(usable(&report), number != 24, "{jump}: {report:?}");
        }
        let model = reconstructor.model();
        let moved = motion(18 + jump) * motion(0).inverse();
        let early = (0..model.len()).filter(|&i| model.born()[i] == 0);
        let off = mean(early.map(|i| (model.live()[i] - moved * model.rest()[i]).norm()));
        assert!(
            off < 0.007,
            "after {jump} steps in a frame, material is {off} m off"
        );
    }
}

/// A body that is turned half way: what the last frame measured is known better than what has turned away, and asking changes nothing.
#[test]
fn what_is_seen_is_known_better_than_what_is_hidden() {
    let (mut asked, mut left_alone) = (reconstructor(), reconstructor());
    assert!(asked.uncertainty().is_none(), "nothing was seen yet");
    let mut measured = Vec::new();
    for (_, observation) in film() {
        measured = asked.process(&observation, &table()).unwrap().measured;
        left_alone.process(&observation, &table()).unwrap();
        let sigmas = asked.uncertainty().unwrap();
        assert_eq!(sigmas.len(), asked.model().len());
        assert!(sigmas.iter().all(|s| *s > 0.0), "a deviation is positive");
    }
    assert!(same(asked.model(), left_alone.model()));
    let sigmas = asked.uncertainty().unwrap();
    let of = |seen: bool| {
        let chosen = sigmas.iter().zip(&measured).filter(|(_, m)| **m == seen);
        mean(chosen.map(|(s, _)| *s))
    };
    let [seen, hidden] = [true, false].map(of);
    assert!(seen.is_finite() && hidden.is_finite());
    assert!(hidden > 1.05 * seen, "{seen} m and {hidden} m");
}
