//! The best set of any size, against all sets.
#![allow(missing_docs, clippy::unwrap_used, reason = "tests")]

mod fixture;

use fixture::Body;
use grip_planner::nalgebra::Vector3;
use grip_planner::{Coverage, CoverageOptions, Plane};
use proptest::prelude::*;

fn coverage(body: &Body, count: usize) -> Coverage {
    let table = Plane {
        normal: -Vector3::z_axis(),
        offset: fixture::DEPTH,
    };
    let n = body.points.len();
    let candidates: Vec<u32> = (0..count).map(|k| (k * n / count) as u32).collect();
    Coverage::new(
        &body.model(),
        &table,
        &candidates,
        &CoverageOptions::default(),
    )
    .unwrap()
}

fn body() -> impl Strategy<Value = Body> {
    (80usize..160, 0.05..0.15, 0.03..0.1, -0.3..0.3, 0.0..3.0)
        .prop_map(|(count, a, b, lowest, yaw)| Body::ellipsoid([a, b, 0.025], count, lowest, yaw))
}

/// The largest score of all sets of `size`, by counting through bit masks.
fn best_of_all(coverage: &Coverage, size: u32) -> f64 {
    let candidates = coverage.candidates();
    (0u32..1 << candidates.len())
        .filter(|mask| mask.count_ones() == size)
        .map(|mask| {
            let set: Vec<u32> = (0..candidates.len())
                .filter(|k| mask >> k & 1 == 1)
                .map(|k| candidates[k])
                .collect();
            coverage.score(&set).unwrap()
        })
        .fold(0.0, f64::max)
}

// Sums in another order differ by some 1e-15.
const ROUNDING: f64 = 1e-12;

proptest! {
    #![proptest_config(ProptestConfig { max_shrink_iters: 10, ..ProptestConfig::with_cases(cases(24)) })]

    #[test]
    fn up_to_three_it_is_the_best_of_all(body in body()) {
        let coverage = coverage(&body, 10);
        for size in 1..=3 {
            let (set, score) = coverage.best_set(size as usize).unwrap();
            prop_assert!((score - best_of_all(&coverage, size)).abs() < ROUNDING);
            prop_assert!((score - coverage.score(&set).unwrap()).abs() < ROUNDING);
        }
    }

    #[test]
    fn beyond_no_exchange_betters_it_and_little_is_lost(body in body(), size in 4usize..7) {
        let coverage = coverage(&body, 12);
        let (set, score) = coverage.best_set(size).unwrap();
        prop_assert_eq!(set.len(), size);
        for place in 0..size {
            for &other in coverage.candidates().iter().filter(|c| !set.contains(c)) {
                let mut exchanged = set.clone();
                exchanged[place] = other;
                prop_assert!(coverage.score(&exchanged).unwrap() <= score + ROUNDING);
            }
        }
        let ratio = score / best_of_all(&coverage, size as u32);
        prop_assert!(ratio >= 0.98, "{ratio}");
        // A grip more never commands less.
        prop_assert!(score >= coverage.best_set(size - 1).unwrap().1);
    }
}

#[test]
fn most_sets_of_four_are_the_best_of_all() {
    let mut equal = 0;
    for k in 0..40 {
        let t = f64::from(k);
        let half = [0.06 + 0.002 * t, 0.04 + 0.001 * ((7.0 * t) % 40.0), 0.025];
        let coverage = coverage(&Body::ellipsoid(half, 90 + k as usize, 0.0, 0.1 * t), 12);
        let (_, score) = coverage.best_set(4).unwrap();
        equal += usize::from(score >= best_of_all(&coverage, 4) - ROUNDING);
    }
    assert!(equal >= 38, "{equal} of 40");
}

#[test]
fn draws_go_to_the_first_and_sizes_that_do_not_exist_are_none() {
    // Two pieces that are the same: either grip commands as much.
    let mut body = Body::ellipsoid([0.1, 0.06, 0.025], 40, 0.0, 0.0);
    body.edges.clear();
    body.areas.fill(1e-4);
    body.boundary.fill(false);
    for p in &mut body.points {
        p.z = fixture::DEPTH - 0.05;
    }
    let all = coverage(&body, 6);
    let (set, _) = all.best_set(2).unwrap();
    assert_eq!(set, all.candidates()[..2]);
    assert!(all.best_set(7).is_none());
    assert_eq!(all.best_set(0).unwrap().0, [0u32; 0]);
    assert_eq!(all.best_set(6).unwrap().0, all.candidates());
}

/// Every case scores thousands of sets: fewer cases than usual, unless more are asked for.
fn cases(usual: u32) -> u32 {
    std::env::var("PROPTEST_CASES")
        .ok()
        .and_then(|c| c.parse().ok())
        .unwrap_or(usual)
}
