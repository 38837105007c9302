//! Measures against known defects: each defect raises its measure and no other.
#![allow(missing_docs, clippy::unwrap_used)]

use explore_loop::canonical::{CanonicalModel, NewVertex};
use explore_loop::measure::{
    DoubledOptions, Measurer, MeshMeasures, MeshReport, Sampling, Surface, TrueSurface,
    TruthMeasures, compare, doubled, explored, unsupported,
};
use nalgebra::{Matrix3, Point3, Rotation3, UnitVector3, Vector3};
use proptest::prelude::*;
use std::collections::{BTreeMap, BTreeSet};

#[derive(Debug, Clone, Default)]
struct Mesh {
    vertices: Vec<Point3<f64>>,
    triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// A sphere of radius 1 from an octahedron, each triangle quartered `times` times.
    fn sphere(times: usize) -> Self {
        let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
        let mut mesh = Self {
            vertices: axes
                .iter()
                .flat_map(|a| [Point3::from(*a), Point3::from(-a)])
                .collect(),
            triangles: vec![
                [0, 2, 4],
                [2, 1, 4],
                [1, 3, 4],
                [3, 0, 4],
                [2, 0, 5],
                [1, 2, 5],
                [3, 1, 5],
                [0, 3, 5],
            ],
        };
        for _ in 0..times {
            mesh.quarter();
        }
        mesh
    }

    fn quarter(&mut self) {
        let mut middles: BTreeMap<[u32; 2], u32> = BTreeMap::new();
        let mut finer = Vec::new();
        for [a, b, c] in std::mem::take(&mut self.triangles) {
            let [ab, bc, ca] = [[a, b], [b, c], [c, a]].map(|[i, k]| {
                *middles.entry([i.min(k), i.max(k)]).or_insert_with(|| {
                    let sum = self.vertices[i as usize].coords + self.vertices[k as usize].coords;
                    self.vertices.push(Point3::from(sum.normalize()));
                    self.vertices.len() as u32 - 1
                })
            });
            finer.extend([[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]);
        }
        self.triangles = finer;
    }

    fn moved(&self, map: impl Fn(&Point3<f64>) -> Point3<f64>) -> Self {
        Self {
            vertices: self.vertices.iter().map(map).collect(),
            triangles: self.triangles.clone(),
        }
    }

    /// The triangles whose centre `keep` accepts.
    fn part(&self, keep: impl Fn(&Point3<f64>) -> bool) -> Self {
        Self {
            vertices: self.vertices.clone(),
            triangles: self
                .triangles
                .iter()
                .copied()
                .filter(|t| keep(&self.centre(*t)))
                .collect(),
        }
    }

    fn centre(&self, triangle: [u32; 3]) -> Point3<f64> {
        let sum: Vector3<f64> = triangle
            .iter()
            .map(|i| self.vertices[*i as usize].coords)
            .sum();
        Point3::from(sum / 3.0)
    }

    fn with(mut self, other: &Self) -> Self {
        let offset = self.vertices.len() as u32;
        self.vertices.extend(&other.vertices);
        self.triangles
            .extend(other.triangles.iter().map(|t| t.map(|i| i + offset)));
        self
    }

    fn turned(mut self) -> Self {
        self.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        self
    }

    fn surface(&self) -> Surface {
        Surface::new(&self.vertices, &self.triangles).unwrap()
    }

    fn report(&self) -> MeshReport {
        MeshReport::of(&self.vertices, &self.triangles)
    }

    fn against(&self, truth: &Self) -> TruthMeasures {
        TruthMeasures::of(&self.surface(), &truth.surface(), Sampling::default())
    }

    fn doubled(&self, truth: &Self) -> f64 {
        self.against(truth).doubled
    }

    /// The faces between full and empty cells of a grid, halved: closed if no two full cells touch only along an edge.
    fn blocks(size: [i32; 3], cell: f64, full: impl Fn([i32; 3]) -> bool) -> Self {
        let inside = |at: [i32; 3]| (0..3).all(|k| (0..size[k]).contains(&at[k])) && full(at);
        let mut mesh = Self::default();
        let mut corners: BTreeMap<[i32; 3], u32> = BTreeMap::new();
        for index in 0..size[0] * size[1] * size[2] {
            let at = [
                index % size[0],
                index / size[0] % size[1],
                index / (size[0] * size[1]),
            ];
            for (axis, side) in (0..3).flat_map(|axis| [(axis, 0), (axis, 1)]) {
                let mut beyond = at;
                beyond[axis] += 2 * side - 1;
                if !inside(at) || inside(beyond) {
                    continue;
                }
                let mut quad = [[0, 0], [1, 0], [1, 1], [0, 1]].map(|[u, v]| {
                    let mut corner = at;
                    corner[axis] += side;
                    corner[(axis + 1) % 3] += u;
                    corner[(axis + 2) % 3] += v;
                    *corners.entry(corner).or_insert_with(|| {
                        mesh.vertices
                            .push(Point3::from(corner.map(|c| f64::from(c) * cell)));
                        mesh.vertices.len() as u32 - 1
                    })
                });
                if side == 0 {
                    quad.reverse();
                }
                mesh.triangles
                    .extend([[quad[0], quad[1], quad[2]], [quad[0], quad[2], quad[3]]]);
            }
        }
        mesh
    }
}

/// An ellipsoid the size of a hand, edges of about 4 mm.
fn body() -> Mesh {
    Mesh::sphere(4).moved(|p| Point3::new(0.06 * p.x, 0.05 * p.y, 0.04 * p.z))
}

/// Moves a point of [`body`] off its surface along its normal.
fn off(p: &Point3<f64>, distance: f64) -> Point3<f64> {
    let gradient = Vector3::new(p.x / 0.0036, p.y / 0.0025, p.z / 0.0016);
    p + gradient.normalize() * distance
}

fn upper(p: &Point3<f64>) -> bool {
    p.z > 0.02
}

/// Share of the body's area that `part` covers.
fn share(part: &Mesh) -> f64 {
    part.surface().area() / body().surface().area()
}

/// What is measured on a mesh that equals the truth: distances are rounding errors of numbers below 0.1.
const EXACT: f64 = 1e-12;
/// A share that is sampled on 6,000 points stratified by area: a few samples at the boundary of the part fall on the other side.
const SAMPLED: f64 = 0.01;

#[test]
fn the_truth_has_no_fault() {
    let measures = body().against(&body());
    assert!(measures.accuracy.max < EXACT && measures.completeness.max < EXACT);
    assert!((measures.f_score.at_2mm - 1.0).abs() < EXACT);
    assert!((measures.f_score.at_5mm - 1.0).abs() < EXACT);
    assert!(measures.doubled == 0.0);
    let report = body().report();
    assert_eq!(
        report,
        MeshReport {
            watertight: true,
            euler: 2,
            components: 1,
            ..MeshReport::default()
        }
    );
}

#[test]
fn a_second_sheet_is_doubled() {
    let patch = body().part(upper);
    for distance in [-0.015, -0.005, 0.0015, 0.005, 0.015, 0.019] {
        let mesh = body().with(&patch.moved(|p| off(p, distance)));
        let measures = mesh.against(&body());
        // Lines along the true normals meet the offset patch where it was moved from, to within a facet's tilt.
        assert!(
            (measures.doubled - share(&patch)).abs() < SAMPLED,
            "{distance}: {} {}",
            measures.doubled,
            share(&patch)
        );
        assert!(measures.completeness.max < EXACT);
        // Offset facets are chords of a surface curved with a radius of 27 mm and more: off by 4²/8/27 mm < 0.1 mm.
        assert!((measures.accuracy.max - distance.abs()).abs() < 1e-4);
        let report = mesh.report();
        assert_eq!(report.components, 2);
        assert!(!report.watertight && report.open_edges > 0);
    }
}

#[test]
fn farther_than_20_mm_is_another_body() {
    let patch = body().part(upper).moved(|p| off(p, 0.0215));
    assert!(body().with(&patch).doubled(&body()) == 0.0);
}

/// The wall of a cavity faces the other way; an inner layer that faces outward is a second sheet everywhere.
#[test]
fn only_sheets_that_face_the_same_way_count() {
    let inner = body().moved(|p| off(p, -0.01));
    assert!(body().with(&inner).doubled(&body()) > 1.0 - SAMPLED);
    assert!(body().with(&inner.turned()).doubled(&body()) == 0.0);
}

#[test]
fn a_blister_is_doubled_though_the_mesh_is_closed() {
    let top = Vector3::new(0.0, 0.0, 0.045);
    let blister = Mesh::sphere(3).moved(|p| Point3::from(p.coords * 0.008 + top));
    let mesh = body().with(&blister);
    let measures = mesh.against(&body());
    // The blister's disc of 8 mm radius, less its rim, which it turns to the line at more than 60 degrees: sin 60° of the radius.
    let disc = |radius: f64| std::f64::consts::PI * radius * radius / body().surface().area();
    assert!(measures.doubled > 0.9 * disc(0.008 * 0.75f64.sqrt()));
    assert!(measures.doubled < disc(0.008));
    assert!(measures.completeness.max < EXACT);
    let report = mesh.report();
    assert!(report.watertight && report.open_edges == 0);
    assert_eq!((report.components, report.euler), (2, 4));
}

/// A sheet that hangs on the surface along a line and rises from it, over the cap.
#[test]
fn a_flap_is_doubled_and_its_hinge_is_not_manifold() {
    let mut mesh = body();
    let flap = body().part(|p| upper(p) && p.x > 0.0);
    let mut raised: BTreeMap<u32, u32> = BTreeMap::new();
    for t in &flap.triangles {
        let t = t.map(|i| {
            let p = mesh.vertices[i as usize];
            if p.x <= 0.002 {
                return i;
            }
            *raised.entry(i).or_insert_with(|| {
                mesh.vertices.push(off(&p, 0.005));
                mesh.vertices.len() as u32 - 1
            })
        });
        mesh.triangles.push(t);
    }
    let measures = mesh.against(&body());
    assert!(measures.doubled > 0.7 * share(&flap) && measures.doubled < share(&flap) + SAMPLED);
    let report = mesh.report();
    assert!(report.non_manifold_edges > 0);
    assert_eq!(report.components, 1);
}

#[test]
fn a_slit_is_open_and_nothing_else() {
    // A row of triangles over the top.
    let mesh = body().part(|p| !(p.z > 0.0 && (0.0..0.003).contains(&p.y)));
    let removed = body().triangles.len() - mesh.triangles.len();
    assert!(removed > 10, "{removed}");
    let (measures, report) = (mesh.against(&body()), mesh.report());
    assert!(!report.watertight && report.open_edges > removed);
    assert_eq!(report.non_manifold_edges, 0);
    assert!(measures.accuracy.max < EXACT && measures.doubled == 0.0);
    // No place in a triangle of 5 mm edges is farther than that from its edges.
    assert!(measures.completeness.max < 0.005 && measures.completeness.p95 < EXACT);
}

#[test]
fn a_missing_patch_is_incomplete() {
    let mesh = body().part(|p| !upper(p));
    let (measures, report) = (mesh.against(&body()), mesh.report());
    assert!(measures.accuracy.max < EXACT && measures.doubled == 0.0);
    assert!(measures.completeness.max > 0.02);
    assert!(measures.f_score.at_5mm < 1.0);
    // A disc is left: Euler 1.
    assert_eq!(
        (report.euler, report.components, report.watertight),
        (1, 1, false)
    );
}

#[test]
fn a_shift_is_an_error_both_ways_and_no_second_sheet() {
    for shift in [0.003, 0.012] {
        let mesh = body().moved(|p| p + Vector3::new(0.0, 0.0, shift));
        let measures = mesh.against(&body());
        for spread in [measures.accuracy, measures.completeness] {
            // At the poles the shift is along the normal.
            assert!(spread.max <= shift + EXACT && spread.max > 0.98 * shift);
            assert!(spread.mean > 0.3 * shift && spread.mean < shift);
        }
        assert!(measures.doubled == 0.0);
        assert_eq!(mesh.report(), body().report());
    }
}

#[test]
fn a_flipped_triangle_is_misoriented() {
    let mut mesh = body();
    mesh.triangles[100].swap(0, 1);
    assert_eq!(
        mesh.report(),
        MeshReport {
            misoriented_edges: 3,
            ..body().report()
        }
    );
    let measures = mesh.against(&body());
    assert!(measures.accuracy.max < EXACT && measures.doubled == 0.0);
}

#[test]
fn a_stray_component_is_inaccurate() {
    let stray = Mesh::sphere(2).moved(|p| Point3::from(p.coords * 0.01 + Vector3::x() * 0.15));
    let mesh = body().with(&stray);
    let (measures, report) = (mesh.against(&body()), mesh.report());
    assert_eq!((report.components, report.watertight), (2, true));
    assert!((measures.accuracy.max - 0.1).abs() < 1e-3);
    assert!(measures.completeness.max < EXACT && measures.doubled == 0.0);
}

#[test]
fn concentric_spheres_are_their_difference_apart() {
    let sphere = |radius: f64| Mesh::sphere(4).moved(|p| p * radius);
    let (inner, outer) = (sphere(0.05).surface(), sphere(0.053).surface());
    let comparison = compare(&outer, &inner, Sampling::default());
    // Facets of 5 mm edges sag by 5²/8/50 mm = 0.07 mm.
    for spread in [comparison.accuracy(), comparison.completeness()] {
        assert!((spread.mean - 0.003).abs() < 1e-4 && (spread.max - 0.003).abs() < 1e-4);
    }
    assert!(comparison.f_score(0.002) == 0.0);
    assert!((comparison.f_score(0.005) - 1.0).abs() < EXACT);
}

/// Bodies whose own parts are near each other: a sheet of 4 mm, two fingers 4 mm apart, a sheet folded on itself.
fn delicate() -> [(&'static str, Mesh); 4] {
    let cell = 0.004;
    let sheet = Mesh::blocks([25, 20, 1], cell, |_| true);
    let fingers = Mesh::blocks([7, 20, 3], cell, |[x, y, _]| y < 5 || x != 3);
    let fold = Mesh::blocks([20, 10, 3], cell, |[x, _, z]| x < 2 || z != 1);
    let capsules = Mesh::sphere(4).moved(|p| Point3::new(0.008 * p.x, 0.04 * p.y, 0.008 * p.z));
    let capsules = capsules
        .clone()
        .with(&capsules.moved(|p| p + Vector3::x() * 0.018));
    [
        ("sheet", sheet),
        ("fingers", fingers),
        ("fold", fold),
        ("capsules", capsules),
    ]
}

#[test]
fn thin_and_folded_bodies_are_not_doubled() {
    for (name, body) in delicate() {
        assert!(body.report().watertight, "{name}");
        assert!(body.doubled(&body) == 0.0, "{name}");
        // Nor are they when the mesh is 2.5 mm off: less than the margin of 5 mm.
        let shifted = body.moved(|p| p + Vector3::new(0.0015, 0.0005, 0.002));
        assert!(shifted.doubled(&body) == 0.0, "{name}");
    }
}

/// Two leaves 10 mm apart that the mesh has 6 and 2 mm too high: nearer to the wrong leaf, but no more leaves than there are.
#[test]
fn a_badly_placed_fold_has_no_sheet_too_many() {
    let fold = Mesh::blocks([20, 10, 3], 0.005, |[x, _, z]| x < 2 || z != 1);
    let high = fold.moved(|p| p + Vector3::z() * if p.z < 0.006 { 0.006 } else { 0.002 });
    assert!(high.doubled(&fold) == 0.0);
}

/// Four triangles meet in each pole of an octahedron; a line through them crosses its surface twice.
#[test]
fn a_line_through_a_vertex_crosses_once() {
    let surface = Mesh::sphere(0).surface();
    let found = surface.crossings(&Point3::origin(), &Vector3::z_axis(), 2.0);
    let along: Vec<f64> = found.iter().map(|c| c.along).collect();
    assert_eq!(along, [-1.0, 1.0]);
    assert!(found[0].facing < 0.0 && found[1].facing > 0.0);
}

/// On them, too, a second sheet is seen: all bodies once more, 6 mm beside themselves.
#[test]
fn thin_and_folded_bodies_can_be_doubled() {
    for (name, body) in delicate() {
        let again = body.moved(|p| p + Vector3::z() * 0.006);
        // Every face up or down is crossed twice; it is more than a third of the area in all of them.
        let doubled = body.clone().with(&again).doubled(&body);
        assert!(doubled > 0.33, "{name}: {doubled}");
    }
}

#[test]
fn what_no_point_supports_is_unsupported() {
    let mesh = body();
    let all = unsupported(&mesh.surface(), &mesh.vertices, 0.005, Sampling::default());
    assert!(all == 0.0);
    let seen: Vec<_> = mesh
        .vertices
        .iter()
        .copied()
        .filter(|p| !upper(p))
        .collect();
    let some = unsupported(&mesh.surface(), &seen, 0.005, Sampling::default());
    // Of the cap, a band of one spacing inside its rim is supported.
    let cap = share(&body().part(upper));
    assert!(some > 0.5 * cap && some < cap, "{some} {cap}");
    let nothing = unsupported(&mesh.surface(), &[], 0.005, Sampling::default());
    assert!((nothing - 1.0).abs() < EXACT);
    // The same points explore what they support.
    let known = explored(&seen, &mesh.surface(), 0.005, Sampling::default());
    assert!((known + some - 1.0).abs() < EXACT);
}

#[test]
fn an_empty_mesh_has_no_measures() {
    let truth = body().surface();
    let measures =
        MeshMeasures::of(&[], &[], &[], 0.005, Some(&truth), Sampling::default()).unwrap();
    assert_eq!(measures, MeshMeasures::default());
    assert!(!measures.report.watertight);
}

#[test]
fn meshes_that_cannot_be_measured_are_refused() {
    let mesh = body();
    assert!(Surface::new(&[], &[]).is_err());
    assert!(Surface::new(&mesh.vertices[..10], &mesh.triangles).is_err());
    let mut broken = mesh.vertices.clone();
    broken[7].y = f64::NAN;
    let error = Surface::new(&broken, &mesh.triangles).err().unwrap();
    assert!(error.to_string().contains("vertex 7"));
    assert!(Surface::new(&[Point3::origin(); 3], &[[0, 1, 2]]).is_err());
    // A report can be had of anything.
    assert_eq!(
        MeshReport::of(&mesh.vertices[..1], &mesh.triangles),
        MeshReport::default()
    );
}

/// A file that repeats every corner is read as one surface.
#[test]
fn coinciding_vertices_are_one() {
    let mesh = body();
    let soup = Mesh {
        vertices: mesh
            .triangles
            .iter()
            .flatten()
            .map(|i| mesh.vertices[*i as usize])
            .collect(),
        triangles: (0..mesh.triangles.len() as u32)
            .map(|k| [3 * k, 3 * k + 1, 3 * k + 2])
            .collect(),
    };
    assert_eq!(soup.report(), mesh.report());
}

#[test]
fn a_ring_has_euler_number_zero() {
    let ring = Mesh::blocks([3, 3, 1], 0.01, |[x, y, _]| [x, y] != [1, 1]);
    let report = ring.report();
    assert!(report.watertight && report.misoriented_edges == 0);
    assert_eq!((report.euler, report.components), (0, 1));
}

/// Distance to a triangle the slow way: to its plane where the foot lies inside, to its sides, to its corners.
fn to_triangle(p: &Point3<f64>, [a, b, c]: [Point3<f64>; 3]) -> f64 {
    let segment = |a: Point3<f64>, b: Point3<f64>| {
        let t = ((p - a).dot(&(b - a)) / (b - a).norm_squared()).clamp(0.0, 1.0);
        (a + (b - a) * t - p).norm()
    };
    let normal = (b - a).cross(&(c - a)).normalize();
    let height = normal.dot(&(p - a));
    let foot = p - normal * height;
    let within = [[a, b], [b, c], [c, a]]
        .iter()
        .all(|[s, t]| normal.dot(&(t - s).cross(&(foot - s))) >= 0.0);
    let plane = if within { height.abs() } else { f64::INFINITY };
    plane
        .min(segment(a, b))
        .min(segment(b, c))
        .min(segment(c, a))
}

/// Six times the volume of a tetrahedron.
fn volume(a: &Point3<f64>, b: &Point3<f64>, c: &Point3<f64>, d: &Point3<f64>) -> f64 {
    (b - a).cross(&(c - a)).dot(&(d - a))
}

fn soup() -> impl Strategy<Value = Mesh> {
    let point = [-0.05..0.05, -0.05..0.05, -0.05..0.05f64].prop_map(Point3::from);
    proptest::collection::vec(point, 9..40).prop_map(|vertices| {
        let triangles = (0..vertices.len() as u32 / 3)
            .map(|k| [3 * k, 3 * k + 1, 3 * k + 2])
            .collect();
        Mesh {
            vertices,
            triangles,
        }
    })
}

fn place() -> impl Strategy<Value = Point3<f64>> {
    [-0.1..0.1, -0.1..0.1, -0.1..0.1f64].prop_map(Point3::from)
}

proptest! {
    #[test]
    fn distances_are_those_of_every_triangle(mesh in soup(), point in place()) {
        let corners = |t: &[u32; 3]| t.map(|i| mesh.vertices[i as usize]);
        let flat = |[a, b, c]: [Point3<f64>; 3]| (b - a).cross(&(c - a)).norm() < 1e-7;
        prop_assume!(!mesh.triangles.iter().any(|t| flat(corners(t))));
        let slow = mesh.triangles.iter().map(|t| to_triangle(&point, corners(t))).fold(f64::INFINITY, f64::min);
        // Needles with a height of a ten-thousandth of their length lose a few digits.
        prop_assert!((mesh.surface().distance(&point) - slow).abs() < 1e-9);
    }

    #[test]
    fn crossings_are_those_of_every_triangle(mesh in soup(), from in place(), to in place()) {
        prop_assume!((to - from).norm() > 0.02);
        let middle = nalgebra::center(&from, &to);
        let direction = UnitVector3::new_normalize(to - from);
        let found = mesh.surface().crossings(&middle, &direction, 0.5 * (to - from).norm());
        // A segment crosses a triangle when its ends are on different sides and it passes all sides on the same hand.
        let mut facing = Vec::new();
        for t in &mesh.triangles {
            let [a, b, c] = t.map(|i| mesh.vertices[i as usize]);
            let hands = [volume(&from, &to, &a, &b), volume(&from, &to, &b, &c), volume(&from, &to, &c, &a)];
            let ends = [volume(&a, &b, &c, &from), volume(&a, &b, &c, &to)];
            prop_assume!(hands.iter().chain(&ends).all(|v| v.abs() > 1e-10));
            if ends[0] * ends[1] < 0.0 && (hands.iter().all(|h| *h > 0.0) || hands.iter().all(|h| *h < 0.0)) {
                facing.push(ends[1] > 0.0);
            }
        }
        prop_assert_eq!(found.len(), facing.len());
        prop_assert_eq!(found.iter().filter(|c| c.facing > 0.0).count(), facing.iter().filter(|f| **f).count());
        prop_assert!(found.windows(2).all(|w| w[0].along <= w[1].along));
    }

    /// Every triangle gets its share of the samples, to within one.
    #[test]
    fn samples_are_even_by_area(mesh in soup(), seed in any::<u64>(), count in 1..500_usize) {
        // Taken apart along x, so that a sample tells its triangle.
        let apart = Mesh {
            vertices: mesh.vertices.iter().enumerate().map(|(i, p)| p + Vector3::x() * (i / 3) as f64).collect(),
            triangles: mesh.triangles.clone(),
        };
        let surface = apart.surface();
        let samples = surface.samples(Sampling::default().with_count(count).with_seed(seed));
        prop_assert_eq!(samples.len(), count);
        for (k, t) in apart.triangles.iter().enumerate() {
            let [a, b, c] = t.map(|i| apart.vertices[i as usize]);
            let share = 0.5 * (b - a).cross(&(c - a)).norm() / surface.area();
            let got = samples.iter().filter(|s| (s.point.x - k as f64).abs() < 0.5).count();
            prop_assert!((got as f64 - share * count as f64).abs() <= 1.0 + 1e-6);
        }
        prop_assert!(samples.iter().all(|s| surface.distance(&s.point) < 1e-9));
    }

    /// The other way round, accuracy is completeness; and nothing depends on where the two lie.
    #[test]
    fn swapping_swaps_the_two(one in soup(), other in soup(), turn in [-3.0..3.0, -3.0..3.0, -3.0..3.0f64], seed in any::<u64>()) {
        let sampling = Sampling::default().with_count(200).with_seed(seed);
        let there = compare(&one.surface(), &other.surface(), sampling);
        let back = compare(&other.surface(), &one.surface(), sampling);
        prop_assert_eq!(there.accuracy(), back.completeness());
        prop_assert_eq!(there.completeness(), back.accuracy());
        prop_assert!((there.f_score(0.01) - back.f_score(0.01)).abs() < EXACT);
        let rotation = Rotation3::new(Vector3::from(turn));
        let moved = |m: &Mesh| m.moved(|p| rotation * p + Vector3::new(0.3, -0.2, 0.9)).surface();
        let far = compare(&moved(&one), &moved(&other), sampling);
        prop_assert!((far.accuracy().mean - there.accuracy().mean).abs() < 1e-6);
    }

    /// A mesh that is up to 3 mm off has all its sheets where the truth has them.
    #[test]
    fn a_small_shift_of_delicate_bodies_is_not_doubled(shift in [-1.0..1.0, -1.0..1.0, -1.0..1.0f64]) {
        let shift = Vector3::from(shift);
        let shift = shift * (0.003 / shift.norm().max(1.0));
        for (name, body) in delicate() {
            prop_assert!(body.moved(|p| p + shift).doubled(&body) == 0.0, "{}", name);
        }
    }

    /// Noise far below the size of the details makes no second sheet.
    #[test]
    fn noise_is_not_doubled(seed in any::<u64>()) {
        let mut state = seed | 1;
        let mut noise = || {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 11) as f64 / (1u64 << 53) as f64 * 2e-3 - 1e-3
        };
        let mut rough = body();
        for p in &mut rough.vertices {
            *p += Vector3::new(noise(), noise(), noise());
        }
        prop_assert!(rough.doubled(&body()) == 0.0);
    }
}

#[test]
fn the_seed_chooses_the_samples() {
    let surface = body().surface();
    let with = |seed| surface.samples(Sampling::default().with_seed(seed));
    assert_eq!(with(1), with(1));
    assert_ne!(with(1), with(2));
    let other = DoubledOptions::default();
    let twice = body().with(&body().part(upper).moved(|p| off(p, 0.01)));
    let shares: Vec<f64> = (0..4)
        .map(|seed| {
            let sampling = Sampling::default().with_seed(seed);
            doubled(&twice.surface(), &surface, &other, sampling)
        })
        .collect();
    assert!(shares.iter().all(|s| (s - shares[0]).abs() < SAMPLED));
}

fn model(points: &[Point3<f64>]) -> CanonicalModel {
    let mut model = CanonicalModel::default();
    for p in points {
        let vertex = NewVertex {
            rest: *p,
            rest_normal: Vector3::z_axis(),
            live: *p,
            rotation: Matrix3::identity(),
        };
        model.push(vertex, 0);
    }
    model
}

/// Vertices that crept along the surface slide by as much; vertices that left it along the normal do not.
#[test]
fn slide_is_the_tangential_error() {
    let flat = Mesh::blocks([10, 10, 1], 0.01, |_| true);
    let truth = TrueSurface {
        vertices: flat.vertices.clone(),
        triangles: flat.triangles.clone(),
    };
    let tops: Vec<_> = (0..5)
        .map(|k| Point3::new(0.031 + 0.005 * f64::from(k), 0.042, 0.01))
        .collect();
    let mut model = model(&tops);
    let mut measurer = Measurer::new(truth.clone()).unwrap();
    let seen = [true, true, true, false, false];
    measurer.frame(&model, &seen, false, &truth).unwrap();
    for (k, live) in model.live_mut().iter_mut().enumerate() {
        *live += if seen[k] {
            Vector3::new(0.003, 0.0, 0.002)
        } else {
            Vector3::new(0.0, 0.006, 0.008)
        };
    }
    let errors = measurer.frame(&model, &seen, true, &truth).unwrap();
    assert!((errors[4] - 0.01).abs() < EXACT);
    let tracking = measurer.tracking();
    // Means over two frames, of which the first had no error; only in the second an arm held.
    assert!((tracking.slide.unwrap() - 0.0015).abs() < EXACT);
    assert!((tracking.prediction_error.unwrap() - 0.005).abs() < EXACT);
    assert!((tracking.prediction_error_held.unwrap() - 0.01).abs() < EXACT);
    let fewer = TrueSurface {
        vertices: truth.vertices[1..].to_vec(),
        ..truth
    };
    assert!(measurer.frame(&model, &seen, true, &fewer).is_err());
}

/// Points of smooth and of thin bodies give a closed surface that is the body.
#[test]
fn recorded_points_make_a_closed_surface() {
    let rod = Mesh::sphere(4).moved(|p| Point3::new(0.04 * p.x, 0.02 * p.y, 0.02 * p.z));
    for mesh in [body(), rod] {
        let mesh = mesh.moved(|p| p + Vector3::z());
        let laid = TrueSurface::from_points(&mesh.vertices).unwrap();
        let report = MeshReport::of(&laid.vertices, &laid.triangles);
        assert_eq!(report, mesh.report());
        let used: BTreeSet<u32> = laid.triangles.iter().flatten().copied().collect();
        assert_eq!(used.len(), mesh.vertices.len());
        let comparison = compare(
            &laid.surface().unwrap(),
            &mesh.surface(),
            Sampling::default(),
        );
        // The same vertices over other diagonals: apart by the sag of a facet, edges up to 8 mm on a radius of 4 mm and more.
        assert!(comparison.accuracy().mean < 1e-4);
    }
    assert!(TrueSurface::from_points(&[]).is_err());
    assert!(TrueSurface::from_points(&[Point3::origin(); 20]).is_err());
}
