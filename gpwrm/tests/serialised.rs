//! With the feature `serde`, options survive a round trip through JSON and results one through bytes.
#![cfg(feature = "serde")]
#![allow(missing_docs, clippy::unwrap_used, reason = "a test may panic")]

use gpwrm::nalgebra::{Point3, Vector3};
use gpwrm::{Field, FieldOptions, Sample, Support, Weight};

#[test]
fn options_and_samples_come_back() {
    let options = FieldOptions::default()
        .with_support(Support::Nearest(9))
        .with_weight(Weight::Quartic);
    let text = serde_json::to_string(&options).unwrap();
    assert_eq!(
        serde_json::from_str::<FieldOptions>(&text).unwrap(),
        options
    );

    let nodes: Vec<Point3<f64>> = (0..27)
        .map(|k| Point3::new(f64::from(k % 3), f64::from(k / 3 % 3), f64::from(k / 9)) * 0.01)
        .collect();
    let moved: Vec<Vector3<f64>> = nodes.iter().map(|p| p.coords * 0.1).collect();
    let field = Field::new(&nodes, &moved, &options).unwrap();
    let sample = field.evaluate(&Point3::new(0.004, 0.013, 0.007));
    let bytes = postcard::to_allocvec(&sample).unwrap();
    assert_eq!(postcard::from_bytes::<Sample>(&bytes).unwrap(), sample);
}
