//! Calibration: files survive a round trip bit for bit, errors name invalid files, and a check tells whether a calibration is still valid.
#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::float_cmp,
    reason = "tests; copied values must be the same bits"
)]

mod planted;

use planted::*;

use dvrk_io::Error;
use dvrk_io::calibration::{
    Calibration, CheckOptions, FitOptions, Method, Sighting, Verdict, fit_sightings,
};
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use proptest::prelude::*;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

#[test]
fn the_verdict_is_a_share() {
    let mut random = ChaCha8Rng::seed_from_u64(12);
    let planted = [any_transform(&mut random), any_transform(&mut random)];
    let options = FitOptions::default();
    let fit = fit_sightings(
        &sightings(&mut random, &planted, 16, [2e-4, 2e-3]),
        &options,
    )
    .unwrap();
    let calibration = Calibration::new("PSM1", "camera", "PSM1_base", &fit).unwrap();
    let limits = CheckOptions::default();
    let fresh = touches(&mut random, &planted[0], 16, 5e-4);
    let verdict = |broken: usize| {
        let mut samples = fresh.clone();
        samples
            .iter_mut()
            .take(broken)
            .for_each(|sample| sample.camera.x += 0.02);
        let check = calibration.check_touches(&samples, &limits).unwrap();
        assert_eq!((check.within, check.options.limit), (16 - broken, 0.005));
        check.verdict
    };
    assert_eq!([0, 4].map(verdict), [Verdict::Holds; 2]);
    assert_eq!([5, 8].map(verdict), [Verdict::Doubtful; 2]);
    assert_eq!([9, 16].map(verdict), [Verdict::Broken; 2]);

    // A camera that was knocked: the bias says by how much.
    let knock = Vector3::new(0.0, 0.011, -0.004);
    let seen = sightings(&mut random, &planted, 9, [2e-4, 2e-3]);
    assert_eq!(
        calibration.check_sightings(&seen, &limits).unwrap().verdict,
        Verdict::Holds
    );
    let knocked: Vec<Sighting> = seen
        .iter()
        .map(|s| Sighting {
            camera_from_marker: Translation3::from(knock) * s.camera_from_marker,
            ..*s
        })
        .collect();
    let check = calibration.check_sightings(&knocked, &limits).unwrap();
    assert_eq!((check.verdict, check.within), (Verdict::Broken, 0));
    assert!((check.bias - knock).norm() < 1e-3 && check.max >= check.rms && check.rms > 0.01);
    // One that was only turned shows in the angles.
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.2);
    let turned: Vec<Sighting> = seen
        .iter()
        .map(|s| {
            let mut pose = s.camera_from_marker;
            pose.rotation = turn * pose.rotation;
            Sighting {
                camera_from_marker: pose,
                ..*s
            }
        })
        .collect();
    assert_eq!(
        calibration
            .check_sightings(&turned, &limits)
            .unwrap()
            .verdict,
        Verdict::Broken
    );
    assert!(matches!(
        calibration.check_touches(&fresh[..3], &limits),
        Err(Error::TooFewSamples {
            given: 3,
            needed: 4
        })
    ));
    let touched = Calibration::new("PSM1", "camera", "PSM1_base", &fit_of_touches()).unwrap();
    assert!(matches!(
        touched.check_sightings(&seen, &limits),
        Err(Error::NoMarker)
    ));
}

#[test]
fn files_come_back_to_the_bit() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("psm1.toml");
    for fit in [fit_of_touches(), fit_of_sightings()] {
        let calibration =
            Calibration::new("PSM1", "camera_depth_optical_frame", "PSM1_base", &fit).unwrap();
        calibration.save(&path).unwrap();
        let again = Calibration::load(&path).unwrap();
        let bits = |c: &Calibration| {
            let poses = [Some(c.camera_from_rcm), c.wrist_from_marker];
            let numbers = poses.into_iter().flatten().flat_map(|pose| {
                let turn: [f64; 4] = pose.rotation.coords.into();
                let shift: [f64; 3] = pose.translation.vector.into();
                turn.into_iter().chain(shift)
            });
            let all = numbers.chain([c.rms, c.max, c.rms_angle, c.max_angle]);
            all.map(f64::to_bits).collect::<Vec<u64>>()
        };
        assert_eq!(bits(&again), bits(&calibration));
        assert_eq!(again, calibration);
        // Text and all.
        assert_eq!(again.to_toml().unwrap(), calibration.to_toml().unwrap());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }
    assert!(matches!(
        Calibration::load(folder.path().join("none.toml")),
        Err(Error::Io { .. })
    ));
    assert!(matches!(
        Calibration::new("", "camera", "PSM1_base", &fit_of_touches()),
        Err(Error::BadCalibration { key, .. }) if key == "arm"
    ));
}

/// A file as a person would write it, and what happens to it.
const FILE: &str = r#"# Our cell.
format = "dvrk-io calibration"
version = 1
arm = "PSM1"
method = "touches"

[units]
length = "m"
angle = "rad"

[camera_from_rcm]
target = "camera"
source = "PSM1_base"
translation = [0.1, 0, 0.4]
quaternion_xyzw = [0.0, 0.7071, 0.0, 0.7071]

[residuals]
samples = 12
outliers = [5]
rms = 4e-4
max = 7e-4
rms_angle = 0
max_angle = 0
"#;

#[test]
fn a_file_by_hand() {
    let read = Calibration::from_toml(FILE.as_bytes()).unwrap();
    assert_eq!(
        (read.arm.as_str(), read.method, read.samples),
        ("PSM1", Method::Touches, 12)
    );
    assert_eq!(
        read.camera_from_rcm.translation.vector,
        Vector3::new(0.1, 0.0, 0.4)
    );
    assert!((read.camera_from_rcm.rotation.quaternion().norm() - 1.0).abs() < 1e-15);
    // The dVRK has x to the left and y up.
    let seen = read.dvrk_camera_from_rcm().translation.vector;
    assert!((seen - Vector3::new(-0.1, 0.0, 0.4)).norm() < 1e-15);
}

#[test]
fn bad_files_name_line_and_key() {
    let cases = [
        ("version = 1", "version = 2", 3, "version"),
        ("version = 1", "version = \"1\"", 3, "version"),
        ("version = 1", "verson = 1", 1, "file"),
        ("calibration\"", "session\"", 2, "format"),
        ("\"PSM1\"", "\"\"", 4, "arm"),
        ("\"touches\"", "\"guesses\"", 5, "method"),
        ("\"touches\"", "\"sightings\"", 5, "method"),
        ("\"m\"", "\"mm\"", 8, "length"),
        ("\"rad\"", "\"deg\"", 9, "angle"),
        ("target = \"camera\"", "target = 3", 12, "target"),
        ("[0.1, 0, 0.4]", "[0.1, nan, 0.4]", 14, "translation"),
        ("[0.1, 0, 0.4]", "[0.1, inf, 0.4]", 14, "translation"),
        ("[0.1, 0, 0.4]", "[0.1, 0.4]", 14, "translation"),
        (
            "[0.1, 0, 0.4]",
            "[\n  0.1,\n  \"a\",\n  0.4]",
            16,
            "translation",
        ),
        ("0.7071]", "0.9]", 15, "quaternion_xyzw"),
        ("0.7071]", "nan]", 15, "quaternion_xyzw"),
        ("[5]", "[12]", 19, "outliers"),
        ("[5]", "[5, 5]", 19, "outliers"),
        ("[5]", "[-5]", 19, "outliers"),
        ("rms = 4e-4", "rms = -1.0", 20, "rms"),
        ("max = 7e-4", "max = nan", 21, "max"),
        ("max_angle = 0", "max_angel = 0", 23, "max_angel"),
        ("arm = \"PSM1\"", "arm = \"PSM1", 4, "arm"),
        ("[residuals]", "[residuals", 17, "quaternion_xyzw"),
    ];
    for (old, new, line, key) in cases {
        assert!(FILE.contains(old), "{old}");
        let text = FILE.replacen(old, new, 1);
        match Calibration::from_toml(text.as_bytes()) {
            Err(Error::BadCalibration {
                line: at,
                key: named,
                reason,
            }) => {
                assert_eq!((at, named.as_str()), (line, key), "{new}: {reason}");
                assert!(!reason.is_empty());
            }
            other => panic!("{new}: {other:?}"),
        }
    }
    let message = Calibration::from_toml(
        FILE.replace("\"mm\"", "\"m\"")
            .replace("\"m\"", "\"mm\"")
            .as_bytes(),
    );
    assert_eq!(
        message.unwrap_err().to_string(),
        "calibration, line 8, `length`: must be \"m\""
    );
    let missing = FILE.replace("rms = 4e-4\n", "");
    let message = Calibration::from_toml(missing.as_bytes())
        .unwrap_err()
        .to_string();
    assert!(
        message.contains("residuals") && message.contains("rms"),
        "{message}"
    );
    let mut latin = FILE.as_bytes().to_vec();
    latin[40] = 0xe9;
    assert!(matches!(
        Calibration::from_toml(&latin),
        Err(Error::BadCalibration { line: 2, .. })
    ));
    let deep = format!("format = {}", "[".repeat(100_000));
    assert!(Calibration::from_toml(deep.as_bytes()).is_err());
}

proptest! {
    #[test]
    fn any_numbers_come_back(
        shift in prop::array::uniform3(-1e5..1e5), turn in prop::array::uniform4(-1.0..1.0),
        small in -1e-300..1e-300, name in "[ -~]{1,20}", rms in 0.0..1e300,
    ) {
        let turn = Quaternion::new(turn[0], turn[1], turn[2], turn[3]);
        prop_assume!(turn.norm() > 0.01 && !name.trim().is_empty());
        let mut calibration = Calibration::new("PSM1", "camera", "PSM1_base", &fit_of_touches())?;
        let [x, y, _] = shift;
        let rotation = UnitQuaternion::new_normalize(turn);
        calibration.camera_from_rcm = Isometry3::from_parts(Translation3::new(x, y, small), rotation);
        (calibration.camera_frame, calibration.rms) = (name, rms);
        let again = Calibration::from_toml(calibration.to_toml()?.as_bytes())?;
        prop_assert_eq!(&again, &calibration);
        let [one, two] = [&again, &calibration].map(|c| c.camera_from_rcm.translation.z.to_bits());
        prop_assert_eq!(one, two);
    }

    #[test]
    fn any_bytes(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        let _ = Calibration::from_toml(&bytes);
    }

    /// A good file with bytes changed, cut or doubled.
    #[test]
    fn damaged_files(at in 0..FILE.len(), byte: u8, cut in 0..FILE.len(), doubled: bool) {
        let mut bytes = FILE.as_bytes().to_vec();
        bytes[at] = byte;
        if let Ok(read) = Calibration::from_toml(&bytes) {
            prop_assert!(read.camera_from_rcm.to_homogeneous().iter().all(|x| x.is_finite()));
        }
        prop_assert!(cut + 2 > FILE.len() || Calibration::from_toml(&FILE.as_bytes()[..cut]).is_err());
        if doubled {
            bytes.extend_from_slice(FILE.as_bytes());
            prop_assert!(Calibration::from_toml(&bytes).is_err());
        }
    }
}
