//! With the feature `serde`, meshes, tables and options come back from JSON as they went, and what is no mesh is refused.
#![cfg(feature = "serde")]
#![allow(missing_docs, clippy::unwrap_used, reason = "a test may panic")]

use mesh_io::nalgebra::{Point3, Vector3};
use mesh_io::{Array, Encoding, Load, Mesh, Options, Property, Table, Units, Up, read_table};
use serde::{Serialize, de::DeserializeOwned};

fn comes_back<T: Serialize + DeserializeOwned + PartialEq + std::fmt::Debug>(value: &T) {
    let text = serde_json::to_string(value).unwrap();
    assert_eq!(&serde_json::from_str::<T>(&text).unwrap(), value);
}

fn mesh() -> Mesh {
    let corners = [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.3, 0.7]].map(Point3::from);
    let mesh = Mesh::new(corners.to_vec()).unwrap();
    let mesh = mesh.with_triangles(vec![[0, 1, 2]]).unwrap();
    let mesh = mesh.with_normals(vec![Vector3::z(); 3]).unwrap();
    let mesh = mesh.with_colours(vec![[1, 2, 3]; 3]).unwrap();
    let confidence = Property::new("confidence", vec![0.1, 0.2, 0.3]);
    mesh.with_property(confidence).unwrap()
}

#[test]
fn everything_comes_back() {
    comes_back(&mesh());
    comes_back(&Mesh::default());
    comes_back(
        &Load::default()
            .with_units("0.0254".parse().unwrap())
            .with_up(Up::X),
    );
    comes_back(&read_table(b"x,y\n1,2\n3,4.5\n", ["x", "y"]).unwrap());
    let array: Array = serde_json::from_str(r#"{"shape":[2],"values":[1.0,2.5]}"#).unwrap();
    comes_back(&array);
    let options = Options::default()
        .with_encoding(Encoding::Text)
        .with_comment("a remark");
    let text = serde_json::to_string(&options).unwrap();
    assert_eq!(serde_json::from_str::<Options>(&text).unwrap(), options);
}

#[test]
fn what_does_not_fit_together_is_refused() {
    let good = serde_json::to_value(mesh()).unwrap();
    for (part, bad) in [
        ("triangles", serde_json::json!([[0, 1, 3]])),
        ("normals", serde_json::json!([[0.0, 0.0, 1.0]])),
        ("colours", serde_json::json!([[0, 0, 1]])),
        (
            "properties",
            serde_json::json!([{ "name": "short", "values": [1.0] }]),
        ),
    ] {
        let mut broken = good.clone();
        broken[part] = bad;
        assert!(serde_json::from_value::<Mesh>(broken).is_err(), "{part}");
    }
    assert!(serde_json::from_str::<Units>("0.0").is_err());
    let ragged = r#"{"rows":[[1.0,2.0],[1.0]],"lines":[1,2],"headed":false}"#;
    assert!(serde_json::from_str::<Table<2>>(ragged).is_err());
}
