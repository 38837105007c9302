//! With the feature `serde`, options survive a round trip through JSON and results one through bytes.
#![cfg(feature = "serde")]
#![allow(missing_docs, clippy::unwrap_used, reason = "a test may panic")]

use topo_ekf::nalgebra::Point3;
use topo_ekf::{Filter, Frame, Observation, Options, StepReport};

#[test]
fn options_and_reports_come_back() {
    let options = Options::default();
    let text = serde_json::to_string(&options).unwrap();
    assert_eq!(serde_json::from_str::<Options>(&text).unwrap(), options);

    let rest = [[0.0, 0.0], [0.01, 0.0], [0.0, 0.01]].map(|[x, y]| Point3::new(x, y, 0.0));
    let mut filter = Filter::new(&rest, &[[0, 1], [1, 2], [0, 2]], &options).unwrap();
    let seen = [Observation {
        vertex: 1,
        position: Point3::new(0.0103, 0.0, 0.001),
        sigma: 1e-3,
    }];
    let report = filter.step(&Frame::new(&seen)).unwrap();
    let bytes = postcard::to_allocvec(&report).unwrap();
    assert_eq!(postcard::from_bytes::<StepReport>(&bytes).unwrap(), report);
}
