//! Null-space coverage: laws, and the dense definition as oracle.
#![allow(missing_docs, clippy::unwrap_used, reason = "tests")]

mod fixture;

use fixture::Body;
use grip_planner::nalgebra::{DMatrix, Isometry3, Translation3, UnitQuaternion, Vector3};
use grip_planner::{Coverage, CoverageOptions, Plane, Stiffness, target_weights};
use proptest::prelude::*;

fn options() -> CoverageOptions {
    CoverageOptions::default()
        .with_decay_length(0.08)
        .with_friction(4.0)
        .with_contact_height(0.02)
        .with_boundary_weight(3.0)
        .with_boundary_length(0.02)
}

fn table() -> Plane {
    Plane {
        normal: -Vector3::z_axis(),
        offset: fixture::DEPTH,
    }
}

fn small() -> impl Strategy<Value = Body> {
    (40usize..90, 0.05..0.15, 0.03..0.1, -0.3..0.3, 0.0..3.0)
        .prop_map(|(count, a, b, lowest, yaw)| Body::ellipsoid([a, b, 0.025], count, lowest, yaw))
}

/// `K` as the documentation defines it, from the public springs and anchors.
fn dense(stiffness: &Stiffness) -> DMatrix<f64> {
    let n = stiffness.anchors().len();
    let mut k = DMatrix::zeros(n, n);
    for &([a, b], w) in stiffness.springs() {
        let (a, b) = (a as usize, b as usize);
        k[(a, a)] += w;
        k[(b, b)] += w;
        k[(a, b)] -= w;
        k[(b, a)] -= w;
    }
    for (i, d) in stiffness.anchors().iter().enumerate() {
        k[(i, i)] += d;
    }
    k
}

/// `Z(ZᵀKZ)⁻¹Zᵀ` with `Z` the unit vectors of the vertices that are not gripped.
fn left_free(k: &DMatrix<f64>, grips: &[u32]) -> DMatrix<f64> {
    let n = k.nrows();
    let free: Vec<usize> = (0..n).filter(|&i| !grips.contains(&(i as u32))).collect();
    let z = DMatrix::from_fn(n, free.len(), |i, j| if free[j] == i { 1.0 } else { 0.0 });
    &z * (z.transpose() * k * &z).try_inverse().unwrap() * z.transpose()
}

/// The definition: `1 − tr(S Z(ZᵀKZ)⁻¹Zᵀ)/tr(S K⁻¹)`.
fn definition(k: &DMatrix<f64>, s: &[f64], grips: &[u32]) -> f64 {
    let left = left_free(k, grips);
    let all = k.clone().try_inverse().unwrap();
    let trace = |m: &DMatrix<f64>| (0..s.len()).map(|i| s[i] * m[(i, i)]).sum::<f64>();
    1.0 - trace(&left) / trace(&all)
}

/// Eight vertices spread over the body.
fn some(body: &Body) -> Vec<u32> {
    let n = body.points.len() as u32;
    (0..8).map(|k| k * n / 8).collect()
}

// Both sides are well conditioned here (condition number of K below 1e4): 1e-9 leaves five digits of room.
const CLOSE: f64 = 1e-9;

proptest! {
    #![proptest_config(ProptestConfig { max_shrink_iters: 20, ..ProptestConfig::with_cases(cases(24)) })]

    #[test]
    fn pairs_and_triples_equal_the_dense_definition(body in small()) {
        let grips = some(&body);
        let stiffness = Stiffness::membrane(&body.model(), &table(), &options()).unwrap();
        let s = target_weights(&body.model(), &options()).unwrap();
        let k = dense(&stiffness);
        let coverage = Coverage::with_stiffness(&stiffness, &s, &grips).unwrap();
        let mut best: f64 = 0.0;
        for (pair, score) in coverage.pairs() {
            prop_assert!((score - definition(&k, &s, &pair)).abs() < CLOSE);
            prop_assert!((score - coverage.score(&pair).unwrap()).abs() < CLOSE);
        }
        for (i, &a) in grips.iter().enumerate() {
            for (j, &b) in grips.iter().enumerate().skip(i + 1) {
                for &c in &grips[j + 1..] {
                    let score = coverage.score(&[a, b, c]).unwrap();
                    if (a + b + c) % 5 == 0 {
                        prop_assert!((score - definition(&k, &s, &[a, b, c])).abs() < CLOSE);
                    }
                    best = best.max(score);
                }
            }
        }
        prop_assert!((coverage.best_triple().unwrap().1 - best).abs() < CLOSE);
    }

    #[test]
    fn between_nothing_and_all_growing_with_every_grip(body in small()) {
        let everything: Vec<u32> = (0..body.points.len() as u32).collect();
        let coverage = Coverage::new(&body.model(), &table(), &everything, &options()).unwrap();
        prop_assert!(coverage.score(&[]).unwrap().abs() < f64::MIN_POSITIVE);
        let mut last = 0.0;
        for count in [1, 2, 3, 5, 9, everything.len() - 1, everything.len()] {
            let score = coverage.score(&everything[..count]).unwrap();
            prop_assert!((last..=1.0).contains(&score));
            last = score;
        }
        prop_assert!((last - 1.0).abs() < CLOSE);
    }

    #[test]
    fn a_grip_more_never_commands_less(body in small(), picks in prop::collection::vec(0usize..1000, 1..8), extra in 0usize..1000) {
        let n = body.points.len();
        let everything: Vec<u32> = (0..n as u32).collect();
        let coverage = Coverage::new(&body.model(), &table(), &everything, &options()).unwrap();
        let set: Vec<u32> = picks.iter().map(|p| (p % n) as u32).collect();
        let mut more = set.clone();
        more.push((extra % n) as u32);
        let [a, b] = [&set, &more].map(|s| coverage.score(s).unwrap());
        prop_assert!((0.0..=1.0).contains(&a) && (a..=1.0).contains(&b));
        let [less, more] = [&set, &more].map(|s| coverage.map(s).unwrap());
        prop_assert!(less.iter().zip(&more).all(|(a, b)| (0.0..=1.0).contains(a) && *b >= a - 1e-15));
    }

    #[test]
    fn the_map_is_the_definition_vertex_by_vertex(body in small()) {
        let g = &some(&body)[..3];
        let stiffness = Stiffness::membrane(&body.model(), &table(), &options()).unwrap();
        let s = target_weights(&body.model(), &options()).unwrap();
        let coverage = Coverage::with_stiffness(&stiffness, &s, g).unwrap();
        let map = coverage.map(&[g[0], g[1], g[2], g[1]]).unwrap();
        let k = dense(&stiffness);
        let (left, all) = (left_free(&k, g), k.clone().try_inverse().unwrap());
        for i in 0..s.len() {
            prop_assert!((map[i] - (1.0 - left[(i, i)] / all[(i, i)])).abs() < CLOSE);
        }
        for &v in g {
            prop_assert!((map[v as usize] - 1.0).abs() < CLOSE);
        }
        // The coverage is its mean, weighted with how much each vertex matters and moves.
        let weight = |i: usize| s[i] * all[(i, i)];
        let whole: f64 = (0..s.len()).map(weight).sum();
        let mean = (0..s.len()).map(|i| weight(i) * map[i]).sum::<f64>() / whole;
        prop_assert!((mean - coverage.score(g).unwrap()).abs() < CLOSE);
    }

    #[test]
    fn what_grips_leave_free_is_a_projection_onto_their_null_space(body in small(), count in 1usize..6) {
        let g = &some(&body)[..count];
        let stiffness = Stiffness::membrane(&body.model(), &table(), &options()).unwrap();
        let s = target_weights(&body.model(), &options()).unwrap();
        let coverage = Coverage::with_stiffness(&stiffness, &s, g).unwrap();
        let n = s.len();
        let mut p = DMatrix::zeros(n, n);
        for j in 0..n {
            let mut unit = vec![Vector3::zeros(); n];
            unit[j] = Vector3::y();
            for (i, u) in coverage.free_motion(g, &unit).unwrap().iter().enumerate() {
                p[(i, j)] = u.y;
                prop_assert!(u.x == 0.0 && u.z == 0.0);
            }
        }
        // ΦP = 0, P² = P, rank n − g.
        prop_assert!(g.iter().all(|&v| p.row(v as usize).amax() < CLOSE));
        prop_assert!((&p * &p - &p).amax() < CLOSE);
        prop_assert_eq!(p.clone().svd(false, false).rank(1e-7), n - count);
        // It is the projection of the definition, Z(ZᵀKZ)⁻¹ZᵀK.
        let k = dense(&stiffness);
        prop_assert!((left_free(&k, g) * k - p).amax() < CLOSE);
    }

    #[test]
    fn blind_to_the_order_of_grips_and_to_repeats(body in small()) {
        let g = some(&body);
        let coverage = Coverage::new(&body.model(), &table(), &g, &options()).unwrap();
        let score = coverage.score(&[g[0], g[3], g[5]]).unwrap();
        prop_assert!((score - coverage.score(&[g[5], g[0], g[3]]).unwrap()).abs() < CLOSE);
        prop_assert!((score - coverage.score(&[g[5], g[0], g[3], g[0], g[5]]).unwrap()).abs() < CLOSE);
    }

    #[test]
    fn blind_to_the_order_of_vertices(body in small(), seed in 1usize..1000) {
        let n = body.points.len();
        // A step without a common divisor with n visits every vertex once.
        let step = (seed..seed + 2 * n).find(|s| gcd(*s, n) == 1).unwrap();
        let new_of: Vec<usize> = (0..n).map(|i| (i * step + seed) % n).collect();
        let shuffled = permuted(&body, &new_of);
        let g = some(&body);
        let renamed: Vec<u32> = g.iter().map(|&v| new_of[v as usize] as u32).collect();
        let a = Coverage::new(&body.model(), &table(), &g, &options()).unwrap();
        let b = Coverage::new(&shuffled.model(), &table(), &renamed, &options()).unwrap();
        for k in 1..g.len() {
            prop_assert!((a.score(&g[..k]).unwrap() - b.score(&renamed[..k]).unwrap()).abs() < CLOSE);
        }
    }

    #[test]
    fn blind_to_where_the_whole_scene_is(body in small(), axis in prop::array::uniform3(-1.0..1.0), shift in prop::array::uniform3(-1.0..1.0)) {
        let turn = Isometry3::from_parts(Translation3::from(Vector3::from(shift)), UnitQuaternion::new(Vector3::from(axis) * 3.0));
        let mut moved = body.clone();
        moved.points.iter_mut().for_each(|p| *p = turn * *p);
        moved.normals.iter_mut().for_each(|n| *n = turn * *n);
        let normal = turn * table().normal;
        // n·x + c of the old point equals n'·x' + c' of the moved one.
        let plane = Plane { normal, offset: table().offset - normal.dot(&Vector3::from(shift)) };
        let g = some(&body);
        let a = Coverage::new(&body.model(), &table(), &g, &options()).unwrap();
        let b = Coverage::new(&moved.model(), &plane, &g, &options()).unwrap();
        prop_assert!((a.score(&g[..3]).unwrap() - b.score(&g[..3]).unwrap()).abs() < CLOSE);
    }

    #[test]
    fn the_field_is_a_projection_and_in_balance(body in small(), v in prop::array::uniform6(-1.0..1.0)) {
        let g = some(&body);
        let coverage = Coverage::new(&body.model(), &table(), &g, &options()).unwrap();
        let held = [(g[1], Vector3::new(v[0], v[1], v[2])), (g[6], Vector3::new(v[3], v[4], v[5]))];
        let field = coverage.field(&held).unwrap();
        for (vertex, velocity) in held {
            prop_assert!((field[vertex as usize] - velocity).norm() < CLOSE);
        }
        // Asking for what the field already does changes nothing.
        let again: Vec<_> = [g[1], g[6], g[2]].iter().map(|&k| (k, field[k as usize])).collect();
        for (a, b) in coverage.field(&again).unwrap().iter().zip(&field) {
            prop_assert!((a - b).norm() < CLOSE);
        }
        // No force anywhere but at the grips.
        let k = dense(&Stiffness::membrane(&body.model(), &table(), &options()).unwrap());
        let u = DMatrix::from_fn(field.len(), 3, |i, c| field[i][c]);
        let force = &k * u;
        for i in (0..field.len()).filter(|i| ![g[1], g[6]].contains(&(*i as u32))) {
            prop_assert!(force.row(i).norm() < CLOSE * k.amax());
        }
    }
}

#[test]
fn a_spring_across_the_body_carries_the_pull_through() {
    // Two pieces without an edge between them: only the added spring lets the grip on one command the other.
    let mut body = Body::ellipsoid([0.1, 0.06, 0.025], 60, 0.0, 0.0);
    body.edges.clear();
    let mut stiffness = Stiffness::membrane(&body.model(), &table(), &options()).unwrap();
    let mut targets = vec![0.0; body.points.len()];
    targets[7] = 1.0;
    let apart = Coverage::with_stiffness(&stiffness, &targets, &[0])
        .unwrap()
        .score(&[0])
        .unwrap();
    stiffness.couple([0, 7], 1.0).unwrap();
    let joined = Coverage::with_stiffness(&stiffness, &targets, &[0])
        .unwrap()
        .score(&[0])
        .unwrap();
    assert!(apart.abs() < f64::MIN_POSITIVE);
    assert!(joined > 0.4);
}

#[test]
fn what_is_next_to_the_hidden_surface_weighs_more() {
    let body = fixture::usual(400);
    let weights = target_weights(&body.model(), &options()).unwrap();
    let share = |v: usize| weights[v] / body.areas[v];
    let top = 0;
    let rim = body.boundary.iter().position(|&b| b).unwrap();
    assert!((share(rim) - 4.0).abs() < 1e-12);
    assert!(share(top) < 1.2);
}

#[test]
fn a_target_weight_that_is_none_is_named() {
    let body = fixture::usual(100);
    let stiffness = Stiffness::membrane(&body.model(), &table(), &options()).unwrap();
    let mut targets = vec![1.0; body.points.len()];
    targets[3] = -1.0;
    let refused = Coverage::with_stiffness(&stiffness, &targets, &[0]).unwrap_err();
    assert_eq!(
        refused.to_string(),
        "target weight 3 is -1, but must be finite and at least 0"
    );
}

fn gcd(a: usize, b: usize) -> usize {
    if b == 0 { a } else { gcd(b, a % b) }
}

fn permuted(body: &Body, new_of: &[usize]) -> Body {
    let mut out = body.clone();
    for (old, &new) in new_of.iter().enumerate() {
        out.points[new] = body.points[old];
        out.normals[new] = body.normals[old];
        out.areas[new] = body.areas[old];
        out.boundary[new] = body.boundary[old];
        out.visible[new] = body.visible[old];
    }
    out.edges = body
        .edges
        .iter()
        .map(|e| e.map(|v| new_of[v as usize] as u32))
        .collect();
    out
}

/// Dense inverses are slow: fewer cases than usual, unless more are asked for.
fn cases(usual: u32) -> u32 {
    std::env::var("PROPTEST_CASES")
        .ok()
        .and_then(|c| c.parse().ok())
        .unwrap_or(usual)
}
