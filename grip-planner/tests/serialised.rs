//! With the feature `serde`, options and results survive a round trip through JSON.
#![cfg(feature = "serde")]
#![allow(missing_docs, clippy::unwrap_used, reason = "a test may panic")]

use grip_planner::{Error, PlanOptions, Reason};

#[test]
fn options_come_back() {
    let options = PlanOptions::default();
    let text = serde_json::to_string(&options).unwrap();
    assert_eq!(serde_json::from_str::<PlanOptions>(&text).unwrap(), options);
}

#[test]
fn reasons_can_be_written_down() {
    let text = serde_json::to_string(&Reason::FacesTable { dip: 0.25 }).unwrap();
    assert_eq!(text, r#"{"FacesTable":{"dip":0.25}}"#);
    assert_eq!(
        serde_json::to_string(&Error::EmptyModel).unwrap(),
        r#""EmptyModel""#
    );
}
