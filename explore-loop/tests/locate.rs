//! A body that was lost is found where it lies: in any pose, also if part of it was never seen.
//!
//! The scenes of the simulated cell, thrown onto the table in random orientations; the truth is the pose they were thrown in.
#![cfg(feature = "sim")]
#![allow(missing_docs, clippy::unwrap_used, clippy::print_stdout)]

mod common;

use common::observation;
use explore_loop::canonical::{CanonicalModel, NewVertex};
use explore_loop::cell::Plane;
use explore_loop::cell::sim::Scene;
use explore_loop::measure::{Sample, Sampling, Surface};
use explore_loop::reconstruct::locate::locate;
use explore_loop::visibility::{DepthGrid, Sight, facing};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, UnitVector3, Vector3};
use nonrigid_reg::{Cloud, align_rigid, estimate_normals, even_rotations};
use std::sync::OnceLock;

/// As the loop has it.
const FOUND: f64 = 0.5;

const SPACING: f64 = 0.005;
/// Distance of the table from the camera, metres.
const TABLE: f64 = 0.55;

/// A body: its surface about its centre, evenly sampled twice.
struct Body {
    surface: Surface,
    /// About four samples per square of the spacing.
    dense: Vec<Sample>,
    /// About one.
    vertices: Vec<Sample>,
}

impl Body {
    fn of(scene: &str) -> Self {
        let scene = Scene::named(scene).unwrap();
        let mesh = scene.mesh();
        let centre = mesh.vertices.iter().map(|p| p.coords).sum::<Vector3<f64>>()
            / mesh.vertices.len() as f64;
        let vertices: Vec<Point3<f64>> = mesh.vertices.iter().map(|p| p - centre).collect();
        let triangles: Vec<[u32; 3]> = mesh.triangles.iter().map(|t| t.map(|i| i as u32)).collect();
        let surface = Surface::new(&vertices, &triangles).unwrap();
        let places = surface.area() / (SPACING * SPACING);
        let samples = |per: f64| {
            let sampling = Sampling::default().with_count((per * places) as usize);
            surface.samples(sampling)
        };
        let (dense, vertices) = (samples(6.0), samples(1.2));
        Self {
            surface,
            dense,
            vertices,
        }
    }

    /// The pose in which it lies on the table, turned by `turn`.
    fn lying(&self, turn: UnitQuaternion<f64>, at: [f64; 2]) -> Isometry3<f64> {
        let lowest = self.dense.iter().map(|s| (turn * s.point).z);
        let lowest = lowest.fold(f64::NEG_INFINITY, f64::max);
        Isometry3::from_parts(Translation3::new(at[0], at[1], TABLE - lowest), turn)
    }

    /// What the camera sees of it.
    fn cloud(&self, pose: &Isometry3<f64>) -> Vec<Point3<f64>> {
        let moved: Vec<Point3<f64>> = self.dense.iter().map(|s| pose * s.point).collect();
        let depth = DepthGrid::new(&moved, 0.004, &Isometry3::identity()).unwrap();
        let seen =
            |(p, s): (&Point3<f64>, &Sample)| visible(p, &(pose.rotation * s.normal), &depth);
        moved
            .iter()
            .zip(&self.dense)
            .filter(|(p, s)| seen((p, s)))
            .map(|(p, _)| *p)
            .collect()
    }

    /// The model after views in these poses, as it was last estimated in the last of them.
    fn model(&self, views: &[Isometry3<f64>]) -> CanonicalModel {
        let last = views[views.len() - 1];
        let mut known = vec![None; self.vertices.len()];
        for (frame, pose) in views.iter().enumerate() {
            let moved: Vec<Point3<f64>> = self.dense.iter().map(|s| pose * s.point).collect();
            let depth = DepthGrid::new(&moved, 0.004, &Isometry3::identity()).unwrap();
            for (known, s) in known.iter_mut().zip(&self.vertices) {
                if visible(&(pose * s.point), &(pose.rotation * s.normal), &depth) {
                    *known = Some(100 * frame as u32);
                }
            }
        }
        let mut model = CanonicalModel::default();
        for (frame, s) in known.iter().zip(&self.vertices) {
            if let Some(frame) = frame {
                let normal = UnitVector3::new_unchecked(last.rotation * s.normal.into_inner());
                model.push(NewVertex::new(last * s.point, normal), *frame);
            }
        }
        model
    }

    /// Mean distance of a located model from the surface where it really is, metres.
    fn off(&self, model: &CanonicalModel, motion: &Isometry3<f64>, truth: &Isometry3<f64>) -> f64 {
        let back = truth.inverse() * motion;
        let far = |p: &Point3<f64>| self.surface.distance(&(back * p));
        model.live().iter().map(far).sum::<f64>() / model.len() as f64
    }
}

fn visible(p: &Point3<f64>, normal: &UnitVector3<f64>, depth: &DepthGrid) -> bool {
    let supported = matches!(depth.sight(p, 0.003, 0.003), Sight::Supported { .. });
    supported && facing(p, normal, &Point3::origin()) > 0.25
}

fn table() -> Plane {
    Plane {
        normal: -Vector3::z_axis(),
        offset: TABLE,
    }
}

fn bodies() -> &'static [(&'static str, Body)] {
    static BODIES: OnceLock<Vec<(&'static str, Body)>> = OnceLock::new();
    BODIES.get_or_init(|| {
        ["beanie", "glove", "liver", "colon"]
            .map(|scene| (scene, Body::of(scene)))
            .into()
    })
}

/// Results of throws.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq)]
struct Tally {
    throws: usize,
    /// Found where it is.
    right: usize,
    /// Believed to be where it is not.
    wrong: usize,
    /// Found by the best rigid alignment of the clouds alone.
    aligned: usize,
}

fn throw(body: &Body, views: &[Isometry3<f64>], throws: usize) -> Tally {
    let model = body.model(views);
    let normals: Vec<_> = (0..model.len()).map(|i| model.live_normal(i)).collect();
    let mut tally = Tally::default();
    for turn in even_rotations(throws) {
        let truth = body.lying(turn, [0.02, -0.03]);
        let seen = observation(body.cloud(&truth));
        let is_right = |motion: &Isometry3<f64>| body.off(&model, motion, &truth) < 0.003;
        let places = locate(&model, &seen, &table(), SPACING);
        let seen_normals = estimate_normals(&seen.points, 16, &Point3::origin()).unwrap();
        let whole = Cloud {
            points: model.live(),
            normals: &normals,
        };
        let cloud = Cloud {
            points: &seen.points,
            normals: &seen_normals,
        };
        let aligned = align_rigid(&whole, &cloud).unwrap();
        let best = places.first().filter(|place| place.agreement >= FOUND);
        let right = best.is_some_and(|place| is_right(&place.found_from_lost));
        tally.throws += 1;
        tally.right += usize::from(right);
        tally.wrong += usize::from(best.is_some() && !right);
        tally.aligned += usize::from(is_right(&aligned.target_from_source));
    }
    tally
}

/// Throws of every body after it was seen from four sides.
fn after_a_turn(throws: usize) -> Vec<(&'static str, Tally)> {
    let one = |(scene, body): &(&'static str, Body)| {
        let about_x = |angle: f64| {
            let turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), angle.to_radians());
            body.lying(turn, [0.0, 0.0])
        };
        let tally = throw(body, &[0.0, 60.0, 120.0, 180.0].map(about_x), throws);
        println!("{scene}: {tally:?}");
        (*scene, tally)
    };
    bodies().iter().map(one).collect()
}

#[test]
fn a_body_is_found_in_any_pose() {
    for (scene, tally) in after_a_turn(6) {
        assert!(tally.right + 1 >= tally.throws, "{scene}: {tally:?}");
    }
}

/// The shape alone does not tell: a dome fits onto itself in every rotation.
#[test]
#[ignore = "takes minutes"]
fn more_bodies_are_found_than_by_their_shape_alone() {
    let all = after_a_turn(40);
    let sum = |part: fn(&Tally) -> usize| all.iter().map(|(_, tally)| part(tally)).sum::<usize>();
    let (right, aligned) = (sum(|t| t.right), sum(|t| t.aligned));
    assert!(right > aligned, "{right} and {aligned}");
    assert!(20 * right > 19 * sum(|t| t.throws), "{right}");
}

/// The other side of a body was never seen: when it shows that side, it must not be believed to lie in the way that it did.
#[test]
fn a_body_that_shows_an_unknown_side_is_not_found_elsewhere() {
    let (_, beanie) = &bodies()[0];
    let tally = throw(
        beanie,
        &[beanie.lying(UnitQuaternion::identity(), [0.0, 0.0])],
        6,
    );
    println!("{tally:?}");
    assert_eq!(tally.wrong, 0, "{tally:?}");
}

/// Nothing to search for, and nothing to search in.
#[test]
fn without_a_model_or_a_cloud_there_is_no_place() {
    let (_, liver) = &bodies()[2];
    let rest = liver.lying(UnitQuaternion::identity(), [0.0, 0.0]);
    let model = liver.model(&[rest]);
    let seen = observation(liver.cloud(&rest));
    let nowhere = |model: &CanonicalModel, points: Vec<Point3<f64>>| {
        locate(model, &observation(points), &table(), SPACING).is_empty()
    };
    assert!(nowhere(&CanonicalModel::default(), seen.points.clone()));
    assert!(nowhere(&model, Vec::new()));
    assert!(nowhere(&model, seen.points[..3].to_vec()));
}
