//! Medians and percentiles of times.
#![allow(missing_docs, clippy::unwrap_used)]

use explore_loop::report::metrics::Timing;
use proptest::prelude::*;

#[test]
fn median_and_percentile_of_a_hundred() {
    let times: Vec<f64> = (1..=101).map(f64::from).collect();
    let timing = Timing::of(&times);
    assert_eq!(
        timing,
        Timing {
            median: 51.0,
            p95: 96.0
        }
    );
    assert_eq!(Timing::of(&[]), Timing::default());
    assert_eq!(
        Timing::of(&[7.0]),
        Timing {
            median: 7.0,
            p95: 7.0
        }
    );
}

proptest! {
    /// Both are times that occurred; half and nineteen of twenty are no longer; the order does not matter.
    #[test]
    fn percentiles_split_the_times(times in prop::collection::vec(0.0..1e3f64, 1..200)) {
        let timing = Timing::of(&times);
        let reversed: Vec<f64> = times.iter().rev().copied().collect();
        prop_assert_eq!(Timing::of(&reversed), timing);
        for (value, share) in [(timing.median, 0.5), (timing.p95, 0.95)] {
            prop_assert!(times.contains(&value));
            let below = times.iter().filter(|t| **t <= value).count() as f64;
            let above = times.iter().filter(|t| **t >= value).count() as f64;
            // The rank is rounded to a whole time, so each side may miss half a time.
            prop_assert!(below >= share * times.len() as f64 - 0.5);
            prop_assert!(above >= (1.0 - share) * times.len() as f64 - 0.5);
        }
    }
}
