//! Files as they occur in practice: the result of reading each, or its error message.
#![allow(missing_docs, clippy::unwrap_used, reason = "tests")]

use std::fmt::Write as _;

use mesh_io::nalgebra::{Point3, Vector3};
use mesh_io::{
    Array, Encoding, Format, Load, Mesh, Options, Units, Up, Vertices, opposing_share, parse,
    read_table,
};

/// A cube of side 1 as quadrilaterals, counter-clockwise from outside.
const CORNERS: [[f64; 3]; 8] = [
    [0., 0., 0.],
    [1., 0., 0.],
    [1., 1., 0.],
    [0., 1., 0.],
    [0., 0., 1.],
    [1., 0., 1.],
    [1., 1., 1.],
    [0., 1., 1.],
];
const QUADS: [[u32; 4]; 6] = [
    [3, 2, 1, 0],
    [4, 5, 6, 7],
    [0, 1, 5, 4],
    [1, 2, 6, 5],
    [2, 3, 7, 6],
    [3, 0, 4, 7],
];

/// Volume of what the triangles enclose.
fn volume(mesh: &Mesh) -> f64 {
    let corner = |v: u32| mesh.points()[v as usize].coords;
    let one = |t: &[u32; 3]| corner(t[0]).dot(&corner(t[1]).cross(&corner(t[2])));
    mesh.triangles().iter().map(one).sum::<f64>() / 6.0
}

fn read(bytes: &[u8], format: Format) -> Mesh {
    parse(bytes, format).unwrap_or_else(|e| panic!("{e}: {}", String::from_utf8_lossy(bytes)))
}

#[track_caller]
fn is_cube(bytes: &[u8], format: Format) -> Mesh {
    let mesh = read(bytes, format).welded();
    assert_eq!((mesh.points().len(), mesh.triangles().len()), (8, 12));
    assert!((volume(&mesh) - 1.0).abs() < 1e-6, "{}", volume(&mesh));
    mesh
}

#[track_caller]
fn refused(bytes: &[u8], format: Format, words: &str) {
    let said = parse(bytes, format).unwrap_err().to_string();
    assert!(said.contains(words), "{words:?} is not in: {said}");
    assert_eq!(said.lines().count(), 1);
}

/// A text PLY of the cube; `head` stands behind the format, `eol` ends each line.
fn ply(head: &str, eol: &str) -> String {
    let mut text = format!(
        "ply\nformat ascii 1.0\n{head}element vertex 8\nproperty double x\nproperty double y\nproperty double z\n\
         element face 6\nproperty list uchar int vertex_indices\nend_header\n"
    );
    for [x, y, z] in CORNERS {
        writeln!(text, "{x} {y} {z}").unwrap();
    }
    for [a, b, c, d] in QUADS {
        writeln!(text, "4 {a} {b} {c} {d}").unwrap();
    }
    text.replace('\n', eol)
}

fn obj_vertices() -> String {
    CORNERS.iter().fold(String::new(), |text, [x, y, z]| {
        text + &format!("v {x} {y} {z}\n")
    })
}

fn obj_faces(word: impl Fn(u32) -> String, eol: &str) -> String {
    QUADS.iter().fold(String::new(), |text, quad| {
        text + "f " + &quad.map(&word).join(" ") + eol
    })
}

/// Binary PLY of the cube in any byte order: a camera in front, lists of every kind around what is wanted.
fn binary_ply(big: bool, eol: &str) -> Vec<u8> {
    let order = if big { "big" } else { "little" };
    let header = format!(
        "ply\nformat binary_{order}_endian 1.0\ncomment M\u{fc}ller, end_header, format ascii 1.0\nobj_info made by hand\n\
         element camera 1\nproperty double x\nproperty double y\nproperty double z\n\
         element vertex 8\nproperty list uint double descriptor\nproperty short x\nproperty uchar red\nproperty uchar green\n\
         property uchar blue\nproperty float quality\nproperty int y\nproperty float64 z\n\
         element face 6\nproperty uchar material\nproperty list uint8 uint32 vertex_index\nproperty list uchar float texcoord\nend_header\n"
    );
    let mut bytes: Vec<u8> = header.replace('\n', eol).chars().map(|c| c as u8).collect();
    let mut put = |mut number: Vec<u8>| {
        if big {
            number.reverse();
        }
        bytes.extend(number);
    };
    for _ in 0..3 {
        put(9.0f64.to_le_bytes().to_vec());
    }
    for (k, [x, y, z]) in CORNERS.into_iter().enumerate() {
        put((k as u32 % 3).to_le_bytes().to_vec());
        (0..k % 3).for_each(|_| put(5.0f64.to_le_bytes().to_vec()));
        put((x as i16).to_le_bytes().to_vec());
        put(vec![200]);
        put(vec![100]);
        put(vec![k as u8]);
        put((k as f32).to_le_bytes().to_vec());
        put((y as i32).to_le_bytes().to_vec());
        put(z.to_le_bytes().to_vec());
    }
    for quad in QUADS {
        put(vec![7]);
        put(vec![4]);
        for v in quad {
            put(v.to_le_bytes().to_vec());
        }
        put(vec![2]);
        for t in [0.5f32, 0.5] {
            put(t.to_le_bytes().to_vec());
        }
    }
    bytes
}

#[test]
fn ply_as_other_programs_write_it() {
    for eol in ["\n", "\r\n", "\r"] {
        is_cube(ply("", eol).as_bytes(), Format::Ply);
        // A remark that says end_header, another that names a format, an empty one, one between element and property.
        let head = "comment data follow end_header\ncomment was format binary_little_endian 1.0\ncomment\nobj_info a tool!\n";
        let text = ply(head, eol).replace(
            "property double y",
            &format!("comment between{eol}property double y"),
        );
        is_cube(text.as_bytes(), Format::Ply);
        is_cube(
            &binary_ply(false, if eol == "\r" { "\n" } else { eol }),
            Format::Ply,
        );
        // Blank lines behind the header.
        is_cube(
            ply("", "\n")
                .replace("end_header\n", "end_header\n\n\n")
                .as_bytes(),
            Format::Ply,
        );
    }
    // Byte-order marks in front of the file and of the data; Latin-1.
    is_cube(format!("\u{feff}{}", ply("", "\n")).as_bytes(), Format::Ply);
    is_cube(
        ply("", "\n")
            .replace("end_header\n", "end_header\n\u{feff}")
            .as_bytes(),
        Format::Ply,
    );
    let latin: Vec<u8> = ply("comment K\u{f6}rper\n", "\n")
        .chars()
        .map(|c| c as u8)
        .collect();
    is_cube(&latin, Format::Ply);
    for big in [false, true] {
        let mesh = is_cube(&binary_ply(big, "\n"), Format::Ply);
        assert_eq!(mesh.colours()[3], [200, 100, 3]);
        assert_eq!(
            mesh.property("quality").unwrap(),
            [0., 1., 2., 3., 4., 5., 6., 7.]
        );
        assert_eq!(mesh.properties().len(), 1);
    }
    // More rows than declared are another element's, or nobody's.
    let fewer = ply("", "\n").replace(
        "element face 6\nproperty list uchar int vertex_indices\n",
        "",
    );
    assert!(read(fewer.as_bytes(), Format::Ply).triangles().is_empty());
}

#[test]
fn ply_strips_turn_every_second_triangle() {
    // The sides of a prism, then a strip of its own for each lid.
    let text = "ply\nformat ascii 1.0\nelement vertex 6\nproperty float x\nproperty float y\nproperty float z\nelement tristrips 1\n\
        property list int int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 1\n0 1 1\n\
        16 0 3 2 5 1 4 0 3 -1 0 2 1 -1 3 4 5\n";
    let mesh = read(text.as_bytes(), Format::Ply);
    assert_eq!(mesh.triangles().len(), 8);
    assert!(
        (volume(&mesh).abs() - 0.5).abs() < 1e-12,
        "{}",
        volume(&mesh)
    );
}

#[test]
fn ply_refusals_name_line_and_reason() {
    let good = ply("", "\n");
    let has = |old: &str, new: &str| good.replacen(old, new, 1).into_bytes();
    for (bytes, words) in [
        (b"x y z\n1 2 3\n".to_vec(), "line 1: not a PLY file"),
        (Vec::new(), "there is no end_header"),
        (
            b"ply\nformat ascii 1.0\nend_header\n".to_vec(),
            "line 3: the header names no element vertex",
        ),
        (
            has("ascii 1.0", "ascii 2.0"),
            "line 2: not a format of version 1.0",
        ),
        (
            has(
                "element face",
                "element vertex 1\nproperty double x\nelement face",
            ),
            "line 7: a second element vertex: \"element vertex 1\"",
        ),
        (
            has("double y", "real y"),
            "line 5: not a property of an element: \"property real y\"",
        ),
        (
            has("double y", "double q"),
            "element vertex has no property y",
        ),
        (
            has("vertex 8", "vertex many"),
            "line 3: not a number of elements",
        ),
        (
            has("vertex 8", "vertex 9"),
            "line 18: vertex 8: an extra value: \"1\"",
        ),
        (
            has("face 6", "face 7"),
            "line 23: the file ends at face 6, the header says 7",
        ),
        (
            has("\n1 1 0\n", "\n1 nan 0\n"),
            "line 12: vertex 2: y is NaN",
        ),
        (
            has("\n1 1 0\n", "\n1 1\n"),
            "line 12: vertex 2: z is missing",
        ),
        (
            has("\n1 1 0\n", "\n1 l 0\n"),
            "line 12: vertex 2: y is not a number: \"l\"",
        ),
        (
            has("\n4 3 2 1 0", "\n4 3 2 1 8"),
            "face 0 uses vertex 8, but there are only 8",
        ),
        (
            has("\n4 3 2 1 0", "\n4 3 2 1 -1"),
            "line 18: face 0: -1 is not the index of a vertex",
        ),
        (
            has("\n4 3 2 1 0", "\n-4 3 2 1 0"),
            "line 18: face 0: vertex_indices cannot have -4 values",
        ),
        (
            has("list uchar int", "list float int"),
            "not a property of an element",
        ),
    ] {
        refused(&bytes, Format::Ply, words);
    }
    let bytes = binary_ply(false, "\n");
    let end = bytes.len() - 3;
    refused(
        &bytes[..end],
        Format::Ply,
        "the file ends in face 5, the header says 6",
    );
}

#[test]
fn obj_as_other_programs_write_it() {
    let number = |v: u32| (v + 1).to_string();
    let vertices = obj_vertices();
    let lf = obj_faces(number, "\n");
    for text in [
        vertices.clone() + &lf,
        (vertices.clone() + &lf).replace('\n', "\r\n"),
        format!("\u{feff}{vertices}{lf}"),
        // Tabs, remarks behind a face, a face over two lines, other words.
        vertices.replace(' ', "\t") + &obj_faces(number, " # last\n"),
        vertices.clone() + &lf.replacen("f 4 3", "f 4 3 \\\n", 1),
        format!(
            "mtllib a.mtl\no cube\n{vertices}vt 0 0\ns off\ng a\nusemtl b\n{}",
            obj_faces(|v| format!("{}/1", v + 1), "\n")
        ),
        // From the last backwards, with normals behind two slashes.
        vertices.clone() + "vn 0 0 1\n" + &obj_faces(|v| format!("-{}//-1", 8 - v), "\n"),
        // A block of vertices for each face.
        QUADS.iter().fold(String::new(), |text, quad| {
            let rows = quad
                .map(|v| CORNERS[v as usize])
                .map(|[x, y, z]| format!("v {x} {y} {z}\n"));
            text + &rows.concat() + "f -4 -3 -2 -1\n"
        }),
        // Faces in front of their vertices.
        lf.clone() + &vertices,
    ] {
        is_cube(text.as_bytes(), Format::Obj);
    }
    let latin: Vec<u8> = format!("# K\u{f6}rper\nusemtl Stra\u{df}e\n{vertices}{lf}")
        .chars()
        .map(|c| c as u8)
        .collect();
    is_cube(&latin, Format::Obj);
    let coloured = vertices.replace('\n', " 0.2 0.4 1\n") + &lf;
    assert_eq!(
        is_cube(coloured.as_bytes(), Format::Obj).colours()[7],
        [51, 102, 255]
    );
    let bytes = vertices.replace('\n', " 51 102 255\n") + &lf;
    assert_eq!(
        is_cube(bytes.as_bytes(), Format::Obj).colours()[7],
        [51, 102, 255]
    );
}

#[test]
fn obj_refusals_name_line_and_reason() {
    let vertices = obj_vertices();
    let with = |line: &str| format!("{vertices}{line}\n").into_bytes();
    let wide: Vec<u8> = vertices
        .encode_utf16()
        .fold(vec![0xff, 0xfe], |mut bytes, unit| {
            bytes.extend(unit.to_le_bytes());
            bytes
        });
    for (bytes, words) in [
        (wide, "byte 0: this is UTF-16 text"),
        (
            b"hello\n".to_vec(),
            "there is no vertex (a line that begins with v)",
        ),
        (with("v 1 two 3"), "line 9: \"two\" is not a number"),
        (with("v 1 2"), "line 9: a vertex needs three coordinates"),
        (with("v 1 2 inf"), "line 9: vertex 8: z is inf"),
        (with("f 1 2"), "line 9: a face with 2 corners"),
        (
            with("f 1 2 0"),
            "line 9: \"0\" is not the index of a vertex (8 so far)",
        ),
        (with("f 1 2 -9"), "\"-9\" is not the index of a vertex"),
        (
            with("f 1 2 9"),
            "face 0 uses vertex 8, but there are only 8",
        ),
        (
            with("f 1//1 2//1 3//1"),
            "\"1\" is not the index of a normal (0 so far)",
        ),
    ] {
        refused(&bytes, Format::Obj, words);
    }
}

fn cube() -> Mesh {
    is_cube(
        (obj_vertices() + &obj_faces(|v| (v + 1).to_string(), "\n")).as_bytes(),
        Format::Obj,
    )
}

#[test]
fn stl_as_other_programs_write_it() {
    let binary = cube().to_bytes(Format::Stl, Options::default()).unwrap();
    let mut named = binary.clone();
    named[..80].copy_from_slice(format!("{:80}", "solid part").as_bytes());
    let text = Options::default().with_encoding(Encoding::Text);
    let text = String::from_utf8(cube().to_bytes(Format::Stl, text).unwrap()).unwrap();
    let long = text.replace("mesh", &"x".repeat(300));
    let nan = regex_free(&text, "facet normal", "facet normal nan nan nan");
    for bytes in [
        binary.clone(),
        named.clone(),
        [&binary[..], &[0; 16]].concat(),
        [&named[..], &[0; 16]].concat(),
        text.clone().into_bytes(),
        text.to_uppercase().into_bytes(),
        text.replace('\n', "\r\n").into_bytes(),
        long.into_bytes(),
        nan.into_bytes(),
    ] {
        is_cube(&bytes, Format::Stl);
    }
    for (bytes, words) in [
        (
            binary[..binary.len() - 30].to_vec(),
            "byte 80: the header says 12 triangles, which take 684 bytes; the file has 654",
        ),
        (
            [&binary[..80], &[0; 4], &binary[84..]].concat(),
            "byte 80: the header says 0 triangles, which take 84 bytes; the file has 684",
        ),
        (
            b"hello".to_vec(),
            "byte 0: neither text that begins with \"solid\" nor long enough",
        ),
        (
            text.replacen("vertex 0", "vertex x", 1).into_bytes(),
            "\"x\" is not a number",
        ),
        (
            text.as_bytes()[..text.find("endloop").unwrap()].to_vec(),
            "the file ends in a facet",
        ),
        (
            text.replacen("vertex", "vortex", 1).into_bytes(),
            "line 7: a facet with 2 corners",
        ),
    ] {
        refused(&bytes, Format::Stl, words);
    }
}

/// Every line that begins with `start` becomes `line`.
fn regex_free(text: &str, start: &str, line: &str) -> String {
    let lines = text
        .lines()
        .map(|l| if l.starts_with(start) { line } else { l });
    lines.collect::<Vec<_>>().join("\n") + "\n"
}

#[test]
fn off_as_other_programs_write_it() {
    let rows = CORNERS.map(|[x, y, z]| format!("{x} {y} {z}\n")).concat();
    let faces = QUADS
        .map(|[a, b, c, d]| format!("4 {a} {b} {c} {d}\n"))
        .concat();
    is_cube(
        format!("OFF\n# a cube\n8 6 12\n\n{rows}{faces}").as_bytes(),
        Format::Off,
    );
    is_cube(
        format!(
            "OFF 8 6 0\r\n{rows}{}",
            faces.replace('\n', " 255 0 0 # red\n")
        )
        .as_bytes(),
        Format::Off,
    );
    let coloured = format!(
        "COFF\n8 6 0\n{}{faces}",
        rows.replace('\n', " 0.2 0.4 1 1\n")
    );
    assert_eq!(
        is_cube(coloured.as_bytes(), Format::Off).colours()[0],
        [51, 102, 255]
    );
    let bytes = format!(
        "COFF\n8 6 0\n{}{faces}",
        rows.replace('\n', " 51 102 255 255\n")
    );
    assert_eq!(
        is_cube(bytes.as_bytes(), Format::Off).colours()[0],
        [51, 102, 255]
    );
    for (text, words) in [
        ("4OFF\n1 0 0\n0 0 0 0\n", "line 1: \"4OFF\" is not OFF"),
        (
            "OFF\nmany\n",
            "line 2: expected the numbers of vertices and faces",
        ),
        (
            "OFF\n2 0 0\n0 0 0\n",
            "line 3: the file ends before vertex 1, the header says 2",
        ),
        (
            "NOFF\n1 0 0\n0 0 0\n",
            "line 3: vertex 0: expected 6 numbers, found 3",
        ),
        (
            "OFF\n1 1 0\n0 0 0\n3 0 0\n",
            "line 4: face 0: the line says 3 corners, but 2 numbers follow",
        ),
    ] {
        refused(text.as_bytes(), Format::Off, words);
    }
}

#[test]
fn pcd_as_other_programs_write_it() {
    let header = |fields: &str, data: &str| {
        format!(
            "# .PCD v.7 - Point Cloud Data file format\nVERSION .7\n{fields}\nWIDTH 3\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 3\nDATA {data}\n"
        )
    };
    let packed = header(
        "FIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 1",
        "ascii",
    );
    // 4210752 is the number whose bits are 0x4A808080.
    let cloud = read(
        format!("{packed}0 0 1 4210752\nnan nan nan 0\n1 2 3 0\n").as_bytes(),
        Format::Pcd,
    );
    assert_eq!(
        cloud.points(),
        [Point3::new(0., 0., 1.), Point3::new(1., 2., 3.)]
    );
    assert_eq!((cloud.colours()[0], cloud.left_out()), ([0x80; 3], 1));
    // Padding between fields, a histogram, normals under their long names, 16-bit coordinates; colours whose bits are no number.
    let fields = "FIELDS x y _ z normal_x normal_y normal_z vfh rgba intensity\nSIZE 2 2 1 2 4 4 4 4 4 1\nTYPE I I U I F F F F F U\nCOUNT 1 1 3 1 1 1 1 2 1 1";
    let row = |k: i16| {
        let mut row = [k, -k].map(i16::to_le_bytes).concat();
        row.extend([9; 3]);
        row.extend(7i16.to_le_bytes());
        for v in [0.0f32, 0.0, 1.0, 5.0, 6.0] {
            row.extend(v.to_le_bytes());
        }
        row.extend([1, 2, 0x83, 0xff, 40]);
        row
    };
    let rows: Vec<Vec<u8>> = (1..4).map(row).collect();
    let binary = [header(fields, "binary").into_bytes(), rows.concat()].concat();
    let columns =
        |from: usize, size: usize| rows.iter().flat_map(move |r| r[from..from + size].to_vec());
    let sizes = [2, 2, 3, 2, 4, 4, 4, 8, 4, 1];
    let mut at = 0;
    let by_field: Vec<u8> = sizes
        .iter()
        .flat_map(|size| {
            at += size;
            columns(at - size, *size)
        })
        .collect();
    let block = lzf::compress(&by_field).unwrap();
    let mut compressed = header(fields, "binary_compressed").into_bytes();
    compressed.extend((block.len() as u32).to_le_bytes());
    compressed.extend((by_field.len() as u32).to_le_bytes());
    compressed.extend(&block);
    for bytes in [&binary, &compressed] {
        let cloud = read(bytes, Format::Pcd);
        assert_eq!(cloud.points()[2], Point3::new(3., -3., 7.));
        assert_eq!(cloud.normals()[1], Vector3::z());
        assert_eq!(cloud.colours()[1], [0x83, 2, 1]);
        assert_eq!(cloud.property("intensity").unwrap(), [40.0; 3]);
    }
    for (bytes, words) in [
        (
            binary[..binary.len() - 1].to_vec(),
            "the header says 3 points of 34 bytes, but there are 101 bytes",
        ),
        (
            compressed[..compressed.len() - 1].to_vec(),
            "compressed bytes, but",
        ),
        (
            format!("{packed}0 0 1 0\n").into_bytes(),
            "line 12: the file ends at point 1, the header says 3",
        ),
        (
            format!("{packed}0 0 1 0\n0 inf 0 0\n").into_bytes(),
            "line 13: vertex 1: y is inf",
        ),
        (b"hello\n".to_vec(), "line 1: not a PCD file"),
        (
            b"FIELDS x y\nSIZE 4 4\nTYPE F F\nPOINTS 0\nDATA ascii\n".to_vec(),
            "there is no field z",
        ),
        (
            b"FIELDS x y z\nSIZE 4 4\nTYPE F F\nPOINTS 0\nDATA ascii\n".to_vec(),
            "3 FIELDS, 2 SIZE",
        ),
    ] {
        refused(&bytes, Format::Pcd, words);
    }
}

#[test]
fn xyz_as_other_programs_write_it() {
    let point = Point3::new(1.0, 2.5, -3.0);
    for text in [
        "1 2.5 -3\n",
        "1,2.5,-3\r\n",
        "1;2.5;-3\n",
        "\u{feff}# a scan\n\n1\t2.5\t-3\n",
        "x,y,z\n1,2.5,-3\n",
        "1\n1 2.5 -3\n",
        "//X Y Z R G B\n1 2.5 -3 1 2 3\n",
        "1 2.5 -3 10 20 30\n",
        "1 2.5 -3 0 0 1\n",
        "1 2.5 -3 77\n",
        "1 2.5 -3 -5 1 2 3\n",
    ] {
        assert_eq!(
            read(text.as_bytes(), Format::Xyz).points(),
            [point],
            "{text}"
        );
    }
    assert_eq!(
        read(b"1 2 3 10 20 30\n", Format::Xyz).colours(),
        [[10, 20, 30]]
    );
    assert_eq!(
        read(b"1 2 3 0 0.6 0.8\n", Format::Xyz).normals(),
        [Vector3::new(0.0, 0.6, 0.8)]
    );
    let nine = read(b"1 2 3 0 0 1 10 20 30\n", Format::Xyz);
    assert_eq!(
        (nine.normals()[0], nine.colours()[0]),
        (Vector3::z(), [10, 20, 30])
    );
    let named = read(
        b"Z,X,Y,confidence,R,G,B\n3,1,2,0.5,0.2,0.4,1\n",
        Format::Xyz,
    );
    assert_eq!(
        (named.points()[0], named.colours()[0]),
        (Point3::new(1., 2., 3.), [51, 102, 255])
    );
    assert_eq!(named.property("confidence").unwrap(), [0.5]);
    for (text, words) in [
        ("1 2 3\n1 2\n", "line 2: 2 values, but there are 3 columns"),
        ("1 2 3\n1 2 x\n", "line 2: value 3: \"x\" is not a number"),
        (
            "1 2\n",
            "line 1: 2 numbers a line: expected 3, 4, 6, 7 or 9 numbers",
        ),
        ("1 2 nan\n", "line 1: vertex 0: z is NaN"),
        (
            "2\n1 2 3\n",
            "the first line says 2 points, but there are 1",
        ),
        (
            "hello\n",
            "line 1: \"hello\" is neither a point nor the number of points",
        ),
    ] {
        refused(text.as_bytes(), Format::Xyz, words);
    }
}

#[test]
fn npy_of_any_type_and_order() {
    let array = |descr: &str, fortran: &str, shape: &str, data: &[u8]| {
        let header =
            format!("{{'descr': '{descr}', 'fortran_order': {fortran}, 'shape': {shape}, }}\n");
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((header.len() as u16).to_le_bytes());
        [&bytes[..], header.as_bytes(), data].concat()
    };
    let rows = [1.0f32, 2.0, 3.0, 4.0, 5.0, 6.0];
    let little: Vec<u8> = rows.iter().flat_map(|v| v.to_le_bytes()).collect();
    let big: Vec<u8> = [1i16, 4, 2, 5, 3, 6]
        .iter()
        .flat_map(|v| v.to_be_bytes())
        .collect();
    for bytes in [
        array("<f4", "False", "(2, 3)", &little),
        array(">i2", "True", "(2, 3)", &big),
    ] {
        assert_eq!(
            read(&bytes, Format::Npy).points(),
            [Point3::new(1., 2., 3.), Point3::new(4., 5., 6.)]
        );
    }
    let six = read(&array("<f4", "False", "(1, 6)", &little), Format::Npy);
    assert_eq!(six.normals(), [Vector3::new(4., 5., 6.)]);
    refused(
        &array("<f4", "False", "(9, 3)", &little),
        Format::Npy,
        "the header says 9 rows of 3 numbers, but 24 bytes follow",
    );
    refused(
        &array("<f4", "False", "(2, 4)", &little),
        Format::Npy,
        "shape [2, 4]: expected (n, 3) or (n, 6)",
    );
    refused(
        &array("<U8", "False", "(2, 3)", &little),
        Format::Npy,
        "an array of <U8: expected numbers",
    );
    // Arrays of any shape, in either order.
    let values: Vec<u8> = (0..24_u8).collect();
    let plain = Array::parse(&array("|u1", "False", "(2, 3, 4)", &values)).unwrap();
    assert_eq!(plain.shape, [2, 3, 4]);
    assert_eq!(plain.values, (0..24).map(f64::from).collect::<Vec<_>>());
    let fortran = Array::parse(&array("|u1", "True", "(2, 3, 4)", &values)).unwrap();
    let places = (0..24).map(|k| (k / 12 + 2 * (k / 4 % 3) + 6 * (k % 4)).into());
    assert_eq!(fortran.values, places.collect::<Vec<f64>>());
    let short = Array::parse(&array("<f8", "False", "(2, 3, 4)", &values)).unwrap_err();
    assert!(
        short
            .to_string()
            .contains("shape [2, 3, 4], but 24 bytes follow"),
        "{short}"
    );
    let huge = array("<f8", "False", "(4294967296, 4294967296, 3)", &values);
    assert!(Array::parse(&huge).is_err());
    refused(b"hello", Format::Npy, "not a NumPy file");
}

#[test]
fn seams_soups_and_what_no_face_uses() {
    // Every quad with corners of its own, slightly off, and a vertex of no face far away: the cube all the same.
    let mut text = String::from("v 300 300 300\n");
    for (k, quad) in QUADS.iter().enumerate() {
        for v in quad {
            let [x, y, z] = CORNERS[*v as usize];
            writeln!(text, "v {} {y} {z}", x + 1e-7 * k as f64).unwrap();
        }
        text += "f -4 -3 -2 -1\n";
    }
    is_cube(text.as_bytes(), Format::Obj);
    let kept = Load::default()
        .with_vertices(Vertices::AsInFile)
        .apply(read(text.as_bytes(), Format::Obj))
        .unwrap();
    assert_eq!(kept.points().len(), 25);
    // Two cubes that touch along a face are two.
    let second = CORNERS
        .map(|[x, y, z]| format!("v {} {y} {z}\n", x + 1.0))
        .concat();
    let touching = obj_vertices()
        + &obj_faces(|v| (v + 1).to_string(), "\n")
        + &second
        + &obj_faces(|v| (v + 9).to_string(), "\n");
    let two = read(touching.as_bytes(), Format::Obj).welded();
    assert_eq!((two.points().len(), two.bodies().len()), (16, 2));
    // What is no triangle is none.
    let flat = obj_vertices() + "f 1 1 2\nf 1 2 3\nf 1 2 3\n";
    assert_eq!(read(flat.as_bytes(), Format::Obj).triangles().len(), 2);
}

#[test]
fn units_size_up_and_bodies() {
    let two = cube().to_bytes(Format::Obj, Options::default()).unwrap();
    let mut two = String::from_utf8(two).unwrap();
    two += "v 9 0 0\nv 9 1 0\nv 9 0 5\nf 9 10 11\n";
    let mesh = || read(two.as_bytes(), Format::Obj);
    let load = Load::default().with_extent([0.001, 0.1]);
    let error = load.apply(mesh()).unwrap_err().to_string();
    assert!(
        error.contains("10.3 m across, outside 0.001 m to 0.1 m") && error.contains("--units mm"),
        "{error}"
    );
    let small = load.with_units(Units::MILLIMETRES).apply(mesh()).unwrap();
    assert!((small.diagonal() - 0.0103).abs() < 1e-4);
    let first = load
        .with_size(Some(0.02))
        .with_body(Some(1))
        .apply(mesh())
        .unwrap();
    assert_eq!(first.triangles().len(), 12);
    assert!((first.diagonal() - 0.02 * 3f64.sqrt()).abs() < 1e-12);
    let second = Load::default()
        .with_body(Some(2))
        .with_up(Up::Y)
        .apply(mesh())
        .unwrap();
    assert!(
        second
            .points()
            .iter()
            .any(|p| *p == Point3::new(0.0, 9.0, 1.0)),
        "{second:?}"
    );
    assert!((second.points().len(), second.triangles().len()) == (3, 1));
    let error = Load::default()
        .with_body(Some(3))
        .apply(mesh())
        .unwrap_err()
        .to_string();
    assert_eq!(
        error,
        "there is no body 3: the number of bodies in the mesh is 2 (the largest is --body 1)"
    );
}

/// A program that takes the options of a file.
#[derive(Debug, clap::Parser)]
struct Program {
    #[command(flatten)]
    loading: mesh_io::program::Loading,
}

#[test]
fn options_of_a_file_are_understood_or_refused() {
    let parse = |words: &[&str]| {
        let words = ["program"].iter().chain(words);
        <Program as clap::Parser>::try_parse_from(words)
    };
    let words = ["--units", "mm", "--up", "y", "--body", "2"];
    let load = parse(&words).unwrap().loading.of(Load::default());
    assert_eq!(load.units, Units::MILLIMETRES);
    assert_eq!((load.up, load.body, load.size), (Up::Y, Some(2), None));
    for (option, given, words) in [
        (
            "--units",
            "inch",
            "expected m, cm, mm or the length of a unit in metres",
        ),
        ("--size", "-1", "-1 is not positive"),
        ("--size", "nan", "'nan' is not a finite number"),
        ("--up", "w", "x, y or z"),
        ("--body", "0", "0 is not an integer of at least 1"),
    ] {
        let error = parse(&[&format!("{option}={given}")]).unwrap_err();
        let error = error.to_string();
        assert!(error.contains(words) && error.contains(option), "{error}");
    }
}

/// Points of a sphere at equal distances (a spiral).
fn sphere(count: usize) -> Vec<Point3<f64>> {
    let point = |i: usize| {
        let z = 1.0 - (2 * i + 1) as f64 / count as f64;
        let a = std::f64::consts::PI * (1.0 + 5f64.sqrt()) * i as f64;
        let s = (1.0 - z * z).sqrt();
        Point3::new(s * a.cos(), s * a.sin(), z)
    };
    (0..count).map(point).collect()
}

#[test]
fn estimated_normals_point_outward() {
    let points = sphere(600);
    let normals = mesh_io::estimate_normals(&points);
    for (p, n) in points.iter().zip(&normals) {
        assert!(p.coords.dot(n) > 0.98, "{p} {n:?}");
    }
    assert!(opposing_share(&points, &normals) <= 0.0);
    let either: Vec<_> = normals
        .iter()
        .enumerate()
        .map(|(k, n)| if k * k % 7 < 3 { -*n } else { *n })
        .collect();
    assert!((0.3..0.7).contains(&opposing_share(&points, &either)));
    // Two pieces, points twice, one alone, one only.
    let both: Vec<_> = points
        .iter()
        .flat_map(|p| [*p, *p, p + Vector3::new(50., 0., 0.)])
        .chain([Point3::new(1e3, 0., 0.)])
        .collect();
    let normals = mesh_io::estimate_normals(&both);
    assert!(
        both.iter()
            .zip(&normals)
            .take(1800)
            .all(
                |(p, n)| (p.coords - Vector3::new(50. * (p.x / 50.).round(), 0., 0.)).dot(n) > 0.9
            )
    );
    assert_eq!(
        mesh_io::estimate_normals(&both[..2]),
        [Vector3::z_axis(); 2]
    );
    assert!(mesh_io::estimate_normals(&[]).is_empty());
    assert_eq!(
        mesh_io::estimate_normals(&[Point3::new(1e200, 0., 0.), Point3::origin()]).len(),
        2
    );
}

#[test]
fn normals_come_from_the_file_the_triangles_or_the_neighbours() {
    let mesh = cube();
    let out = mesh.unit_normals_or_estimated().unwrap();
    assert!(
        mesh.points()
            .iter()
            .zip(out)
            .all(|(p, n)| (p - Point3::new(0.5, 0.5, 0.5)).dot(&n) > 0.5)
    );
    let given = mesh
        .clone()
        .with_normals(vec![Vector3::new(0., 0., 1e-200); 8])
        .unwrap();
    assert_eq!(
        given.unit_normals_or_estimated().unwrap(),
        [Vector3::z_axis(); 8]
    );
    let mut zero = vec![Vector3::z(); 8];
    zero[5] = Vector3::zeros();
    let error = mesh
        .clone()
        .with_normals(zero.clone())
        .unwrap()
        .unit_normals()
        .unwrap_err();
    assert_eq!(
        error.to_string(),
        "vertex 5: the normal (0, 0, 0) is zero or not finite"
    );
    zero[5].y = f64::INFINITY;
    assert!(mesh.with_normals(zero).unwrap().unit_normals().is_err());
}

#[test]
fn tables_as_other_programs_write_them() {
    for text in [
        "1,2\n3,4\n",
        "1;2\n3;4\n",
        "1\t2\n3\t4\n",
        "1 2\n3 4\n",
        "1,2,\n3,4,\n",
        "\u{feff}a,b\r\n1,2\r\n\r\n3,4",
        "# x\n\"A\",\"B\"\n1, 2\n3, 4\n",
    ] {
        let table =
            read_table(text.as_bytes(), ["a", "b"]).unwrap_or_else(|e| panic!("{e}: {text}"));
        assert_eq!(table.rows, [[1.0, 2.0], [3.0, 4.0]], "{text}");
    }
    for (text, words) in [
        ("1,2,3\n", "line 1: 3 values, but there are 2 columns"),
        (
            "1,2\n3,x\n",
            "line 2: column b: \"x\" is not a finite number",
        ),
        (
            "1,2\n3,nan\n",
            "line 2: column b: \"nan\" is not a finite number",
        ),
        (
            "b,a\n1,2\n",
            "line 1: column \"b\" stands where \"a\" belongs",
        ),
        ("a,b\na,b\n", "line 2: column a: \"a\""),
    ] {
        let said = read_table(text.as_bytes(), ["a", "b"])
            .unwrap_err()
            .to_string();
        assert!(said.contains(words), "{said}");
    }
}

#[test]
fn errors_name_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cube.ply");
    let said = mesh_io::read(&path).unwrap_err().to_string();
    assert!(said.contains("cube.ply: "), "{said}");
    std::fs::write(&path, ply("", "\n").replace("4 3 2 1 0", "4 3 2 1 x")).unwrap();
    let said = Load::default().read(&path).unwrap_err().to_string();
    assert!(
        said.ends_with("cube.ply: line 18: face 0: vertex_indices is not a number: \"x\""),
        "{said}"
    );
    cube().save(&path, Options::default()).unwrap();
    assert_eq!(Load::default().read(&path).unwrap(), cube());
}

/// Reads a million points with normals; prints how long it took.
#[test]
#[ignore = "a measurement: cargo test --release -p mesh-io --test cases -- --ignored --nocapture million"]
#[allow(clippy::print_stdout)]
fn a_million_points() {
    let points: Vec<_> = (0..1_000_000)
        .map(|k| Point3::new(f64::from(k % 1000), f64::from(k / 1000), 0.5))
        .collect();
    let cloud = Mesh::new(points)
        .unwrap()
        .with_normals(vec![Vector3::z(); 1_000_000])
        .unwrap();
    for format in [Format::Ply, Format::Pcd, Format::Npy] {
        let bytes = cloud.to_bytes(format, Options::default()).unwrap();
        let start = std::time::Instant::now();
        let read = parse(&bytes, format).unwrap();
        println!("{format}: {:.0} ms", 1e3 * start.elapsed().as_secs_f64());
        assert_eq!(read, cloud);
    }
}
