//! Reaction of the loop to faults of the cell: no set-point beyond the limits, a safe state at once, and then continuation or a stop with the true reason.
#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::panic,
    clippy::print_stdout,
    reason = "tests"
)]

mod common;

use common::fake::{FakeCell, PERIOD, Recorder};
use explore_loop::Error;
use explore_loop::canonical::CanonicalModel;
use explore_loop::cell::Cell;
use explore_loop::cell::faults::{Begin, Fault, FaultKind, FaultyCell};
use explore_loop::explore::{Event, ExploreOptions, Explorer, FrameFault, Outcome, Phase, Watcher};
use explore_loop::plan::CoveragePlanner;
use explore_loop::reconstruct::{ReconstructOptions, Reconstructor};
use proptest::prelude::*;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

const SPACING: f64 = 0.008;
const SPEED: f64 = 0.03;

/// Records when the loop noticed a fault.
struct Notes {
    world: FakeCell,
    /// True times of the first serious fault of a frame or trouble.
    noticed: Option<f64>,
    words: Vec<String>,
    phases: Vec<Phase>,
    found: usize,
    /// Frames of which something was taken out.
    cleaned: usize,
    /// Jaws closed in each frame of a manipulation, and grips of the plan.
    closed: Vec<usize>,
    grips: usize,
    /// Sets the flag in this phase, after so many frames of it.
    interrupts: Option<(Phase, usize, Arc<AtomicBool>)>,
    /// Panics in this phase.
    panics: Option<Phase>,
    /// Somebody takes the body away after so many frames in the jaws.
    taken_at: Option<usize>,
}

impl Notes {
    fn new(world: &FakeCell) -> Self {
        Self {
            world: world.clone(),
            noticed: None,
            words: Vec::new(),
            phases: Vec::new(),
            found: 0,
            cleaned: 0,
            closed: Vec::new(),
            grips: 0,
            interrupts: None,
            panics: None,
            taken_at: None,
        }
    }

    fn note(&mut self, word: String) {
        self.noticed = self.noticed.or(Some(self.world.now()));
        if self.words.last() != Some(&word) {
            self.words.push(word);
        }
    }
}

impl Watcher for Notes {
    fn event(&mut self, event: Event<'_>, _: &CanonicalModel) -> Result<(), Error> {
        match event {
            Event::Fault(FrameFault::Foreign { .. }) => self.cleaned += 1,
            Event::Fault(fault) if fault.is_serious() => self.note(format!("{fault}")),
            Event::Trouble(trouble) => self.note(format!("{trouble}")),
            Event::Missed(arm) => self.note(format!("arm {arm} missed")),
            Event::Waiting(arm) => self.note(format!("the others wait for arm {arm}")),
            Event::Found => self.found += 1,
            Event::Phase(phase) => self.phases.push(phase),
            Event::Planned(plan) => self.grips = plan.grips.len(),
            Event::Frame(..) => {
                let now = self.phases.last().copied();
                if now == Some(Phase::Manipulate) {
                    let closed = self.world.closed();
                    self.closed.push(closed.iter().filter(|c| **c).count());
                }
                assert!(
                    self.panics.is_none() || self.panics != now,
                    "as it was told to"
                );
                if let Some((phase, frames, flag)) = &mut self.interrupts
                    && Some(*phase) == now
                {
                    *frames = frames.saturating_sub(1);
                    if *frames == 0 {
                        flag.store(true, Ordering::Relaxed);
                    }
                }
            }
            _ => {}
        }
        Ok(())
    }
}

fn options() -> ExploreOptions {
    let mut options = ExploreOptions::new(SPACING, SPEED);
    options.max_manipulations = 1;
    options
}

/// The rigid body of the fake cell goes with tips that are led as for a soft one, and they do not say that they are held back: the pull of the
/// grips means nothing here.
fn reconstructor() -> Reconstructor {
    let mut options = ReconstructOptions::new(SPACING);
    options.limits.pull = f64::INFINITY;
    Reconstructor::new(options).unwrap()
}

struct Run {
    outcome: Result<Outcome, Error>,
    notes: Notes,
    cell: Recorder<FaultyCell<FakeCell>>,
    world: FakeCell,
}

impl Run {
    fn of(arms: usize, faults: Vec<Fault>, change: impl FnOnce(&mut Notes)) -> Self {
        let world = FakeCell::new(arms);
        let mut notes = Notes::new(&world);
        change(&mut notes);
        world.world.borrow_mut().taken_at = notes.taken_at;
        let options = options();
        let mut cell = Recorder::new(
            FaultyCell::new(world.clone(), faults),
            world.clone(),
            options.limits,
        );
        let mut planner = CoveragePlanner::default();
        let flag = notes.interrupts.as_ref().map(|i| Arc::clone(&i.2));
        let mut explorer = Explorer::with_reconstructor(
            &mut cell,
            &mut planner,
            &mut notes,
            options,
            reconstructor(),
        );
        if let Some(flag) = flag {
            explorer = explorer.interrupt(flag);
        }
        let outcome = explorer.run();
        drop(explorer);
        Self {
            outcome,
            notes,
            cell,
            world,
        }
    }

    fn word(&self) -> String {
        match &self.outcome {
            Ok(outcome) => outcome.stop.word().to_owned(),
            Err(error) => error.to_string(),
        }
    }

    fn manipulations(&self) -> usize {
        self.outcome.as_ref().map_or(0, |o| o.manipulations)
    }

    /// From the first frame with the fault until it was noticed, seconds of the cell.
    fn noticed_after(&self) -> Option<f64> {
        let began = self.cell.inner().began().into_iter().flatten().min()?;
        let first = self.cell.trace.get(began + 1)?.0;
        Some((self.notes.noticed? - first).max(0.0))
    }

    /// From when it was noticed until every tip stood or sank, seconds of the cell.
    fn safe_after(&self) -> Option<f64> {
        let noticed = self.notes.noticed?;
        // Stopped, and no frame since.
        let mut safe = if self.world.moving() {
            f64::INFINITY
        } else {
            0.0
        };
        if self
            .cell
            .trace
            .last()
            .is_some_and(|last| last.0 > noticed + 1e-9)
        {
            safe = f64::INFINITY;
        }
        for pair in self.cell.trace.windows(2) {
            if pair[0].0 < noticed - 1e-9 {
                continue;
            }
            let still = pair[0].1.iter().zip(&pair[1].1).all(|(a, b)| {
                let way = b.translation.vector - a.translation.vector;
                // The camera looks along +z: down is +z.
                way.xy().norm() < 1e-9 && way.z >= -1e-9
            });
            if still {
                safe = pair[0].0 - noticed;
                break;
            }
        }
        Some(safe)
    }

    fn within_limits(&self) {
        let worst = self.cell.worst;
        assert!(
            worst.iter().all(|w| *w <= 1.0 + 1e-6),
            "step, speed, turn rate, acceleration: {worst:?} of the limits"
        );
    }
}

#[test]
fn without_faults_a_manipulation_is_made_within_the_limits() {
    for arms in [2, 3] {
        let run = Run::of(arms, Vec::new(), |_| {});
        println!(
            "{arms} arms: {} after {} manipulations, {:.1} s, worst {:?}, {:?}",
            run.word(),
            run.manipulations(),
            run.world.now(),
            run.cell.worst,
            run.notes.words
        );
        assert_eq!(run.manipulations(), 1);
        assert!(run.cell.commands > 100);
        // All grips hold at first; a supporting one lets go on the way, the lifting ones do not.
        let closed = &run.notes.closed;
        assert_eq!(run.notes.grips, arms);
        assert_eq!(closed.first(), Some(&arms));
        assert_eq!(closed.last(), Some(&2));
        assert!(run.notes.words.is_empty(), "{:?}", run.notes.words);
        assert!(run.outcome.as_ref().unwrap().troubles.is_empty());
        run.cell_is_left_alone();
    }
}

impl Run {
    fn cell_is_left_alone(&self) {
        self.within_limits();
        assert!(!self.world.moving() && !self.world.closed().contains(&true));
    }
}

/// Required outcome of a fault.
#[derive(Clone, Copy, PartialEq)]
enum Comes {
    /// The exploration goes on to its manipulation.
    On,
    /// It goes on, and the body had to be found again.
    Found,
    /// It ends with this word, jaws open.
    Ends(&'static str),
    /// It ends with this word, jaws as they are.
    Kept(&'static str),
}

struct Case {
    name: &'static str,
    faults: Vec<Fault>,
    taken_at: Option<usize>,
    comes: Comes,
    /// Whether the loop has to notice it in time; what is cleaned or skipped needs no safe state.
    serious: bool,
}

const EVER: usize = usize::MAX;

fn case(name: &'static str, kind: FaultKind, begin: Begin, frames: usize, comes: Comes) -> Case {
    let fault = Fault {
        kind,
        begin,
        frames,
    };
    Case {
        name,
        faults: vec![fault],
        taken_at: None,
        comes,
        serious: true,
    }
}

#[allow(clippy::too_many_lines, reason = "a table")]
fn cases() -> Vec<Case> {
    use Begin::{Frame, Held, Moving};
    use Comes::{Ends, Kept, On};
    use FaultKind as F;
    let lift = Held(30);
    let moved = F::Moved {
        turn: 0.6,
        shift: 0.06,
    };
    let mut cases = vec![
        case("track lost in mid-lift for 0.5 s", moved, lift, 5, On),
        case(
            "camera displaced in mid-lift",
            moved,
            lift,
            EVER,
            Ends("grasp_failed"),
        ),
        case("grip of arm 0 slips", F::Slip { arm: 0 }, lift, 1, On),
        case("jaw 0 misses twice", F::Miss { arm: 0 }, Frame(0), 60, On),
        case(
            "jaw 0 always misses",
            F::Miss { arm: 0 },
            Frame(0),
            EVER,
            Ends("grasp_failed"),
        ),
        case(
            "arm 1 stuck for 2 s on its way",
            F::Stuck { arm: 1 },
            Moving(10),
            20,
            On,
        ),
        case(
            "arm 1 never arrives",
            F::Stuck { arm: 1 },
            Moving(10),
            EVER,
            Ends("not_arriving"),
        ),
        case(
            "arm 1 stuck for 2 s in mid-lift",
            F::Stuck { arm: 1 },
            lift,
            20,
            On,
        ),
        case(
            "arm 1 stuck in mid-lift",
            F::Stuck { arm: 1 },
            lift,
            EVER,
            Kept("not_arriving"),
        ),
        case(
            "arm 0 goes to FAULT on its way",
            F::ArmFault { arm: 0 },
            Moving(10),
            EVER,
            Ends("arm_fault"),
        ),
        case(
            "arm 0 goes to FAULT in mid-lift",
            F::ArmFault { arm: 0 },
            lift,
            EVER,
            Kept("arm_fault"),
        ),
        case("frozen for 1 s in mid-lift", F::Frozen, lift, 10, On),
        case(
            "frozen from mid-lift on",
            F::Frozen,
            lift,
            EVER,
            Ends("blind"),
        ),
        case("empty for 1 s in mid-lift", F::Empty, lift, 10, On),
        case(
            "empty from mid-lift on",
            F::Empty,
            lift,
            EVER,
            Ends("blind"),
        ),
        case(
            "empty from the way to the grips on",
            F::Empty,
            Moving(10),
            EVER,
            Ends("blind"),
        ),
        case(
            "every frame 0.5 s late for 2 s",
            F::Late { frames: 4 },
            lift,
            4,
            On,
        ),
        case(
            "every other frame twice for 2 s",
            F::Duplicate,
            lift,
            20,
            On,
        ),
        case(
            "every other frame an old one for 2 s",
            F::OutOfOrder,
            lift,
            20,
            On,
        ),
        case(
            "clock set ahead by an hour",
            F::ClockJump { seconds: 3600.0 },
            lift,
            1,
            On,
        ),
        case(
            "clock set back by an hour",
            F::ClockJump { seconds: -3600.0 },
            lift,
            1,
            On,
        ),
        case(
            "pose of arm 0 NaN for 0.5 s",
            F::NonFinitePose { arm: 0 },
            lift,
            5,
            On,
        ),
        case(
            "pose of arm 0 NaN for ever",
            F::NonFinitePose { arm: 0 },
            lift,
            EVER,
            Kept("blind"),
        ),
        case(
            "80 % of the points NaN for 1 s",
            F::NonFinitePoints { share: 0.8 },
            lift,
            10,
            On,
        ),
        case(
            "cell fails in mid-lift",
            F::Failed,
            lift,
            EVER,
            Kept("cell_failed"),
        ),
    ];
    let mut cleaned = vec![
        case(
            "10 % of the points NaN",
            F::NonFinitePoints { share: 0.1 },
            Frame(2),
            EVER,
            On,
        ),
        case(
            "a patch of table in the cloud",
            F::Table,
            Frame(2),
            EVER,
            On,
        ),
        case("the tools in the cloud", F::Tools, Frame(2), EVER, On),
    ];
    for c in &mut cleaned {
        c.serious = false;
    }
    cases.extend(cleaned);
    cases
}

/// One line of the table, and whether it is as it must be.
fn survives(case: &Case) -> (String, Result<(), String>) {
    let run = Run::of(2, case.faults.clone(), |notes| {
        notes.taken_at = case.taken_at;
    });
    let safe = run.safe_after();
    let word = run.word();
    let done = word == "closed" || run.manipulations() == 1 && word == "too_many_manipulations";
    let reason = run.outcome.as_ref().ok().and_then(|o| o.stop.reason());
    let became = match &reason {
        _ if done && run.notes.found > 0 => "body found again, went on".to_owned(),
        _ if done => "went on".to_owned(),
        Some(reason) => format!("{word}: {reason}"),
        None => word.clone(),
    };
    let noticed = match run.notes.words.first() {
        Some(word) => word.clone(),
        None => format!("{} frames cleaned", run.notes.cleaned),
    };
    let line = format!(
        "| {} | {noticed} | {} | {} | {became} | {:.0} s |",
        case.name,
        run.noticed_after()
            .map_or_else(|| "-".into(), |s| format!("{:.0}", 1e3 * s)),
        safe.map_or_else(|| "-".into(), |s| format!("{:.0}", 1e3 * s)),
        run.world.now(),
    );
    let closed = run.world.closed().contains(&true);
    let right = match case.comes {
        Comes::On => done && !closed,
        Comes::Found => done && run.notes.found > 0 && !closed,
        Comes::Ends(end) => word == end && !closed,
        Comes::Kept(end) => word == end && closed,
    };
    let in_time = if case.serious {
        safe.is_some_and(|s| s <= PERIOD + 1e-9)
    } else {
        run.notes.cleaned > 0
    };
    let worst = run.cell.worst;
    let verdict = if worst.iter().any(|w| *w > 1.0 + 1e-6) {
        Err(format!("{}: {worst:?} of the limits", case.name))
    } else if !right {
        Err(format!("{}: {became}, jaws closed: {closed}", case.name))
    } else if !in_time || run.world.moving() && !matches!(case.comes, Comes::Kept("cell_failed")) {
        Err(format!("{}: not safe in time", case.name))
    } else {
        Ok(())
    };
    (line, verdict)
}

/// A body that is taken out of the jaws and put elsewhere in another orientation is found by its shape.
#[test]
fn a_body_taken_away_is_found_again() {
    let taken = Case {
        name: "body taken away in mid-lift, put down elsewhere",
        faults: Vec::new(),
        taken_at: Some(30),
        comes: Comes::Found,
        serious: true,
    };
    let (line, verdict) = survives(&taken);
    println!("{line}");
    verdict.unwrap();
}

/// The table of faults, printed with `--nocapture`.
#[test]
fn every_fault_has_an_answer() {
    let cases = cases();
    let half = cases.len() / 2;
    let results: Vec<_> = std::thread::scope(|scope| {
        let (first, second) = cases.split_at(half);
        let other = scope.spawn(|| second.iter().map(survives).collect::<Vec<_>>());
        let mut results: Vec<_> = first.iter().map(survives).collect();
        results.extend(other.join().unwrap());
        results
    });
    println!(
        "| fault | noticed as | noticed after, ms | safe after that, ms | became of it | robot time |"
    );
    println!("|---|---|---:|---:|---|---:|");
    for (line, _) in &results {
        println!("{line}");
    }
    let wrong: Vec<&String> = results
        .iter()
        .filter_map(|(_, r)| r.as_ref().err())
        .collect();
    assert!(wrong.is_empty(), "{wrong:#?}");
}

/// A flag ends the exploration from anywhere: what is held is lowered, the arms go home.
#[test]
fn an_interrupt_puts_down_what_is_held() {
    for (phase, frames, arms) in [
        (Phase::Look, 2, 2),
        (Phase::Reach, 8, 2),
        // The third arm still holds the body by the pivot.
        (Phase::Manipulate, 15, 3),
        (Phase::Manipulate, 45, 2),
        (Phase::Lower, 2, 2),
        (Phase::Release, 1, 2),
    ] {
        let flag = Arc::new(AtomicBool::new(false));
        let run = Run::of(arms, Vec::new(), |notes| {
            notes.interrupts = Some((phase, frames, flag));
        });
        println!(
            "interrupted in {phase:?}: {}, safe after {:.0} ms, {:.1} s",
            run.word(),
            1e3 * run.safe_after().unwrap(),
            run.world.now()
        );
        assert_eq!(run.word(), "interrupted");
        assert!(run.safe_after().unwrap() <= PERIOD + 1e-9);
        run.cell_is_left_alone();
        run.is_home();
    }
}

/// A panic in a watcher goes on to the caller after the arms have been brought to a safe state.
#[test]
fn a_panic_in_a_stage_leaves_no_arm_holding() {
    for phase in [Phase::Reach, Phase::Manipulate, Phase::Release] {
        let world = FakeCell::new(2);
        let mut notes = Notes::new(&world);
        notes.panics = Some(phase);
        let options = options();
        let mut cell = Recorder::new(world.clone(), world.clone(), options.limits);
        let mut planner = CoveragePlanner::default();
        let caught = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            let mut explorer = Explorer::with_reconstructor(
                &mut cell,
                &mut planner,
                &mut notes,
                options,
                reconstructor(),
            );
            explorer.run().is_ok()
        }));
        assert!(caught.is_err(), "the panic goes on");
        assert!(!world.moving() && !world.closed().contains(&true));
        assert!(cell.stops > 0 && cell.worst.iter().all(|w| *w <= 1.0 + 1e-6));
    }
}

/// A planner or watcher that fails ends the exploration with its error; the arms are brought to a safe state.
#[test]
fn an_error_of_a_stage_leaves_no_arm_holding() {
    struct Full(Notes);
    impl Watcher for Full {
        fn event(&mut self, event: Event<'_>, model: &CanonicalModel) -> Result<(), Error> {
            self.0.event(event, model)?;
            if self.0.phases.last() == Some(&Phase::Manipulate) && self.0.world.now() > 8.0 {
                return Err(Error::Write {
                    path: "session.mcap".into(),
                    error: std::io::Error::other("no space left"),
                });
            }
            Ok(())
        }
    }
    let world = FakeCell::new(2);
    let mut watcher = Full(Notes::new(&world));
    let options = options();
    let mut cell = Recorder::new(world.clone(), world.clone(), options.limits);
    let mut planner = CoveragePlanner::default();
    let outcome = Explorer::with_reconstructor(
        &mut cell,
        &mut planner,
        &mut watcher,
        options,
        reconstructor(),
    )
    .run();
    assert!(matches!(outcome, Err(Error::Write { .. })));
    assert!(!world.moving() && !world.closed().contains(&true));
    assert!(cell.worst.iter().all(|w| *w <= 1.0 + 1e-6));
}

/// The same faults in the same cell give the same result bit for bit.
#[test]
fn the_same_faults_give_the_same_run() {
    let fault = Fault {
        kind: FaultKind::Empty,
        begin: Begin::Held(20),
        frames: 5,
    };
    let [a, b] = [0, 1].map(|_| Run::of(2, vec![fault], |_| {}));
    assert_eq!(a.cell.trace, b.cell.trace);
    let bits = |run: &Run| run.cell.worst.map(f64::to_bits);
    assert_eq!(bits(&a), bits(&b));
    assert_eq!(a.word(), b.word());
}

impl Run {
    fn is_home(&self) {
        let home = self.cell.info().arms.iter().map(|a| a.camera_from_home);
        for (tip, home) in self.world.tips().iter().zip(home) {
            assert!((tip.translation.vector - home.translation.vector).norm() < 1e-3);
        }
    }
}

/// Any fault of a frame or of a jaw, at any time, for any time.
fn any_fault() -> impl Strategy<Value = Fault> {
    let kind = prop_oneof![
        Just(FaultKind::Empty),
        Just(FaultKind::Frozen),
        Just(FaultKind::Duplicate),
        Just(FaultKind::OutOfOrder),
        (1usize..12).prop_map(|frames| FaultKind::Late { frames }),
        (-100.0..100.0).prop_map(|seconds| FaultKind::ClockJump { seconds }),
        (0.0..1.0).prop_map(|share| FaultKind::NonFinitePoints { share }),
        (0usize..3).prop_map(|arm| FaultKind::NonFinitePose { arm }),
        Just(FaultKind::Table),
        Just(FaultKind::Tools),
        (-3.0..3.0, -0.1..0.1).prop_map(|(turn, shift)| FaultKind::Moved { turn, shift }),
        (0usize..2).prop_map(|arm| FaultKind::Slip { arm }),
        (0usize..2).prop_map(|arm| FaultKind::Miss { arm }),
        (0usize..3).prop_map(|arm| FaultKind::Stuck { arm }),
        (0usize..3).prop_map(|arm| FaultKind::ArmFault { arm }),
        Just(FaultKind::Failed),
    ];
    (kind, 2usize..220, 1usize..40).prop_map(|(kind, at, frames)| Fault {
        kind,
        begin: Begin::Frame(at),
        frames,
    })
}

proptest! {
    #![proptest_config(ProptestConfig { max_shrink_iters: 0, failure_persistence: None, ..ProptestConfig::with_cases(usual(4)) })]

    /// Whatever happens together: an end, no set-point beyond the limits, no arm left moving unless the cell itself failed.
    #[test]
    fn any_faults_end_within_the_limits(faults in prop::collection::vec(any_fault(), 1..4)) {
        let failed = |f: &Fault| f.kind == FaultKind::Failed;
        let cell_fails = faults.iter().any(failed);
        let run = Run::of(2, faults, |_| {});
        let worst = run.cell.worst;
        prop_assert!(worst.iter().all(|w| *w <= 1.0 + 1e-6), "{worst:?} of the limits, {}", run.word());
        prop_assert!(!run.world.moving() || cell_fails);
    }
}

/// The usual number of cases, unless more are wanted from outside.
fn usual(cases: u32) -> u32 {
    let wanted = std::env::var("PROPTEST_CASES");
    wanted.ok().and_then(|w| w.parse().ok()).unwrap_or(cases)
}
