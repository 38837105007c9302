//! When the surface of a model counts as closed, against bodies and faults known by construction.
#![allow(missing_docs, clippy::unwrap_used)]

mod common;

use common::{AXES, COUNT, Normal, SPACING, at_rest, ellipsoid, net};
use explore_loop::canonical::genus::Genus;
use explore_loop::canonical::topology::{Obstacle, Topology, analyse, analyse_as, analyse_within};
use explore_loop::measure::MeshReport;
use nalgebra::{Point3, Rotation3, Vector3};
use proptest::prelude::*;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::sync::OnceLock;

type Net = (Vec<Point3<f64>>, Vec<Normal>);

/// Judges a net, and checks what holds for every one: the mesh of a closed surface is watertight, and that of one that is not wholly
/// seen is not. (Wholly seen but not closed is a ring, or a surface with strays beside it.)
fn judge((points, normals): &Net) -> Topology {
    let topology = analyse(&at_rest(points, normals), SPACING).unwrap();
    assert_eq!(topology.is_closed(), topology.obstacle().is_none());
    assert_eq!(topology.boundary.len(), points.len());
    if let Some(surface) = &topology.surface {
        let report = MeshReport::of(&surface.vertices, &surface.triangles);
        let wholly_seen = topology.wholly_seen;
        assert_eq!(
            report.watertight,
            wholly_seen,
            "{report:?} {:?}",
            topology.obstacle()
        );
        assert!(wholly_seen || !topology.is_closed());
        assert_eq!(report.non_manifold_edges + report.misoriented_edges, 0);
        if topology.is_closed() {
            let genus = Genus::of_betti(topology.persistent).unwrap();
            let euler = 2 - 2 * i64::try_from(genus).unwrap();
            assert_eq!((report.euler, report.components), (euler, 1));
        }
    } else {
        assert!(!topology.is_closed());
    }
    topology
}

/// The vertices nearest to vertex `centre` on its own sheet, as many as `share` of all.
fn patch((points, normals): &Net, centre: usize, share: f64) -> Vec<usize> {
    let mut near: Vec<usize> = (0..points.len())
        .filter(|&i| normals[i].dot(&normals[centre]) > 0.0)
        .collect();
    let away = |i: usize| (points[i] - points[centre]).norm();
    near.sort_by(|a, b| away(*a).total_cmp(&away(*b)));
    near.truncate((share * points.len() as f64).ceil() as usize);
    near
}

/// The vertices closer to vertex `centre` than `radius` that do not face away from it.
fn within((points, normals): &Net, centre: usize, radius: f64) -> Vec<usize> {
    (0..points.len())
        .filter(|&i| {
            (points[i] - points[centre]).norm() < radius && normals[i].dot(&normals[centre]) > 0.0
        })
        .collect()
}

fn without(net: &Net, gone: &[usize]) -> Net {
    let kept = (0..net.0.len()).filter(|i| !gone.contains(i));
    kept.map(|i| (net.0[i], net.1[i])).unzip()
}

/// A second sheet over some vertices, `off` metres outside.
fn with_sheet(net: &Net, over: &[usize], off: f64) -> Net {
    let (mut points, mut normals) = net.clone();
    for &i in over {
        points.push(net.0[i] + net.1[i].into_inner() * off);
        normals.push(net.1[i]);
    }
    (points, normals)
}

/// 100 × 80 × 8 mm, its margin half round.
fn slab() -> &'static Net {
    static SLAB: OnceLock<Net> = OnceLock::new();
    SLAB.get_or_init(thin)
}

fn thin() -> Net {
    let half = Vector3::new(0.05, 0.04, 0.004);
    let value = |p: &Point3<f64>| {
        let beyond = p.coords.abs() - (half - Vector3::repeat(0.0039));
        beyond.sup(&Vector3::zeros()).norm() + beyond.max().min(0.0) - 0.0039
    };
    net(value, half, 0.85 * SPACING)
}

fn torus() -> Net {
    let value = |p: &Point3<f64>| (p.x.hypot(p.y) - 0.045).hypot(p.z) - 0.018;
    net(value, Vector3::new(0.063, 0.063, 0.018), 0.85 * SPACING)
}

#[test]
fn a_net_of_an_ellipsoid_is_closed() {
    let topology = judge(&ellipsoid(COUNT, AXES));
    assert_eq!(topology.persistent, [1, 0, 1]);
    assert!(topology.is_closed());
    assert!(topology.missing < 1e-9, "{}", topology.missing);
    assert!(topology.loops.is_empty());
    assert!(!topology.boundary.contains(&true));
}

#[test]
fn a_slab_of_8_mm_is_closed() {
    let topology = judge(slab());
    assert_eq!(topology.obstacle(), None);
}

/// Wholly seen, but not the surface of a ball: closed, unless a ball is asked for.
#[test]
fn a_ring_is_closed_unless_a_ball_is_asked_for() {
    let (points, normals) = torus();
    let topology = judge(&(points.clone(), normals.clone()));
    assert_eq!(topology.obstacle(), None);
    assert_eq!(topology.persistent, [1, 2, 1]);
    assert_eq!(topology.handles.count, 1);
    let model = at_rest(&points, &normals);
    let asked = |genus| {
        analyse_as(&model, SPACING, Genus::Exactly(genus))
            .unwrap()
            .obstacle()
    };
    assert_eq!(asked(0), Some(Obstacle::Betti([1, 2, 1])));
    assert_eq!(asked(1), None);
    assert_eq!(asked(2), Some(Obstacle::Betti([1, 2, 1])));
}

/// Part of a ring with round ends that overlap by `overlap` metres.
fn open_ring(overlap: f64) -> Net {
    let (ring, tube) = (0.045, 0.018);
    let half: f64 = ((tube - 0.5 * overlap) / ring).asin();
    let value = move |p: &Point3<f64>| {
        let angle = p.y.abs().atan2(p.x).max(half);
        let axis = Point3::new(ring * angle.cos(), ring * angle.sin(), 0.0);
        (Point3::new(p.x, p.y.abs(), p.z) - axis).norm() - tube
    };
    net(value, Vector3::new(0.063, 0.063, 0.018), 0.85 * SPACING)
}

/// The walls with which the ends of an open ring touch: both sides of the plane `y = 0`.
fn walls(overlap: f64) -> Net {
    let (ring, tube) = (0.045, 0.018);
    let gap: f64 = tube - 0.5 * overlap;
    let middle = Point3::new((ring * ring - gap * gap).sqrt(), 0.0, 0.0);
    let (radius, step) = ((tube * tube - gap * gap).sqrt(), 0.85 * SPACING);
    let steps = (radius / step) as i32;
    let mut net: Net = (Vec::new(), Vec::new());
    for (i, k) in (-steps..=steps).flat_map(|i| (-steps..=steps).map(move |k| (i, k))) {
        let offset = Vector3::new(f64::from(i), 0.0, f64::from(k)) * step;
        for normal in [Vector3::y_axis(), -Vector3::y_axis()] {
            if offset.norm() < radius {
                net.0.push(middle + offset);
                net.1.push(normal);
            }
        }
    }
    net
}

/// The ends of an open ring that touch close no ring, however large the patch where they touch. Once the walls there were seen they are separated,
/// and what is left is a ball.
#[test]
fn parts_that_touch_are_separated_once_they_were_seen_apart() {
    // The neck of less than that is so narrow that it is cut as noise.
    for overlap in [0.004, 0.006] {
        let touching = open_ring(overlap);
        let topology = judge(&touching);
        assert!(
            matches!(topology.obstacle(), Some(Obstacle::Contact(angle)) if angle > 0.6),
            "{:?} {:?}",
            topology.obstacle(),
            topology.handles
        );
        assert_eq!(topology.contacts(), 0);
        // It is known where they touch, and that nothing else is missing.
        let parts = topology.touching().unwrap();
        let middle = Point3::new(0.042, 0.0, 0.0);
        assert!((parts.at - middle).norm() < 0.005, "{parts}");

        let walls = walls(overlap);
        let seen: Net = (
            [touching.0, walls.0].concat(),
            [touching.1, walls.1].concat(),
        );
        let topology = judge(&seen);
        assert_eq!(topology.obstacle(), None, "overlap of {overlap} m");
        assert_eq!(topology.persistent, [1, 0, 1]);
        assert_eq!(topology.contacts(), 1);
        assert_eq!(topology.touching(), None);
        let surface = topology.surface.unwrap();
        let edges: std::collections::BTreeSet<[u32; 2]> = surface
            .triangles
            .iter()
            .flat_map(|[a, b, c]| [[*a, *b], [*b, *c], [*c, *a]])
            .collect();
        assert!(edges.iter().all(|[a, b]| edges.contains(&[*b, *a])));
        let [vertices, triangles] = [surface.vertices.len(), surface.triangles.len()];
        assert_eq!(vertices + triangles, edges.len() / 2 + 2);
        // Where it is known that there is a ring, it stays one.
        let model = at_rest(&seen.0, &seen.1);
        let ring = analyse_as(&model, SPACING, Genus::Exactly(1)).unwrap();
        assert_eq!((ring.handles.count, ring.contacts()), (1, 0));
    }
}

/// The same where nobody saw the walls, but vertices on both sides of the contact were seen to move apart. One pair may be a mistake, and pairs that are not
/// across the contact say nothing about it.
#[test]
fn parts_that_came_apart_are_separated() {
    let (points, normals) = open_ring(0.006);
    // Near each other, on both sides of the plane y = 0: at the contact, or at the opposite side of the ring.
    let pairs = |sign: f64| {
        let mut pairs = Vec::new();
        for (a, p) in points.iter().enumerate() {
            for (b, q) in points.iter().enumerate() {
                let beside = p.y > 0.0 && q.y < 0.0 && sign * p.x > 0.0;
                if beside && (p - q).norm() < 3.0 * SPACING {
                    pairs.push([a as u32, b as u32]);
                }
            }
        }
        pairs
    };
    let (across, elsewhere) = (pairs(1.0), pairs(-1.0));
    assert!(across.len() > 20 && elsewhere.len() > 20);
    let judged = |cut: &[[u32; 2]]| {
        let mut model = at_rest(&points, &normals);
        assert_eq!(model.cut(cut), cut.len());
        analyse(&model, SPACING).unwrap()
    };
    // What is left to see is the middle of the walls, and that is said.
    let parted = judged(&across);
    assert_eq!((parted.contacts(), parted.handles.count), (1, 0));
    assert!(parted.neck.is_empty());
    assert!(parted.bare > 0.0 && parted.bare < 0.01, "{}", parted.bare);
    for joined in [judged(&[]), judged(&across[..1]), judged(&elsewhere)] {
        assert_eq!((joined.contacts(), joined.handles.count), (0, 1));
        assert!(!joined.is_closed());
        // What planning needs to pull them apart.
        let area = joined.handles.creased_area();
        assert!(area.normalize().y.abs() > 0.95, "{area}");
        let at = |v: &u32| points[*v as usize];
        assert!(joined.neck.len() > 5 && joined.neck.iter().all(|v| at(v).y.abs() < 0.008));
    }
}

/// Two fingers with a sharp web between them are closed at any angle between them, and under noise: the web is narrower than the cylinders of the complex, and its sides
/// face each other.
#[test]
fn a_web_between_fingers_does_not_tear() {
    for (k, degrees) in [20.0f64, 30.0, 40.0, 60.0, 80.0].into_iter().enumerate() {
        let half = degrees.to_radians() / 2.0;
        let finger = move |p: &Point3<f64>, side: f64| {
            let along = Vector3::new(half.cos(), side * half.sin(), 0.0);
            let at = p.coords.dot(&along).clamp(0.0, 0.07);
            (p.coords - along * at).norm() - 0.012
        };
        let value = move |p: &Point3<f64>| finger(p, 1.0).min(finger(p, -1.0));
        let (points, normals) = net(value, Vector3::new(0.085, 0.06, 0.012), 0.85 * SPACING);
        for seed in 0..3u64 {
            let random = &mut ChaCha8Rng::seed_from_u64(10 * k as u64 + seed);
            let moved = points
                .iter()
                .map(|p| p + Vector3::from_fn(|_, _| random.random_range(-2e-4..2e-4)));
            let topology = judge(&(moved.collect(), normals.clone()));
            assert_eq!(topology.obstacle(), None, "{degrees}°, seed {seed}");
            assert_eq!(topology.persistent, [1, 0, 1]);
        }
    }
}

/// A handle that has grown onto a ball, with a crease all around where it has: never taken for parts that touch, as nothing was seen within it.
#[test]
fn a_handle_with_a_crease_is_not_cut() {
    let (ball, ring, tube) = (0.035, 0.022, 0.008);
    let value = |p: &Point3<f64>| {
        let q = p - Vector3::new(ball, 0.0, 0.0);
        let handle = (q.x.hypot(q.y) - ring).hypot(q.z) - tube;
        (p.coords.norm() - ball).min(handle)
    };
    let half = Vector3::new(0.065, 0.035, 0.035);
    let (points, normals) = net(value, half, 0.85 * SPACING);
    // Whoever knows that it has a handle can say so.
    let asked = analyse_as(&at_rest(&points, &normals), SPACING, Genus::Exactly(1)).unwrap();
    assert_eq!(asked.obstacle(), None);
    let topology = judge(&(points, normals));
    assert_eq!((topology.handles.count, topology.contacts()), (1, 0));
    let closed_as_ball = topology.is_closed() && topology.persistent == [1, 0, 1];
    assert!(!closed_as_ball, "{:?}", topology.handles);
    assert!(!topology.is_closed() && !topology.neck.is_empty());
    assert!(topology.handles.crease > 0.6, "{:?}", topology.handles);
}

/// A ring with a hole of 2 to 3 spacings in it is not closed.
#[test]
fn a_hole_in_a_ring_is_missed() {
    let whole = torus();
    for centre in [0, 100, 400] {
        let gone = within(&whole, centre, 2.6 * SPACING);
        assert!(!judge(&without(&whole, &gone)).is_closed());
    }
}

#[test]
fn nothing_is_not_closed() {
    let topology = judge(&(Vec::new(), Vec::new()));
    assert!(!topology.is_closed());
    assert!(topology.surface.is_none());
}

/// Whichever end is missing, the surface is open there and only there, and the vector area says how much is missing.
#[test]
fn without_a_cap_it_is_open() {
    let whole = ellipsoid(COUNT, AXES);
    for (axis, sign) in [
        (0, 1.0),
        (0, -1.0),
        (1, 1.0),
        (1, -1.0),
        (2, 1.0),
        (2, -1.0),
    ] {
        let limit = 0.8 * AXES[axis];
        let gone: Vec<usize> = (0..COUNT)
            .filter(|&i| sign * whole.0[i][axis] >= limit)
            .collect();
        let open = without(&whole, &gone);
        let topology = judge(&open);
        assert_eq!(topology.persistent, [1, 0, 0], "axis {axis}");
        assert!(topology.missing > 0.0);
        assert_eq!(topology.loops.len(), 1);
        for (p, boundary) in open.0.iter().zip(&topology.boundary) {
            // Within two and a half spacings of where the cap was taken off.
            let far = sign * p[axis] < limit - 2.5 * SPACING;
            assert!(!(far && *boundary), "{p} is not at the rim");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: std::env::var("PROPTEST_CASES").ok().and_then(|n| n.parse().ok()).unwrap_or(12), ..ProptestConfig::default() })]

    /// How the body lies does not matter.
    #[test]
    fn a_turned_net_is_closed(turn in common::rotation(), shift in [-0.5..0.5, -0.5..0.5, 0.2..0.8f64]) {
        let (points, normals) = ellipsoid(COUNT, AXES);
        let points = points.iter().map(|p| turn * p + Vector3::from(shift)).collect();
        let normals = normals.iter().map(|n| turn * n).collect();
        prop_assert_eq!(judge(&(points, normals)).obstacle(), None);
    }

    /// Wherever 2 to 3 % are missing, it is open.
    #[test]
    fn a_patch_of_two_percent_is_missed(centre in 0..COUNT, share in 0.02..0.03f64) {
        let whole = ellipsoid(COUNT, AXES);
        let gone = patch(&whole, centre, share);
        prop_assert!(!judge(&without(&whole, &gone)).is_closed());
    }

    /// The same on the flat sides of a slab. (Around its margin as many points make a strip of one row, no wider than the spacing.)
    #[test]
    fn a_patch_of_a_slab_is_missed(centre in 0..1000usize, share in 0.02..0.03f64) {
        let whole = slab();
        let flat: Vec<usize> = (0..whole.0.len()).filter(|&i| whole.1[i].z.abs() > 0.9).collect();
        let gone = patch(whole, flat[centre % flat.len()], share);
        prop_assert!(!judge(&without(whole, &gone)).is_closed());
    }

    /// A hole is missed by its width, however small a share of the body it is: everything within 2.2 to 3 spacings of a place is gone, on a body
    /// of which that is 1 to 3 %, and on one four times as large.
    #[test]
    fn a_hole_of_a_known_width_is_missed(centre in 0..COUNT, radius in 2.2..3.0f64, large in any::<bool>()) {
        let (count, axes) = if large { (4 * COUNT, AXES.map(|a| 2.0 * a)) } else { (COUNT, AXES) };
        let whole = ellipsoid(count, axes);
        let gone = within(&whole, centre * count / COUNT, radius * SPACING);
        let topology = judge(&without(&whole, &gone));
        prop_assert!(!topology.is_closed(), "{} of {count} points gone", gone.len());
    }

    /// A single point that is missing is none.
    #[test]
    fn a_missing_point_is_no_hole(centre in 0..COUNT) {
        let whole = ellipsoid(COUNT, AXES);
        prop_assert_eq!(judge(&without(&whole, &[centre])).obstacle(), None);
    }

    /// A second sheet over a tenth of the surface, 2 to 4 spacings off it: what a slip of the tracking leaves.
    #[test]
    fn a_second_sheet_is_not_closed(centre in 0..COUNT, off in 2.0..4.0f64) {
        let whole = ellipsoid(COUNT, AXES);
        let over = patch(&whole, centre, 0.1);
        let topology = judge(&with_sheet(&whole, &over, off * SPACING));
        prop_assert!(!topology.is_closed(), "strays {}", topology.strays);
    }

    /// A blister encloses a cavity of its own; it does not make up for a hole on the other side.
    #[test]
    fn a_blister_does_not_close_what_is_open(centre in 0..COUNT, off in 0.8..3.0f64) {
        let whole = ellipsoid(COUNT, AXES);
        let opposite = (0..COUNT)
            .min_by(|a, b| whole.0[*a].coords.dot(&whole.0[centre].coords).total_cmp(&whole.0[*b].coords.dot(&whole.0[centre].coords)))
            .unwrap();
        let blistered = with_sheet(&whole, &patch(&whole, centre, 0.1), off * SPACING);
        let open = without(&blistered, &patch(&whole, opposite, 0.05));
        prop_assert!(!judge(&open).is_closed());
    }
}

/// A sheet that stands off is called by its name.
#[test]
fn strays_are_named() {
    let whole = ellipsoid(COUNT, AXES);
    let over = patch(&whole, 100, 0.08);
    let topology = judge(&with_sheet(&whole, &over, 3.0 * SPACING));
    assert!(topology.strays > 0.03, "{}", topology.strays);
    assert!(matches!(
        topology.obstacle(),
        Some(Obstacle::Strays(_) | Obstacle::Betti(_))
    ));
}

/// Turning a model over changes no verdict.
#[test]
fn reflections_keep_the_verdict() {
    let flip = Rotation3::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    let (points, normals) = slab();
    let turned = (
        points.iter().map(|p| flip * p).collect(),
        normals.iter().map(|n| flip * n).collect(),
    );
    assert!(judge(&turned).is_closed());
}

/// Ten thousand vertices in one place are no reason to give up: they are thinned, and it is said.
#[test]
fn a_crowded_model_is_thinned_and_reported() {
    let (mut points, mut normals) = ellipsoid(COUNT, AXES);
    let sparse = analyse(&at_rest(&points, &normals), SPACING).unwrap();
    assert_eq!(sparse.thinned, 0);
    let (place, normal) = (points[0], normals[0]);
    for k in 0..10_000 {
        let at = f64::from(k) * 1e-7;
        points.push(place + Vector3::new(at, 1e-3 * (at * 1e5).sin(), 0.0));
        normals.push(normal);
    }
    let crowded = analyse(&at_rest(&points, &normals), SPACING).unwrap();
    assert!(crowded.is_closed(), "the surface through them is even");
    assert_eq!(crowded.boundary.len(), points.len());
}

/// A complex that may not grow as large as the sample asks for is built on fewer points: never an error, and never closed where it was open.
#[test]
fn a_complex_that_is_too_large_is_thinned_and_reported() {
    let (points, normals) = ellipsoid(COUNT, AXES);
    let whole = at_rest(&points, &normals);
    let mut thinned = 0;
    for most in [100_000, 30_000, 5_000, 100, 1] {
        let topology = analyse_within(&whole, SPACING, most).unwrap();
        assert!(topology.thinned > thinned, "{most}: {}", topology.thinned);
        thinned = topology.thinned;
        assert!(topology.simplices.iter().sum::<usize>() <= most);
        assert_eq!(topology.boundary.len(), points.len());
        assert!(
            most < 30_000 || topology.is_closed(),
            "{most}: {:?}",
            topology.obstacle()
        );
    }
    let (points, normals): Net = std::iter::zip(points, normals)
        .filter(|(p, _)| p.z > -0.01)
        .unzip();
    for most in [100_000, 30_000, 5_000, 100, 1] {
        let topology = analyse_within(&at_rest(&points, &normals), SPACING, most).unwrap();
        assert!(topology.thinned > 0 && !topology.is_closed(), "{most}");
    }
}
