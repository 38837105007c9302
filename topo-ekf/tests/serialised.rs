//! With the feature `serde`, options survive a round trip through JSON and results one through bytes.
#![cfg(feature = "serde")]
#![allow(missing_docs, clippy::unwrap_used, reason = "a test may panic")]

use topo_ekf::body::{BodyFilter, BodyFrame, BodyOptions, BodyReport, Embedding, Lattice, Row};
use topo_ekf::nalgebra::{Point3, Rotation3, Vector3};
use topo_ekf::{Filter, Frame, Observation, Options, Plane, StepReport};

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

#[test]
fn what_a_body_is_told_and_tells_comes_back() {
    let mut lattice = Lattice::new(0.016, Point3::origin(), Rotation3::identity());
    let cell = lattice.ensure([0; 3]);
    lattice.set_fill(cell, 1.0, 1.0);
    let at = Embedding::new(cell, [0.5; 3]);
    let row = Row::along(at, Point3::origin(), Vector3::z_axis(), 1e6);
    let bytes = postcard::to_allocvec(&row).unwrap();
    assert_eq!(postcard::from_bytes::<Row>(&bytes).unwrap(), row);

    let table = Plane {
        normal: Vector3::z_axis(),
        offset: 0.0,
    };
    let mut body = BodyFilter::new(lattice, table, &BodyOptions::default()).unwrap();
    let frame = BodyFrame::new(&[], &[]);
    let report = body.step(&frame, &mut |_, _, _| vec![row], &mut |_, _| {});
    let report = report.unwrap();
    let bytes = postcard::to_allocvec(&report).unwrap();
    assert_eq!(postcard::from_bytes::<BodyReport>(&bytes).unwrap(), report);
}
