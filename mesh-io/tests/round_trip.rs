//! Writing and reading give the same mesh, in every format that can hold it.
#![allow(missing_docs, clippy::unwrap_used, reason = "tests")]

use mesh_io::nalgebra::{Point3, Vector3};
use mesh_io::{Encoding, Format, Mesh, Options, Precision, Property, parse};
use proptest::prelude::*;

/// Any finite number, from the smallest to the largest.
fn coordinate() -> impl Strategy<Value = f64> {
    prop_oneof![
        -1.0..1.0f64,
        prop::num::f64::NORMAL | prop::num::f64::SUBNORMAL | prop::num::f64::ZERO,
    ]
}

/// What fits 32 bits.
fn short(value: f64) -> f64 {
    let value = value as f32;
    if value.is_finite() {
        value.into()
    } else {
        0.25
    }
}

prop_compose! {
    fn mesh()(count in 1..30usize)(
        points in prop::collection::vec(prop::array::uniform3(coordinate()), count),
        normals in prop::option::of(prop::collection::vec(prop::array::uniform3(coordinate()), count)),
        colours in prop::option::of(prop::collection::vec(prop::array::uniform3(any::<u8>()), count)),
        further in prop::collection::vec(prop::collection::vec(coordinate(), count), 0..3),
        triangles in prop::collection::vec(prop::array::uniform3(0..count as u32), 0..20),
    ) -> Mesh {
        let mut mesh = Mesh::new(points.into_iter().map(Point3::from).collect()).unwrap();
        if let Some(normals) = normals {
            mesh = mesh.with_normals(normals.into_iter().map(Vector3::from).collect()).unwrap();
        }
        if let Some(colours) = colours {
            mesh = mesh.with_colours(colours).unwrap();
        }
        for (k, values) in further.into_iter().enumerate() {
            mesh = mesh.with_property(Property::new(&format!("further_{k}"), values)).unwrap();
        }
        // Triangles with a corner twice are none.
        let proper = |[a, b, c]: &[u32; 3]| a != b && b != c && c != a;
        mesh.with_triangles(triangles.into_iter().filter(proper).collect()).unwrap()
    }
}

/// The parts of `mesh` that a format holds.
fn holding(mesh: &Mesh, what: &[&str]) -> Mesh {
    let holds = |part: &str| what.contains(&part);
    let mut kept = Mesh::new(mesh.points().to_vec()).unwrap();
    if holds("normals") && !mesh.normals().is_empty() {
        kept = kept.with_normals(mesh.normals().to_vec()).unwrap();
    }
    if holds("colours") && !mesh.colours().is_empty() {
        kept = kept.with_colours(mesh.colours().to_vec()).unwrap();
    }
    for property in mesh.properties().iter().filter(|_| holds("further")) {
        kept = kept.with_property(property.clone()).unwrap();
    }
    let triangles = if holds("triangles") {
        mesh.triangles()
    } else {
        &[]
    };
    kept.with_triangles(triangles.to_vec()).unwrap()
}

/// Everything rounded to 32 bits.
fn rounded(mesh: &Mesh) -> Mesh {
    let mut kept = Mesh::new(mesh.points().iter().map(|p| p.map(short)).collect()).unwrap();
    if !mesh.normals().is_empty() {
        let normals = mesh.normals().iter().map(|n| n.map(short));
        kept = kept.with_normals(normals.collect()).unwrap();
    }
    if !mesh.colours().is_empty() {
        kept = kept.with_colours(mesh.colours().to_vec()).unwrap();
    }
    for property in mesh.properties() {
        let values = property.values().iter().map(|v| short(*v));
        let property = Property::new(property.name(), values.collect());
        kept = kept.with_property(property).unwrap();
    }
    kept.with_triangles(mesh.triangles().to_vec()).unwrap()
}

/// The bits of all numbers, so that −0 is not 0.
fn bits(mesh: &Mesh) -> Vec<u64> {
    let places = mesh.points().iter().flat_map(|p| p.coords.as_slice());
    let normals = mesh.normals().iter().flat_map(Vector3::as_slice);
    let further = mesh.properties().iter().flat_map(Property::values);
    places
        .chain(normals)
        .chain(further)
        .map(|v| v.to_bits())
        .collect()
}

fn back(mesh: &Mesh, format: Format, options: Options) -> Mesh {
    parse(&mesh.to_bytes(format, options).unwrap(), format).unwrap()
}

const ENCODINGS: [Encoding; 2] = [Encoding::Text, Encoding::Binary];

proptest! {
    #[test]
    fn ply_holds_all_to_the_bit(mesh in mesh()) {
        for encoding in ENCODINGS {
            let double = back(&mesh, Format::Ply, Options::default().with_encoding(encoding));
            prop_assert_eq!(&double, &mesh);
            prop_assert_eq!(bits(&double), bits(&mesh));
            let short = rounded(&mesh);
            let single = Options::default().with_encoding(encoding).with_precision(Precision::Single);
            // Text has as many digits as 32 bits need.
            let read = rounded(&back(&short, Format::Ply, single));
            prop_assert_eq!(&read, &short);
            prop_assert_eq!(bits(&read), bits(&short));
        }
    }

    #[test]
    fn pcd_holds_all_but_triangles(mesh in mesh()) {
        let mesh = holding(&mesh, &["normals", "colours", "further"]);
        for encoding in ENCODINGS {
            let read = back(&mesh, Format::Pcd, Options::default().with_encoding(encoding));
            prop_assert_eq!(&read, &mesh);
            prop_assert_eq!(bits(&read), bits(&mesh));
        }
    }

    #[test]
    fn obj_and_off_hold_all_but_further_numbers(mesh in mesh()) {
        let mesh = holding(&mesh, &["normals", "colours", "triangles"]);
        for format in [Format::Obj, Format::Off] {
            let read = back(&mesh, format, Options::default());
            if format == Format::Obj && !mesh.normals().is_empty() && !mesh.triangles().is_empty() {
                // A vertex that no face uses has no normal in OBJ.
                prop_assert_eq!(read.points(), mesh.points());
                prop_assert_eq!(read.colours(), mesh.colours());
                prop_assert_eq!(read.triangles(), mesh.triangles());
                for v in mesh.triangles().iter().flatten() {
                    prop_assert_eq!(read.normals()[*v as usize], mesh.normals()[*v as usize]);
                }
            } else {
                prop_assert_eq!(read, mesh.clone());
            }
        }
    }

    #[test]
    fn xyz_holds_all_but_triangles(mesh in mesh()) {
        let mesh = holding(&mesh, &["normals", "colours", "further"]);
        let read = back(&mesh, Format::Xyz, Options::default());
        prop_assert_eq!(&read, &mesh);
        prop_assert_eq!(bits(&read), bits(&mesh));
    }

    #[test]
    fn npy_holds_points_and_normals(mesh in mesh()) {
        let mesh = holding(&mesh, &["normals"]);
        let read = back(&mesh, Format::Npy, Options::default());
        prop_assert_eq!(bits(&read), bits(&mesh));
        let short = rounded(&mesh);
        let read = back(&short, Format::Npy, Options::default().with_precision(Precision::Single));
        prop_assert_eq!(bits(&read), bits(&short));
    }

    // STL has no vertices of its own: the corners of the triangles are what is kept.
    #[test]
    fn stl_holds_triangles(mesh in mesh()) {
        if mesh.triangles().is_empty() {
            return Ok(());
        }
        let short = rounded(&mesh);
        let corners = |m: &Mesh| -> Vec<[Point3<f64>; 3]> {
            let corner = |v: u32| m.points()[v as usize];
            // A triangle between two vertices at one place has none of its own in STL.
            let proper = |t: &[Point3<f64>; 3]| t[0] != t[1] && t[1] != t[2] && t[2] != t[0];
            m.triangles().iter().map(|t| t.map(corner)).filter(proper).collect()
        };
        for encoding in ENCODINGS {
            let read = back(&short, Format::Stl, Options::default().with_encoding(encoding));
            prop_assert_eq!(corners(&read), corners(&short));
        }
    }

    // No reader of our own: the parts are where the header says that they are.
    #[test]
    fn glb_is_as_long_as_it_says(mesh in mesh()) {
        let bytes = mesh.to_bytes(Format::Glb, Options::default()).unwrap();
        let word = |at: usize| u32::from_le_bytes(*bytes[at..].first_chunk().unwrap()) as usize;
        prop_assert_eq!(&bytes[..4], b"glTF");
        prop_assert_eq!((word(4), word(8)), (2, bytes.len()));
        let text = std::str::from_utf8(&bytes[20..20 + word(12)]).unwrap();
        let binary = 20 + word(12);
        prop_assert_eq!(bytes.len(), binary + 8 + word(binary));
        let length = format!("\"byteLength\":{}}}]", word(binary));
        prop_assert!(text.contains(&length), "{} in {}", length, text);
        prop_assert_eq!(word(12) % 4 + word(binary) % 4, 0);
    }
}

#[test]
fn a_cloud_is_no_stl_and_an_ending_is_needed() {
    let cloud = Mesh::new(vec![Point3::origin()]).unwrap();
    let error = cloud.to_bytes(Format::Stl, Options::default()).unwrap_err();
    assert!(error.to_string().contains("cloud of points"), "{error}");
    let error = cloud
        .save("points.docx".as_ref(), Options::default())
        .unwrap_err();
    assert!(
        error
            .to_string()
            .starts_with("points.docx: the ending \"docx\" is none of ply"),
        "{error}"
    );
}

#[test]
fn lists_of_another_length_are_refused() {
    let mesh = || Mesh::new(vec![Point3::origin(); 3]).unwrap();
    assert!(mesh().with_normals(vec![Vector3::x()]).is_err());
    assert!(mesh().with_colours(vec![[0; 3]; 4]).is_err());
    assert!(mesh().with_property(Property::new("a b", vec![])).is_err());
    assert!(mesh().with_triangles(vec![[0, 1, 3]]).is_err());
    assert!(Mesh::new(vec![Point3::new(0.0, f64::NAN, 0.0)]).is_err());
    assert_eq!(Property::new("first seen\n", vec![]).name(), "first_seen_");
}
