//! No bytes make a reader panic, hang, or allocate more memory than the size of the file justifies.
#![allow(missing_docs, clippy::unwrap_used, reason = "tests")]

use mesh_io::nalgebra::{Point3, Vector3};
use mesh_io::{Encoding, Format, Load, Mesh, Options, Property, parse, read_table};
use proptest::prelude::*;

const FORMATS: [Format; 7] = [
    Format::Ply,
    Format::Obj,
    Format::Stl,
    Format::Off,
    Format::Pcd,
    Format::Xyz,
    Format::Npy,
];

/// A mesh with a bit of everything.
fn mesh() -> Mesh {
    let point = |k: u32| Point3::new(f64::from(k % 3), f64::from(k / 3), 0.125);
    let mesh = Mesh::new((0..9).map(point).collect()).unwrap();
    let mesh = mesh.with_normals(vec![Vector3::z(); 9]).unwrap();
    let mesh = mesh.with_colours(vec![[1, 128, 255]; 9]).unwrap();
    let mesh = mesh
        .with_property(Property::new("confidence", vec![0.5; 9]))
        .unwrap();
    mesh.with_triangles(vec![[0, 1, 3], [1, 4, 3], [4, 5, 7]])
        .unwrap()
}

fn files() -> Vec<(Format, Vec<u8>)> {
    let mut files = Vec::new();
    for format in FORMATS {
        for encoding in [Encoding::Text, Encoding::Binary] {
            let options = Options::default().with_encoding(encoding);
            files.push((format, mesh().to_bytes(format, options).unwrap()));
        }
    }
    files.push((Format::Pcd, compressed(36)));
    files.push((Format::Ply, b"ply\nformat binary_big_endian 1.0\nelement tristrips 1\nproperty list int int a\nelement vertex 1\nproperty list char short q\nproperty short x\nproperty double y\nproperty uint z\nend_header\n\0\0\0\x01\xff\xff\xff\xff\0\0\x01aaaaaaaabbbb".to_vec()));
    files
}

/// Three points in a compressed block that claims to hold `large` bytes.
fn compressed(large: u32) -> Vec<u8> {
    let mut bytes = b"VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 3\nHEIGHT 1\nDATA binary_compressed\n".to_vec();
    let block = lzf::compress(&[0; 36]).unwrap();
    bytes.extend((block.len() as u32).to_le_bytes());
    bytes.extend(large.to_le_bytes());
    bytes.extend(block);
    bytes
}

/// All operations on a mesh.
fn use_all(bytes: &[u8], format: Format) {
    let _ = read_table(bytes, ["x", "y", "z"]);
    let Ok(mesh) = parse(bytes, format) else {
        return;
    };
    let _ = mesh.unit_normals_or_estimated();
    let _ = mesh_io::estimate_normals(mesh.points());
    let _ = Load::default()
        .with_body(Some(1))
        .with_size(Some(1.0))
        .apply(mesh);
}

/// Ten thousand take two seconds; another count is given with `PROPTEST_CASES`.
fn cases() -> u32 {
    let given = std::env::var("PROPTEST_CASES").ok();
    given.and_then(|n| n.parse().ok()).unwrap_or(10_000)
}

proptest! {
    // Each case tries every format.
    #![proptest_config(ProptestConfig { cases: cases(), ..ProptestConfig::default() })]

    #[test]
    fn any_bytes(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        for format in FORMATS {
            use_all(&bytes, format);
        }
    }

    // Good files with bytes changed, cut out and doubled.
    #[test]
    fn damaged_files(
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>(), 0..4u8), 1..8),
    ) {
        for (format, mut bytes) in files() {
            for (at, byte, what) in &changes {
                if bytes.is_empty() {
                    break;
                }
                let at = at.index(bytes.len());
                match what {
                    0 => bytes[at] = *byte,
                    1 => bytes.truncate(at),
                    2 => bytes.insert(at, *byte),
                    _ => drop(bytes.splice(at..at, *b"9")),
                }
            }
            use_all(&bytes, format);
        }
    }

    // Words of the formats in any order.
    #[test]
    fn words_in_any_order(words in prop::collection::vec(prop::sample::select(WORDS), 0..40)) {
        let text = words.concat();
        for format in FORMATS {
            let head = match format {
                Format::Ply => "ply\n",
                Format::Off => "OFF\n",
                Format::Stl => "solid\nfacet\n",
                _ => "",
            };
            use_all(format!("{head}{text}").as_bytes(), format);
        }
    }
}

const WORDS: &[&str] = &[
    "\n",
    "\n",
    "\n",
    " ",
    " ",
    "1",
    "0",
    "-1",
    "3",
    "1e9",
    "nan",
    "1e400",
    "ply\n",
    "format ascii 1.0\n",
    "format binary_little_endian 1.0\n",
    "element vertex 99999999999\n",
    "element vertex 2\n",
    "element face 2\n",
    "property float x\n",
    "property double y\n",
    "property short z\n",
    "property list uchar int vertex_indices\n",
    "end_header\n",
    "v 0 0 0\n",
    "f 1 2 3 4\n",
    "f -1 -2 -3\n",
    "vn 0 0 1\n",
    "f 1//1 2//1 3//1\n",
    "\\\n",
    "# x\n",
    "vertex 1 2 3\n",
    "endloop\n",
    "facet\n",
    "4 0 1 2 3\n",
    "COFF\n",
    "FIELDS x y z rgb\n",
    "SIZE 4 4 4 4\n",
    "TYPE F F F U\n",
    "COUNT 1 1 1 99999999999\n",
    "WIDTH 2\n",
    "HEIGHT 9999999999999\n",
    "POINTS 2\n",
    "DATA ascii\n",
    "DATA binary\n",
    "DATA binary_compressed\n",
    ",",
    ";",
    "//X Y Z\n",
    "0 0 0\n",
    "1 2 3 0 0 1\n",
];

#[test]
fn counts_alone_take_no_memory() {
    let ply = "ply\nformat binary_little_endian 1.0\nelement vertex 18000000000000000000\nproperty double x\nproperty double y\nproperty double z\nend_header\n1234";
    let error = parse(ply.as_bytes(), Format::Ply).unwrap_err().to_string();
    assert!(
        error.contains("the file ends in vertex 0, the header says 18000000000000000000"),
        "{error}"
    );
    let list = b"ply\nformat binary_little_endian 1.0\nelement vertex 0\nproperty double x\nproperty double y\nproperty double z\nelement face 1\nproperty list uint int vertex_index\nend_header\n\xff\xff\xff\xff";
    assert!(parse(list, Format::Ply).is_err());
    let pcd = b"FIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nPOINTS 9000000000000000000\nDATA binary\nabc";
    assert!(parse(pcd, Format::Pcd).is_err());
    assert_eq!(
        parse(&compressed(36), Format::Pcd).unwrap().points().len(),
        3
    );
    for large in [u32::MAX, 37, 35, 0] {
        assert!(parse(&compressed(large), Format::Pcd).is_err(), "{large}");
    }
}
