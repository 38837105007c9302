//! With the feature `serde`, options and results survive a round trip through JSON.
#![cfg(feature = "serde")]
#![allow(missing_docs, clippy::unwrap_used, reason = "a test may panic")]

use nonrigid_reg::{Options, Settled, Status};

#[test]
fn options_come_back() {
    let options = Options::default().scaled(0.5);
    let text = serde_json::to_string(&options).unwrap();
    assert_eq!(serde_json::from_str::<Options>(&text).unwrap(), options);
    let settled = Settled {
        tolerance: 1e-4,
        at_least: 3,
    };
    let text = serde_json::to_string(&settled).unwrap();
    assert_eq!(serde_json::from_str::<Settled>(&text).unwrap(), settled);
    let text = serde_json::to_string(&Status::Converged).unwrap();
    assert_eq!(
        serde_json::from_str::<Status>(&text).unwrap(),
        Status::Converged
    );
}
