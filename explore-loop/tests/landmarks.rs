//! Colour features as landmarks: they show motion that geometry does not; and without them nothing is computed for them.
#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::float_cmp,
    clippy::print_stdout
)]

use dvrk_io::features::{Descriptor, Feature};
use explore_loop::cell::{Observation, Plane};
use explore_loop::reconstruct::{ColourFeatures, ReconstructOptions, Reconstructor};
use nalgebra::{Point3, Rotation3, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

const SPACING: f64 = 0.005;
const TABLE: f64 = 0.5;
/// Radius and height of a dome, metres.
const RADIUS: f64 = 0.06;
const HEIGHT: f64 = 0.03;

/// Height of the dome over the table at a distance from its axis.
fn height(r: f64) -> f64 {
    HEIGHT * (1.0 - (r / RADIUS).powi(2)).max(0.0).sqrt()
}

/// The point of the dome over a place of the table.
fn on_dome(x: f64, y: f64) -> Point3<f64> {
    Point3::new(x, y, TABLE - height(x.hypot(y)))
}

/// Points on a grid that stays where it is: they do not tell whether the dome turns about its axis.
fn cloud() -> Vec<Point3<f64>> {
    let places = (-45..=45).flat_map(|i| (-45..=45).map(move |j| (f64::from(i), f64::from(j))));
    places
        .map(|(i, j)| (0.0014 * i, 0.0014 * j))
        .filter(|(x, y)| x.hypot(*y) < 0.98 * RADIUS)
        .map(|(x, y)| on_dome(x, y))
        .collect()
}

/// Places of the dome that can be recognised.
fn painted(random: &mut ChaCha8Rng) -> Vec<Feature> {
    let mut features = Vec::new();
    while features.len() < 250 {
        let [x, y] = [0, 0].map(|_| random.random_range(-RADIUS..RADIUS));
        if x.hypot(y) < 0.85 * RADIUS {
            features.push(Feature {
                point: on_dome(x, y),
                descriptor: Descriptor(std::array::from_fn(|_| random.random())),
            });
        }
    }
    features
}

fn turned(p: &Point3<f64>, angle: f64) -> Point3<f64> {
    Rotation3::from_axis_angle(&Vector3::z_axis(), angle) * p
}

/// The features as they are seen: a third are not, each is off by half a millimetre, some bits are wrong, and one in ten is somewhere else.
fn seen(all: &[Feature], angle: f64, random: &mut ChaCha8Rng) -> Vec<Feature> {
    let mut seen = Vec::new();
    for feature in all {
        if random.random_bool(0.33) {
            continue;
        }
        let [dx, dy] = [0, 0].map(|_| random.random_range(-0.0008..0.0008));
        let mut at = turned(&feature.point, angle) + Vector3::new(dx, dy, 0.0);
        if random.random_bool(0.1) {
            let far = random.random_range(0.004..0.012);
            at = turned(&at, far / RADIUS * 2.0);
        }
        let mut descriptor = feature.descriptor;
        for word in &mut descriptor.0 {
            *word ^= 1 << random.random_range(0..32);
        }
        seen.push(Feature {
            point: on_dome(at.x, at.y),
            descriptor,
        });
    }
    seen
}

/// Mean error of the vertices, metres, after the dome has turned about its axis by so many degrees in so many frames; what it would be if
/// nobody noticed; and the bits of the model.
fn after_turning(features: ColourFeatures) -> (f64, f64, Vec<[u64; 3]>) {
    const FRAMES: u32 = 30;
    let table = Plane {
        normal: -Vector3::z_axis(),
        offset: TABLE,
    };
    let mut random = ChaCha8Rng::seed_from_u64(3);
    let all = painted(&mut random);
    let options = ReconstructOptions::new(SPACING).with_features(features);
    let mut reconstructor = Reconstructor::new(options).unwrap();
    let mut angle = 0.0;
    for frame in 0..FRAMES {
        angle = 0.4_f64.to_radians() * f64::from(frame);
        let observation = Observation {
            stamp: 0.1 * f64::from(frame),
            camera: None,
            points: cloud(),
            colours: None,
            features: Some(seen(&all, angle, &mut random)),
            arms: Vec::new(),
        };
        let report = reconstructor.process(&observation, &table).unwrap();
        assert_eq!(report.failure, None);
    }
    let model = reconstructor.model();
    let (mut error, mut moved) = (0.0, 0.0);
    for (rest, live) in model.rest().iter().zip(model.live()) {
        error += (turned(rest, angle) - live).norm();
        moved += (turned(rest, angle) - rest).norm();
    }
    let count = model.len() as f64;
    let bits = model
        .live()
        .iter()
        .map(|p| [p.x, p.y, p.z].map(f64::to_bits));
    (error / count, moved / count, bits.collect())
}

#[test]
fn features_see_a_dome_turn_about_its_axis() {
    let (without, unnoticed, _) = after_turning(ColourFeatures::Ignored);
    let (with, _, bits) = after_turning(ColourFeatures::Landmarks);
    println!(
        "turned by {:.1} mm: {:.1} mm off without features, {:.1} mm with them",
        1e3 * unnoticed,
        1e3 * without,
        1e3 * with
    );
    // Geometry alone says that nothing moved.
    assert!(without > 0.9 * unnoticed, "{without} of {unnoticed}");
    assert!(with < 0.35 * unnoticed, "{with} of {unnoticed}");
    assert_eq!(after_turning(ColourFeatures::Landmarks).2, bits);
}

/// Where nothing moves, features with their errors move nothing.
#[test]
fn features_leave_what_rests_at_rest() {
    let table = Plane {
        normal: -Vector3::z_axis(),
        offset: TABLE,
    };
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let all = painted(&mut random);
    let mut reconstructor = Reconstructor::new(ReconstructOptions::new(SPACING)).unwrap();
    for frame in 0..20 {
        let observation = Observation {
            stamp: 0.1 * f64::from(frame),
            camera: None,
            points: cloud(),
            colours: None,
            features: Some(seen(&all, 0.0, &mut random)),
            arms: Vec::new(),
        };
        reconstructor.process(&observation, &table).unwrap();
    }
    let model = reconstructor.model();
    let moved = model
        .rest()
        .iter()
        .zip(model.live())
        .map(|(a, b)| (a - b).norm());
    let mean = moved.sum::<f64>() / model.len() as f64;
    assert!(mean < 0.0005, "{mean} m");
}

#[cfg(feature = "sim")]
mod simulated {
    use super::SPACING;
    use dvrk_io::features::{FeatureOptions, LandmarkPair, landmark_pairs};
    use explore_loop::cell::Cell;
    use explore_loop::cell::sim::{CameraOptions, Scene, SimCell, SimOptions};
    use explore_loop::measure::Surface;

    fn options(camera: CameraOptions, features: Option<usize>) -> SimOptions {
        let mut options = SimOptions::new(Scene::ellipsoid([0.06, 0.045, 0.03]).unwrap());
        options.fidelity.tetrahedra = 500;
        options.camera = camera;
        options.camera.noise = 3e-4;
        options.camera.features = features;
        options
    }

    #[test]
    fn a_camera_finds_features_when_asked_and_else_does_nothing() {
        for camera in [CameraOptions::default(), CameraOptions::realsense()] {
            let (mut plain, _) = SimCell::new(&options(camera, None)).unwrap();
            let (mut asked, truth) = SimCell::new(&options(camera, Some(2))).unwrap();
            let (mut again, _) = SimCell::new(&options(camera, Some(2))).unwrap();
            let mut frames = Vec::new();
            for _ in 0..3 {
                let [without, with, twice] =
                    [&mut plain, &mut asked, &mut again].map(|cell| cell.observe().unwrap());
                assert_eq!(without.features, None);
                assert_eq!(with, twice);
                assert_eq!((&without.points, without.stamp), (&with.points, with.stamp));
                assert_eq!(
                    (&without.colours, &without.arms),
                    (&with.colours, &with.arms)
                );
                frames.push(with.features.unwrap());
            }
            let triangles: Vec<[u32; 3]> = truth
                .triangles()
                .iter()
                .map(|t| t.map(|i| i as u32))
                .collect();
            let surface = Surface::new(&truth.live(), &triangles).unwrap();
            let features = &frames[2];
            println!("{} features", features.len());
            assert!(features.len() > 40, "{} features", features.len());
            for feature in features {
                let off = surface.distance(&feature.point);
                assert!(off < SPACING, "{off} m off the surface");
            }
            // The body rests, so that every pair is at one place, to the noise of a pixel and of the depth.
            let pairs = landmark_pairs(&frames[1], features, &FeatureOptions::default());
            assert!(pairs.len() > 25, "{} pairs", pairs.len());
            let near = |pair: &&LandmarkPair| nalgebra::distance(&pair.a, &pair.b) < 0.004;
            let right = pairs.iter().filter(near).count();
            println!("{right} of {} pairs right", pairs.len());
            assert!(right as f64 > 0.9 * pairs.len() as f64);
        }
    }

    #[test]
    fn a_scale_out_of_range_is_refused() {
        for scale in [0, 5, usize::MAX] {
            assert!(SimCell::new(&options(CameraOptions::default(), Some(scale))).is_err());
        }
    }
}
