//! Writes a mesh as PLY.

use std::io::{self, Write};

use crate::Mesh;
use crate::write::{Encoding, Options, Precision};

/// Writes `x y z`, normals, colours, and every further number under its own name; then triangles.
pub fn write(out: &mut dyn Write, mesh: &Mesh, options: Options) -> io::Result<()> {
    header(out, mesh, options)?;
    let list = usize::from(options.encoding == Encoding::Text);
    let mut row = Vec::new();
    for i in 0..mesh.points.len() {
        row.clear();
        row.extend_from_slice(mesh.points[i].coords.as_slice());
        if let Some(normal) = mesh.normals.get(i) {
            row.extend_from_slice(normal.as_slice());
        }
        let further = mesh
            .properties
            .iter()
            .filter_map(|p| p.values().get(i).copied());
        let colour = mesh.colours.get(i);
        if list == 1 {
            let further: Vec<f64> = further.collect();
            text(out, &row, colour, &further, options.precision)?;
        } else {
            row.iter()
                .try_for_each(|v| number(out, *v, options.precision))?;
            colour.map_or(Ok(()), |c| out.write_all(c))?;
            for value in further {
                number(out, value, options.precision)?;
            }
        }
    }
    for t in &mesh.triangles {
        if list == 1 {
            writeln!(out, "3 {} {} {}", t[0], t[1], t[2])?;
        } else {
            out.write_all(&[3])?;
            t.iter().try_for_each(|v| out.write_all(&v.to_le_bytes()))?;
        }
    }
    out.flush()
}

fn header(out: &mut dyn Write, mesh: &Mesh, options: Options) -> io::Result<()> {
    let format = match options.encoding {
        Encoding::Text => "ascii",
        Encoding::Binary => "binary_little_endian",
    };
    let kind = match options.precision {
        Precision::Single => "float",
        Precision::Double => "double",
    };
    writeln!(out, "ply\nformat {format} 1.0")?;
    if let Some(comment) = options.comment {
        // Kept to one line, whatever it contains.
        writeln!(out, "comment {}", comment.replace(['\n', '\r'], " "))?;
    }
    writeln!(out, "element vertex {}", mesh.points.len())?;
    let mut names = vec!["x", "y", "z"];
    if !mesh.normals.is_empty() {
        names.extend(["nx", "ny", "nz"]);
    }
    for name in names {
        writeln!(out, "property {kind} {name}")?;
    }
    if !mesh.colours.is_empty() {
        writeln!(
            out,
            "property uchar red\nproperty uchar green\nproperty uchar blue"
        )?;
    }
    for property in &mesh.properties {
        writeln!(out, "property {kind} {}", property.name())?;
    }
    if !mesh.triangles.is_empty() {
        writeln!(out, "element face {}", mesh.triangles.len())?;
        writeln!(out, "property list uchar uint vertex_indices")?;
    }
    writeln!(out, "end_header")
}

fn number(out: &mut dyn Write, value: f64, precision: Precision) -> io::Result<()> {
    match precision {
        Precision::Single => out.write_all(&(value as f32).to_le_bytes()),
        Precision::Double => out.write_all(&value.to_le_bytes()),
    }
}

fn text(
    out: &mut dyn Write,
    row: &[f64],
    colour: Option<&[u8; 3]>,
    further: &[f64],
    precision: Precision,
) -> io::Result<()> {
    let word = |v: &f64| precision.text(*v);
    let colour = colour.iter().flat_map(|c| c.iter()).map(u8::to_string);
    let words = row
        .iter()
        .map(word)
        .chain(colour)
        .chain(further.iter().map(word));
    let words: Vec<String> = words.collect();
    writeln!(out, "{}", words.join(" "))
}
