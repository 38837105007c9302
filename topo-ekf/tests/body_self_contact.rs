//! Surface of a body against itself: two fingers that are pinched together do not pass through each other, and what touches at rest is left alone.
#![allow(missing_docs, clippy::unwrap_used, reason = "tests")]

#[path = "common/body.rs"]
mod dense;

use dense::{TABLE, skin};
use nalgebra::{Point3, Rotation3, Vector3};
use proptest::prelude::*;
use topo_ekf::body::{BodyFilter, BodyFrame, BodyOptions, Embedding, Lattice, Pose, SelfContact};
use topo_ekf::{Error, Plane, Status};

const H: f64 = 0.012;
const APART: f64 = 0.001;
/// Cells along each finger; one cell is free between the two.
const LONG: i32 = 5;

/// Two fingers along the first axis, on a palm, off the table.
fn hand() -> Lattice {
    let mut lattice = Lattice::new(H, Point3::origin(), Rotation3::identity());
    for x in 0..=LONG {
        for y in 0..3 {
            if x == 0 || y != 1 {
                lattice.ensure([x, y, 4]);
            }
        }
    }
    lattice
}

/// The faces of the hand as triangles over corners of their own, counter-clockwise from outside; every face in 3 × 3 squares.
struct Skin {
    places: Vec<Embedding>,
    triangles: Vec<[u32; 3]>,
}

fn triangulated(lattice: &Lattice) -> Skin {
    const FINE: usize = 3;
    let mut known = std::collections::BTreeMap::new();
    let mut all = Skin {
        places: vec![],
        triangles: vec![],
    };
    for (middle, face) in skin(lattice) {
        let (axis, side) = (face / 2, face % 2);
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let mut corner = |i: usize, j: usize| {
            let mut xi = middle.xi;
            xi[u] = i as f64 / FINE as f64;
            xi[v] = j as f64 / FINE as f64;
            let place = lattice.cells()[middle.cell as usize].place;
            let key =
                [0, 1, 2].map(|a| ((f64::from(place[a]) + xi[a]) * FINE as f64).round() as i64);
            *known.entry(key).or_insert_with(|| {
                all.places.push(Embedding::new(middle.cell, xi));
                all.places.len() as u32 - 1
            })
        };
        let mut squares = vec![];
        for i in 0..FINE {
            for j in 0..FINE {
                squares.push([
                    corner(i, j),
                    corner(i + 1, j),
                    corner(i + 1, j + 1),
                    corner(i, j + 1),
                ]);
            }
        }
        for [a, b, c, d] in squares {
            for t in [[a, b, c], [a, c, d]] {
                all.triangles
                    .push(if side == 1 { t } else { [t[0], t[2], t[1]] });
            }
        }
    }
    all
}

fn positions(lattice: &Lattice, pose: &Pose, places: &[Embedding]) -> Vec<Point3<f64>> {
    places.iter().map(|at| pose.position(lattice, at)).collect()
}

/// Least height of a vertex of one finger over a triangle of the other's inner side, of those whose foot is inside of it. Brute force.
fn clearance(skin: &Skin, rest: &[Point3<f64>], live: &[Point3<f64>]) -> f64 {
    let finger = |p: &Point3<f64>| (p.x > 1.2 * H).then_some(p.y > 1.5 * H);
    let mut least = f64::INFINITY;
    for t in &skin.triangles {
        let [a, b, c] = t.map(|k| live[k as usize]);
        let at_rest = t.map(|k| rest[k as usize]);
        let Some(own) = finger(&at_rest[0]) else {
            continue;
        };
        // The inner side: at rest it faces the other finger.
        let out = (at_rest[1] - at_rest[0])
            .cross(&(at_rest[2] - at_rest[0]))
            .normalize();
        let inner = if own { out.y < -0.9 } else { out.y > 0.9 };
        if !inner {
            continue;
        }
        let area = (b - a).cross(&(c - a));
        for (v, p) in live.iter().enumerate() {
            if finger(&rest[v]) != Some(!own) {
                continue;
            }
            let inside = |p: &Point3<f64>, q: &Point3<f64>, r: &Point3<f64>| {
                (q - p).cross(&(r - p)).dot(&area) > 0.0
            };
            if inside(&a, &b, p) && inside(&b, &c, p) && inside(&c, &a, p) {
                let height = area.normalize().dot(&(p - a));
                // Beyond half a finger it is the outer side.
                if height > -0.5 * H {
                    least = least.min(height);
                }
            }
        }
    }
    least
}

/// Pinches the tips of the fingers together, past each other by `over`; the least clearance in any frame, and how often rows were infeasible.
fn pinch(over: f64, slant: Vector3<f64>, contact: bool) -> (f64, usize) {
    let lattice = hand();
    let skin = triangulated(&lattice);
    let rest = positions(&lattice, &Pose::at_rest(&lattice), &skin.places);
    let tip = |y: i32| Embedding::new(lattice.cell_at([LONG, y, 4]).unwrap(), [0.9, 0.5, 0.5]);
    let tips = [tip(0), tip(2)];
    let palm = Embedding::new(lattice.cell_at([0, 1, 4]).unwrap(), [0.5; 3]);
    let start = [tips[0], tips[1], palm].map(|at| Pose::at_rest(&lattice).position(&lattice, &at));
    let mut watched = SelfContact::new(&skin.triangles, &rest, APART).unwrap();
    let mut options = BodyOptions::default();
    options.initial_weight = 1e-6;
    let mut body = BodyFilter::new(lattice, TABLE, &options).unwrap();
    body.set_feet(vec![]);
    let (mut least, mut infeasible) = (f64::INFINITY, 0);
    for frame in 1..=16 {
        let share = f64::from(frame) / 16.0;
        // The free gap is 12 mm and the tips stand 24 mm apart.
        let way = (0.5 * H + over) * share;
        let to = |k: usize, side: f64| {
            start[k] + Vector3::new(0.0, side * way, 0.0) + slant * share * side
        };
        let grips = [
            (tips[0], to(0, 1.0)),
            (tips[1], to(1, -1.0)),
            (palm, start[2]),
        ];
        let live = positions(body.lattice(), body.pose(), &skin.places);
        let rows = if contact {
            watched.inequalities(&live, &skin.places).unwrap()
        } else {
            vec![]
        };
        let frame = BodyFrame::new(&grips, &skin.places).with_inequalities(&rows);
        let report = body
            .step(&frame, &mut |_, _, _| vec![], &mut |_, _| {})
            .unwrap();
        infeasible += usize::from(report.status == Status::Infeasible);
        let live = positions(body.lattice(), body.pose(), &skin.places);
        least = least.min(clearance(&skin, &rest, &live));
    }
    (least, infeasible)
}

#[test]
fn without_rows_the_fingers_pass_through_each_other() {
    let (least, _) = pinch(0.003, Vector3::zeros(), false);
    assert!(least < -0.004, "{least}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    /// Whatever way they are pinched, they stay apart, but for the turn of a triangle within a frame.
    #[test]
    fn pinched_fingers_stay_apart(over in 0.0..0.003, along in -0.002..0.002, up in -0.002..0.002) {
        let (least, infeasible) = pinch(over, Vector3::new(along, 0.0, up), true);
        prop_assert!(least > 0.6 * APART, "{least}");
        prop_assert_eq!(infeasible, 0);
    }
}

/// Fingers that touch at rest are not pushed apart: nothing moves.
#[test]
fn what_touches_at_rest_stays_there() {
    let lattice = hand();
    let skin = triangulated(&lattice);
    let rest = positions(&lattice, &Pose::at_rest(&lattice), &skin.places);
    // A separation wider than the gap between the fingers.
    let mut contact = SelfContact::new(&skin.triangles, &rest, 0.016).unwrap();
    let rows = contact.inequalities(&rest, &skin.places).unwrap();
    assert!(!rows.is_empty());
    let step = |rows: &[_]| {
        let mut body = BodyFilter::new(hand(), TABLE, &BodyOptions::default()).unwrap();
        let frame = BodyFrame::new(&[], &skin.places).with_inequalities(rows);
        let report = body
            .step(&frame, &mut |_, _, _| vec![], &mut |_, _| {})
            .unwrap();
        assert_ne!(report.status, Status::Infeasible);
        positions(body.lattice(), body.pose(), &skin.places)
    };
    let moved = step(&rows)
        .into_iter()
        .zip(step(&[]))
        .map(|(a, b)| (a - b).norm());
    let most = moved.fold(0.0, f64::max);
    assert!(most < 1e-5, "{most}");
}

#[test]
fn what_makes_no_sense_is_refused() {
    let lattice = hand();
    let skin = triangulated(&lattice);
    let rest = positions(&lattice, &Pose::at_rest(&lattice), &skin.places);
    let count = rest.len() as u32;
    assert!(matches!(
        SelfContact::new(&[[0, 1, count]], &rest, APART),
        Err(Error::VertexOutOfRange { vertex, .. }) if vertex == count
    ));
    for separation in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(matches!(
            SelfContact::new(&skin.triangles, &rest, separation),
            Err(Error::Value {
                what: "separation",
                ..
            })
        ));
    }
    let mut contact = SelfContact::new(&skin.triangles, &rest, APART).unwrap();
    assert!(matches!(
        contact.inequalities(&rest[1..], &skin.places),
        Err(Error::Length { .. })
    ));
    let mut bad = rest.clone();
    bad[3].y = f64::NAN;
    assert!(matches!(
        contact.inequalities(&bad, &skin.places),
        Err(Error::NonFinitePoint { index: 3, .. })
    ));
}

/// Surface that is new and lies under the table comes out of it without a step, and nothing moves where nothing is violated.
#[test]
fn a_projection_alone_keeps_the_table() {
    let lattice = dense::block([4, 2, 2], 0.016);
    let mut body = BodyFilter::new(lattice, TABLE, &BodyOptions::default()).unwrap();
    let before = body.pose().clone();
    let inside = [Embedding::new(0, [0.5, 0.5, 0.0])];
    let report = body.project(&BodyFrame::new(&[], &inside)).unwrap();
    assert_eq!(report.status, Status::Free);
    assert_eq!(&before, body.pose());
    // A bulge 1 mm under the bottom of the first cell.
    let bulge = [Embedding::new(0, [0.5, 0.5, -1.0 / 16.0])];
    let report = body.project(&BodyFrame::new(&[], &bulge)).unwrap();
    assert_eq!(report.status, Status::Constrained);
    let height = |at: &Embedding| TABLE.height(&body.pose().position(body.lattice(), at));
    assert!(
        (-1e-6..1e-5).contains(&height(&bulge[0])),
        "{}",
        height(&bulge[0])
    );
    // The far end stays where it was, within a fifth of what the near one moved.
    let far = Embedding::new(3, [1.0, 0.5, 0.0]);
    assert!(height(&far).abs() < 2e-4, "{}", height(&far));
    let table = Plane {
        offset: f64::NAN,
        ..TABLE
    };
    assert!(
        BodyFilter::new(
            dense::block([1, 1, 1], 0.016),
            table,
            &BodyOptions::default()
        )
        .is_err()
    );
}
