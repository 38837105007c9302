//! A rigid egg in a cell that was written from the docs of `Cell` alone: a model reported as closed was completely seen and has the right size.
#![allow(missing_docs, clippy::unwrap_used, dead_code)]

#[path = "../examples/own_robot/egg.rs"]
mod egg;
#[path = "../examples/own_robot/judge.rs"]
mod judge;

use judge::{End, explored};

#[track_caller]
fn told(end: &End, seed: u64) {
    assert!(
        end.is_honest(),
        "seed {seed}: {} with {:.1} % shown, semi-axes {:?} m",
        end.stop,
        100.0 * end.shown,
        end.axes
    );
}

#[test]
fn an_egg_is_closed_only_when_all_of_it_was_shown() {
    let ends: Vec<End> = (0..4).map(|seed| explored(seed, false).unwrap()).collect();
    (0..).zip(&ends).for_each(|(seed, end)| told(end, seed));
    // Honest is not enough: an egg that is held firmly can be explored.
    assert!(ends.iter().all(|end| end.stop == "closed"));
}

/// Jaws that lose their hold on the egg while it is pressed on the table report nothing; the apparent pull reveals it.
#[test]
fn an_egg_that_slips_is_not_believed_to_turn() {
    for seed in [1, 9] {
        let end = explored(seed, true).unwrap();
        assert!(end.failed > 0, "nothing was noticed");
        told(&end, seed);
    }
}
