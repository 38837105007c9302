//! The cell of dVRK arms against served arms and a served camera on a bus within this process, in simulated time: operation
//! without faults, and how each fault is reported.
#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::float_cmp,
    reason = "tests; what does not move stays at the same bits"
)]

#[path = "dvrk_cell/world.rs"]
mod world;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use dvrk_io::cdr::{Bool, PoseStamped};
use dvrk_io::transport::{Qos, Writer};
use explore_loop::cell::dvrk::{CellFile, DvrkCell};
use explore_loop::cell::{Cell, CellError, Observation};
use explore_loop::nalgebra::{Isometry3, Translation3};
use world::{BALL, RADIUS, World};

/// As slow as a manipulation, m/s; a motion of [`FAR`] takes a few seconds then.
const SPEED: f64 = 0.01;
const FAR: f64 = 0.03;

/// The pose in which an arm is, moved towards the table.
fn lower(cell: &DvrkCell, arm: usize, way: f64) -> Isometry3<f64> {
    Translation3::new(0.0, 0.0, way) * cell.info().arms[arm].camera_from_home
}

/// Sends both arms on a long way, and sees them on it.
fn under_way(cell: &mut DvrkCell) {
    for arm in 0..2 {
        let goal = lower(cell, arm, FAR);
        cell.move_arm(arm, goal, SPEED).unwrap();
    }
    let seen = frames(cell, 5);
    assert!(seen.arms.iter().all(|arm| arm.moving));
}

fn frames(cell: &mut DvrkCell, count: usize) -> Observation {
    (1..count).for_each(|_| drop(cell.observe().unwrap()));
    cell.observe().unwrap()
}

/// How far an arm is from its home.
fn way(cell: &DvrkCell, seen: &Observation, arm: usize) -> f64 {
    let home = &cell.info().arms[arm].camera_from_home;
    (seen.arms[arm].camera_from_tip.translation.vector - home.translation.vector).norm()
}

/// Both arms stop before their goals, and further commands are rejected, with the reason of one arm.
fn all_stand(cell: &mut DvrkCell, world: &World, faulty: usize, why: &str) {
    let jaws = world.jaws();
    let seen = frames(cell, 2);
    let later = frames(cell, 5);
    for arm in 0..2 {
        assert!(!later.arms[arm].moving, "arm {arm}");
        let (then, now) = (way(cell, &seen, arm), way(cell, &later, arm));
        assert!((then - now).abs() < 1e-6, "arm {arm}: {then} to {now}");
        assert!(now > 1e-3 && now < 0.9 * FAR, "arm {arm}: {now}");
    }
    for arm in 0..2 {
        let goal = lower(cell, arm, 0.0);
        let refused = [
            cell.move_arm(arm, goal, SPEED),
            cell.close_jaw(arm),
            cell.open_jaw(arm),
            cell.home(),
        ];
        for refused in refused {
            let Err(CellError::ArmFault { arm, reason }) = &refused else {
                panic!("{refused:?}");
            };
            assert_eq!(*arm, faulty);
            assert!(reason.contains(why), "{reason}");
        }
    }
    assert_eq!(world.jaws(), jaws);
}

#[test]
fn what_is_looked_at_moves_nothing_and_what_is_sent_arrives() {
    let world = World::new();
    let preflight = world.preflight();
    for check in preflight.checks() {
        assert!(check.found.is_ok(), "{check}");
    }
    let table = preflight
        .checks()
        .iter()
        .find(|check| check.what == "table");
    let table = table.unwrap().found.clone().unwrap();
    assert!(table.starts_with("given, 0.550 m") && table.contains("% of the points on it"));
    assert!(!world.is_powered(0) && !world.is_powered(1));
    let mut cell = world.start(preflight);
    assert!(world.is_powered(0) && world.is_powered(1));
    // A dVRK homes without its wrist going anywhere: the way home is ours.
    cell.home().unwrap();
    let seen = cell.observe().unwrap();
    assert!(seen.points.len() > 100, "{}", seen.points.len());
    for point in &seen.points {
        let off = (point - BALL).norm() - RADIUS;
        // Millimetres of the image, and the mean of a voxel of 2.2 mm on a curved surface.
        assert!(off.abs() < 2e-3, "{off}");
    }
    let goal = lower(&cell, 0, 0.02);
    cell.move_arm(0, goal, 0.05).unwrap();
    let seen = frames(&mut cell, 10);
    assert!(!seen.arms[0].moving && !seen.arms[1].moving);
    assert!((way(&cell, &seen, 0) - 0.02).abs() < 1e-4);
    assert!(way(&cell, &seen, 1) < 1e-4);
    // Behind its own back.
    let mut behind = goal;
    behind.translation.z -= 1.0;
    let refused = cell.move_arm(0, behind, 0.05);
    assert!(
        matches!(refused, Err(CellError::BadCommand { arm: 0, .. })),
        "{refused:?}"
    );
    let refused = cell.move_arm(2, goal, 0.05);
    assert!(matches!(
        refused,
        Err(CellError::NoSuchArm { arm: 2, count: 2 })
    ));
    cell.home().unwrap();
    let seen = cell.observe().unwrap();
    assert!(way(&cell, &seen, 0) < 1e-3);
}

const CALIBRATION: &str = r#"format = "dvrk-io calibration"
version = 1
arm = "PSM1"
method = "touches"
[units]
length = "m"
angle = "rad"
[camera_from_rcm]
target = "camera_depth_optical_frame"
source = "PSM1_base"
translation = [0.1543, 0.0, 0.3361]
quaternion_xyzw = [0.6645, -0.6645, 0.2418, -0.2418]
[residuals]
samples = 12
outliers = [5]
rms = 4e-4
max = 7e-4
rms_angle = 0
max_angle = 0
"#;

#[test]
fn calibration_table_and_limits_are_looked_at() {
    // What is said of an arm, for a file and a calibration that lies beside it.
    let said = |what: &str, calibration: &str, home: Option<f64>| {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("PSM1.toml"), calibration).unwrap();
        let line = "camera_from_base = { translation = [0.1543";
        let text = include_str!("../doc/CELL.toml").replacen(
            line,
            "calibration = \"PSM1.toml\" # { translation = [0.1543",
            1,
        );
        let path = folder.path().join("CELL.toml");
        std::fs::write(&path, text).unwrap();
        let read = CellFile::load(&path).unwrap();
        let world = World::with(|file| {
            file.arm.clone_from(&read.arm);
            file.arm[0].home[1] = home.unwrap_or(file.arm[0].home[1]);
        });
        let preflight = world.preflight();
        let check = preflight.checks().iter().find(|check| check.what == what);
        check.unwrap().found.clone()
    };
    let good = said("PSM1, calibration", CALIBRATION, None).unwrap();
    assert_eq!(
        good,
        "12 samples, 1 of them rejected, residuals 0.4 mm rms and 0.7 mm at most"
    );
    let none = said("PSM2, calibration", CALIBRATION, None).unwrap();
    assert!(none.contains("without residuals"), "{none}");
    let poor = CALIBRATION.replace("4e-4", "6e-3").replace("7e-4", "9e-3");
    let poor = said("PSM1, calibration", &poor, None).unwrap_err();
    assert!(
        poor.contains("6.0 mm rms") && poor.contains("anew"),
        "{poor}"
    );
    let other = CALIBRATION.replace("depth_optical", "color_optical");
    let other = said("PSM1, calibration", &other, None).unwrap_err();
    assert!(other.contains("camera_color_optical_frame"), "{other}");
    let world = World::with(|file| file.table = None);
    let preflight = world.preflight();
    let table = preflight
        .checks()
        .iter()
        .find(|check| check.what == "table");
    let table = table.unwrap().found.clone().unwrap();
    assert!(
        table.starts_with("found, 0.550 m") && table.contains("% of"),
        "{table}"
    );
    let limits = said("PSM1, limits", CALIBRATION, None).unwrap();
    assert!(
        limits.contains("50 mm/s") && limits.contains("1.0 m/s²"),
        "{limits}"
    );
    let beyond = said("PSM1, limits", CALIBRATION, Some(1.4)).unwrap_err();
    assert!(beyond.contains("beyond the limits of pitch"), "{beyond}");
}

#[test]
fn a_jaw_holds_what_keeps_it_open() {
    let world = World::new();
    let mut cell = world.cell();
    let open = world.jaws()[0];
    let missed = cell.close_jaw(0);
    assert!(
        matches!(missed, Err(CellError::NothingGrasped { arm: 0 })),
        "{missed:?}"
    );
    assert!((world.jaws()[0] - open).abs() < 0.02);
    world.put_between(0, 0.2);
    cell.close_jaw(0).unwrap();
    assert!(cell.observe().unwrap().arms[0].holding);
    // What it held slips out.
    world.put_between(0, f64::NEG_INFINITY);
    assert!(!frames(&mut cell, 2).arms[0].holding);
    cell.open_jaw(0).unwrap();
    assert!(!cell.observe().unwrap().arms[0].holding);
}

/// What may happen to the second arm, and for how long the first may go on then, seconds: an arm is silent once nothing has come for 0.2 s.
enum Trouble {
    Fault,
    NoInstrument,
    Hand,
    Teleoperation,
    OtherWriter,
    Silence,
    AskedToStop,
}

impl Trouble {
    const ALL: [(Self, f64, &'static str); 7] = [
        (Self::Fault, 0.1, "encoder"),
        (Self::NoInstrument, 0.1, "not homed"),
        (Self::Hand, 0.1, "by hand"),
        (Self::Teleoperation, 0.1, "teleoperation"),
        (Self::OtherWriter, 0.1, "/PSM2/servo_cp"),
        (Self::Silence, 0.3, "silent"),
        (Self::AskedToStop, 0.1, "stopped"),
    ];

    /// Makes it happen; what has to be kept for it to last.
    fn begin(&self, world: &World, flag: &AtomicBool) -> Option<Box<dyn std::any::Any>> {
        let node = world.bus.node();
        match self {
            Self::Fault => world.fail(1, "encoder"),
            Self::NoInstrument => world.take_instrument_out(1),
            Self::Hand => world.clutch(1, true),
            Self::Teleoperation => {
                let mut console =
                    Writer::new(&node, "/console/teleop/enabled", Qos::EVENT).unwrap();
                console.publish(&Bool { data: true }).unwrap();
                return Some(Box::new(console));
            }
            Self::OtherWriter => {
                let rival = Writer::<PoseStamped>::new(&node, "/PSM2/servo_cp", Qos::COMMAND);
                return Some(Box::new(rival.unwrap()));
            }
            Self::Silence => world.silence_arm(1, true),
            Self::AskedToStop => flag.store(true, Ordering::Relaxed),
        }
        None
    }
}

/// The loop computes for longer than a frame and does not call the cell.
#[test]
fn trouble_of_one_arm_moving_or_at_rest_stops_all_at_once() {
    for (trouble, time, why) in Trouble::ALL {
        for both_move in [true, false] {
            let (world, flag) = (World::new(), Arc::new(AtomicBool::new(false)));
            let mut cell = world.cell().stop_flag(Arc::clone(&flag));
            if both_move {
                under_way(&mut cell);
            } else {
                let goal = lower(&cell, 0, FAR);
                cell.move_arm(0, goal, SPEED).unwrap();
                assert!(frames(&mut cell, 5).arms[0].moving);
            }
            let (before, jaws) = (world.tips(), world.jaws());
            world.compute_for(0.05);
            assert!(world.tips()[0] != before[0], "{why}");
            let _lasts = trouble.begin(&world, &flag);
            world.compute_for(time);
            let (then, stood) = (world.tips(), world.now());
            world.compute_for(1.0);
            assert!(world.now() - stood > 0.99);
            assert_eq!(world.tips(), then, "{why}, both move: {both_move}");
            assert_eq!(world.jaws(), jaws);
            let refused = [
                cell.move_arm(0, lower(&cell, 0, 0.0), SPEED),
                cell.close_jaw(1),
            ];
            let reasons = refused.map(|refused| refused.map_err(|error| error.to_string()));
            if matches!(trouble, Trouble::Silence) {
                // It may speak again; the other can be commanded meanwhile.
                assert_eq!(reasons[0], Ok(()));
                assert!(
                    reasons[1].as_ref().unwrap_err().contains(why),
                    "{reasons:?}"
                );
                continue;
            }
            for reason in reasons {
                assert!(reason.as_ref().unwrap_err().contains(why), "{reason:?}");
            }
            world.compute_for(0.5);
            assert_eq!((world.tips(), world.jaws()), (then, jaws));
        }
    }
}

#[test]
fn a_fault_of_one_arm_stops_all() {
    let world = World::new();
    let mut cell = world.cell();
    under_way(&mut cell);
    world.fail(1, "a PID gave up");
    all_stand(&mut cell, &world, 1, "a PID gave up");
}

#[test]
fn a_hand_at_an_arm_is_not_forgotten_when_it_lets_go() {
    let world = World::new();
    let mut cell = world.cell();
    under_way(&mut cell);
    world.clutch(0, true);
    frames(&mut cell, 2);
    // As the loop does when an arm is not where it was sent.
    cell.stop().unwrap();
    world.clutch(0, false);
    all_stand(&mut cell, &world, 0, "by hand");
}

#[test]
fn a_second_writer_stops_all_and_lets_nobody_begin() {
    let world = World::new();
    let mut cell = world.cell();
    under_way(&mut cell);
    let other = world.bus.node();
    let _writer = Writer::<PoseStamped>::new(&other, "/PSM2/servo_cp", Qos::COMMAND).unwrap();
    all_stand(&mut cell, &world, 1, "/PSM2/servo_cp");
    drop(cell);
    let preflight = world.preflight();
    let wrong: Vec<_> = preflight
        .checks()
        .iter()
        .filter(|check| check.found.is_err())
        .map(ToString::to_string)
        .collect();
    assert_eq!(wrong.len(), 1, "{wrong:?}");
    assert!(wrong[0].contains("PSM2, other commanders"), "{wrong:?}");
    assert!(matches!(preflight.start(), Err(CellError::Failed(_))));
}

#[test]
fn an_arm_that_is_silent_is_nowhere_and_does_not_go_on() {
    let world = World::new();
    let mut cell = world.cell();
    under_way(&mut cell);
    world.silence_arm(1, true);
    let seen = frames(&mut cell, 5);
    assert!(seen.arms[1].camera_from_tip.translation.x.is_nan());
    assert!(!seen.arms[1].moving);
    // It is for the loop to stop the other, which it does for such a frame.
    cell.stop().unwrap();
    let refused = cell.move_arm(1, lower(&cell, 1, 0.0), SPEED);
    assert!(
        matches!(refused, Err(CellError::ArmFault { arm: 1, .. })),
        "{refused:?}"
    );
    // When it speaks again it can be driven again.
    world.silence_arm(1, false);
    let seen = frames(&mut cell, 3);
    assert!(seen.arms[1].camera_from_tip.translation.x.is_finite());
    cell.move_arm(1, lower(&cell, 1, 0.0), SPEED).unwrap();
    frames(&mut cell, 50);
    let seen = cell.observe().unwrap();
    assert!(way(&cell, &seen, 1) < 1e-3);
}

#[test]
fn an_arm_that_is_kept_back_is_seen_where_it_is() {
    let world = World::new();
    let mut cell = world.cell();
    under_way(&mut cell);
    world.stick(0, true);
    let stuck = frames(&mut cell, 25);
    assert!(!stuck.arms[0].moving && stuck.arms[1].camera_from_tip.translation.x.is_finite());
    // A command is taken, and leads nowhere.
    let goal = lower(&cell, 0, FAR);
    cell.move_arm(0, goal, SPEED).unwrap();
    let seen = frames(&mut cell, 5);
    assert!((way(&cell, &seen, 0) - way(&cell, &stuck, 0)).abs() < 1e-6);
    world.stick(0, false);
    frames(&mut cell, 2);
    cell.move_arm(0, goal, 0.05).unwrap();
    let seen = frames(&mut cell, 20);
    assert!((way(&cell, &seen, 0) - FAR).abs() < 1e-3);
}

#[test]
fn a_camera_that_is_silent_shows_nothing_and_then_fails() {
    let world = World::new();
    let mut cell = world.cell();
    assert!(!cell.observe().unwrap().points.is_empty());
    world.silence_camera(true);
    let blind = frames(&mut cell, 2);
    assert!(blind.points.is_empty() && blind.colours.is_none());
    assert!(way(&cell, &blind, 0) < 1e-3);
    world.silence_camera(false);
    assert!(!frames(&mut cell, 2).points.is_empty());

    under_way(&mut cell);
    world.silence_camera(true);
    let start = world.now();
    frames(&mut cell, 1);
    let first = world.now() - start;
    assert!((1.0..1.2).contains(&first), "{first}");
    // Frames without points come at the rate of the camera: what is held is lowered by them, and in time.
    frames(&mut cell, 10);
    let ten = world.now() - start - first;
    assert!((0.99..1.1).contains(&ten), "{ten}");
    let failed = (0..400).find_map(|_| cell.observe().err());
    let Some(CellError::Failed(reason)) = &failed else {
        panic!("{failed:?}");
    };
    assert!(reason.contains("silent"), "{reason}");
    let waited = world.now() - start;
    assert!((30.0..35.0).contains(&waited), "{waited}");
}

#[test]
fn whoever_asks_to_stop_is_heard_by_every_call() {
    let world = World::new();
    let flag = Arc::new(AtomicBool::new(false));
    let mut cell = world.cell().stop_flag(Arc::clone(&flag));
    under_way(&mut cell);
    flag.store(true, Ordering::Relaxed);
    let jaws = world.jaws();
    let goal = lower(&cell, 0, 0.0);
    let answers = [
        cell.observe().map(drop),
        cell.move_arm(0, goal, SPEED),
        cell.open_jaw(0),
        cell.close_jaw(1),
        cell.home(),
        cell.stop(),
    ];
    for answer in answers {
        assert!(matches!(answer, Err(CellError::Failed(_))), "{answer:?}");
    }
    world.compute_for(0.1);
    let then = world.tips();
    world.bus.advance(std::time::Duration::from_secs(1));
    assert_eq!(world.tips(), then);
    assert_eq!(world.jaws(), jaws);
}
