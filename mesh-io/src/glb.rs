//! GLB, glTF 2.0 in one binary file, for viewers: positions, normals, colours, further numbers as `_NAME`, and triangles or points.
//!
//! Positions are written unchanged, in metres. By the convention of glTF y points up, but in a camera frame the upward direction is unknown.

use std::fmt::Write as _;
use std::io::{self, Write};

use crate::Mesh;

const FLOAT: u32 = 5126;
const BYTE: u32 = 5121;
const WHOLE: u32 = 5125;

/// The binary chunk, and its description for the JSON chunk.
#[derive(Default)]
struct Body {
    bytes: Vec<u8>,
    views: Vec<String>,
    accessors: Vec<String>,
}

impl Body {
    /// Adds a block of values and returns its index.
    fn add(&mut self, block: &[u8], kind: u32, shape: &str, count: usize, further: &str) -> usize {
        let (start, length) = (self.bytes.len(), block.len());
        self.bytes.extend_from_slice(block);
        let index = self.views.len();
        self.views.push(format!(
            r#"{{"buffer":0,"byteOffset":{start},"byteLength":{length}}}"#
        ));
        self.accessors.push(format!(
            r#"{{"bufferView":{index},"componentType":{kind},"type":"{shape}","count":{count}{further}}}"#
        ));
        index
    }
}

fn floats<'a>(values: impl IntoIterator<Item = &'a f64>) -> Vec<u8> {
    // The format has no representation of unknown values.
    let known = |v: &f64| if v.is_finite() { *v as f32 } else { -1.0 };
    values
        .into_iter()
        .flat_map(|v| known(v).to_le_bytes())
        .collect()
}

/// Writes one node with one primitive. Values that are not finite become −1.
pub fn write(out: &mut dyn Write, mesh: &Mesh) -> io::Result<()> {
    let (mut body, mut attributes, count) = (Body::default(), Vec::new(), mesh.points.len());
    let mut indices = String::new();
    if let Some((low, high)) = mesh.bounds() {
        let single = |p: nalgebra::Point3<f64>| [p.x as f32, p.y as f32, p.z as f32];
        let bounds = format!(r#","min":{:?},"max":{:?}"#, single(low), single(high));
        let positions = floats(mesh.points.iter().flat_map(|p| p.coords.as_slice()));
        let index = body.add(&positions, FLOAT, "VEC3", count, &bounds);
        attributes.push(format!(r#""POSITION":{index}"#));
        if let Ok(normals) = mesh.unit_normals()
            && !normals.is_empty()
        {
            let normals = floats(normals.iter().flat_map(|n| n.as_slice()));
            let index = body.add(&normals, FLOAT, "VEC3", count, "");
            attributes.push(format!(r#""NORMAL":{index}"#));
        }
        if !mesh.colours.is_empty() {
            // Padded to four bytes: attributes begin at multiples of four.
            let colours: Vec<u8> = mesh
                .colours
                .iter()
                .flat_map(|[r, g, b]| [*r, *g, *b, 255])
                .collect();
            let index = body.add(&colours, BYTE, "VEC4", count, r#","normalized":true"#);
            attributes.push(format!(r#""COLOR_0":{index}"#));
        }
        for property in &mesh.properties {
            let index = body.add(&floats(property.values()), FLOAT, "SCALAR", count, "");
            attributes.push(format!(
                r#""_{}":{index}"#,
                property.name().to_ascii_uppercase()
            ));
        }
        if !mesh.triangles.is_empty() {
            let corners: Vec<u8> = mesh
                .triangles
                .iter()
                .flatten()
                .flat_map(|v| v.to_le_bytes())
                .collect();
            let index = body.add(&corners, WHOLE, "SCALAR", 3 * mesh.triangles.len(), "");
            let _ = write!(indices, r#","indices":{index}"#);
        }
    }
    // 4: triangles, 0: points.
    let mode = if mesh.triangles.is_empty() { 0 } else { 4 };
    let mut text = String::from(r#"{"asset":{"version":"2.0"},"scene":0,"#);
    if attributes.is_empty() {
        text.push_str(r#""scenes":[{}]}"#);
    } else {
        let _ = write!(
            text,
            r#""scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0}}],"meshes":[{{"primitives":[{{"attributes":{{{}}}{indices},"mode":{mode}}}]}}],"buffers":[{{"byteLength":{}}}],"bufferViews":[{}],"accessors":[{}]}}"#,
            attributes.join(","),
            body.bytes.len(),
            body.views.join(","),
            body.accessors.join(","),
        );
    }
    while text.len() % 4 != 0 {
        text.push(' ');
    }
    let chunks = [(text.as_bytes(), b"JSON"), (&body.bytes[..], b"BIN\0")];
    let chunks = chunks.iter().filter(|(bytes, _)| !bytes.is_empty());
    let length: usize = 12
        + chunks
            .clone()
            .map(|(bytes, _)| 8 + bytes.len())
            .sum::<usize>();
    out.write_all(b"glTF")?;
    out.write_all(&2u32.to_le_bytes())?;
    out.write_all(&(length as u32).to_le_bytes())?;
    for (bytes, kind) in chunks {
        out.write_all(&(bytes.len() as u32).to_le_bytes())?;
        out.write_all(*kind)?;
        out.write_all(bytes)?;
    }
    out.flush()
}
