//! An arm driven on the in-process bus: all reasons that stop a motion or prevent its start.
#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::float_cmp,
    reason = "tests; the ends of motions are met to the last bit"
)]

mod bus;

use bus::{World, apart, classic, reason, seconds, shifted};
use dvrk_io::Error;
use dvrk_io::arm::{
    Absence, Arm, ArmOptions, Dialect, EventKind, Mode, OtherWriters, ReferenceFromRcm, Stop,
};
use dvrk_io::cdr::{Bool, JointState, PoseStamped, StringStamped, Text};
use dvrk_io::kinematics::{RcmFromTip, Unreachable};
use dvrk_io::nalgebra::{Isometry3, UnitQuaternion, Vector3};
use dvrk_io::serve::{ServeOptions, ServedArm};
use dvrk_io::transport::{Qos, Reader, Transport, Writer};

/// Ticks for some time.
fn run(world: &World, arm: &mut Arm, time: f64) {
    for _ in 0..(time * 100.0) as usize {
        world.bus.advance(seconds(0.01));
        arm.tick();
    }
}

/// An arm on a line of 40 mm at 20 mm/s, 0.3 s after its start.
fn moving(options: ArmOptions) -> (World, Arm) {
    let world = World::default();
    let mut arm = world.ready(options);
    arm.start_line(&shifted(&arm, 0.04, 0.0, 0.0), 0.02)
        .unwrap();
    run(&world, &mut arm, 0.3);
    assert!(arm.is_moving());
    (world, arm)
}

/// What the arm was told to hold by the client, counted on the bus.
struct Holds(Reader<dvrk_io::cdr::Empty>);

impl Holds {
    fn new(world: &World) -> Self {
        Self(
            Reader::new(
                &world.bus.node(),
                "/PSM1/hold",
                Qos {
                    depth: 100,
                    ..Qos::COMMAND
                },
            )
            .unwrap(),
        )
    }

    fn count(&mut self) -> usize {
        std::iter::from_fn(|| self.0.take().unwrap()).count()
    }
}

#[test]
fn each_missing_stream_is_named() {
    let world = World::default();
    world.kill();
    let Err(Error::StreamsMissing {
        arm,
        waited,
        streams,
    }) = world.connect(ArmOptions::default())
    else {
        panic!("there is nobody");
    };
    assert_eq!((arm.as_str(), waited, streams.len()), ("PSM1", 6.0, 12));
    let silent = streams
        .iter()
        .filter(|stream| stream.reason == Absence::NobodyPublishes);
    assert_eq!(silent.count(), 7);
    let deaf = streams
        .iter()
        .filter(|stream| stream.reason == Absence::NobodyListens);
    assert_eq!(deaf.count(), 5);

    // Another type, another quality, nothing sent, nothing readable.
    let node = world.bus.node();
    let event = Qos {
        latched: false,
        ..Qos::EVENT
    };
    let state: Writer<dvrk_io::cdr::OperatingState> =
        Writer::new(&node, "/PSM1/operating_state", event).unwrap();
    let pose: Writer<Text> = Writer::new(&node, "/PSM1/measured_cp", Qos::PERIODIC).unwrap();
    let setpoint: Writer<PoseStamped> =
        Writer::new(&node, "/PSM1/setpoint_cp", Qos::PERIODIC).unwrap();
    let Err(Error::StreamsMissing { streams, .. }) = world.connect(ArmOptions::default()) else {
        panic!("nothing is sent");
    };
    let of = |topic: &str| {
        streams
            .iter()
            .find(|stream| stream.topic == topic)
            .map(|stream| &stream.reason)
    };
    assert!(
        matches!(of("/PSM1/operating_state"), Some(Absence::OtherQuality { lacks }) if lacks.contains("latched"))
    );
    assert!(
        matches!(of("/PSM1/measured_cp"), Some(Absence::OtherType { found }) if found == "std_msgs/msg/String")
    );
    assert_eq!(of("/PSM1/setpoint_cp"), Some(&Absence::Silent));
    drop((state, pose, setpoint));
}

#[test]
fn samples_that_do_not_count_are_named() {
    // Stamps of 0, of long ago, of tomorrow, and quaternions that are none.
    let cases = [(0.0, 1.0), (-3.0, 1.0), (3.0, 1.0), (-0.001, 0.0)];
    for (index, (offset, w)) in cases.into_iter().enumerate() {
        let world = World::default();
        let mut arm = world.ready(ArmOptions::default());
        world.kill();
        world.bus.advance(seconds(0.3));
        let node = world.bus.node();
        let mut writer: Writer<PoseStamped> =
            Writer::new(&node, "/PSM1/measured_cp", Qos::PERIODIC).unwrap();
        let stamp = if index == 0 {
            0.0
        } else {
            world.bus.now().as_secs_f64() + offset
        };
        let mut pose: PoseStamped = PoseStamped {
            header: dvrk_io::cdr::Header {
                stamp: dvrk_io::cdr::Time::from_seconds(stamp).unwrap(),
                frame_id: String::new(),
            },
            pose: (&Isometry3::identity()).into(),
        };
        pose.pose.orientation[3] = w;
        writer.publish(&pose).unwrap();
        arm.tick();
        let missing = arm.missing();
        let of_pose = missing
            .iter()
            .find(|stream| stream.topic == "/PSM1/measured_cp")
            .unwrap();
        let expected = match index {
            0 => of_pose.reason == Absence::Invalid,
            1 => matches!(of_pose.reason, Absence::Old(age) if (age - 3.0).abs() < 0.01),
            2 => matches!(of_pose.reason, Absence::Ahead(by) if (by - 3.0).abs() < 0.01),
            _ => {
                matches!(&of_pose.reason, Absence::Unreadable(text) if text.contains("quaternion"))
            }
        };
        assert!(expected, "{index}: {of_pose:?}");
    }
}

#[test]
fn nothing_moves_before_it_is_ready() {
    let world = World::default();
    let mut arm = world.connect(ArmOptions::default()).unwrap();
    let goal = RcmFromTip(Isometry3::translation(0.0, 0.0, -0.12));
    let not_ready = |arm: &mut Arm, mode| {
        let Stop::NotReady { status, .. } = reason(arm.start_line(&goal, 0.02)) else {
            panic!("{mode}");
        };
        assert_eq!(status.mode, mode);
    };
    not_ready(&mut arm, Mode::Disabled);
    arm.enable(seconds(3.0)).unwrap();
    not_ready(&mut arm, Mode::Enabled);
    assert!(matches!(
        reason(arm.start_move(&goal)),
        Stop::NotReady { .. }
    ));
    assert!(matches!(reason(arm.start_jaw(0.1)), Stop::NotReady { .. }));
    arm.home(seconds(3.0)).unwrap();
    for speed in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(matches!(
            arm.start_line(&goal, speed),
            Err(Error::OutOfRange { what: "speed", .. })
        ));
    }
    for angle in [-0.35, 1.5, f64::NAN] {
        assert!(matches!(
            arm.start_jaw(angle),
            Err(Error::OutOfRange { .. })
        ));
    }
    assert!(!arm.is_moving());
}

#[test]
fn goals_out_of_reach_are_refused_before_anything_moves() {
    let world = World::default();
    let mut arm = world.ready(ArmOptions::default());
    // Beyond the insertion.
    let far = shifted(&arm, 0.0, 0.0, -0.2);
    assert!(matches!(
        arm.start_line(&far, 0.02),
        Err(Error::Unreachable(Unreachable::JointLimit { .. }))
    ));
    // Within limits, but with little margin.
    let near_limit = classic()
        .rcm_from_tip(&[0.0, 0.9, 0.12, 0.0, 0.0, 0.0])
        .unwrap();
    assert!(matches!(
        arm.start_line(&near_limit, 0.02),
        Err(Error::Unreachable(Unreachable::LittleMargin { .. }))
    ));
    assert!(matches!(
        arm.start_move(&near_limit),
        Err(Error::Unreachable(_))
    ));
    // Both ends within reach, but the way passes the remote centre.
    let side = classic()
        .rcm_from_tip(&[1.5, 0.0, 0.07, 0.0, 0.0, 0.0])
        .unwrap();
    arm.start_move(&side).unwrap();
    arm.wait(seconds(10.0)).unwrap();
    run(&world, &mut arm, 0.1);
    let other = classic()
        .rcm_from_tip(&[-1.5, 0.0, 0.07, 0.0, 0.0, 0.0])
        .unwrap();
    assert!(matches!(
        arm.start_line(&other, 0.02),
        Err(Error::Unreachable(_))
    ));
    let nan = RcmFromTip(Isometry3::translation(f64::NAN, 0.0, 0.0));
    assert!(arm.start_line(&nan, 0.02).is_err() && arm.start_move(&nan).is_err());
    assert!(!arm.is_moving());
}

#[test]
fn silence_stops_the_arm() {
    let (world, mut arm) = moving(ArmOptions::default());
    let mut holds = Holds::new(&world);
    world.kill();
    let killed = world.bus.now();
    let Stop::Stale { age, .. } = reason(arm.wait(seconds(5.0))) else {
        panic!("nobody is there");
    };
    // One period beyond the 0.2 s after which a stream is stale.
    assert!(age > 0.2 && age < 0.23, "{age}");
    assert!(world.since(killed) < 0.23);
    assert_eq!(holds.count(), 1);
    assert!(matches!(
        reason(arm.start_line(&RcmFromTip(Isometry3::identity()), 0.01)),
        Stop::Stale { .. }
    ));
    assert!(arm.rcm_from_tip().is_none() && arm.joints().is_none() && arm.jaw().is_none());
    assert!(arm.missing().len() > 5);
    // Back again, it has to be enabled and homed anew; the client is the same.
    world.start();
    run(&world, &mut arm, 0.1);
    assert!(matches!(reason(arm.start_jaw(0.2)), Stop::NotReady { .. }));
    arm.enable(seconds(3.0)).unwrap();
    arm.home(seconds(3.0)).unwrap();
    arm.start_line(&shifted(&arm, 0.01, 0.0, 0.0), 0.02)
        .unwrap();
    arm.wait(seconds(3.0)).unwrap();
}

#[test]
fn a_sender_that_repeats_itself_is_silent() {
    let world = World::default();
    let mut arm = world.ready(ArmOptions::default());
    world.kill();
    let node = world.bus.node();
    let mut listener: Reader<PoseStamped> =
        Reader::new(&node, "/PSM1/servo_cp", Qos::COMMAND).unwrap();
    let mut writer: Writer<JointState> =
        Writer::new(&node, "/PSM1/measured_js", Qos::PERIODIC).unwrap();
    let stamp = dvrk_io::cdr::Time::from_seconds(world.bus.now().as_secs_f64()).unwrap();
    let mut joints = JointState {
        position: vec![0.0; 6],
        ..JointState::default()
    };
    joints.header.stamp = stamp;
    world
        .bus
        .every(seconds(0.01), move |_| writer.publish(&joints).unwrap());
    run(&world, &mut arm, 0.15);
    assert!(arm.joints().is_some());
    run(&world, &mut arm, 0.15);
    assert!(arm.joints().is_none(), "the same stamp again and again");
    assert!(listener.take().unwrap().is_none());
}

#[test]
fn a_fault_in_mid_motion() {
    for dialect in [Dialect::Robot, Dialect::Simulator] {
        let world = World::new(ServeOptions::default().with_dialect(dialect));
        let mut arm = world.ready(ArmOptions::default());
        arm.start_line(&shifted(&arm, 0.04, 0.0, 0.0), 0.02)
            .unwrap();
        run(&world, &mut arm, 0.3);
        world.plant(|plant| plant.breaks = Some("encoder lost".into()));
        let Stop::NotReady { status, said } = reason(arm.wait(seconds(5.0))) else {
            panic!("it broke");
        };
        assert_eq!(
            (status.mode, said.as_str()),
            (Mode::Fault, "PSM1: encoder lost")
        );
        // Neither a motion nor a plain `enable` goes over it.
        assert!(matches!(reason(arm.start_jaw(0.2)), Stop::NotReady { .. }));
        let Stop::NotReady { said, .. } = reason(arm.enable(seconds(3.0))) else {
            panic!("{dialect:?}");
        };
        assert_eq!(said, "PSM1: encoder lost");
        arm.clear_fault(seconds(5.0)).unwrap();
        arm.home(seconds(5.0)).unwrap();
        arm.start_line(&shifted(&arm, 0.01, 0.0, 0.0), 0.02)
            .unwrap();
        arm.wait(seconds(5.0)).unwrap();
        arm.clear_fault(seconds(1.0)).unwrap();
    }
}

#[test]
fn an_obstacle_is_told_from_a_fault_to_come() {
    let (world, mut arm) = moving(ArmOptions::default());
    let mut holds = Holds::new(&world);
    world.plant(|plant| plant.stuck = true);
    let Stop::Blocked { distance, .. } = reason(arm.wait(seconds(5.0))) else {
        panic!("it is stuck");
    };
    assert!(distance > 0.015 && distance < 0.017, "{distance}");
    assert_eq!((holds.count(), arm.status().mode), (1, Mode::Enabled));
    // It is still behind: the next motion would push on.
    assert!(matches!(
        reason(arm.start_line(&shifted(&arm, 0.0, 0.0, 0.0), 0.02)),
        Stop::Blocked { .. }
    ));
}

#[test]
fn a_set_point_that_was_clipped_is_noticed() {
    // The robot has tighter limits than its client believes.
    let mut limits = *classic().limits();
    limits[0] = [-0.1, 0.1];
    let world =
        World::new(ServeOptions::default().with_kinematics(classic().with_limits(limits).unwrap()));
    let mut arm = world.ready(ArmOptions::default());
    arm.start_line(&shifted(&arm, 0.04, 0.0, 0.0), 0.02)
        .unwrap();
    let Stop::Diverged { distance, angle } = reason(arm.wait(seconds(5.0))) else {
        panic!("it was clipped");
    };
    assert!(
        (distance > 1e-3 || angle > 0.02) && distance < 0.02,
        "{distance} {angle}"
    );

    // A jaw too.
    let world = World::new(ServeOptions::default().with_jaw_range([0.0, 0.5]));
    let mut arm = world.ready(ArmOptions::default());
    arm.start_jaw(1.0).unwrap();
    let Stop::JawDiverged { angle } = reason(arm.wait(seconds(5.0))) else {
        panic!("it was clipped");
    };
    assert!((angle - 0.5).abs() < 1e-9);
    // And a trajectory.
    let world =
        World::new(ServeOptions::default().with_kinematics(classic().with_limits(limits).unwrap()));
    let mut arm = world.ready(ArmOptions::default());
    arm.start_move(&shifted(&arm, 0.04, 0.0, 0.0)).unwrap();
    assert!(matches!(
        reason(arm.wait(seconds(5.0))),
        Stop::NotReached { .. }
    ));
}

#[test]
fn what_a_simulator_refuses_is_an_error_that_stops() {
    let mut limits = *classic().limits();
    limits[0] = [-0.1, 0.1];
    let options = ServeOptions::default()
        .with_dialect(Dialect::Simulator)
        .with_kinematics(classic().with_limits(limits).unwrap());
    let world = World::new(options);
    let mut arm = world.ready(ArmOptions::default());
    arm.start_line(&shifted(&arm, 0.04, 0.0, 0.0), 0.02)
        .unwrap();
    let Stop::Said(text) = reason(arm.wait(seconds(5.0))) else {
        panic!("it was refused");
    };
    assert!(text.contains("inverse kinematics"), "{text}");
}

#[test]
fn a_hand_at_the_arm() {
    let (world, mut arm) = moving(ArmOptions::default());
    let mut holds = Holds::new(&world);
    let now = world.bus.now();
    world.server(|server| server.clutch(now, true));
    assert_eq!(reason(arm.wait(seconds(5.0))), Stop::Clutched);
    assert!(arm.is_clutched());
    assert_eq!(holds.count(), 0, "a hand is not to be fought");
    assert_eq!(reason(arm.start_jaw(0.1)), Stop::Clutched);
    world.server(|server| server.clutch(now, false));
    run(&world, &mut arm, 0.05);
    assert!(!arm.is_clutched());
    arm.start_line(&shifted(&arm, 0.0, 0.0, 0.01), 0.02)
        .unwrap();
    arm.wait(seconds(5.0)).unwrap();
}

#[test]
fn somebody_else_who_commands() {
    for topic in ["/PSM1/servo_cp", "/PSM1/move_jp", "/PSM1/jaw/servo_jp"] {
        let (world, mut arm) = moving(ArmOptions::default());
        let node = world.bus.node();
        let rival: Writer<PoseStamped> = Writer::new(&node, topic, Qos::COMMAND).unwrap();
        assert_eq!(arm.other_writers(), [topic]);
        assert_eq!(
            reason(arm.wait(seconds(5.0))),
            Stop::OtherWriter {
                topic: topic.into()
            }
        );
        assert_eq!(
            reason(arm.start_jaw(0.1)),
            Stop::OtherWriter {
                topic: topic.into()
            }
        );
        drop(rival);
        arm.start_jaw(0.1).unwrap();
        arm.wait(seconds(2.0)).unwrap();
    }
    // Where it is allowed, what it does is noticed.
    let (world, mut arm) = moving(ArmOptions::default().with_other_writers(OtherWriters::Allow));
    let node = world.bus.node();
    let mut rival: Writer<PoseStamped> =
        Writer::new(&node, "/PSM1/servo_cp", Qos::COMMAND).unwrap();
    run(&world, &mut arm, 0.3);
    assert!(arm.is_moving());
    let there = classic()
        .rcm_from_wrist(&[0.3, 0.1, 0.12, 0.0, 0.0, 0.0])
        .unwrap();
    let pose = PoseStamped {
        header: dvrk_io::cdr::Header::default(),
        pose: (&there.0).into(),
    };
    world
        .bus
        .every(seconds(0.001), move |_| rival.publish(&pose).unwrap());
    // Out of step with the robot, as clocks are: in step, each sample could show our own set-point.
    for _ in 0..50 {
        world.bus.advance(seconds(0.011));
        arm.tick();
    }
    let stop = arm.last_stop().unwrap();
    assert!(
        matches!(stop, Stop::Diverged { .. } | Stop::Blocked { .. }),
        "{stop}"
    );
}

#[test]
fn teleoperation() {
    let (world, mut arm) = moving(ArmOptions::default());
    let mut console: Writer<Bool> =
        Writer::new(&world.bus.node(), "/console/teleop/enabled", Qos::EVENT).unwrap();
    console.publish(&Bool { data: true }).unwrap();
    assert_eq!(reason(arm.wait(seconds(5.0))), Stop::Teleoperation);
    assert_eq!(reason(arm.start_jaw(0.1)), Stop::Teleoperation);
    // Who comes later learns of it too.
    let mut late = world
        .connect(ArmOptions::default().with_other_writers(OtherWriters::Allow))
        .unwrap();
    assert_eq!(reason(late.start_jaw(0.1)), Stop::Teleoperation);
    console.publish(&Bool { data: false }).unwrap();
    arm.tick();
    assert!(!arm.is_teleoperated());
}

#[test]
fn a_base_frame_that_moves() {
    let (world, mut arm) = moving(ArmOptions::default());
    // The camera moves: measured_cp changes, local/measured_cp does not. A second publisher of one of them does as much.
    world.kill();
    let node = world.bus.node();
    let mut streams: Vec<(Writer<PoseStamped>, f64)> =
        ["measured_cp", "setpoint_cp", "local/measured_cp"]
            .into_iter()
            .zip([0.005, 0.005, 0.0])
            .map(|(topic, shift)| {
                (
                    Writer::new(&node, format!("/PSM1/{topic}"), Qos::PERIODIC).unwrap(),
                    shift,
                )
            })
            .collect();
    let local = arm.rcm_from_wrist().unwrap().value.0;
    world.bus.every(seconds(0.01), move |now| {
        for (writer, shift) in &mut streams {
            let pose = Isometry3::translation(0.0, *shift, 0.0) * local;
            let stamp = dvrk_io::cdr::Time::from_seconds(now.as_secs_f64()).unwrap();
            let header = dvrk_io::cdr::Header {
                stamp,
                frame_id: String::new(),
            };
            writer
                .publish(&PoseStamped {
                    header,
                    pose: (&pose).into(),
                })
                .unwrap();
        }
    });
    let Stop::BaseMoved { distance, .. } = reason(arm.wait(seconds(5.0))) else {
        panic!("it moved");
    };
    assert!((distance - 0.005).abs() < 1e-6);
}

#[test]
fn another_instrument_is_noticed() {
    // A robot with an instrument 20 mm longer than its client believes.
    let longer = classic()
        .instrument()
        .with_shaft(classic().instrument().shaft + 0.02);
    let world = World::new(
        ServeOptions::default().with_kinematics(classic().with_instrument(longer).unwrap()),
    );
    let mut arm = world.connect(ArmOptions::default()).unwrap();
    let refused = arm.enable(seconds(3.0));
    assert!(
        matches!(refused, Err(Error::FramesDisagree { distance, .. }) if (distance - 0.0098).abs() < 1e-3),
        "{refused:?}"
    );
}

#[test]
fn a_tool_that_is_missing() {
    let world = World::default();
    let mut arm = world.connect(ArmOptions::default()).unwrap();
    world.plant(|plant| plant.bare = true);
    arm.enable(seconds(3.0)).unwrap();
    let late = arm.home(seconds(4.0));
    let Err(Error::ArmTimeout { status, said, .. }) = late else {
        panic!("{late:?}");
    };
    assert!(status.mode == Mode::Enabled && !status.homed && !status.busy);
    assert_eq!(said, "there is no instrument");
    assert_eq!(arm.tool(), Some(""));
    world.plant(|plant| plant.bare = false);
    arm.home(seconds(4.0)).unwrap();
    // Taken out in mid-motion.
    arm.start_line(&shifted(&arm, 0.02, 0.0, 0.0), 0.02)
        .unwrap();
    run(&world, &mut arm, 0.2);
    world.plant(|plant| plant.bare = true);
    assert!(
        matches!(reason(arm.wait(seconds(5.0))), Stop::NotReady { status, .. } if !status.homed)
    );
}

#[test]
fn a_trajectory_that_is_aborted_by_somebody() {
    let world = World::default();
    let mut arm = world.ready(ArmOptions::default().with_other_writers(OtherWriters::Allow));
    arm.start_move(&shifted(&arm, 0.05, 0.0, 0.0)).unwrap();
    run(&world, &mut arm, 0.3);
    let mut rival: Writer<dvrk_io::cdr::Empty> =
        Writer::new(&world.bus.node(), "/PSM1/hold", Qos::COMMAND).unwrap();
    rival.publish(&dvrk_io::cdr::Empty).unwrap();
    assert!(matches!(
        reason(arm.wait(seconds(5.0))),
        Stop::NotReached { .. }
    ));
}

#[test]
fn commands_that_a_state_does_not_take_are_refused() {
    // The table of DVRK states, by a client that sends what it likes.
    let world = World::default();
    let node = world.bus.node();
    let mut commands: Writer<StringStamped> =
        Writer::new(&node, "/PSM1/state_command", Qos::COMMAND).unwrap();
    let mut warnings: Reader<Text> = Reader::new(&node, "/PSM1/warning", Qos::EVENT).unwrap();
    let mut send = |command: &str| {
        let message = StringStamped {
            string: command.into(),
            ..StringStamped::default()
        };
        commands.publish(&message).unwrap();
        world.bus.advance(seconds(1.5));
        let warned = warnings.take().unwrap().map(|text| text.data);
        (world.server(|server| server.status()), warned)
    };
    for (command, mode, warns) in [
        ("home", Mode::Disabled, true),
        ("pause", Mode::Disabled, true),
        ("resume", Mode::Disabled, true),
        ("enable", Mode::Enabled, false),
        ("resume", Mode::Enabled, true),
        ("pause", Mode::Paused, false),
        ("home", Mode::Paused, true),
        ("enable", Mode::Paused, true),
        ("resume", Mode::Enabled, false),
        ("home", Mode::Enabled, false),
        ("unhome", Mode::Enabled, false),
        ("clear_fault", Mode::Enabled, true),
        ("ENABLE", Mode::Enabled, true),
        ("", Mode::Enabled, true),
        ("disable", Mode::Disabled, false),
        ("disable", Mode::Disabled, false),
    ] {
        let (status, warned) = send(command);
        assert_eq!(
            (status.mode, warned.is_some()),
            (mode, warns),
            "{command}: {warned:?}"
        );
        if let Some(text) = warned {
            assert!(
                text.starts_with("PSM1: command ") && text.contains("is not supported in state")
            );
        }
    }
}

#[test]
fn a_simulator_in_a_fault_does_not_take_enable() {
    let world = World::new(ServeOptions::default().with_dialect(Dialect::Simulator));
    let node = world.bus.node();
    let mut commands: Writer<StringStamped> =
        Writer::new(&node, "/PSM1/state_command", Qos::COMMAND).unwrap();
    let mut warnings: Reader<StringStamped> = Reader::new(
        &node,
        "/PSM1/warning",
        Qos {
            depth: 10,
            ..Qos::EVENT
        },
    )
    .unwrap();
    for (command, mode, warns) in [
        ("fault", Mode::Fault, false),
        ("enable", Mode::Fault, true),
        ("clear_fault", Mode::Disabled, false),
        ("enable", Mode::Enabled, false),
    ] {
        let message = StringStamped {
            string: command.into(),
            ..StringStamped::default()
        };
        commands.publish(&message).unwrap();
        world.bus.advance(seconds(1.0));
        assert_eq!(
            world.server(|server| server.status().mode),
            mode,
            "{command}"
        );
        assert_eq!(warnings.take().unwrap().is_some(), warns, "{command}");
    }
}

#[test]
fn a_paused_arm_is_resumed_by_enabling() {
    let world = World::default();
    let mut arm = world.ready(ArmOptions::default());
    let mut commands: Writer<StringStamped> =
        Writer::new(&world.bus.node(), "/PSM1/state_command", Qos::COMMAND).unwrap();
    arm.start_line(&shifted(&arm, 0.02, 0.0, 0.0), 0.02)
        .unwrap();
    run(&world, &mut arm, 0.2);
    commands
        .publish(&StringStamped {
            string: "pause".into(),
            ..StringStamped::default()
        })
        .unwrap();
    assert!(
        matches!(reason(arm.wait(seconds(3.0))), Stop::NotReady { status, .. } if status.mode == Mode::Paused)
    );
    arm.enable(seconds(3.0)).unwrap();
    assert!(arm.status().homed);
}

#[test]
fn a_released_arm_is_held_and_free_for_others() {
    let (world, arm) = moving(ArmOptions::default());
    let mut holds = Holds::new(&world);
    arm.release();
    assert_eq!(holds.count(), 1);
    let mut next = world.ready(ArmOptions::default());
    assert!(next.other_writers().is_empty());
    next.start_jaw(0.2).unwrap();
    next.wait(seconds(2.0)).unwrap();
}

#[test]
fn jumps_and_bad_commands_of_other_clients_are_answered_as_a_robot_does() {
    let world = World::default();
    let arm = world.ready(ArmOptions::default());
    let node = world.bus.node();
    let mut servo: Writer<PoseStamped> =
        Writer::new(&node, "/PSM1/servo_cp", Qos::COMMAND).unwrap();
    let mut errors: Reader<Text> = Reader::new(&node, "/PSM1/error", Qos::EVENT).unwrap();
    let start = world.plant(|plant| plant.rcm_from_wrist());
    let mut send = |pose: &Isometry3<f64>| {
        let message = PoseStamped {
            header: dvrk_io::cdr::Header::default(),
            pose: pose.into(),
        };
        servo.publish(&message).unwrap();
        world.bus.advance(seconds(0.1));
        errors.take().unwrap().map(|text| text.data)
    };
    // At the remote centre: no inverse kinematics, dropped, still enabled.
    let said = send(&Isometry3::identity()).unwrap();
    assert!(
        said.contains("unable to solve inverse kinematics"),
        "{said}"
    );
    // Not a number, and a quaternion of length 0.
    assert!(send(&Isometry3::translation(f64::NAN, 0.0, 0.0)).is_some());
    assert!(apart(&world.plant(|plant| plant.rcm_from_wrist()).0, &start.0).0 < 1e-12);
    // 20 mm from the remote centre: pushed out to 45 mm, without a word.
    assert_eq!(
        send(&(Isometry3::translation(0.0, 0.0, -0.02) * start.0.rotation)),
        None
    );
    let pushed = world
        .plant(|plant| plant.rcm_from_wrist())
        .0
        .translation
        .vector;
    assert!(
        (pushed.norm() - (0.045 + 0.0091)).abs() < 1e-9,
        "{}",
        pushed.norm()
    );
    // A jump of the set-point by more than the PID allows.
    world.plant(|plant| plant.stuck = true);
    let far = classic()
        .rcm_from_wrist(&[0.8, 0.0, 0.12, 0.0, 0.0, 0.0])
        .unwrap();
    let said = send(&far.0).unwrap();
    assert!(said.contains("tracking error"), "{said}");
    assert_eq!(world.server(|server| server.status().mode), Mode::Fault);
    drop(arm);
}

#[test]
fn a_client_behind_a_moved_base_commands_the_same_place() {
    // The order of frames in a command is the other way round than in a measurement: a mistake shows with a turned base only.
    let base = Isometry3::from_parts(
        Vector3::new(0.1, 0.2, 0.3).into(),
        UnitQuaternion::from_scaled_axis(Vector3::new(1.0, 2.0, -0.5)),
    );
    let world = World::new(ServeOptions::default().with_reference_from_rcm(ReferenceFromRcm(base)));
    let mut arm = world.ready(ArmOptions::default());
    let goal = shifted(&arm, -0.01, 0.02, 0.0);
    arm.start_move(&goal).unwrap();
    arm.wait(seconds(5.0)).unwrap();
    run(&world, &mut arm, 0.05);
    assert!(apart(&arm.rcm_from_tip().unwrap().value.0, &goal.0).0 < 1e-9);
    let events = arm.take_events();
    assert!(
        !events
            .iter()
            .any(|event| matches!(event.kind, EventKind::Error(_) | EventKind::Trouble(_)))
    );
    assert!(world.node().now() > seconds(0.0));
}

#[test]
fn names_and_options_are_checked() {
    let world = World::default();
    for name in ["", "PSM 1", "1PSM", "PSM1/jaw", "PSM1/", "ÄRM"] {
        let refused = Arm::connect(world.node(), name, ArmOptions::default(), seconds(1.0));
        assert!(
            matches!(refused.map(drop), Err(Error::BadArmName { .. })),
            "{name}"
        );
    }
    let bad = [
        ArmOptions::default().with_period(seconds(0.0)),
        ArmOptions::default().with_period(seconds(1.0)),
        ArmOptions::default().with_stale(seconds(0.001)),
        ArmOptions::default().with_joint_step(f64::NAN),
        ArmOptions::default().with_jaw_range([1.0, 0.0]),
        ArmOptions::default().with_divergence(dvrk_io::arm::Tolerance {
            length: 0.0,
            angle: 1.0,
        }),
    ];
    for options in bad {
        assert!(matches!(
            world.connect(options).map(drop),
            Err(Error::OutOfRange { .. })
        ));
    }
}
