//! Laws of the profile generator: no limit is broken, the end is met, and not much later than it could be.
#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::float_cmp,
    reason = "tests; the ends of motions are met to the last bit"
)]

use dvrk_io::Error;
use dvrk_io::arm::{Profile, ProfileLimits};
use proptest::prelude::*;

/// Lengths and limits over many orders of magnitude, as mistakes in units give them.
fn profiles() -> impl Strategy<Value = (f64, f64, ProfileLimits)> {
    let decades = |low: f64, high: f64| (low..high).prop_map(|x: f64| 10_f64.powf(x));
    (
        decades(-6.0, 0.5),
        decades(-3.0, -1.0),
        decades(-3.0, 0.5),
        decades(-2.0, 1.5),
        decades(-5.0, 0.0),
    )
        .prop_map(|(length, tick, speed, acceleration, step)| {
            let limits = ProfileLimits {
                speed,
                acceleration,
                step,
            };
            (length, tick, limits)
        })
}

/// The time that the motion takes if it is not cut into ticks.
fn best_time(length: f64, speed: f64, acceleration: f64) -> f64 {
    if length >= speed * speed / acceleration {
        length / speed + speed / acceleration
    } else {
        2.0 * (length / acceleration).sqrt()
    }
}

proptest! {
    #[test]
    fn limits_hold_and_the_end_is_met((length, tick, limits) in profiles()) {
        let top = limits.speed.min(limits.step / tick);
        let best = best_time(length, top, limits.acceleration);
        // Longer runs tell nothing more.
        prop_assume!(best / tick < 20_000.0);
        let mut profile = Profile::new(length, tick, limits).unwrap();
        // Rounding of a sum of up to 10⁵ terms.
        let rounding = 1e-11 * length.max(1e-9) / tick;
        let (mut last, mut speed, mut ticks) = (0.0, 0.0, 0_u32);
        while !profile.is_done() {
            let way = profile.advance();
            let step = way - last;
            let now = step / tick;
            prop_assert!(step >= 0.0 && way <= length);
            prop_assert!(step <= limits.step * (1.0 + 1e-9) + rounding * tick);
            prop_assert!(now <= top * (1.0 + 1e-9) + rounding, "speed {now} > {top}");
            let gain = limits.acceleration * tick;
            prop_assert!((now - speed).abs() <= gain * (1.0 + 1e-9) + 2.0 * rounding, "gain {} > {gain}", now - speed);
            (last, speed) = (way, now);
            ticks += 1;
        }
        prop_assert_eq!(last, length);
        // At rest in the next tick without braking harder than allowed.
        prop_assert!(speed <= limits.acceleration * tick * (1.0 + 1e-9) + rounding);
        // Ticks cost: one to start, one to end, and the last steps of braking.
        prop_assert!(f64::from(ticks) * tick <= 1.02 * best + 8.0 * tick, "{ticks} ticks of {tick} s for {best} s");
        prop_assert_eq!(profile.advance(), length);
        prop_assert_eq!(profile.speed(), 0.0);
    }

    #[test]
    fn braking_at_any_time_keeps_the_limits((length, tick, limits) in profiles(), when in 0.0..1.0_f64) {
        let best = best_time(length, limits.speed.min(limits.step / tick), limits.acceleration);
        prop_assume!(best / tick < 20_000.0);
        let mut profile = Profile::new(length, tick, limits).unwrap();
        for _ in 0..(when * best / tick) as u32 {
            profile.advance();
        }
        let (start, speed) = (profile.travelled(), profile.speed());
        profile.brake();
        // The way that braking takes, and not more than there was.
        let way = speed * speed / (2.0 * limits.acceleration);
        prop_assert!(profile.length() <= length && profile.length() <= start + way * (1.0 + 1e-12) + 1e-15);
        let (mut last, mut before) = (start, speed);
        while !profile.is_done() {
            let now = (profile.advance() - last) / tick;
            let rounding = 1e-11 * length.max(1e-9) / tick;
            prop_assert!((now - before).abs() <= limits.acceleration * tick * (1.0 + 1e-9) + 2.0 * rounding);
            (last, before) = (profile.travelled(), now);
        }
    }

    #[test]
    fn a_speed_that_is_carried_on_is_one_it_can_stop_from((length, tick, limits) in profiles(), speed in -1.0..1e3_f64) {
        let profile = Profile::new(length, tick, limits).unwrap().with_speed(speed);
        let carried = profile.speed();
        prop_assert!(carried >= 0.0 && carried <= limits.speed && carried * tick <= limits.step * (1.0 + 1e-12));
        prop_assert!(carried * carried <= 2.0 * limits.acceleration * length * (1.0 + 1e-12));
    }
}

#[test]
fn a_known_profile() {
    // 10 mm at 0.1 m/s and 1 m/s², ticks of 10 ms: up in 10 ticks over 5.5 mm would be too far, so a triangle.
    let limits = ProfileLimits {
        speed: 0.1,
        acceleration: 1.0,
        step: 1.0,
    };
    let mut profile = Profile::new(0.01, 0.01, limits).unwrap();
    let mut fastest = 0.0_f64;
    let mut ticks = 0;
    while !profile.is_done() {
        profile.advance();
        fastest = fastest.max(profile.speed());
        ticks += 1;
    }
    // √(a·L) = 0.1 in continuous time.
    assert!(fastest > 0.085 && fastest <= 0.1, "{fastest}");
    assert!((20..=24).contains(&ticks), "{ticks}");
}

#[test]
fn nothing_to_do() {
    let limits = ProfileLimits {
        speed: 1.0,
        acceleration: 1.0,
        step: 1.0,
    };
    let mut profile = Profile::new(0.0, 0.01, limits).unwrap();
    assert!(profile.is_done());
    assert_eq!((profile.advance(), profile.speed()), (0.0, 0.0));
}

#[test]
fn what_is_no_limit_is_refused() {
    let good = ProfileLimits {
        speed: 1.0,
        acceleration: 1.0,
        step: 1.0,
    };
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let limits = [
            ProfileLimits { speed: bad, ..good },
            ProfileLimits {
                acceleration: bad,
                ..good
            },
            ProfileLimits { step: bad, ..good },
        ];
        for limits in limits {
            let refused = Profile::new(1.0, 0.01, limits);
            assert!(
                matches!(refused, Err(Error::OutOfRange { value, .. }) if value.to_bits() == bad.to_bits())
            );
        }
        assert!(Profile::new(1.0, bad, good).is_err());
    }
    for bad in [-1.0, f64::NAN, f64::INFINITY] {
        assert!(Profile::new(bad, 0.01, good).is_err());
    }
}
