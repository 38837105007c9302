//! Scenes and meshes: closed, oriented, even, of the right size; invalid ones are rejected with the wrong value.
#![allow(
    clippy::unwrap_used,
    clippy::format_push_string,
    clippy::cast_sign_loss,
    clippy::float_cmp,
    clippy::needless_for_each,
    reason = "a test stops where it fails, and its loops read as prose"
)]

use std::collections::HashSet;

use explore_loop::cell::sim::{SCENES, Scene, SimError, TriangleMesh, about};
use explore_loop::mesh::{Encoding, Format, Load, Mesh, Options, parse};
use nalgebra::{Point3, Vector3};
use proptest::prelude::*;

/// Vertices − edges + triangles: 2 for a sphere.
fn euler(mesh: &TriangleMesh) -> i64 {
    let edges: HashSet<_> = mesh
        .triangles
        .iter()
        .flat_map(|t| [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])])
        .map(|(a, b)| (a.min(b), a.max(b)))
        .collect();
    i64::try_from(mesh.vertices.len() + mesh.triangles.len()).unwrap()
        - i64::try_from(edges.len()).unwrap()
}

fn icosphere_like(half_axes: [f64; 3]) -> TriangleMesh {
    Scene::ellipsoid(half_axes).unwrap().mesh().clone()
}

/// Closed, of one piece, with the handles it should have, outward.
fn bounds_a_solid(name: &str, mesh: &TriangleMesh) {
    mesh.check_closed().unwrap();
    let handles = i64::from(name == "torus");
    assert_eq!(euler(mesh), 2 - 2 * handles, "{name}");
    assert_eq!(mesh.pieces(), 1, "{name}");
    assert!(mesh.volume() > 0.0, "{name} is inside out");
}

#[test]
fn built_in_scenes_are_solids_of_about_two_thousand_vertices() {
    for name in SCENES {
        let scene = Scene::named(name).unwrap();
        let mesh = scene.mesh();
        bounds_a_solid(name, mesh);
        // A thin wall needs triangles smaller than it is thick, a fold smaller than it is wide.
        let most = if ["cap", "sheet", "beanie", "colon"].contains(&name) {
            10_000
        } else {
            3200
        };
        assert!(
            (1600..most).contains(&mesh.vertices.len()),
            "{name}: {} vertices",
            mesh.vertices.len()
        );
        assert!(!about(name).is_empty(), "{name}");
    }
    assert!(about("teapot").is_empty());
}

/// Whether the segment from `a` to `b` pierces a triangle (Möller and Trumbore), not counting its ends and the triangle's edges.
fn pierces([a, b]: [Point3<f64>; 2], [p, q, r]: [Point3<f64>; 3]) -> bool {
    let (way, u, v) = (b - a, q - p, r - p);
    let cross = way.cross(&v);
    let det = u.dot(&cross);
    if det.abs() < 1e-18 {
        return false;
    }
    let from = a - p;
    let x = from.dot(&cross) / det;
    let y = way.dot(&from.cross(&u)) / det;
    let t = v.dot(&from.cross(&u)) / det;
    x > 0.0 && y > 0.0 && x + y < 1.0 && (0.0..=1.0).contains(&t)
}

/// Edges that pierce a triangle they share no vertex with.
fn intersections(mesh: &TriangleMesh) -> usize {
    let v = &mesh.vertices;
    let longest = mesh
        .triangles
        .iter()
        .flat_map(|t| (0..3).map(|k| (v[t[k]] - v[t[(k + 1) % 3]]).norm()))
        .fold(0.0, f64::max);
    let place = |p: &Point3<f64>| [p.x, p.y, p.z].map(|c| (c / longest).floor() as i64);
    let mut at = std::collections::HashMap::<[i64; 3], Vec<usize>>::new();
    for (k, t) in mesh.triangles.iter().enumerate() {
        at.entry(place(&v[t[0]])).or_default().push(k);
    }
    let mut count = 0;
    for t in &mesh.triangles {
        for k in 0..3 {
            let (a, b) = (t[k], t[(k + 1) % 3]);
            if a > b {
                continue;
            }
            let [x, y, z] = place(&v[a]);
            // A triangle within reach of the edge begins at most two lengths away.
            for (dx, dy, dz) in
                (-2..=2).flat_map(|i| (-2..=2).flat_map(move |j| (-2..=2).map(move |l| (i, j, l))))
            {
                for &o in at.get(&[x + dx, y + dy, z + dz]).into_iter().flatten() {
                    let other = mesh.triangles[o];
                    if !other.contains(&a) && !other.contains(&b) {
                        count += usize::from(pierces([v[a], v[b]], other.map(|i| v[i])));
                    }
                }
            }
        }
    }
    count
}

#[test]
fn no_scene_intersects_itself() {
    for name in SCENES {
        let scene = Scene::named(name).unwrap();
        assert_eq!(intersections(scene.mesh()), 0, "{name}");
    }
}

/// Extents, m, and volume, cm³, against rough sums of balls, cylinders and slabs; what the paper explores has its cylinders.
#[test]
fn objects_of_the_paper_have_their_size() {
    let expected = [
        ("glove", [0.164, 0.182, 0.029], [250.0, 420.0], Some(0.005)),
        ("beanie", [0.16, 0.16, 0.118], [500.0, 900.0], Some(0.005)),
        ("colon", [0.086, 0.20, 0.04], [150.0, 260.0], Some(0.0035)),
        ("torus", [0.15, 0.15, 0.045], [510.0, 530.0], None),
        ("sheet", [0.14, 0.112, 0.004], [55.0, 63.0], None),
    ];
    for (name, extents, volume, radius) in expected {
        let scene = Scene::named(name).unwrap();
        let (low, high) = scene.mesh().bounds();
        for (got, want) in (high - low).iter().zip(extents) {
            assert!((got / want - 1.0).abs() < 0.12, "{name}: {}", high - low);
        }
        let cubic = 1e6 * scene.mesh().volume();
        assert!(
            (volume[0]..volume[1]).contains(&cubic),
            "{name}: {cubic} cm³"
        );
        assert_eq!(scene.cylinder().map(|c| c[0]), radius, "{name}");
    }
}

/// Index and middle finger come nearer to each other than the camera can tell, over a length; no other pair does.
#[test]
fn two_fingers_of_the_glove_touch() {
    let mesh = Scene::named("glove").unwrap().mesh().clone();
    let v = &mesh.vertices;
    let mut normals = vec![Vector3::zeros(); v.len()];
    for t in &mesh.triangles {
        let face = (v[t[1]] - v[t[0]]).cross(&(v[t[2]] - v[t[0]]));
        t.iter().for_each(|&i| normals[i] += face);
    }
    let faces_another = |i: usize, within: f64| {
        (0..v.len()).any(|j| {
            let d = v[j] - v[i];
            d.norm() < within
                && d.dot(&normals[i]) > 0.3 * d.norm() * normals[i].norm()
                && normals[i].dot(&normals[j]) < -0.5 * normals[i].norm() * normals[j].norm()
        })
    };
    let touching: Vec<&Point3<f64>> = (0..v.len())
        .filter(|&i| faces_another(i, 0.0035))
        .map(|i| &v[i])
        .collect();
    let (low, high) = touching
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), p| {
            (a.min(p.y), b.max(p.y))
        });
    assert!(high - low > 0.010, "they touch from {low} to {high}");
    assert!(
        touching
            .iter()
            .all(|p| (-0.04..0.0).contains(&p.x) && p.y > 0.06),
        "{touching:?}"
    );
}

/// At every size a scene is as long as asked for, and no thinner than its walls.
#[test]
fn scenes_have_the_size_asked_for() {
    for name in SCENES {
        for size in [0.1, 0.17, 0.25] {
            let scene = Scene::sized(name, size).unwrap();
            bounds_a_solid(name, scene.mesh());
            let (low, high) = scene.mesh().bounds();
            // The outermost vertices miss the outermost point by e²/(8R): less than 1 % for edges of a quarter of R.
            let longest = (high - low).max();
            assert!(
                (0.985 * size..1.005 * size).contains(&longest),
                "{name}: {longest}"
            );
        }
        for size in [0.0, 0.3, -0.1, f64::NAN, f64::INFINITY] {
            let refused = Scene::sized(name, size);
            assert!(
                matches!(refused, Err(SimError::BadOption { .. })),
                "{name} {size}"
            );
        }
    }
}

/// A vertical line through the middle leaves a scene above what it rests on: it does not tip over. Its centre of mass lies above the
/// hull of the lowest part of it.
#[test]
fn scenes_lie_stably() {
    for name in SCENES {
        let mesh = Scene::named(name).unwrap().mesh().clone();
        let v = &mesh.vertices;
        let (mut volume, mut moment) = (0.0, Vector3::zeros());
        for t in &mesh.triangles {
            let [a, b, c] = t.map(|i| v[i].coords);
            let part = a.dot(&b.cross(&c)) / 6.0;
            volume += part;
            moment += part * (a + b + c) / 4.0;
        }
        let middle = moment / volume;
        // A soft body settles into its lowest few millimetres.
        let ground = mesh.bounds().0.z + 0.004;
        let feet: Vec<Vector3<f64>> = v
            .iter()
            .filter(|p| p.z < ground)
            .map(|p| p.coords)
            .collect();
        for k in 0..36 {
            let (s, c) = (f64::from(k) * std::f64::consts::TAU / 36.0).sin_cos();
            let way = Vector3::new(c, s, 0.0);
            let farthest = feet
                .iter()
                .map(|f| f.dot(&way))
                .fold(f64::NEG_INFINITY, f64::max);
            assert!(
                farthest > middle.dot(&way) + 0.002,
                "{name} tips over in direction {k}"
            );
        }
    }
}

#[test]
fn an_unknown_scene_is_answered_with_the_names_there_are() {
    let said = Scene::named("spleen").unwrap_err().to_string();
    assert!(said.contains("spleen"));
    for name in SCENES {
        assert!(said.contains(name), "{said}");
    }
}

#[test]
fn the_liver_has_the_size_of_a_liver() {
    let scene = Scene::liver().unwrap();
    let (low, high) = scene.mesh().bounds();
    let size = high - low;
    for (got, want) in size.iter().zip([0.20, 0.13, 0.055]) {
        assert!((got / want - 1.0).abs() < 0.1, "{size:?}");
    }
    // Thick on the right, thin on the left.
    let highest = |left: bool| {
        scene
            .mesh()
            .vertices
            .iter()
            .filter(|p| (p.x > 0.05) == left)
            .map(|p| p.z)
            .fold(0.0, f64::max)
    };
    assert!(highest(false) > 1.5 * highest(true));
}

#[test]
fn triangles_are_even() {
    for name in SCENES {
        let mesh = Scene::named(name).unwrap().mesh().clone();
        let v = &mesh.vertices;
        let mut smallest = f64::INFINITY;
        for t in &mesh.triangles {
            for k in 0..3 {
                let (a, b, c) = (v[t[k]], v[t[(k + 1) % 3]], v[t[(k + 2) % 3]]);
                smallest = smallest.min((b - a).angle(&(c - a)).to_degrees());
            }
        }
        assert!(smallest > 15.0, "{name}: an angle of {smallest} degrees");
    }
}

#[test]
fn an_ellipsoid_has_the_volume_of_an_ellipsoid() {
    let [a, b, c] = [0.06, 0.04, 0.03];
    let mesh = icosphere_like([a, b, c]);
    let exact = 4.0 / 3.0 * std::f64::consts::PI * a * b * c;
    // Flat triangles with edges e cut off about e²/(8R) of depth: 4 mm on 30 mm is 0.07 mm, a quarter of a per cent of the radius.
    assert!(
        (mesh.volume() / exact - 1.0).abs() < 0.01,
        "{}",
        mesh.volume() / exact
    );
    for p in &mesh.vertices {
        let on = Vector3::new(p.x / a, p.y / b, p.z / c).norm();
        assert!((on - 1.0).abs() < 1e-3, "{p} is off the surface: {on}");
    }
}

#[test]
fn what_bounds_no_solid_is_refused() {
    let good = icosphere_like([0.05, 0.05, 0.05]);
    let mut open = good.clone();
    open.triangles.pop();
    assert!(matches!(
        open.into_solid(),
        Err(SimError::NotClosed { triangles: 1, .. })
    ));

    let mut twisted = good.clone();
    twisted.triangles[7].swap(0, 1);
    assert!(matches!(
        twisted.into_solid(),
        Err(SimError::NotOriented { .. })
    ));

    let mut millimetres = good.clone();
    millimetres.vertices.iter_mut().for_each(|p| *p *= 1000.0);
    let error = millimetres.into_solid().unwrap_err();
    assert!(
        matches!(error, SimError::NotInMetres { diagonal } if (diagonal - 173.0).abs() < 2.0),
        "{error}"
    );

    let mut two = good.clone();
    let count = two.vertices.len();
    two.vertices.extend(
        good.vertices
            .iter()
            .map(|p| p + Vector3::new(0.2, 0.0, 0.0)),
    );
    two.triangles
        .extend(good.triangles.iter().map(|t| t.map(|v| v + count)));
    assert_eq!(
        two.into_solid().unwrap_err(),
        SimError::SeveralPieces { pieces: 2 }
    );

    let mut lost = good.clone();
    lost.vertices[3].x = f64::NAN;
    assert!(matches!(
        lost.into_solid(),
        Err(SimError::NonFiniteVertex { index: 3, .. })
    ));

    assert_eq!(
        TriangleMesh::default().into_solid().unwrap_err(),
        SimError::EmptyMesh
    );
    let huge = TriangleMesh {
        vertices: vec![Point3::origin(); 3],
        triangles: vec![[0, 1, 2]; 200_001],
    };
    assert!(matches!(
        huge.into_solid(),
        Err(SimError::TooManyTriangles { count: 200_001, .. })
    ));
    assert!(matches!(
        Scene::named("spleen"),
        Err(SimError::NoSuchScene { .. })
    ));
    assert!(matches!(
        Scene::ellipsoid([0.05, f64::NAN, 0.05]),
        Err(SimError::BadOption { .. })
    ));
}

#[test]
fn an_inside_out_mesh_is_turned() {
    let good = icosphere_like([0.05, 0.04, 0.03]);
    let mut inside_out = good.clone();
    inside_out.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    assert!((inside_out.into_solid().unwrap().volume() - good.volume()).abs() < 1e-12);
}

/// The solid that a file bounds, as `explore run --mesh` takes it.
fn solid(bytes: &[u8], format: Format) -> Result<TriangleMesh, SimError> {
    let mesh = Load::default().apply(parse(bytes, format)?)?;
    TriangleMesh::from(mesh).into_solid()
}

#[test]
fn every_format_gives_the_mesh_back() {
    let mesh = icosphere_like([0.05, 0.04, 0.03]);
    let triangles = mesh.triangles.iter().map(|t| t.map(|v| v as u32)).collect();
    let file = Mesh::new(mesh.vertices.clone()).unwrap();
    let file = file.with_triangles(triangles).unwrap();
    for format in [Format::Ply, Format::Obj, Format::Stl, Format::Off] {
        for encoding in [Encoding::Text, Encoding::Binary] {
            let options = Options::default().with_encoding(encoding);
            let read = solid(&file.to_bytes(format, options).unwrap(), format).unwrap();
            assert_eq!(
                (read.vertices.len(), read.triangles.len()),
                (mesh.vertices.len(), mesh.triangles.len()),
                "{format}"
            );
            // Binary STL is f32: 1e-7 of 0.1 m on each coordinate.
            assert!((read.volume() / mesh.volume() - 1.0).abs() < 1e-5);
        }
    }
}

#[test]
fn a_box_of_quads_is_a_solid() {
    let obj = "v 0 0 0\nv .1 0 0\nv .1 .1 0\nv 0 .1 0\nv 0 0 .1\nv .1 0 .1\nv .1 .1 .1\nv 0 .1 .1\nf 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n";
    let mesh = solid(obj.as_bytes(), Format::Obj).unwrap();
    assert!((mesh.volume() - 1e-3).abs() < 1e-12);
    assert_eq!(mesh.triangles.len(), 12);
    let far = obj.replace("v ", "v 1");
    let two = obj.to_owned() + &far.replace('f', "#");
    assert!(
        solid(two.as_bytes(), Format::Obj).is_ok(),
        "vertices alone are no piece"
    );
}

#[test]
fn broken_files_say_where() {
    let said = |name: &str| {
        let error = Scene::from_file(std::path::Path::new(name), &Load::default());
        error.unwrap_err().to_string()
    };
    assert!(said("nowhere.obj").starts_with("nowhere.obj: "));
    assert!(said("mesh.step").contains("the ending \"step\" is none of"));
    let error = solid(b"v 0 0 0\nv 1 two 0\n", Format::Obj).unwrap_err();
    assert_eq!(error.to_string(), "line 2: \"two\" is not a number");
}

proptest! {
    #[test]
    fn no_bytes_break_a_solid(bytes in proptest::collection::vec(any::<u8>(), 1..9), at in any::<prop::sample::Index>()) {
        let tetrahedron = Mesh::new(vec![
            Point3::origin(), Point3::new(0.1, 0.0, 0.0), Point3::new(0.0, 0.1, 0.0), Point3::new(0.0, 0.0, 0.1),
        ]);
        let tetrahedron = tetrahedron.unwrap().with_triangles(vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]).unwrap();
        for format in [Format::Ply, Format::Obj, Format::Stl, Format::Off] {
            let mut file = tetrahedron.to_bytes(format, Options::default()).unwrap();
            let at = at.index(file.len());
            file.splice(at..(at + bytes.len()).min(file.len()), bytes.iter().copied());
            let _ = solid(&file, format);
        }
    }
}
