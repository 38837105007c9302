//! With the feature `serde`, options and readings survive a round trip through JSON and through bytes.
#![cfg(feature = "serde")]
#![allow(missing_docs, clippy::unwrap_used, reason = "a test may panic")]

use std::fmt::Debug;

use dvrk_io::Psm;
use dvrk_io::arm::{ArmOptions, Stop};
use dvrk_io::calibration::{CheckOptions, FitOptions};
use dvrk_io::cdr::{Header, Pose, PoseStamped};
use dvrk_io::depth::{Capsule, Intrinsics, ObjectOptions};
use dvrk_io::features::FeatureOptions;
use dvrk_io::kinematics::Kinematics;
use dvrk_io::nalgebra::Point3;
use dvrk_io::serve::ServeOptions;
use dvrk_io::session::{Role, WriterOptions};
use serde::Serialize;
use serde::de::DeserializeOwned;

fn comes_back<T: Serialize + DeserializeOwned + PartialEq + Debug>(value: &T) {
    let text = serde_json::to_string(value).unwrap();
    assert_eq!(&serde_json::from_str::<T>(&text).unwrap(), value, "{text}");
    let bytes = postcard::to_allocvec(value).unwrap();
    assert_eq!(&postcard::from_bytes::<T>(&bytes).unwrap(), value);
}

#[test]
fn options_come_back() {
    comes_back(&ArmOptions::default());
    comes_back(&FitOptions::default());
    comes_back(&CheckOptions::default());
    comes_back(&ObjectOptions::default());
    comes_back(&FeatureOptions::default());
    comes_back(&ServeOptions::default());
    comes_back(&WriterOptions::default());
}

#[test]
fn readings_come_back() {
    let camera = Intrinsics::new(640, 480, [600.0, 601.0], [319.5, 239.5]).unwrap();
    comes_back(&camera);
    // What a constructor rejects is not read either.
    let text = serde_json::to_string(&camera).unwrap();
    let read = serde_json::from_str::<Intrinsics>(&text.replace("600.0", "-600.0"));
    let error = read.unwrap_err().to_string();
    assert!(error.contains("focal length is -600"), "{error}");
    let text = serde_json::to_string(&Kinematics::new(Psm::Si)).unwrap();
    let read = serde_json::from_str::<Kinematics>(&text.replace("0.0091", "0.0"));
    let error = read.unwrap_err().to_string();
    assert!(error.contains("wrist link is 0"), "{error}");
    comes_back(&Capsule {
        start: Point3::origin(),
        end: Point3::new(0.0, 0.0, 0.1),
        radius: 0.004,
    });
    comes_back(&"PSM1/measured_cp".parse::<Role>().unwrap());
    comes_back(&PoseStamped {
        header: Header::default(),
        pose: Pose {
            position: [0.1, 0.2, 0.3],
            orientation: [0.0, 0.0, 0.0, 1.0],
        },
    });
    // The reason why an arm stopped contains texts of this crate, so it can be written but not read.
    let text = serde_json::to_string(&Stop::Arrived).unwrap();
    assert_eq!(text, "\"Arrived\"");
}
