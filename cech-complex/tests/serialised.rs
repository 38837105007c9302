//! With the feature `serde`, options survive a round trip through JSON and results one through bytes.
#![cfg(feature = "serde")]
#![allow(missing_docs, clippy::unwrap_used, reason = "a test may panic")]

use cech_complex::manifolds::Manifold;
use cech_complex::{Bar, Complex, Cylinder, DistortionLimits, Options, Orientation};

#[test]
fn options_come_back() {
    let options = Options::default()
        .with_max_scale(1.25)
        .with_orientation(Orientation::Free);
    let text = serde_json::to_string(&options).unwrap();
    assert_eq!(serde_json::from_str::<Options>(&text).unwrap(), options);
    let limits = DistortionLimits::default()
        .with_max_difference(0.01)
        .with_min_cosine(0.2)
        .with_min_displacement(0.001);
    let text = serde_json::to_string(&limits).unwrap();
    assert_eq!(
        serde_json::from_str::<DistortionLimits>(&text).unwrap(),
        limits
    );
}

#[test]
fn bars_come_back() {
    let cloud = Manifold::Sphere { radius: 0.04 }.net(120, 1);
    let cylinder = Cylinder::new(0.015, 0.012).unwrap();
    let options = Options::default();
    let complex = Complex::build(&cloud.points, &cloud.normals, cylinder, &options).unwrap();
    let bars: Vec<Bar> = complex.barcode().bars().to_vec();
    assert!(bars.len() > 10);
    let bytes = postcard::to_allocvec(&bars).unwrap();
    assert_eq!(postcard::from_bytes::<Vec<Bar>>(&bytes).unwrap(), bars);
}
