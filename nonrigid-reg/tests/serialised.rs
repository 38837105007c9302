//! With the feature `serde`, options and results survive a round trip through JSON.
#![cfg(feature = "serde")]
#![allow(missing_docs, clippy::unwrap_used, reason = "a test may panic")]

use nonrigid_reg::nalgebra::{Point3, Vector3};
use nonrigid_reg::{Cloud, Options, Registration, Settled, Status, register};

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

#[test]
fn results_come_back() {
    let at = |k: i32| Point3::new(f64::from(k % 8), f64::from(k / 8), 0.0) * 0.01;
    let points: Vec<_> = (0..64).map(at).collect();
    let normals = vec![Vector3::z_axis(); points.len()];
    let cloud = Cloud {
        points: &points,
        normals: &normals,
    };
    let result = register(&cloud, &cloud, &[], &[], &Options::default()).unwrap();
    let text = serde_json::to_string(&result).unwrap();
    assert_eq!(serde_json::from_str::<Registration>(&text).unwrap(), result);
}
