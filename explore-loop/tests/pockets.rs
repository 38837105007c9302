//! Known holes: a hole that the camera looks into is stretched open, during the turn if the underside is missing too.
#![allow(missing_docs, clippy::unwrap_used, clippy::panic, reason = "tests")]

mod common;

use common::fake::{FakeCell, HEIGHT};
use explore_loop::canonical::genus::{Genus, Handles};
use explore_loop::canonical::topology::Topology;
use explore_loop::cell::Cell;
use explore_loop::explore::ExploreOptions;
use explore_loop::plan::{CoveragePlanner, PlanInput, Planner};
use grip_planner::{Plan, Role};
use nalgebra::{Isometry3, Point3, UnitVector3, Vector3};
use proptest::prelude::*;

/// Half axes of the body, metres, and the distance of neighbours.
const HALF: [f64; 3] = [0.09, 0.07, 0.035];
const GAP: f64 = 0.006;

/// A body that lies on the table: the upper half, or nearly all of it, with a slit on top.
struct Body {
    points: Vec<Point3<f64>>,
    normals: Vec<UnitVector3<f64>>,
    edges: Vec<[u32; 2]>,
    visible: Vec<bool>,
    topology: Topology,
}

/// Position relative to the slit: 1 on its edge, less inside. `angle` is that of its long axis.
fn gauge(p: &Point3<f64>, angle: f64) -> f64 {
    let (sin, cos) = angle.sin_cos();
    ((p.x * cos + p.y * sin) / 0.028).hypot((p.y * cos - p.x * sin) / 0.011)
}

impl Body {
    /// With a slit at `angle`, if any; `whole` says whether the underside was seen as well.
    fn new(angle: Option<f64>, whole: bool) -> Self {
        let area = 4.0 * std::f64::consts::PI * (HALF[0] * HALF[1] * HALF[2]).powf(2.0 / 3.0);
        let (all, facing) = common::ellipsoid((1.6 * area / (GAP * GAP)) as usize, HALF);
        let (mut points, mut normals, mut top) = (vec![], vec![], vec![]);
        for (p, n) in all.iter().zip(&facing) {
            // The body's z is up, the camera's is down.
            let at = Point3::new(p.x, -p.y, HEIGHT - HALF[2] - p.z);
            let normal = UnitVector3::new_normalize(Vector3::new(n.x, -n.y, -n.z));
            let inside = angle.is_some_and(|a| p.z > 0.0 && gauge(&at, a) < 1.0);
            if (whole || p.z > 0.0) && !inside {
                points.push(at);
                normals.push(normal);
                top.push(p.z > 0.0);
            }
        }
        let mut edges = Vec::new();
        for i in 0..points.len() {
            for j in i + 1..points.len() {
                if (points[i] - points[j]).norm() < 1.9 * GAP {
                    edges.push([i as u32, j as u32]);
                }
            }
        }
        let ring = |on: &dyn Fn(usize) -> bool| -> Vec<u32> {
            let mut rim: Vec<u32> = (0..points.len() as u32)
                .filter(|&i| on(i as usize))
                .collect();
            let at = |i: &u32| points[*i as usize].y.atan2(points[*i as usize].x);
            rim.sort_by(|a, b| at(a).total_cmp(&at(b)));
            rim
        };
        let outer = ring(&|i| !whole && points[i].z > HEIGHT - HALF[2] - 0.4 * GAP);
        let hole = angle.map(|a| ring(&|i| top[i] && gauge(&points[i], a) < 1.35));
        let mut boundary = vec![false; points.len()];
        let loops: Vec<Vec<u32>> = [Some(outer), hole]
            .into_iter()
            .flatten()
            .filter(|l| !l.is_empty())
            .collect();
        loops
            .iter()
            .flatten()
            .for_each(|&v| boundary[v as usize] = true);
        let ones = usize::from(angle.is_some());
        let topology = Topology {
            betti: [1, ones, 0],
            persistent: [1, ones, 0],
            genus: Genus::Any,
            handles: Handles::default(),
            boundary,
            boundary_share: 0.1,
            missing: if whole { 0.02 } else { 0.6 },
            bare: 0.1,
            hidden: Vec::new(),
            unseen: Vec::new(),
            farthest: 0.05,
            wholly_seen: false,
            strays: 0.0,
            bars: Vec::new(),
            shorter_bars: [0; 3],
            loops,
            neck: Vec::new(),
            cut: [0; 3],
            non_manifold: 0,
            simplices: [0; 4],
            thinned: 0,
            surface: None,
        };
        Self {
            points,
            normals,
            edges,
            visible: top,
            topology,
        }
    }

    fn plan(&self, arms: usize) -> Plan {
        let cell = FakeCell::new(arms);
        let input = PlanInput {
            points: &self.points,
            normals: &self.normals,
            areas: &vec![GAP * GAP; self.points.len()],
            edges: &self.edges,
            topology: &self.topology,
            visible: &self.visible,
            hidden: &[],
            neck_area: Vector3::zeros(),
            camera: Isometry3::identity(),
            cell: cell.info(),
            limits: ExploreOptions::new(GAP, 0.03).limits,
            attempt: 0,
        };
        CoveragePlanner::default().plan(&input).unwrap().unwrap()
    }
}

/// The two pulling grips go apart while the jaws hold, and lie on both sides of the slit's long axis.
fn opens(body: &Body, plan: &Plan, angle: f64) -> Result<(), TestCaseError> {
    let pull: Vec<_> = plan
        .motion
        .arms
        .iter()
        .filter(|p| p.role == Role::Lift)
        .collect();
    let gap = |t: f64| {
        let [a, b] = [0, 1].map(|k| pull[k].at(t).unwrap().translation.vector);
        (a - b).norm()
    };
    let widest = (0..=50)
        .map(|k| gap(plan.motion.duration * f64::from(k) / 50.0))
        .fold(0.0, f64::max);
    prop_assert!(widest > gap(0.0) + 0.02, "{widest} after {}", gap(0.0));
    let across = Vector3::new(-angle.sin(), angle.cos(), 0.0);
    let hole = body.topology.loops.last().unwrap();
    let sum: Vector3<f64> = hole.iter().map(|&v| body.points[v as usize].coords).sum();
    let centre = sum / hole.len() as f64;
    let sides: Vec<f64> = plan
        .grips
        .iter()
        .filter(|g| g.role == Role::Lift)
        .map(|g| across.dot(&(g.tip().coords - centre)))
        .collect();
    prop_assert!(sides[0] * sides[1] < 0.0, "{sides:?}");
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { max_shrink_iters: 0, ..ProptestConfig::with_cases(cases(8)) })]

    #[test]
    fn a_pocket_that_alone_is_left_is_stretched(angle in 0.0..3.1, arms in 2usize..4) {
        let body = Body::new(Some(angle), true);
        let plan = body.plan(arms);
        prop_assert!(plan.turn.is_none() && plan.across.is_some());
        opens(&body, &plan, angle)?;
        // The pull is across the slit.
        let long = Vector3::new(angle.cos(), angle.sin(), 0.0);
        prop_assert!(plan.across.unwrap().dot(&long).abs() < 0.3);
    }

    #[test]
    fn a_pocket_in_a_half_seen_body_is_opened_too(angle in 0.0..3.1) {
        let body = Body::new(Some(angle), false);
        let plan = body.plan(2);
        prop_assert!(plan.across.is_some());
        opens(&body, &plan, angle)?;
    }
}

/// Both apply when the grips on the two sides of the slit can lift as well.
#[test]
fn a_pocket_across_the_axis_is_opened_in_the_turn() {
    let both = (0..12)
        .map(|k| f64::from(k) * std::f64::consts::PI / 12.0)
        .filter(|&angle| {
            let plan = Body::new(Some(angle), false).plan(2);
            plan.turn.is_some() && plan.across.is_some()
        })
        .count();
    assert!(both > 0, "no slit was opened in a turn");
}

#[test]
fn without_a_pocket_the_body_is_turned_over() {
    let plan = Body::new(None, false).plan(2);
    assert!(plan.turn.is_some() && plan.across.is_none());
    // A loop alone is no hole: its class must persist.
    let mut body = Body::new(Some(0.4), false);
    body.topology.persistent[1] = 0;
    let plan = body.plan(2);
    assert!(plan.turn.is_some() && plan.across.is_none());
}

/// A hole that the camera does not see is left for later.
#[test]
fn a_pocket_out_of_sight_is_left() {
    let mut body = Body::new(Some(0.4), false);
    for v in body.topology.loops[1].clone() {
        body.visible[v as usize] = false;
    }
    let plan = body.plan(2);
    assert!(plan.turn.is_some() && plan.across.is_none());
}

/// The usual number of cases, unless more are wanted from outside.
fn cases(usual: u32) -> u32 {
    let wanted = std::env::var("PROPTEST_CASES");
    wanted.ok().and_then(|w| w.parse().ok()).unwrap_or(usual)
}
