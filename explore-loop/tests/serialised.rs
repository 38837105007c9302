//! Options and results survive a round trip through JSON and through bytes.
#![allow(missing_docs, clippy::unwrap_used, reason = "a test may panic")]

use explore_loop::baseline::DynamicFusionOptions;
use explore_loop::canonical::closed_surface::ClosedSurfaceOptions;
use explore_loop::cell::faults::{Begin, Fault, FaultKind};
use explore_loop::cell::sim::{
    CameraModel, CameraOptions, Fidelity, JawOptions, Material, StereoOptions,
};
use explore_loop::explore::{ExploreOptions, Phase};
use explore_loop::measure::{DoubledOptions, MeshReport, ShapeMeasures, Spread};
use explore_loop::reconstruct::{FrameReport, ReconstructOptions};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::fmt::Debug;

fn comes_back<T: Serialize + DeserializeOwned + PartialEq + Debug>(value: &T) {
    let text = serde_json::to_string(value).unwrap();
    assert_eq!(&serde_json::from_str::<T>(&text).unwrap(), value, "{text}");
    let bytes = postcard::to_allocvec(value).unwrap();
    assert_eq!(&postcard::from_bytes::<T>(&bytes).unwrap(), value);
}

#[test]
fn options_come_back() {
    comes_back(&ExploreOptions::new(0.005, 0.03).with_steady_speed(true));
    comes_back(&ReconstructOptions::new(0.005));
    comes_back(&ClosedSurfaceOptions::default());
    comes_back(&DoubledOptions::default());
    comes_back(&DynamicFusionOptions::new(0.005));
    comes_back(&CameraOptions::default());
    comes_back(&CameraModel::Stereo(StereoOptions::default()));
    comes_back(&Fidelity::default());
    comes_back(&JawOptions::default());
    comes_back(&Material::default());
    comes_back(&Fault {
        kind: FaultKind::ClockJump { seconds: -0.1 },
        begin: Begin::Frame(12),
        frames: 3,
    });
}

#[test]
fn results_come_back() {
    comes_back(&FrameReport::default());
    comes_back(&ShapeMeasures::default());
    comes_back(&MeshReport::default());
    comes_back(&Spread::default());
    comes_back(&Phase::Lower);
}
