//! Candidates, sets of grips and motions.
#![allow(missing_docs, clippy::unwrap_used, reason = "tests")]

mod fixture;

use std::f64::consts::PI;
use std::sync::Arc;

use fixture::{Body, DEPTH};
use grip_planner::nalgebra::{
    Isometry3, Point3, Translation3, UnitQuaternion, UnitVector3, Vector3,
};
use grip_planner::{
    Action, Arm, CandidateSource, Coverage, Error, Motion, Options, Plan, PlanOptions, Reason,
    Recentre, Refusal, Role, Scene, Stage, Tracking, TurnOptions, Waypoint, Workspace, candidates,
    plan, plan_grips, turn_over,
};
use proptest::prelude::*;

fn body() -> impl Strategy<Value = Body> {
    (0.06..0.12, 0.04..0.08, 0.015..0.035, -0.2..0.3, -3.0..3.0)
        .prop_map(|(a, b, c, lowest, yaw)| Body::ellipsoid([a, b, c], 500, lowest, yaw))
}

/// Workspaces of every kind, all of them large enough for the table's middle.
fn fenced(mut arms: Vec<Arm>, kind: usize, room: f64) -> Vec<Arm> {
    for arm in &mut arms {
        let apex = arm.base + Vector3::new(0.0, 0.0, -0.1);
        arm.workspace = match kind {
            0 => Workspace::Ball {
                center: arm.base,
                radius: 0.45 + 0.3 * room,
            },
            1 => Workspace::Box {
                camera_from_box: Isometry3::translation(0.0, 0.0, DEPTH - 0.2),
                half_extents: Vector3::new(0.35, 0.35, 0.2 + 0.1 * room),
            },
            2 => Workspace::SphereSector {
                apex,
                axis: UnitVector3::new_normalize(Point3::new(0.0, 0.0, DEPTH) - apex),
                half_angle: 0.9 + 0.4 * room,
                radii: [0.05, 0.6 + 0.2 * room],
            },
            _ => {
                let reach = 0.5 + 0.3 * room;
                let base = arm.base;
                Workspace::Custom(Arc::new(move |pose: &Isometry3<f64>| {
                    (pose.translation.vector - base.coords).norm() <= reach
                        && (pose.rotation * Vector3::z()).z > -0.2
                }))
            }
        };
    }
    arms
}

/// All guarantees of a motion, checked more finely than the planner does.
fn keeps_its_promises(motion: &Motion, scene: &Scene, speed: f64) -> Result<(), TestCaseError> {
    prop_assert!((motion.legs.last().unwrap().until - motion.duration).abs() < 1e-12);
    for path in &motion.arms {
        let arm = &scene.arms[path.arm];
        prop_assert!(
            path.keyframes[0].time == 0.0
                && path.keyframes.windows(2).all(|w| w[1].time >= w[0].time)
        );
        prop_assert!(
            path.keyframes.last().unwrap().time <= motion.duration
                && path.release <= motion.duration
        );
        prop_assert!(path.peak_speed() <= speed.min(arm.max_speed) * (1.0 + 1e-9));
        for k in 0..400 {
            let pose = path.at(motion.duration * f64::from(k) / 399.0).unwrap();
            let tip = Point3::from(pose.translation.vector);
            prop_assert!(arm.workspace.contains(&pose));
            prop_assert!(scene.table.height(&tip) >= scene.clearance - 1e-6);
            let wrist = pose * Point3::new(0.0, 0.0, -scene.shaft_length);
            prop_assert!(scene.table.height(&wrist) > 0.0, "a wrist under the table");
        }
    }
    for (i, a) in motion.arms.iter().enumerate() {
        for b in &motion.arms[i + 1..] {
            for k in 0..100 {
                let time = motion.duration * f64::from(k) / 99.0;
                let gap =
                    a.at(time).unwrap().translation.vector - b.at(time).unwrap().translation.vector;
                prop_assert!(gap.norm() >= 2.0 * scene.jaw_radius);
            }
        }
    }
    Ok(())
}

/// Points along a tool behind the first `jaws` metres: its straight part, and the way to the base.
fn along_tool(
    pose: &Isometry3<f64>,
    base: &Point3<f64>,
    jaws: f64,
    shaft: f64,
) -> Vec<Point3<f64>> {
    let part = |z: f64| pose * Point3::new(0.0, 0.0, -z);
    let wrist = part(shaft);
    let straight = (0..=20).map(|k| part(jaws + (shaft - jaws) * f64::from(k) / 20.0));
    let link = (0..=60).map(|k| wrist + (base - wrist) * (f64::from(k) / 60.0));
    straight.chain(link).collect()
}

/// How the body is turned at a key frame: by an even share of the angle at every one of them, and tilted like the line between the lifting tips.
fn turned(plan: &Plan, frame: usize) -> UnitQuaternion<f64> {
    let (turn, motion) = (plan.turn.unwrap(), &plan.motion);
    let keys = &motion.arms[0].keyframes;
    let until = |stage: Stage| {
        motion
            .legs
            .iter()
            .find(|l| l.stage == stage)
            .map(|l| l.until)
    };
    let hangs = until(Stage::Lift).unwrap();
    let shown = until(Stage::Tilt).unwrap_or(hangs);
    let tilting = |k: &usize| keys[*k].time > hangs && keys[*k].time <= shown;
    let straight = (1..keys.len()).filter(|k| !tilting(k)).count();
    let before = (1..=frame).filter(|k| !tilting(k)).count();
    let turned =
        UnitQuaternion::from_axis_angle(&turn.axis, turn.angle * before as f64 / straight as f64);
    let line = |k: usize| {
        let tip = |arm: usize| {
            turn.local(&Point3::from(
                motion.arms[arm].keyframes[k]
                    .camera_from_tip
                    .translation
                    .vector,
            ))
        };
        let along = tip(1) - tip(0);
        (along.z * along.x.signum()).atan2(along.x.abs())
    };
    if !tilting(&frame) {
        return turned;
    }
    let begun = (0..frame).rev().find(|k| !tilting(k)).unwrap();
    UnitQuaternion::from_axis_angle(&-turn.lifted, line(frame) - line(begun)) * turned
}

/// No tool in the body, which is held by each lifting tip; at rest on the way to the grips.
fn keeps_out_of_the_body(plan: &Plan, body: &Body, scene: &Scene) -> Result<(), TestCaseError> {
    // Samples of a segment are never nearer than the segment itself.
    let free = |tool: &[Point3<f64>], body: &[Point3<f64>]| {
        let apart = |p: &Point3<f64>| {
            tool.iter()
                .all(|t| (t - p).norm() >= 0.5 * scene.jaw_radius - 1e-9)
        };
        body.iter().all(apart)
    };
    let jaws = 2.5 * scene.jaw_radius;
    for (grip, path) in plan.grips.iter().zip(&plan.motion.arms) {
        let base = &scene.arms[grip.arm].base;
        let held = path
            .keyframes
            .iter()
            .enumerate()
            .filter(|(_, k)| k.time <= path.release);
        for (k, frame) in held.step_by(5) {
            let turned = turned(plan, k);
            let tip = Point3::from(frame.camera_from_tip.translation.vector);
            let moved: Vec<_> = body
                .points
                .iter()
                .map(|p| tip + turned * (p - grip.tip()))
                .collect();
            let tool = along_tool(&frame.camera_from_tip, base, jaws, scene.shaft_length);
            prop_assert!(
                free(&tool, &moved),
                "arm {} in the body at {:.2} s",
                grip.arm,
                frame.time
            );
        }
    }
    for (grip, path) in plan.grips.iter().zip(&plan.reach.arms) {
        for frame in path.keyframes.iter().step_by(5) {
            let pose = &frame.camera_from_tip;
            // On the straight last part the jaws go round the vertex.
            let far = (pose.translation.vector - grip.tip().coords).norm() > 0.031;
            let tool = along_tool(
                pose,
                &scene.arms[grip.arm].base,
                if far { 0.0 } else { jaws },
                scene.shaft_length,
            );
            prop_assert!(
                free(&tool, &body.points),
                "arm {} in the body at {:.2} s of its way",
                grip.arm,
                frame.time
            );
        }
    }
    Ok(())
}

/// The field of the held grips, at the speed of the motion, over the time of a frame.
fn moves_no_node_farther_than_can_be_followed(
    plan: &Plan,
    body: &Body,
    scene: &Scene,
    options: &PlanOptions,
) -> Result<(), TestCaseError> {
    let vertices: Vec<u32> = plan.grips.iter().map(|g| g.vertex).collect();
    let coverage = Coverage::new(
        &body.model(),
        &scene.table,
        &vertices,
        &options.grips.coverage,
    );
    let coverage = coverage.unwrap();
    let frames = plan.motion.arms[0].keyframes.len();
    for k in 1..frames {
        let time =
            plan.motion.arms[0].keyframes[k].time - plan.motion.arms[0].keyframes[k - 1].time;
        let held = plan
            .motion
            .arms
            .iter()
            .zip(&vertices)
            .filter(|(p, _)| p.keyframes[k].time <= p.release);
        let moved = |p: &grip_planner::ArmPath| {
            let at = |k: usize| p.keyframes[k].camera_from_tip.translation.vector;
            (at(k) - at(k - 1)) / time
        };
        let velocities: Vec<_> = held.map(|(p, &v)| (v, moved(p))).collect();
        let fastest = coverage
            .field(&velocities)
            .unwrap()
            .iter()
            .map(Vector3::norm)
            .fold(0.0, f64::max);
        prop_assert!(fastest / options.tracking.frame_rate <= options.tracking.xi * (1.0 + 1e-9));
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { max_shrink_iters: 20, ..ProptestConfig::with_cases(cases(48)) })]

    #[test]
    fn plans_keep_their_promises(body in body(), count in 2usize..4, kind in 0usize..4, room in 0.0..1.0, speed in 0.005..0.2, xi in 1e-3..2e-2, frame_rate in 2.0..30.0) {
        let arms = fenced(fixture::arms(count), kind, room);
        let scene = fixture::scene(&arms);
        let mut options = PlanOptions::default();
        options.turn.speed = speed;
        options.tracking = Tracking::default().with_xi(xi).with_frame_rate(frame_rate);
        let plan = match plan(&body.model(), &scene, Action::TurnOver, &options) {
            Ok(plan) => plan,
            // A tight workspace may leave nothing; then every set has its reason.
            Err(Refusal::AllRefused { refused }) => {
                prop_assert!(!refused.is_empty() && refused.iter().all(|r| !r.reason.to_string().is_empty()));
                return Ok(());
            }
            Err(Refusal::NoGrips { rejected, .. }) => {
                prop_assert!(!rejected.is_empty());
                return Ok(());
            }
            Err(other) => return Err(TestCaseError::fail(other.to_string())),
        };
        let turn = plan.turn.unwrap();
        prop_assert!((0.0..=1.0).contains(&plan.coverage) && (0.0..=1.0).contains(&plan.score));
        prop_assert!(plan.coverage_map.len() == body.points.len() && plan.coverage_map.iter().all(|m| (0.0..=1.0).contains(m)));
        let lifting: Vec<_> = plan.grips.iter().filter(|g| g.role == Role::Lift).collect();
        prop_assert_eq!(lifting.len(), 2);
        let at: Vec<_> = lifting.iter().map(|g| turn.local(&body.points[g.vertex as usize])).collect();
        // Both on the lifted side, well apart along the axis.
        prop_assert!(at.iter().all(|p| p.y > 0.5 * turn.span));
        prop_assert!((at[0].x - at[1].x).abs() > 0.2 * turn.length);
        for (k, grip) in plan.grips.iter().enumerate() {
            let [reach, held, back] = [&plan.reach, &plan.motion, &plan.withdraw].map(|m| &m.arms[k]);
            prop_assert!([reach.arm, held.arm, back.arm] == [grip.arm; 3]);
            // From home to the grasp, from there to the end, and from the end home.
            let joints = [
                (arms[grip.arm].home, reach.at(0.0).unwrap()),
                (reach.at(plan.reach.duration).unwrap(), grip.camera_from_tip),
                (grip.camera_from_tip, held.at(0.0).unwrap()),
                (held.at(plan.motion.duration).unwrap(), back.at(0.0).unwrap()),
                (back.at(plan.withdraw.duration).unwrap(), arms[grip.arm].home),
            ];
            for (a, b) in joints {
                prop_assert!((a.translation.vector - b.translation.vector).norm() < 1e-9 && a.rotation.angle_to(&b.rotation) < 1e-6);
            }
        }
        keeps_its_promises(&plan.reach, &scene, options.reach.speed)?;
        keeps_its_promises(&plan.motion, &scene, speed.min(plan.speed_limit))?;
        keeps_its_promises(&plan.withdraw, &scene, options.reach.speed)?;
        keeps_out_of_the_body(&plan, &body, &scene)?;
        moves_no_node_farther_than_can_be_followed(&plan, &body, &scene, &options)?;
    }

    #[test]
    fn a_block_tumbles_over_its_edges(body in body(), angle in 1.6..PI) {
        let arms = fixture::arms(2);
        let scene = fixture::scene(&arms);
        let set = plan_grips(&body.model(), &scene, &Options::default()).unwrap().sets.remove(0).without_support();
        // Without slack, floor and shift the tips go like points of a rigid block.
        let options = TurnOptions::default().with_angle(Some(angle)).with_slack(0.0).with_retract(0.0).with_release_height(0.0).with_recentre(Recentre::Tumble);
        let Ok(motion) = turn_over(&body.model(), &scene, &set, &options) else { return Ok(()) };
        let t = set.turn;
        let edge = t.point(&Vector3::new(0.0, -t.thickness, 0.0));
        for (grip, path) in set.grips.iter().zip(&motion.arms) {
            let quarter = UnitQuaternion::from_axis_angle(&t.axis, PI / 2.0);
            let rest = UnitQuaternion::from_axis_angle(&t.axis, angle - PI / 2.0);
            let standing = t.pivot + quarter * (grip.tip() - t.pivot);
            let mut lying = edge + rest * (standing - edge);
            lying += t.up.as_ref() * (scene.clearance - scene.table.height(&lying)).max(0.0);
            let end = path.at(motion.duration).unwrap().translation.vector;
            prop_assert!((end - lying.coords).norm() < 1e-9);
        }
        prop_assert!((motion.arms[0].at(motion.duration).unwrap().translation.vector - motion.arms[1].at(motion.duration).unwrap().translation.vector).norm()
            > 0.9 * (set.grips[0].tip() - set.grips[1].tip()).norm());
    }

    #[test]
    fn staying_brings_the_tips_to_the_other_side_of_the_same_place(body in body()) {
        let arms = fixture::arms(2);
        let scene = fixture::scene(&arms);
        let set = plan_grips(&body.model(), &scene, &Options::default()).unwrap().sets.remove(0).without_support();
        let options = TurnOptions::default().with_angle(Some(PI)).with_retract(0.0);
        let Ok(motion) = turn_over(&body.model(), &scene, &set, &options) else { return Ok(()) };
        for (grip, path) in set.grips.iter().zip(&motion.arms) {
            let start = set.turn.local(&grip.tip());
            let end = set.turn.local(&Point3::from(path.at(motion.duration).unwrap().translation.vector));
            prop_assert!((end.y - (set.turn.span - start.y)).abs() < 1e-9 && (end.x - start.x).abs() < 1e-9);
            prop_assert!(end.z <= set.turn.thickness.max(0.012) + 1e-9);
            // On the way the tips never reach out beyond the body standing at its lifted side, nor far behind where it lay.
            for step in 0..100 {
                let pose = path.at(motion.duration * f64::from(step) / 99.0).unwrap();
                let at = set.turn.local(&Point3::from(pose.translation.vector)).y;
                prop_assert!(at <= set.turn.span + set.turn.thickness + 1e-9 && at >= -set.turn.thickness);
            }
        }
    }

    #[test]
    fn a_stretch_in_the_turn_widens_the_grips(body in body(), stretch in 0.0..0.04) {
        let arms = fixture::arms(2);
        let scene = fixture::scene(&arms);
        let set = plan_grips(&body.model(), &scene, &Options::default()).unwrap().sets.remove(0).without_support();
        let Ok(motion) = turn_over(&body.model(), &scene, &set, &TurnOptions::default().with_stretch(stretch)) else { return Ok(()) };
        let apart = |time: f64| set.turn.axis.dot(&(motion.arms[0].at(time).unwrap().translation.vector - motion.arms[1].at(time).unwrap().translation.vector)).abs();
        prop_assert!((apart(motion.duration) - apart(0.0) - stretch).abs() < 1e-9);
    }

    #[test]
    fn a_tilt_shows_both_ends_and_drags_neither(body in body(), tilt in 0.05..0.6) {
        let arms = fixture::arms(2);
        let scene = fixture::scene(&arms);
        let straight = plan_grips(&body.model(), &scene, &Options::default()).unwrap().sets.remove(0).without_support();
        let mut set = straight.clone();
        set.turn.tilt = tilt;
        let options = TurnOptions::default();
        let (Ok(without), Ok(motion)) = (turn_over(&body.model(), &scene, &straight, &options), turn_over(&body.model(), &scene, &set, &options)) else { return Ok(()) };
        keeps_its_promises(&motion, &scene, options.speed)?;
        let stages: Vec<_> = motion.legs.iter().map(|l| l.stage).collect();
        prop_assert_eq!(stages, [Stage::Lift, Stage::Tilt, Stage::Lower]);
        let [hangs, shown] = [0, 1].map(|k| motion.legs[k].until);
        let tip = |m: &Motion, k: usize, time: f64| set.turn.local(&Point3::from(m.arms[k].at(time).unwrap().translation.vector));
        let tilted = |time: f64| {
            let [a, b] = [0, 1].map(|k| tip(&motion, k, time));
            let (a, b) = if a.x < b.x { (a, b) } else { (b, a) };
            (b.z - a.z).atan2(b.x - a.x)
        };
        let times = (0..=400).map(|k| hangs + (shown - hangs) * f64::from(k) / 400.0);
        let level = tilted(hangs);
        let (mut most, mut least) = (0.0_f64, 0.0_f64);
        for time in times {
            let by = tilted(time) - level;
            (most, least) = (most.max(by), least.min(by));
            // The lower end of the box, which hangs from the middle of the grips, is no lower than it hung.
            let [now, before] = [time, hangs].map(|t| 0.5 * (tip(&motion, 0, t) + tip(&motion, 1, t)));
            let end = 0.5 * set.turn.length + now.x.abs();
            prop_assert!(now.z - before.z >= end * by.abs().sin() - 2e-3, "{} {}", by, now.z - before.z);
        }
        prop_assert!((most - tilt).abs() < 2e-2 && (least + tilt).abs() < 2e-2, "{} {}", most, least);
        // Before and after it the motion is the one without a tilt.
        for k in 0..2 {
            let ends = [(tip(&motion, k, hangs), tip(&without, k, without.legs[0].until)), (tip(&motion, k, motion.duration), tip(&without, k, without.duration))];
            prop_assert!(ends.iter().all(|(a, b)| (a - b).norm() < 1e-9));
        }
    }
}

#[test]
fn every_kind_of_workspace_leaves_room_for_plans() {
    let mut planned = 0;
    for (kind, count, k) in
        (0..4).flat_map(|a| (2..4).flat_map(move |b| (0..5).map(move |k| (a, b, k))))
    {
        let t = f64::from(k);
        let body = Body::ellipsoid([0.07 + 0.01 * t, 0.05, 0.02], 500, 0.0, 0.6 * t);
        let arms = fenced(fixture::arms(count), kind, 1.0);
        let scene = fixture::scene(&arms);
        let plan = plan(
            &body.model(),
            &scene,
            Action::TurnOver,
            &PlanOptions::default(),
        );
        planned += usize::from(plan.is_ok());
    }
    // The laws above would be empty if plans were rare.
    assert!(planned >= 36, "{planned} of 40");
}

#[test]
fn the_same_input_gives_the_same_plan() {
    let (body, arms) = (fixture::usual(1200), fixture::arms(3));
    let run = || {
        plan(
            &body.model(),
            &fixture::scene(&arms),
            Action::TurnOver,
            &PlanOptions::default(),
        )
        .unwrap()
    };
    let (a, b) = (run(), run());
    assert_eq!(a.grips, b.grips);
    assert_eq!(a.reach, b.reach);
    assert_eq!(a.motion, b.motion);
    assert_eq!(a.withdraw, b.withdraw);
    assert_eq!(a.coverage_map, b.coverage_map);
}

#[test]
fn grips_on_the_boundary_are_preferred_and_arms_do_not_cross() {
    let (body, arms) = (fixture::usual(1200), fixture::arms(2));
    let sets = plan_grips(&body.model(), &fixture::scene(&arms), &Options::default())
        .unwrap()
        .sets;
    let best = &sets[0];
    for grip in &best.grips {
        assert!(body.boundary[grip.vertex as usize]);
        // The right arm takes the right grip.
        assert!(grip.tip().x * arms[grip.arm].base.x > 0.0);
        assert!((best.turn.local(&grip.tip()).y / best.turn.span) > 0.8);
    }
    assert!(sets.windows(2).all(|w| w[0].score >= w[1].score));
    // Both long sides are there to fall back on.
    assert!(
        sets.iter()
            .any(|s| s.turn.lifted.dot(&best.turn.lifted) < -0.9)
    );
}

#[test]
fn a_wanted_side_is_lifted() {
    let (body, arms) = (fixture::usual(1200), fixture::arms(2));
    for side in [
        Vector3::x_axis(),
        -Vector3::x_axis(),
        Vector3::y_axis(),
        -Vector3::y_axis(),
    ] {
        let options = Options::default().with_lift(Some(side));
        for set in plan_grips(&body.model(), &fixture::scene(&arms), &options)
            .unwrap()
            .sets
        {
            assert!(set.turn.lifted.dot(&side) > 0.99);
        }
    }
}

#[test]
fn weight_zero_is_the_order_of_coverage() {
    let (body, arms) = (fixture::usual(800), fixture::arms(2));
    let options = Options::default()
        .with_turning_weight(0.0)
        .with_outline_weight(1.0);
    let sets = plan_grips(&body.model(), &fixture::scene(&arms), &options)
        .unwrap()
        .sets;
    assert!(
        sets.windows(2)
            .all(|w| w[0].lifting_coverage >= w[1].lifting_coverage)
    );
}

#[test]
fn a_third_arm_holds_at_the_pivot_and_lets_go_early() {
    let (body, arms) = (fixture::usual(1200), fixture::arms(3));
    let options =
        PlanOptions::default().with_grips(Options::default().with_lift(Some(Vector3::y_axis())));
    let plan = plan(
        &body.model(),
        &fixture::scene(&arms),
        Action::TurnOver,
        &options,
    )
    .unwrap();
    let support = plan
        .grips
        .iter()
        .position(|g| g.role == Role::Support)
        .unwrap();
    let turn = plan.turn.unwrap();
    assert_eq!(plan.grips[support].arm, 2);
    assert!(turn.local(&plan.grips[support].tip()).y < 0.3 * turn.span);
    assert!(plan.motion.arms[support].release < 0.7 * plan.motion.duration);
    let end = plan.motion.arms[support].at(plan.motion.duration).unwrap();
    assert!((end.translation.vector - arms[2].home.translation.vector).norm() < 1e-9);
    let lifting: Vec<u32> = plan.grips[..2].iter().map(|g| g.vertex).collect();
    let ranked = plan_grips(&body.model(), &fixture::scene(&arms), &options.grips).unwrap();
    assert!(plan.coverage > ranked.coverage.score(&lifting).unwrap());
}

#[test]
fn every_reason_for_a_rejection_occurs() {
    let arms = fixture::arms(2);
    let mut scene = fixture::scene(&arms);
    let mut body = fixture::usual(1200);
    let rim: Vec<usize> = (0..body.points.len())
        .filter(|&v| body.boundary[v])
        .collect();
    body.visible[rim[0]] = false;
    body.normals[rim[1]] = Vector3::z_axis();
    body.points[rim[2]].z = DEPTH + 0.02;
    body.points[rim[3]].x = 3.0;
    // A lone point above the middle of the way of a tool.
    let options = Options::default()
        .with_source(CandidateSource::Boundary)
        .with_max_candidates(60);
    let tool = candidates(&body.model(), &scene, &options)
        .unwrap()
        .accepted[5]
        .clone();
    body.points[0] = tool.tip - tool.approach.as_ref() * 0.03;
    // Another that stands up beside a vertex, where a jaw would go.
    let pinched = candidates(&body.model(), &scene, &options)
        .unwrap()
        .accepted[12]
        .clone();
    body.points[1] = pinched.camera_from_tip() * Point3::new(0.0, scene.jaw_radius, -0.01);
    let found = candidates(&body.model(), &scene, &options).unwrap();
    let reason = |v: usize| found.rejected.iter().find(|r| r.0 == v as u32).map(|r| r.1);
    assert_eq!(reason(rim[0]), Some(Reason::Hidden));
    assert!(matches!(reason(rim[1]), Some(Reason::FacesTable { .. })));
    assert!(matches!(reason(rim[2]), Some(Reason::TooLow { .. })));
    assert_eq!(
        reason(pinched.vertex as usize),
        Some(Reason::TooWide { by: 1 })
    );
    assert!(matches!(
        reason(rim[3]),
        Some(Reason::OutOfReach {
            arm: 0,
            at: Waypoint::Approach
        })
    ));
    assert!(
        found
            .rejected
            .iter()
            .any(|r| matches!(r.1, Reason::Blocked { by: 0, .. }))
    );
    scene.jaw_separation = 0.01;
    let few = candidates(&body.model(), &scene, &options.with_max_candidates(4)).unwrap();
    assert_eq!(few.accepted.len(), 4);
    assert!(
        few.rejected
            .iter()
            .any(|r| matches!(r.1, Reason::Thinned { .. }))
    );
    let boundary = body.boundary.iter().filter(|b| **b).count();
    assert_eq!(found.accepted.len() + found.rejected.len(), boundary);
}

#[test]
fn an_arm_must_reach_approach_grasp_and_retreat() {
    let (body, free) = (fixture::usual(1200), fixture::arms(2));
    let options = Options::default();
    let first = candidates(&body.model(), &fixture::scene(&free), &options)
        .unwrap()
        .accepted[0]
        .clone();
    let height = |distance: f64| {
        let pose = first.camera_from_tip() * Translation3::new(0.0, 0.0, -distance);
        DEPTH - pose.translation.vector.z
    };
    // The approach is 0.03 m back along the tool, the retreat as far back and 0.015 m up.
    let (grasp, approach) = (height(0.0), height(options.approach_distance));
    let ceilings = [
        (0.5 * (grasp + approach), Some(Waypoint::Approach)),
        (approach + 0.007, Some(Waypoint::Retreat)),
        (approach + 0.016, None),
    ];
    for (ceiling, expected) in ceilings {
        let mut arms = free.clone();
        for arm in &mut arms {
            arm.workspace = Workspace::Custom(Arc::new(move |pose: &Isometry3<f64>| {
                DEPTH - pose.translation.vector.z <= ceiling
            }));
        }
        let found = candidates(&body.model(), &fixture::scene(&arms), &options).unwrap();
        let missed = found.rejected.iter().find_map(|(v, r)| match r {
            Reason::OutOfReach { at, .. } if *v == first.vertex => Some(*at),
            _ => None,
        });
        assert_eq!(missed, expected);
    }
}

/// Where joints do not let a tool rotate as far as its elevation allows, it rotates less with the same grips: the tissue at the jaws takes up the rest.
#[test]
fn a_tool_rotates_with_the_body_only_as_far_as_its_joints_allow() {
    let body = fixture::usual(1200);
    let turning = |arms: &[Arm]| {
        let scene = fixture::scene(arms);
        plan(
            &body.model(),
            &scene,
            Action::TurnOver,
            &PlanOptions::default(),
        )
    };
    let lean = |pose: &Isometry3<f64>| (pose.rotation * Vector3::z()).z.clamp(-1.0, 1.0).acos();
    let most = |plan: &Plan| {
        let keys = plan.motion.arms.iter().flat_map(|p| &p.keyframes);
        keys.map(|k| lean(&k.camera_from_tip)).fold(0.0, f64::max)
    };
    let free = fixture::arms(2);
    let freely = turning(&free).unwrap();
    // A grasp leans by up to 50°, and a tool that rotates with the body by up to 60° to the other side.
    let bound = 52f64.to_radians();
    assert!(most(&freely) > bound + 0.05);
    let mut jointed = free.clone();
    for arm in &mut jointed {
        arm.workspace = Workspace::Custom(Arc::new(move |pose| lean(pose) <= bound));
    }
    let bounded = turning(&jointed).unwrap();
    assert!(most(&bounded) <= bound);
    let vertices = |plan: &Plan| plan.grips.iter().map(|g| g.vertex).collect::<Vec<_>>();
    assert_eq!(vertices(&bounded), vertices(&freely));
    let way = |plan: &Plan| -> Vec<[f64; 3]> {
        let keys = plan.motion.arms.iter().flat_map(|p| &p.keyframes);
        keys.map(|k| k.camera_from_tip.translation.vector.into())
            .collect()
    };
    for (a, b) in way(&bounded).iter().zip(&way(&freely)) {
        assert!((0..3).all(|k| (a[k] - b[k]).abs() < 1e-9));
    }
    // With a bound that no grasp meets there is no plan, and the reason is given.
    for arm in &mut jointed {
        arm.workspace = Workspace::Custom(Arc::new(move |pose| lean(pose) <= 0.1));
    }
    assert!(turning(&jointed).is_err());
}

#[test]
fn candidates_come_against_the_normal_and_never_from_below() {
    let (body, arms) = (fixture::usual(1200), fixture::arms(2));
    let scene = fixture::scene(&arms);
    let options = Options::default();
    for c in candidates(&body.model(), &scene, &options)
        .unwrap()
        .accepted
    {
        let pose = c.camera_from_tip();
        let (y, z) = (pose.rotation * Vector3::y(), pose.rotation * Vector3::z());
        assert!(
            (z - c.approach.into_inner()).norm() < 1e-9 && (y - c.roll.into_inner()).norm() < 1e-9
        );
        assert!(z.dot(&body.normals[c.vertex as usize]) < 0.0);
        assert!(-z.dot(&scene.table.normal) >= options.min_elevation.sin() - 1e-9);
        for jaw in [-1.0, 1.0] {
            assert!(
                scene
                    .table
                    .height(&(pose * Point3::new(0.0, jaw * scene.jaw_radius, 0.0)))
                    >= 0.0
            );
        }
    }
}

#[test]
fn a_body_whose_boundary_is_hidden_is_held_at_its_outline() {
    let arms = fixture::arms(2);
    let mut body = fixture::usual(1200);
    for v in 0..body.points.len() {
        if body.boundary[v] {
            body.visible[v] = false;
        }
    }
    let scene = fixture::scene(&arms);
    assert!(
        plan(
            &body.model(),
            &scene,
            Action::TurnOver,
            &PlanOptions::default()
        )
        .is_ok()
    );
    let strict = PlanOptions::default()
        .with_grips(Options::default().with_source(CandidateSource::Boundary));
    assert!(matches!(
        plan(&body.model(), &scene, Action::TurnOver, &strict),
        Err(Refusal::NoGrips { accepted: 0, .. })
    ));
}

#[test]
fn motions_that_cannot_be_done_are_refused_with_the_reason() {
    let body = fixture::usual(1200);
    // A workspace that ends just above the body.
    let low: Vec<Arm> = fixture::arms(2)
        .into_iter()
        .map(|a| Arm {
            workspace: Workspace::Box {
                camera_from_box: Isometry3::translation(0.0, 0.0, DEPTH),
                half_extents: Vector3::new(0.5, 0.5, 0.08),
            },
            ..a
        })
        .collect();
    let Err(Refusal::AllRefused { refused }) = plan(
        &body.model(),
        &fixture::scene(&low),
        Action::TurnOver,
        &PlanOptions::default(),
    ) else {
        panic!("a motion out of the workspace was planned")
    };
    assert!(
        refused
            .iter()
            .all(|r| matches!(r.reason, Refusal::OutOfWorkspace { .. }))
    );
    // Arms that come from the same place.
    let mut near = fixture::arms(2);
    near[1].base = near[0].base + Vector3::new(0.0, 0.004, 0.0);
    let Err(Refusal::AllRefused { refused }) = plan(
        &body.model(),
        &fixture::scene(&near),
        Action::TurnOver,
        &PlanOptions::default(),
    ) else {
        panic!("two arms in one place were planned")
    };
    assert!(
        refused
            .iter()
            .all(|r| matches!(r.reason, Refusal::ArmsCollide { .. }))
    );
}

#[test]
fn tools_that_would_go_through_the_body_are_refused() {
    let body = fixture::usual(1200);
    // Arms low on the far side of the table: the lines from their wrists to their bases run through the body.
    let mut low = fixture::arms(2);
    let free = fixture::arms(2);
    let lift = Options::default().with_lift(Some(Vector3::y_axis()));
    for arm in &mut low {
        arm.base = Point3::new(0.14 * arm.base.x, -0.25, DEPTH - 0.005);
    }
    let attempt = |arms: &[Arm]| {
        let scene = fixture::scene(arms);
        let set = plan_grips(&body.model(), &scene, &lift)
            .unwrap()
            .sets
            .remove(0);
        turn_over(&body.model(), &scene, &set, &TurnOptions::default()).map(|_| ())
    };
    assert!(attempt(&free).is_ok());
    let refused = attempt(&low);
    assert!(
        matches!(refused, Err(Refusal::HitsBody { stage: Stage::Lift, distance, .. }) if distance < 0.0025),
        "{refused:?}"
    );
}

#[test]
fn workspaces_hold_what_they_say() {
    let at = |x: f64, y: f64, z: f64| {
        Isometry3::from_parts(Translation3::new(x, y, z), UnitQuaternion::identity())
    };
    let sector = Workspace::SphereSector {
        apex: Point3::origin(),
        axis: Vector3::z_axis(),
        half_angle: 0.5,
        radii: [0.1, 0.2],
    };
    assert!(sector.contains(&at(0.0, 0.0, 0.15)) && sector.contains(&at(0.07, 0.0, 0.15)));
    assert!(
        !sector.contains(&at(0.0, 0.0, 0.05))
            && !sector.contains(&at(0.1, 0.0, 0.1))
            && !sector.contains(&at(0.0, 0.0, -0.15))
    );
    let upright = Workspace::Custom(Arc::new(|pose: &Isometry3<f64>| {
        (pose.rotation * Vector3::z()).z > 0.9
    }));
    assert!(
        upright.contains(&at(9.0, 0.0, 0.0))
            && !upright.contains(&Isometry3::rotation(Vector3::x() * 2.0))
    );
}

#[test]
fn bad_input_is_named() {
    let arms = fixture::arms(2);
    let good = fixture::usual(400);
    let scene = fixture::scene(&arms);
    let run = |body: &Body| {
        plan(
            &body.model(),
            &scene,
            Action::TurnOver,
            &PlanOptions::default(),
        )
        .map(|_| ())
    };
    let mut b = good.clone();
    b.points[7].x = f64::NAN;
    assert!(matches!(
        run(&b),
        Err(Refusal::Input(Error::NonFinitePoint { index: 7, .. }))
    ));
    let mut b = good.clone();
    b.areas[3] = -1.0;
    assert!(matches!(
        run(&b),
        Err(Refusal::Input(Error::BadArea { index: 3, .. }))
    ));
    let mut b = good.clone();
    b.edges[2] = [0, 4000];
    assert!(matches!(
        run(&b),
        Err(Refusal::Input(Error::BadEdge { index: 2, .. }))
    ));
    let mut b = good.clone();
    b.visible.pop();
    assert!(matches!(
        run(&b),
        Err(Refusal::Input(Error::LengthMismatch { .. }))
    ));
    let mut b = good.clone();
    b.normals[5] = UnitVector3::new_unchecked(Vector3::new(f64::NAN, 0.0, 0.0));
    assert!(matches!(
        run(&b),
        Err(Refusal::Input(Error::NonFiniteNormal { index: 5 }))
    ));
    for wrong in [0.0, 0.9, 2.0] {
        let mut b = good.clone();
        b.normals[5] = UnitVector3::new_unchecked(Vector3::new(0.0, 0.0, wrong));
        assert!(matches!(
            run(&b),
            Err(Refusal::Input(Error::BadNormal { index: 5, length })) if (length - wrong).abs() < 1e-12
        ));
    }
    let mut b = good.clone();
    b.areas.fill(0.0);
    assert!(matches!(
        run(&b),
        Err(Refusal::Input(Error::NoTarget { .. }))
    ));
    let one = fixture::arms(1);
    let alone = plan(
        &good.model(),
        &fixture::scene(&one),
        Action::TurnOver,
        &PlanOptions::default(),
    );
    assert!(matches!(
        alone,
        Err(Refusal::Input(Error::TooFewArms { count: 1 }))
    ));
    let turn = TurnOptions::default().with_speed(-1.0);
    let slow = plan(
        &good.model(),
        &scene,
        Action::TurnOver,
        &PlanOptions::default().with_turn(turn),
    );
    assert!(matches!(
        slow,
        Err(Refusal::Input(Error::BadSetting { name: "speed", .. }))
    ));
}

#[test]
fn a_tilt_that_is_none_is_named() {
    let (arms, body) = (fixture::arms(2), fixture::usual(400));
    let scene = fixture::scene(&arms);
    let ranked = plan_grips(&body.model(), &scene, &Options::default()).unwrap();
    let mut set = ranked.sets[0].without_support();
    for tilt in [f64::NAN, -0.1, 1.1, 1e9] {
        set.turn.tilt = tilt;
        let refused = turn_over(&body.model(), &scene, &set, &TurnOptions::default()).unwrap_err();
        assert!(refused.to_string().starts_with("tilt is"), "{refused}");
        let options = Options::default().with_tilt(tilt);
        let refused = plan_grips(&body.model(), &scene, &options).unwrap_err();
        assert!(refused.to_string().starts_with("tilt is"), "{refused}");
    }
    // A camera in the middle of the body sees nothing, and breaks nothing.
    let center =
        body.points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / body.points.len() as f64;
    let scene = Scene {
        camera: center.into(),
        ..scene
    };
    assert!(plan_grips(&body.model(), &scene, &Options::default()).is_ok());
}

#[test]
fn degenerate_bodies_are_errors_and_not_panics() {
    let arms = fixture::arms(3);
    let scene = fixture::scene(&arms);
    let of = |points: Vec<Point3<f64>>| {
        let n = points.len();
        let edges = (1..n as u32).map(|v| [v - 1, v]).collect();
        Body {
            points,
            normals: vec![-Vector3::z_axis(); n],
            areas: vec![1e-4; n],
            edges,
            boundary: vec![true; n],
            visible: vec![true; n],
        }
    };
    let shapes = [
        vec![Point3::new(0.0, 0.0, 0.48)],
        vec![Point3::new(0.0, 0.0, 0.48); 30],
        (0..30)
            .map(|k| Point3::new(0.005 * f64::from(k), 0.0, 0.48))
            .collect(),
        (0..900)
            .map(|k| Point3::new(0.005 * f64::from(k % 30), 0.005 * f64::from(k / 30), DEPTH))
            .collect(),
    ];
    for points in shapes {
        let body = of(points);
        // Whatever comes out, it comes out as a value.
        let _ = plan(
            &body.model(),
            &scene,
            Action::TurnOver,
            &PlanOptions::default(),
        );
    }
}

/// Plans take a few milliseconds: fewer cases than usual, unless more are asked for.
fn cases(usual: u32) -> u32 {
    std::env::var("PROPTEST_CASES")
        .ok()
        .and_then(|c| c.parse().ok())
        .unwrap_or(usual)
}
