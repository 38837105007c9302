//! An arm driven on the in-process bus: operation without faults.
#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::float_cmp,
    reason = "tests; the ends of motions are met to the last bit"
)]

mod bus;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use bus::{World, apart, classic, seconds, shifted};
use dvrk_io::Error;
use dvrk_io::arm::{
    Arm, ArmOptions, ArmThread, CameraFromRcm, ControlPoint, Dialect, EventKind, LocalPose, Mode,
    ProfileLimits, ReferenceFromRcm, Stop, Tolerance,
};
use dvrk_io::cdr::{Empty, JointState, PoseStamped};
use dvrk_io::kinematics::RcmFromTip;
use dvrk_io::nalgebra::{Isometry3, UnitQuaternion, Vector3};
use dvrk_io::serve::ServeOptions;
use dvrk_io::transport::{BusNode, Peer, Publisher, Qos, Reader, Subscriber, Topic, Transport};
use proptest::prelude::*;

fn somewhere() -> Isometry3<f64> {
    Isometry3::new(Vector3::new(0.3, -0.2, 0.5), Vector3::new(0.4, -1.0, 2.0))
}

#[test]
fn connect_enable_home_and_read() {
    let world = World::default();
    let mut arm = world.connect(ArmOptions::default()).unwrap();
    assert_eq!(arm.status().mode, Mode::Disabled);
    assert_eq!(arm.dialect(), Dialect::Robot);
    // Nothing is measured without power: there is a stream, but no pose.
    assert!(arm.rcm_from_tip().is_none() && arm.joints().is_none());
    arm.enable(seconds(3.0)).unwrap();
    assert!(arm.status().mode == Mode::Enabled && !arm.status().homed);
    arm.home(seconds(3.0)).unwrap();
    assert!(arm.status().homed && !arm.status().busy);
    assert_eq!(arm.control_point(), Some(ControlPoint::Wrist));
    assert_eq!(arm.tool(), Some("LARGE_NEEDLE_DRIVER:400006"));
    // DVRK.md: at (0, 0, 0.12, 0, 0, 0) the control point is at (0, 0, −0.1135).
    let wrist = arm.rcm_from_wrist().unwrap().value;
    assert!((wrist.0.translation.vector - Vector3::new(0.0, 0.0, -0.1135)).norm() < 1e-12);
    let tip = arm.rcm_from_tip().unwrap().value;
    assert!((tip.0.translation.vector - Vector3::new(0.0, 0.0, -0.1237)).norm() < 1e-12);
    assert!(apart(&arm.tip_setpoint().unwrap().value.0, &tip.0).0 < 1e-12);
    let joints = arm.joints().unwrap().value;
    assert!((joints[2] - 0.12).abs() < 1e-12);
    assert_eq!(arm.joint_setpoint().unwrap().value[2], 0.12);
    assert_eq!(arm.velocity().unwrap().value.linear, [0.0; 3]);
    let jaw = arm.jaw().unwrap().value;
    assert_eq!((jaw.angle, jaw.setpoint, jaw.effort), (0.0, 0.0, Some(0.0)));
    assert!(arm.other_writers().is_empty() && !arm.is_clutched() && !arm.is_teleoperated());
    // Both do nothing to an arm that is ready.
    let before = world.bus.now();
    arm.enable(seconds(3.0)).unwrap();
    arm.home(seconds(3.0)).unwrap();
    assert!(world.since(before) < 0.05);
    arm.disable(seconds(3.0)).unwrap();
    assert_eq!(arm.status().mode, Mode::Disabled);
}

/// Set-points as the robot got them: each with the time, deduplicated.
fn setpoints(world: &World) -> Vec<(f64, Isometry3<f64>, f64)> {
    let followed = world.plant(|plant| std::mem::take(&mut plant.followed));
    let mut time = 0.0;
    let mut all: Vec<(f64, Isometry3<f64>, f64)> = Vec::new();
    for (step, wrist, jaw) in followed {
        time += step.as_secs_f64();
        let tip = classic().tip_of(&wrist).0;
        if all
            .last()
            .is_none_or(|(_, last, angle)| apart(last, &tip).0 > 1e-12 || *angle != jaw)
        {
            all.push((time, tip, jaw));
        }
    }
    all
}

#[test]
fn a_line_is_straight_and_within_limits_and_the_jaw_goes_along() {
    let world = World::default();
    let motion = ProfileLimits {
        speed: 0.05,
        acceleration: 0.2,
        step: 3e-4,
    };
    let mut arm = world.ready(ArmOptions::default().with_motion(motion));
    setpoints(&world);
    let start = arm.rcm_from_tip().unwrap().value.0;
    let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.3, 0.2, -0.4));
    let mut goal = shifted(&arm, 0.02, -0.015, 0.01);
    goal.0.rotation = turn * goal.0.rotation;
    arm.start_line(&goal, 0.04).unwrap();
    arm.start_jaw(0.6).unwrap();
    assert!(arm.is_moving());
    arm.wait(seconds(10.0)).unwrap();
    assert_eq!(arm.last_stop(), Some(&Stop::Arrived));
    world.bus.advance(seconds(0.1));
    arm.tick();
    let (distance, angle) = apart(&arm.rcm_from_tip().unwrap().value.0, &goal.0);
    assert!(distance < 1e-9 && angle < 1e-9, "{distance} {angle}");
    assert!((arm.jaw().unwrap().value.angle - 0.6).abs() < 1e-9);

    let all = setpoints(&world);
    assert!(all.len() > 60, "{}", all.len());
    let way = goal.0.translation.vector - start.translation.vector;
    let (mut last, mut speed) = (start, 0.0);
    for (_, tip, _) in &all {
        let done = tip.translation.vector - start.translation.vector;
        let share = done.dot(&way) / way.norm_squared();
        assert!((done - share * way).norm() < 1e-9, "off the line");
        let turned = (tip.rotation * start.rotation.inverse()).scaled_axis();
        assert!(
            (turned - share * turn.scaled_axis()).norm() < 1e-6,
            "translation and rotation end together"
        );
        let step = apart(tip, &last).0;
        assert!(step < 3e-4 + 1e-9, "step {step}");
        // 3·10⁻⁴ m in 10 ms is 0.03 m/s: the step is what limits the speed here.
        let now = step / 0.01;
        assert!(
            now <= 0.03 + 1e-9 && (now - speed).abs() <= 0.002 + 1e-8,
            "{now} after {speed}"
        );
        (last, speed) = (*tip, now);
    }
    // Pose and angle change in the same ticks.
    let both = all
        .windows(2)
        .filter(|pair| pair[0].2 != pair[1].2 && apart(&pair[0].1, &pair[1].1).0 > 0.0);
    assert!(both.count() > 30);
    let jaw_steps = all.windows(2).map(|pair| (pair[1].2 - pair[0].2).abs());
    assert!(jaw_steps.fold(0.0, f64::max) <= 0.015 + 1e-9);
}

#[test]
fn a_speed_is_that_of_the_fastest_point_of_the_jaws() {
    let world = World::default();
    let mut arm = world.ready(ArmOptions::default());
    let mut goal = shifted(&arm, 0.0, 0.0, 0.0);
    goal.0.rotation = UnitQuaternion::from_scaled_axis(Vector3::z() * 0.5) * goal.0.rotation;
    let start = world.bus.now();
    arm.start_line(&goal, 0.02).unwrap();
    arm.wait(seconds(10.0)).unwrap();
    // 0.5 rad · 20 mm at 20 mm/s, and 0.1 s to gain and lose speed.
    let time = world.since(start);
    assert!((0.58..0.68).contains(&time), "{time}");
}

#[test]
fn a_new_goal_replaces_the_one_under_way_within_limits() {
    let world = World::default();
    let mut arm = world.ready(ArmOptions::default());
    setpoints(&world);
    let (first, second) = (
        shifted(&arm, 0.03, 0.0, 0.0),
        shifted(&arm, 0.01, 0.03, 0.0),
    );
    arm.start_line(&first, 0.05).unwrap();
    for _ in 0..30 {
        world.bus.advance(seconds(0.01));
        arm.tick();
    }
    arm.start_line(&second, 0.05).unwrap();
    arm.wait(seconds(10.0)).unwrap();
    // The last set-point is on its way when the arm is within tolerance.
    world.bus.advance(seconds(0.02));
    let all = setpoints(&world);
    // 0.3 s at up to 50 mm/s, and the way that braking takes: not the 30 mm of the first goal.
    let farthest = all.iter().map(|(_, tip, _)| tip.translation.x);
    let start = all[0].1.translation.x;
    assert!(farthest.fold(f64::MIN, f64::max) - start < 0.018);
    // Ticks of rest leave no set-point of their own in this list, but a longer gap.
    let mut velocities = Vec::new();
    for pair in all.windows(2) {
        let ticks = ((pair[1].0 - pair[0].0) / 0.01).round() as usize;
        velocities.extend(vec![Vector3::zeros(); ticks - 1]);
        velocities.push((pair[1].1.translation.vector - pair[0].1.translation.vector) / 0.01);
    }
    for pair in velocities.windows(2) {
        let gain = (pair[1] - pair[0]).norm();
        assert!(gain <= 0.002 + 1e-6, "{gain}");
    }
    assert!(
        velocities.contains(&Vector3::zeros()),
        "it stops at the corner"
    );
    assert!(apart(&all.last().unwrap().1, &second.0).0 < 1e-9);
}

#[test]
fn goals_on_one_line_are_joined_without_a_stop() {
    let world = World::default();
    let mut arm = world.ready(ArmOptions::default());
    let goals: Vec<_> = (1..=4)
        .map(|k| shifted(&arm, 0.01 * f64::from(k), 0.0, 0.0))
        .collect();
    let start = world.bus.now();
    for goal in &goals {
        arm.start_line(goal, 0.05).unwrap();
        for _ in 0..12 {
            world.bus.advance(seconds(0.01));
            arm.tick();
        }
    }
    arm.wait(seconds(10.0)).unwrap();
    // 40 mm at 50 mm/s in one go: 0.8 s, 0.25 s to gain and lose speed, and the set-point's way back.
    let time = world.since(start);
    assert!(time < 1.2, "{time}");
}

/// Changes from one tick to the next: none may be more than `limit`, nor the changes of these more than `gain`.
fn within(values: &[f64], limit: f64, gain: f64) -> Result<(), TestCaseError> {
    let steps: Vec<f64> = values.windows(2).map(|pair| pair[1] - pair[0]).collect();
    for step in &steps {
        prop_assert!(step.abs() <= limit * (1.0 + 1e-9) + 1e-12, "step {}", step);
    }
    // From rest, and to rest.
    let rest = [0.0];
    let all: Vec<f64> = rest.iter().chain(&steps).chain(&rest).copied().collect();
    for pair in all.windows(2) {
        let change = (pair[1] - pair[0]).abs();
        // Speed is carried round bends of a thousandth of what a tick allows.
        prop_assert!(
            change <= gain * 1.002 + 1e-9,
            "{} after {}",
            pair[1],
            pair[0]
        );
    }
    Ok(())
}

proptest! {
    /// Goals that turn round, come nearer or are to be reached more slowly, in mid-motion.
    #[test]
    fn goals_at_any_time_keep_the_limits_of_tips_and_jaw(
        goals in prop::collection::vec((1..40_usize, -0.349..1.396_f64, -0.02..0.02_f64, 0.005..0.06_f64), 1..8),
        // The slower the arm reports, the further its set-points lag behind what is sent.
        period in prop::sample::select(vec![0.01, 0.04]),
    ) {
        let world = World::new(ServeOptions::default().with_period(seconds(period)));
        let mut arm = world.ready(ArmOptions::default());
        let every = Qos { depth: 10_000, ..Qos::COMMAND };
        let node = world.node();
        let mut jaws: Reader<JointState> = Reader::new(node.as_ref(), "/PSM1/jaw/servo_jp", every).unwrap();
        let mut poses: Reader<PoseStamped> = Reader::new(node.as_ref(), "/PSM1/servo_cp", every).unwrap();
        let start = shifted(&arm, 0.0, 0.0, 0.0);
        for (ticks, angle, x, speed) in &goals {
            arm.start_jaw(*angle).unwrap();
            let mut goal = start;
            goal.0.translation.x += x;
            arm.start_line(&goal, *speed).unwrap();
            for _ in 0..*ticks {
                world.bus.advance(seconds(0.01));
                arm.tick();
            }
        }
        arm.wait(seconds(10.0)).unwrap();
        let (_, angle, x, _) = goals[goals.len() - 1];
        let mut angles = vec![0.0];
        while let Some(jaw) = jaws.take().unwrap() {
            angles.push(jaw.position[0]);
        }
        let mut places = vec![start.0.translation.x];
        let kinematics = classic();
        while let Some(pose) = poses.take().unwrap() {
            let wrist = dvrk_io::kinematics::RcmFromWrist(pose.pose.isometry().unwrap());
            places.push(kinematics.tip_of(&wrist).0.translation.x);
        }
        prop_assert!((angles[angles.len() - 1] - angle).abs() < 1e-9);
        prop_assert!((places[places.len() - 1] - start.0.translation.x - x).abs() < 1e-9);
        let limits = ArmOptions::default();
        within(&angles, limits.jaw.speed * 0.01, limits.jaw.acceleration * 1e-4)?;
        within(&places, limits.motion.speed * 0.01, limits.motion.acceleration * 1e-4)?;
    }
}

#[test]
fn a_move_waits_for_busy_to_rise_and_fall() {
    let world = World::default();
    let mut arm = world.ready(ArmOptions::default());
    let goal = shifted(&arm, 0.03, 0.02, 0.0);
    let start = world.bus.now();
    arm.start_move(&goal).unwrap();
    assert!(!arm.is_clutched(), "a trajectory is not a hand");
    arm.wait(seconds(10.0)).unwrap();
    let time = world.since(start);
    assert!(time > 0.3 && time < 2.0, "{time:?}");
    world.bus.advance(seconds(0.05));
    arm.tick();
    assert!(apart(&arm.rcm_from_tip().unwrap().value.0, &goal.0).0 < 1e-9);
    // To where it is: done, though busy never rises for long enough to be seen.
    arm.start_move(&goal).unwrap();
    arm.wait(seconds(3.0)).unwrap();
    // And a line from there starts at once.
    arm.start_line(&shifted(&arm, -0.005, 0.0, 0.0), 0.05)
        .unwrap();
    arm.wait(seconds(3.0)).unwrap();
}

#[test]
fn hold_stops_a_line_and_a_trajectory() {
    let world = World::default();
    let mut arm = world.ready(ArmOptions::default());
    let start = arm.rcm_from_tip().unwrap().value.0;
    for trajectory in [false, true] {
        let goal = shifted(&arm, 0.03, 0.0, 0.0);
        if trajectory {
            arm.start_move(&goal).unwrap();
        } else {
            arm.start_line(&goal, 0.02).unwrap();
        }
        for _ in 0..30 {
            world.bus.advance(seconds(0.01));
            arm.tick();
        }
        arm.hold();
        assert_eq!(bus::reason(arm.wait(seconds(1.0))), Stop::Held);
        world.bus.advance(seconds(0.5));
        arm.tick();
        let here = arm.rcm_from_tip().unwrap().value.0;
        let (distance, _) = apart(&here, &goal.0);
        assert!(
            distance > 0.005 && apart(&here, &start).0 > 1e-3,
            "{distance}"
        );
        assert!(!arm.status().busy);
    }
}

/// The reported pose of an arm lags behind its set-points: after a hold the next line starts where the arm will be, without a jump back, and
/// set-points still in transit are not a divergence.
#[test]
fn a_line_goes_on_after_a_hold() {
    for pause in [0.0, 0.01, 0.03, 0.3, 1.0] {
        let world = World::default();
        // Less than the way of one tick at this speed.
        let divergence = Tolerance {
            length: 2e-4,
            angle: 0.02,
        };
        let mut arm = world.ready(ArmOptions::default().with_divergence(divergence));
        let goal = shifted(&arm, 0.04, 0.0, 0.0);
        arm.start_line(&goal, 0.05).unwrap();
        let run = |arm: &mut Arm, time: f64| {
            for _ in 0..(time * 100.0).round() as usize {
                world.bus.advance(seconds(0.01));
                arm.tick();
            }
        };
        run(&mut arm, 0.5);
        setpoints(&world);
        arm.hold();
        run(&mut arm, pause);
        arm.start_line(&goal, 0.05).unwrap();
        arm.wait(seconds(5.0)).unwrap();
        let sent = setpoints(&world);
        let left: Vec<f64> = sent
            .iter()
            .map(|(_, tip, _)| apart(tip, &goal.0).0)
            .collect();
        assert!(
            left.windows(2).all(|two| two[1] < two[0] + 1e-9),
            "{pause}: {left:?}"
        );
        assert!(left.windows(2).all(|two| two[0] - two[1] < 1e-3), "{pause}");
        assert!(left.last().is_some_and(|last| *last < 1e-6));
    }
}

#[test]
fn a_simulator_is_understood_too() {
    let world = World::new(ServeOptions::default().with_dialect(Dialect::Simulator));
    let mut arm = world.connect(ArmOptions::default()).unwrap();
    // Enabled and homed from the start; poses are those of the tips.
    assert!(arm.status().homed && arm.dialect() == Dialect::Simulator);
    assert_eq!(arm.control_point(), Some(ControlPoint::Tip));
    let tip = arm.rcm_from_tip().unwrap().value.0;
    assert!((tip.translation.vector - Vector3::new(0.0, 0.0, -0.1237)).norm() < 1e-12);
    arm.enable(seconds(1.0)).unwrap();
    arm.home(seconds(1.0)).unwrap();
    let goal = shifted(&arm, 0.02, 0.0, 0.005);
    arm.start_line(&goal, 0.05).unwrap();
    arm.wait(seconds(5.0)).unwrap();
    world.bus.advance(seconds(0.05));
    arm.tick();
    // The same goal as with a robot brings the tips to the same place.
    let wrist = world.plant(|plant| dvrk_io::serve::ServedArm::rcm_from_wrist(plant));
    assert!(apart(&classic().tip_of(&wrist).0, &goal.0).0 < 1e-9);
    // Its texts are stamped.
    world.server(|server| server.fail(Duration::from_secs(2000), "the motor is hot"));
    world.bus.advance(seconds(0.05));
    arm.tick();
    let events = arm.take_events();
    assert!(
        events
            .iter()
            .any(|event| event.kind == EventKind::Error("PSM1: the motor is hot".into()))
    );
    arm.clear_fault(seconds(3.0)).unwrap();
    assert_eq!(arm.status().mode, Mode::Enabled);
}

#[test]
fn a_base_frame_is_found_and_goals_are_sent_in_it() {
    let base = ReferenceFromRcm(somewhere());
    let options = ServeOptions::default()
        .with_reference_from_rcm(base)
        .with_reference(Some("camera".into()));
    let world = World::new(options);
    let mut arm = world.ready(ArmOptions::default());
    let check = arm.check().unwrap();
    assert_eq!(check.reference, "camera");
    assert!(check.distance < 1e-9 && apart(&check.reference_from_rcm.0, &base.0).0 < 1e-12);
    let within = Tolerance {
        length: 1e-3,
        angle: 0.01,
    };
    check.compare_base(&base, within).unwrap();
    let wrong = ReferenceFromRcm(Isometry3::translation(0.0, 0.0, 0.002) * base.0);
    assert!(
        matches!(check.compare_base(&wrong, within), Err(Error::BaseFrame { distance, .. }) if (distance - 0.002).abs() < 1e-9)
    );
    let goal = shifted(&arm, 0.01, 0.01, -0.01);
    arm.start_line(&goal, 0.05).unwrap();
    arm.wait(seconds(5.0)).unwrap();
    world.bus.advance(seconds(0.05));
    let wrist = world.plant(|plant| dvrk_io::serve::ServedArm::rcm_from_wrist(plant));
    assert!(apart(&classic().tip_of(&wrist).0, &goal.0).0 < 1e-9);
}

#[test]
fn an_arm_without_a_local_pose_is_driven_by_its_joints() {
    let world = World::default();
    let mut arm = world.ready(ArmOptions::default().with_local(LocalPose::FromJoints));
    let goal = shifted(&arm, 0.01, 0.0, 0.0);
    arm.start_line(&goal, 0.05).unwrap();
    arm.wait(seconds(5.0)).unwrap();
}

#[test]
fn frames_fit_or_do_not_compile() {
    let camera_from_rcm = CameraFromRcm(somewhere());
    let rcm_from_tip = RcmFromTip(Isometry3::translation(0.0, 0.01, -0.12));
    let camera_from_tip = camera_from_rcm * rcm_from_tip;
    let back = camera_from_rcm.rcm_from_tip(&camera_from_tip);
    assert!(apart(&back.0, &rcm_from_tip.0).0 < 1e-12);
    let wrist = classic().wrist_of(&rcm_from_tip);
    let back = camera_from_rcm.rcm_from_wrist(&(camera_from_rcm * wrist));
    assert!(apart(&back.0, &wrist.0).0 < 1e-12);
}

#[test]
fn a_thread_drives_while_its_owner_does_something_else() {
    // Real time: the bus has no thread of its own, so that of the arm makes time pass.
    let world = World::default();
    let arm = world.ready(ArmOptions::default());
    let goal = shifted(&arm, 0.01, 0.0, 0.0);
    let driven = ArmThread::spawn(arm).unwrap();
    driven.lock().start_line(&goal, 0.05).unwrap();
    driven.wait(seconds(30.0)).unwrap();
    let tip = driven.lock().tip_setpoint().unwrap().value;
    assert!(apart(&tip.0, &goal.0).0 < 1e-3);
    driven.release();
}

/// A transport that panics in the thread of the arm.
struct Breaking {
    inner: Arc<BusNode>,
    broken: AtomicBool,
}

impl Transport for Breaking {
    fn now(&self) -> Duration {
        self.inner.now()
    }

    fn wait(&self, until: Duration) {
        self.inner.wait(until);
    }

    fn subscribe(&self, topic: &Topic) -> Result<Box<dyn Subscriber>, Error> {
        self.inner.subscribe(topic)
    }

    fn advertise(&self, topic: &Topic) -> Result<Box<dyn Publisher>, Error> {
        self.inner.advertise(topic)
    }

    fn writers(&self, name: &str) -> Vec<Peer> {
        let driver = std::thread::current().name() == Some("PSM1");
        assert!(
            !(driver && self.broken.load(Ordering::Relaxed)),
            "as planned"
        );
        self.inner.writers(name)
    }

    fn readers(&self, name: &str) -> Vec<Peer> {
        self.inner.readers(name)
    }
}

#[test]
fn a_thread_that_panicked_is_no_arrival() {
    let world = World::default();
    let transport = Arc::new(Breaking {
        inner: world.node(),
        broken: AtomicBool::new(false),
    });
    let shared: Arc<dyn Transport> = Arc::clone(&transport) as _;
    let mut arm = Arm::connect(shared, "PSM1", ArmOptions::default(), seconds(6.0)).unwrap();
    arm.enable(seconds(6.0)).unwrap();
    arm.home(seconds(10.0)).unwrap();
    let mut holds: Reader<Empty> =
        Reader::new(world.node().as_ref(), "/PSM1/hold", Qos::COMMAND).unwrap();
    let goal = shifted(&arm, 0.02, 0.0, 0.0);
    let thread = ArmThread::spawn(arm).unwrap();
    thread.lock().start_line(&goal, 0.01).unwrap();
    transport.broken.store(true, Ordering::Relaxed);
    let Err(Error::Network { reason, .. }) = thread.wait(seconds(10.0)) else {
        panic!("it goes on");
    };
    assert_eq!(reason, "it panicked");
    assert!(holds.take().unwrap().is_some(), "the arm is held");
}

#[test]
fn the_same_run_gives_the_same_bits() {
    let run = || {
        let world = World::default();
        let mut arm = world.ready(ArmOptions::default());
        arm.start_line(&shifted(&arm, 0.01, 0.02, 0.01), 0.03)
            .unwrap();
        arm.start_jaw(0.3).unwrap();
        arm.wait(seconds(10.0)).unwrap();
        let followed = world.plant(|plant| std::mem::take(&mut plant.followed));
        (world.node().now(), followed)
    };
    assert!(run() == run());
}
