//! The pieces of the reconstruction that need no simulator, against answers known by construction.
#![allow(missing_docs, clippy::unwrap_used)]

use explore_loop::canonical::closure::refine;
use explore_loop::canonical::cut::distorted;
use explore_loop::canonical::graph::surface_edges;
use explore_loop::canonical::merge::{FrameCloud, MergeOptions, extension};
use explore_loop::canonical::surface::triangulate;
use explore_loop::canonical::topology::analyse;
use explore_loop::canonical::{CanonicalModel, NewVertex};
use explore_loop::measure::{Measurer, TrueSurface};
use explore_loop::report::metrics::Timing;
use explore_loop::visibility::{DepthGrid, Sight, facing};
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, UnitVector3, Vector3};
use proptest::prelude::*;

type Normal = UnitVector3<f64>;

/// Fibonacci points on an ellipsoid, with exact normals.
fn ellipsoid(count: usize, axes: [f64; 3]) -> (Vec<Point3<f64>>, Vec<Normal>) {
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    (0..count)
        .map(|i| {
            let z = 1.0 - 2.0 * (i as f64 + 0.5) / count as f64;
            let r = (1.0 - z * z).sqrt();
            let (s, c) = (golden * i as f64).sin_cos();
            let d = Vector3::new(r * c, r * s, z);
            let axes = Vector3::from(axes);
            let p = Point3::from(d.component_mul(&axes));
            (p, Normal::new_normalize(d.component_div(&axes)))
        })
        .unzip()
}

/// Half axes of the body in most tests, metres, and the spacing of 1,000 points on it.
const AXES: [f64; 3] = [0.06, 0.045, 0.03];
const COUNT: usize = 1000;
const SPACING: f64 = 5e-3;

fn at_rest(points: &[Point3<f64>], normals: &[Normal]) -> CanonicalModel {
    let mut model = CanonicalModel::default();
    for (p, n) in points.iter().zip(normals) {
        let vertex = NewVertex {
            rest: *p,
            rest_normal: *n,
            live: *p,
            rotation: Matrix3::identity(),
        };
        model.push(vertex, 0);
    }
    model
}

/// Any rotation: an axis-angle vector no longer than half a turn.
fn rotation() -> impl Strategy<Value = Rotation3<f64>> {
    (
        [-1.0..1.0, -1.0..1.0, -1.0..1.0f64],
        0.0..std::f64::consts::PI,
    )
        .prop_filter_map("an axis", |(axis, angle)| {
            let axis = Normal::try_new(Vector3::from(axis), 1e-3)?;
            Some(Rotation3::from_axis_angle(&axis, angle))
        })
}

mod visibility {
    use super::*;

    /// Depth of the plane and half its width, metres; the cloud's pitch and the bin's.
    const DEPTH: f64 = 0.5;
    const HALF: f64 = 0.05;
    const BIN: f64 = 3e-3;

    fn plane(scale: f64) -> DepthGrid {
        let points: Vec<_> = (-50..=50)
            .flat_map(|i| (-50..=50).map(move |j| (f64::from(i), f64::from(j))))
            .map(|(x, y)| Point3::new(x * 1e-3, y * 1e-3, DEPTH) * scale)
            .collect();
        DepthGrid::new(&points, BIN * scale).unwrap()
    }

    proptest! {
        /// Before a plane a point is contradicted, behind it occluded, near it supported by just its distance; and the
        /// same in a world twice as large.
        #[test]
        fn a_plane_tells_before_from_behind(
            x in -0.04..0.04f64, y in -0.04..0.04f64, off in -0.05..0.05f64, scale in 0.5..2.0f64,
        ) {
            let (front, back) = (0.010, 0.006);
            // Neither verdict is asked for within rounding of its bound.
            prop_assume!((off + front).abs() > 1e-9 && (off - back).abs() > 1e-9);
            // On the ray through (x, y) of the plane.
            let point = Point3::from(Vector3::new(x, y, DEPTH) * ((DEPTH + off) / DEPTH) * scale);
            match plane(scale).sight(&point, front * scale, back * scale) {
                Sight::Contradicted => prop_assert!(off < -front),
                Sight::Occluded => prop_assert!(off > back),
                Sight::Supported { behind } => {
                    prop_assert!((-front..=back).contains(&off));
                    prop_assert!((behind - off * scale).abs() < 1e-12);
                }
                Sight::NoData => prop_assert!(false, "the plane covers this ray"),
            }
        }

        /// Beside the plane there is no data, and its nearest edge is found in the image, at the depth of the point.
        #[test]
        fn beside_a_plane_its_edge_is_nearest(
            side in 0usize..4, along in -0.03..0.03f64, beyond in 0.008..0.05f64,
        ) {
            let grid = plane(1.0);
            let turned = |x: f64, y: f64| match side {
                0 => Point3::new(x, y, DEPTH),
                1 => Point3::new(-x, y, DEPTH),
                2 => Point3::new(y, x, DEPTH),
                _ => Point3::new(y, -x, DEPTH),
            };
            let point = turned(HALF + beyond, along);
            prop_assert_eq!(grid.sight(&point, 1.0, 1.0), Sight::NoData);
            let found = grid.nearest_seen(&point, beyond + 2.0 * BIN).unwrap();
            // The middle of the outermost bin, which reaches at most a bin beyond the edge.
            prop_assert!((found - turned(HALF, along)).norm() < 1.5 * BIN);
            prop_assert!((found.z - point.z).abs() < 1e-15);
            let supported = matches!(grid.sight(&found, 1e-9, 1e-9), Sight::Supported { .. });
            prop_assert!(supported);
            // Rings are whole bins: from two bins short of the edge on it is out of reach.
            prop_assert_eq!(grid.nearest_seen(&point, beyond - 2.5 * BIN), None);
        }

        /// Within the outline the nearest seen place is the point's own bin.
        #[test]
        fn within_the_outline_a_point_is_its_own_nearest(x in -0.04..0.04f64, y in -0.04..0.04f64) {
            let point = Point3::new(x, y, DEPTH);
            let found = plane(1.0).nearest_seen(&point, 0.0).unwrap();
            prop_assert!((found - point).norm() <= 0.5 * BIN * 2f64.sqrt() + 1e-12);
        }
    }

    /// The near side of a sphere is supported, its far side occluded, its middle too; before it the camera looks through.
    #[test]
    fn a_sphere_hides_its_far_side() {
        let (radius, centre, bin) = (0.04, Vector3::new(0.02, -0.01, 0.5), 1e-3);
        let (points, normals) = ellipsoid(40_000, [radius; 3]);
        let points: Vec<_> = points.iter().map(|p| p + centre).collect();
        let near: Vec<_> = points
            .iter()
            .zip(&normals)
            .filter(|(p, n)| facing(p, n) > 0.0)
            .map(|(p, _)| *p)
            .collect();
        let grid = DepthGrid::new(&near, bin).unwrap();
        // A bin's depth is that of its nearest point: off by the slope, tan 60° = 1.73 at a facing of 0.5, over the
        // diagonal of two bins.
        let tolerance = 1.73 * 2.0 * bin * 2f64.sqrt();
        for (p, n) in points.iter().zip(&normals) {
            let sight = grid.sight(p, tolerance, tolerance);
            if facing(p, n) > 0.5 {
                assert!(matches!(sight, Sight::Supported { .. }), "{p} {sight:?}");
            } else if facing(p, n) < -0.5 {
                assert_eq!(sight, Sight::Occluded, "{p}");
            }
        }
        let middle = Point3::from(centre);
        assert_eq!(grid.sight(&middle, tolerance, tolerance), Sight::Occluded);
        let before = Point3::from(centre * 0.85);
        assert_eq!(
            grid.sight(&before, tolerance, tolerance),
            Sight::Contradicted
        );
    }

    #[test]
    fn behind_the_camera_there_is_nothing() {
        let grid = plane(1.0);
        let behind = Point3::new(0.0, 0.0, -DEPTH);
        assert_eq!(grid.sight(&behind, 1.0, 1.0), Sight::NoData);
        assert_eq!(grid.nearest_seen(&behind, 1.0), None);
        assert!(DepthGrid::new(&[], BIN).is_none());
        assert!(DepthGrid::new(&[behind], BIN).is_none());
    }
}

mod cutting {
    use super::*;

    /// Two sheets that touch along x = 0, 20 by 12 vertices at 5 mm, in one plane: the graph glues them.
    fn touching() -> CanonicalModel {
        let points: Vec<_> = (0..20)
            .flat_map(|i| (0..12).map(move |j| (f64::from(i) - 9.5, f64::from(j))))
            .map(|(x, y)| Point3::new(x * SPACING, y * SPACING, 0.4))
            .collect();
        let normals = vec![-Vector3::z_axis(); points.len()];
        let mut model = at_rest(&points, &normals);
        model.edges = surface_edges(&model, SPACING);
        model
    }

    fn glue(model: &CanonicalModel) -> Vec<[u32; 2]> {
        let right = |i: u32| model.rest[i as usize].x > 0.0;
        let crosses = |e: &&[u32; 2]| right(e[0]) != right(e[1]);
        model.edges.iter().filter(crosses).copied().collect()
    }

    /// Opens the sheets by `gap` and moves everything rigidly.
    fn open(model: &mut CanonicalModel, gap: f64, turn: &Rotation3<f64>, shift: Vector3<f64>) {
        for i in 0..model.len() {
            let mut p = model.rest[i];
            p.x += if p.x > 0.0 { gap } else { 0.0 };
            model.live[i] = turn * p + shift;
            model.rotations[i] = *turn.matrix();
        }
    }

    proptest! {
        /// However everything turns, edges that did not open are not cut.
        #[test]
        fn a_rigid_turn_cuts_nothing(turn in rotation(), shift in [-1.0..1.0, -1.0..1.0, -1.0..1.0f64]) {
            let mut model = touching();
            prop_assert!(!glue(&model).is_empty());
            open(&mut model, 0.0, &turn, shift.into());
            let seen = vec![true; model.len()];
            prop_assert_eq!(distorted(&model, &seen, SPACING), Vec::<[u32; 2]>::new());
        }

        /// The glue opens beyond three spacings: it is cut, all of it and nothing else; below that nothing is.
        #[test]
        fn only_what_glued_the_sheets_is_cut(turn in rotation(), gap in 0.0..6.0f64) {
            prop_assume!((gap - 3.0).abs() > 1e-6);
            let mut model = touching();
            open(&mut model, gap * SPACING, &turn, Vector3::new(0.1, 0.0, 0.2));
            let seen = vec![true; model.len()];
            let expected = if gap > 3.0 { glue(&model) } else { Vec::new() };
            prop_assert_eq!(distorted(&model, &seen, SPACING), expected);
        }
    }

    /// What was not seen may be mispredicted: it does not count as opened.
    #[test]
    fn unseen_ends_are_not_cut() {
        let mut model = touching();
        open(
            &mut model,
            4.0 * SPACING,
            &Rotation3::identity(),
            Vector3::zeros(),
        );
        let left: Vec<bool> = model.rest.iter().map(|p| p.x < 0.0).collect();
        assert!(distorted(&model, &left, SPACING).is_empty());
    }

    /// One end whose rotation went wrong does not cut its edges.
    #[test]
    fn one_wrong_rotation_cuts_nothing() {
        let mut model = touching();
        let turned = Rotation3::from_axis_angle(&Vector3::z_axis(), std::f64::consts::PI);
        model.rotations[100] = *turned.matrix();
        let seen = vec![true; model.len()];
        assert!(distorted(&model, &seen, SPACING).is_empty());
    }

    /// A cut stays: one round removes all glue, the graph does not join the ends again, nor others across the cut, also
    /// after other vertices are gone.
    #[test]
    fn a_cut_is_for_good() {
        let mut model = touching();
        open(
            &mut model,
            4.0 * SPACING,
            &Rotation3::identity(),
            Vector3::zeros(),
        );
        let seen = vec![true; model.len()];
        let found = distorted(&model, &seen, SPACING);
        assert!(!found.is_empty());
        assert_eq!(model.cut(&found), found.len());
        assert_eq!(model.cut(&found), 0);
        model.edges = surface_edges(&model, SPACING);
        assert!(glue(&model).is_empty());
        let keep: Vec<bool> = (0..model.len()).map(|i| i % 7 != 3).collect();
        let stays = model.retain(&keep);
        model.edges = surface_edges(&model, SPACING);
        assert!(model.edges.iter().all(|e| !model.is_cut(*e)));
        let left = found.iter().filter(|e| e.iter().all(|i| keep[*i as usize]));
        let mut renumbered: Vec<[u32; 2]> = left
            .map(|e| e.map(|i| stays.binary_search(&i).unwrap() as u32))
            .collect();
        let mut cuts = model.cut_edges();
        renumbered.sort_unstable();
        cuts.sort_unstable();
        assert_eq!(cuts, renumbered);
        assert!(
            cuts.iter()
                .all(|e| model.is_cut(*e) && model.is_cut([e[1], e[0]]))
        );
    }
}

mod growing {
    use super::*;

    /// A flat cloud 0.4 m before the camera, 30 by 20 points at half the spacing.
    fn cloud() -> (Vec<Point3<f64>>, Vec<Normal>) {
        let points: Vec<_> = (0..30)
            .flat_map(|i| (0..20).map(move |j| (f64::from(i), f64::from(j))))
            .map(|(x, y)| Point3::new(0.5 * x * SPACING, 0.5 * y * SPACING, 0.4))
            .collect();
        let normals = vec![-Vector3::z_axis(); points.len()];
        (points, normals)
    }

    /// The model knows the left half of the cloud and, if `beyond` says where, the right half that many metres behind it.
    fn model(beyond: Option<f64>) -> CanonicalModel {
        let (points, _) = cloud();
        let on_grid: Vec<_> = points
            .iter()
            .enumerate()
            .filter(|(k, _)| (k / 20) % 2 == 0 && k % 2 == 0)
            .map(|(_, p)| *p)
            .collect();
        let middle = 7.25 * SPACING;
        let known: Vec<_> = on_grid
            .into_iter()
            .filter(|p| beyond.is_some() || p.x < middle)
            .collect();
        let normals = vec![-Vector3::z_axis(); known.len()];
        let mut model = at_rest(&known, &normals);
        // A slit between the halves: only at a frontier is there growth at all.
        let right = |i: u32| model.rest[i as usize].x > middle;
        model.edges = surface_edges(&model, SPACING);
        model.edges.retain(|e| right(e[0]) == right(e[1]));
        for p in model.live.iter_mut().filter(|p| p.x > middle) {
            p.z += beyond.unwrap_or(0.0);
        }
        model
    }

    fn grown(model: &CanonicalModel) -> Vec<NewVertex> {
        let (points, normals) = cloud();
        let seen: Vec<bool> = model.live.iter().map(|p| p.z < 0.4 + 1e-9).collect();
        let frame = FrameCloud {
            points: &points,
            normals: &normals,
        };
        extension(model, frame, &seen, &MergeOptions::new(SPACING)).unwrap()
    }

    /// At the frontier the next row enters, at rest where it is.
    #[test]
    fn the_next_row_enters_at_the_frontier() {
        let fresh = grown(&model(None));
        assert!(fresh.len() >= 8, "{}", fresh.len());
        for v in &fresh {
            assert!((v.rest - v.live).norm() < 1e-9);
            assert!(
                v.live.x > 7.0 * SPACING && v.live.x < 9.5 * SPACING,
                "{}",
                v.live
            );
        }
    }

    proptest! {
        /// Surface that is known but lies up to three spacings behind where it is seen is not laid over it again.
        #[test]
        fn what_is_out_of_place_is_not_new(beyond in 0.0..2.8f64) {
            let fresh = grown(&model(Some(beyond * SPACING)));
            prop_assert!(fresh.is_empty(), "{} of them", fresh.len());
        }
    }
}

mod closing {
    use super::*;

    /// A closed ellipsoid whose lower half at rest is opened like a shell by `angle` about the side `-x`, while the live
    /// frame is `motion` of the truth. Returns the model, what is anchored and the true positions and normals.
    fn opened(
        angle: f64,
        motion: &Isometry3<f64>,
    ) -> (CanonicalModel, Vec<bool>, Vec<Point3<f64>>, Vec<Normal>) {
        let (points, normals) = ellipsoid(COUNT, AXES);
        let mut model = at_rest(&points, &normals);
        let open = Rotation3::from_axis_angle(&Vector3::y_axis(), angle);
        let hinge = Vector3::new(-AXES[0], 0.0, 0.0);
        let turn = motion.rotation.to_rotation_matrix();
        let upper: Vec<bool> = points.iter().map(|p| p.z > 0.0).collect();
        for i in 0..model.len() {
            model.live[i] = motion * points[i];
            model.rotations[i] = *turn.matrix();
            if !upper[i] {
                model.rest[i] = open * (points[i] - hinge) + hinge;
                model.rest_normals[i] = open * normals[i];
                model.rotations[i] = *(turn * open.inverse()).matrix();
            }
        }
        model.edges = surface_edges(&model, SPACING);
        (model, upper, points, normals)
    }

    /// Mean distance of the lower half from the truth, metres.
    fn error(model: &CanonicalModel, upper: &[bool], truth: &[Point3<f64>]) -> f64 {
        let lower: Vec<usize> = (0..model.len()).filter(|&i| !upper[i]).collect();
        let sum: f64 = lower
            .iter()
            .map(|&i| (model.rest[i] - truth[i]).norm())
            .sum();
        sum / lower.len() as f64
    }

    fn motions() -> [Isometry3<f64>; 3] {
        let turned =
            |x, y, z| Isometry3::new(Vector3::new(0.02, -0.01, 0.5), Vector3::new(x, y, z));
        [
            Isometry3::identity(),
            // Turned over, as after a manipulation.
            turned(std::f64::consts::PI, 0.0, 0.0),
            turned(0.7, -1.9, 1.1),
        ]
    }

    /// The shell closes; how the object lies when it is looked at does not matter.
    #[test]
    fn a_shell_is_closed_through_the_body() {
        for motion in motions() {
            let (mut model, upper, truth, normals) = opened(25f64.to_radians(), &motion);
            let lower: Vec<bool> = upper.iter().map(|u| !u).collect();
            let before = error(&model, &upper, &truth);
            // Lever arm of the lower half about the hinge: 60 mm on average, times 2 sin 12.5°.
            assert!(before > 0.02, "{before}");
            refine(&mut model, &lower, &upper).unwrap();
            let after = error(&model, &upper, &truth);
            assert!(after < before / 3.0, "{before} m before, {after} m after");
            // The anchored half stays: it gives way to the springs by less than a spacing.
            for i in (0..model.len()).filter(|&i| upper[i]) {
                assert!((model.rest[i] - truth[i]).norm() < SPACING);
            }
            let tilt: f64 = (0..model.len())
                .filter(|&i| lower[i])
                .map(|i| model.rest_normals[i].angle(&normals[i]))
                .sum::<f64>()
                / lower.iter().filter(|l| **l).count() as f64;
            assert!(tilt < 25f64.to_radians() / 3.0, "{tilt}");
            // What the camera sees is untouched, and normals go on agreeing with it.
            for i in 0..model.len() {
                assert!((model.live[i] - motion * truth[i]).norm() < 1e-12);
                assert!(model.live_normal(i).angle(&(motion.rotation * normals[i])) < 1e-6);
            }
        }
    }

    /// What fits already stays where it is.
    #[test]
    fn a_closed_shell_stays() {
        for motion in motions() {
            let (mut model, upper, _, _) = opened(0.0, &motion);
            let lower: Vec<bool> = upper.iter().map(|u| !u).collect();
            let moved = refine(&mut model, &lower, &upper).unwrap();
            assert!(moved < 1e-9, "{moved}");
        }
    }

    /// Without anchors there is nothing to hold on to.
    #[test]
    fn without_anchors_nothing_moves() {
        let (mut model, upper, _, _) = opened(0.4, &Isometry3::identity());
        let before = model.rest.clone();
        let none = vec![false; upper.len()];
        assert!(refine(&mut model, &upper, &none).unwrap() < 1e-12);
        assert_eq!(model.rest, before);
    }
}

mod measuring {
    use super::*;

    fn truth(count: usize, axes: [f64; 3], spacing: f64) -> (TrueSurface, Vec<Normal>) {
        let (vertices, normals) = ellipsoid(count, axes);
        let triangles = triangulate(&vertices, &normals, spacing);
        assert_eq!(triangles.len(), 2 * count - 4);
        (
            TrueSurface {
                vertices,
                triangles,
            },
            normals,
        )
    }

    fn body() -> (TrueSurface, Vec<Normal>) {
        truth(COUNT, AXES, SPACING)
    }

    #[test]
    fn the_truth_itself_is_explored_and_exact() {
        let (surface, normals) = body();
        let model = at_rest(&surface.vertices, &normals);
        let size = surface.size();
        // The diagonal of the box around the ellipsoid; the outermost points miss the poles by less than 1 %.
        let diagonal = 2.0 * Vector3::from(AXES).norm();
        assert!((0.98..=1.0).contains(&(size / diagonal)));
        let measures = Measurer::new(surface).unwrap().shape(&model, SPACING);
        assert!((measures.explored - 1.0).abs() < 1e-12);
        assert!(measures.difference < 1e-12);
        assert!((measures.relative - measures.difference / size).abs() < 1e-15);
    }

    /// One spacing on either side of its rim is explored by the upper half, and nothing else of the lower half.
    #[test]
    fn the_upper_half_is_half() {
        let (surface, normals) = body();
        let area = surface.area();
        let upper: Vec<usize> = (0..COUNT)
            .filter(|&i| surface.vertices[i].z > 0.0)
            .collect();
        let points: Vec<_> = upper.iter().map(|&i| surface.vertices[i]).collect();
        let normals: Vec<_> = upper.iter().map(|&i| normals[i]).collect();
        let model = at_rest(&points, &normals);
        let measures = Measurer::new(surface).unwrap().shape(&model, SPACING);
        // The band below the rim is at most one spacing wide, over a rim of 2π·(longest half-axis) at most.
        let band = SPACING * std::f64::consts::TAU * AXES.into_iter().fold(0.0, f64::max) / area;
        assert!(
            (0.5..0.5 + band).contains(&measures.explored),
            "{measures:?} {band}"
        );
        assert!(measures.difference < 1e-12);
    }

    #[test]
    fn nothing_is_explored_by_an_empty_model() {
        let measures = Measurer::new(body().0)
            .unwrap()
            .shape(&CanonicalModel::default(), SPACING);
        assert!(measures.explored == 0.0);
        assert!(Measurer::new(TrueSurface::default()).is_err());
    }

    proptest! {
        /// The half of a sphere explores the half and a band of two spacings: (1 + sin θ)/2 with the chord 2ε = 2 r sin(θ/2).
        #[test]
        fn explored_reaches_two_spacings(share in 0.02..0.3f64) {
            let (radius, count) = (0.05, 2000);
            let (surface, normals) = truth(count, [radius; 3], 0.004);
            let upper = (0..count).filter(|&i| surface.vertices[i].z > 0.0);
            let (points, normals): (Vec<_>, Vec<_>) =
                upper.map(|i| (surface.vertices[i], normals[i])).unzip();
            let model = at_rest(&points, &normals);
            let spacing = share * radius;
            let measures = Measurer::new(surface).unwrap().shape(&model, spacing);
            let angle = 2.0 * (spacing / radius).asin();
            let expected = 0.5 * (1.0 + angle.sin());
            // The net is 4 mm wide: the rim of the model lies up to one such width, 0.04 of the area, above the equator.
            prop_assert!((measures.explored_2eps - expected).abs() < 0.04, "{} {expected}", measures.explored_2eps);
            prop_assert!(measures.explored <= measures.explored_2eps);
        }

        /// Material is followed through any motion, and an offset of what is hidden is what the error says.
        #[test]
        fn the_prediction_error_is_the_planted_offset(
            turn in rotation(), offset in [-0.02..0.02, -0.02..0.02, -0.02..0.02f64], stretch in 0.8..1.2f64,
        ) {
            let (surface, normals) = body();
            let offset = Vector3::from(offset);
            let mut model = at_rest(&surface.vertices, &normals);
            let mut measurer = Measurer::new(surface.clone()).unwrap();
            measurer.anchor(&model, &surface).unwrap();
            // The body is stretched and turned; the model follows, but for the hidden half.
            let moved = |p: &Point3<f64>| turn * Point3::new(stretch * p.x, p.y, p.z) + Vector3::new(0.1, 0.2, 0.3);
            let now = TrueSurface {
                vertices: surface.vertices.iter().map(moved).collect(),
                triangles: surface.triangles.clone(),
            };
            let seen: Vec<bool> = (0..COUNT).map(|i| i % 3 == 0).collect();
            for i in 0..COUNT {
                model.live[i] = now.vertices[i] + if seen[i] { Vector3::zeros() } else { offset };
            }
            let error = measurer.prediction_error(&model, &seen, &now).unwrap();
            // Anchors are projections onto triangles in double precision.
            prop_assert!((error - offset.norm()).abs() < 1e-9);
            let each = measurer.live_errors(&model, &now);
            for (e, s) in each.iter().zip(&seen) {
                let planted = if *s { 0.0 } else { offset.norm() };
                prop_assert!((e - planted).abs() < 1e-9);
            }
            prop_assert_eq!(measurer.prediction_error(&model, &[true; COUNT], &now), None);
        }
    }
}

mod timing {
    use super::*;

    #[test]
    fn median_and_percentile_of_a_hundred() {
        let times: Vec<f64> = (1..=101).map(f64::from).collect();
        let timing = Timing::of(&times);
        assert_eq!(
            timing,
            Timing {
                median: 51.0,
                p95: 96.0
            }
        );
        assert_eq!(Timing::of(&[]), Timing::default());
        assert_eq!(
            Timing::of(&[7.0]),
            Timing {
                median: 7.0,
                p95: 7.0
            }
        );
    }

    proptest! {
        /// Both are times that occurred; half and nineteen of twenty are no longer; the order does not matter.
        #[test]
        fn percentiles_split_the_times(times in prop::collection::vec(0.0..1e3f64, 1..200)) {
            let timing = Timing::of(&times);
            let reversed: Vec<f64> = times.iter().rev().copied().collect();
            prop_assert_eq!(Timing::of(&reversed), timing);
            for (value, share) in [(timing.median, 0.5), (timing.p95, 0.95)] {
                prop_assert!(times.contains(&value));
                let below = times.iter().filter(|t| **t <= value).count() as f64;
                let above = times.iter().filter(|t| **t >= value).count() as f64;
                // The rank is rounded to a whole time, so each side may miss half a time.
                prop_assert!(below >= share * times.len() as f64 - 0.5);
                prop_assert!(above >= (1.0 - share) * times.len() as f64 - 0.5);
            }
        }
    }
}

mod topology {
    use super::*;

    #[test]
    fn a_net_of_an_ellipsoid_is_closed() {
        let (points, normals) = ellipsoid(COUNT, AXES);
        let topology = analyse(&at_rest(&points, &normals), SPACING).unwrap();
        assert_eq!(topology.persistent, [1, 0, 1]);
        assert!(topology.is_closed());
        assert!(topology.missing < 1e-9, "{}", topology.missing);
        assert!(topology.loops.is_empty());
        assert!(!topology.boundary.contains(&true));
    }

    /// Whichever end is missing, the surface is open there and only there, and the vector area says how much is missing.
    #[test]
    fn without_a_cap_it_is_open() {
        let (points, normals) = ellipsoid(COUNT, AXES);
        for (axis, sign) in [
            (0, 1.0),
            (0, -1.0),
            (1, 1.0),
            (1, -1.0),
            (2, 1.0),
            (2, -1.0),
        ] {
            let limit = 0.8 * AXES[axis];
            let kept = |p: &Point3<f64>| sign * p[axis] < limit;
            let (points, normals): (Vec<_>, Vec<_>) = points
                .iter()
                .zip(&normals)
                .filter(|(p, _)| kept(p))
                .map(|(p, n)| (*p, *n))
                .unzip();
            let topology = analyse(&at_rest(&points, &normals), SPACING).unwrap();
            assert!(!topology.is_closed(), "axis {axis}");
            assert_eq!(topology.persistent, [1, 0, 0]);
            assert!(topology.missing > 0.0);
            assert_eq!(topology.loops.len(), 1);
            for (p, boundary) in points.iter().zip(&topology.boundary) {
                // Within two and a half spacings of where the cap was taken off.
                let far = sign * p[axis] < limit - 2.5 * SPACING;
                assert!(!(far && *boundary), "{p} is not at the rim");
            }
        }
    }

    /// How the body lies does not matter.
    #[test]
    fn a_turned_net_is_closed() {
        let (points, normals) = ellipsoid(COUNT, AXES);
        let turn = Rotation3::from_euler_angles(0.3, -1.1, 2.0);
        let points: Vec<_> = points
            .iter()
            .map(|p| turn * p + Vector3::new(0.1, 0.0, 0.5))
            .collect();
        let normals: Vec<_> = normals.iter().map(|n| turn * n).collect();
        assert!(
            analyse(&at_rest(&points, &normals), SPACING)
                .unwrap()
                .is_closed()
        );
    }
}
