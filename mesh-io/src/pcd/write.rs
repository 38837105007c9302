//! Writes points as PCD.

use std::io::{self, Write};

use crate::Mesh;
use crate::write::{Encoding, Options, Precision};

/// Writes position, normal, colour and every further number, as text or binary.
pub fn write(out: &mut dyn Write, mesh: &Mesh, options: Options) -> io::Result<()> {
    let mut names = vec!["x", "y", "z"];
    if !mesh.normals.is_empty() {
        names.extend(["normal_x", "normal_y", "normal_z"]);
    }
    names.extend(mesh.properties.iter().map(crate::Property::name));
    let size = if options.precision == Precision::Single {
        "4"
    } else {
        "8"
    };
    let (mut sizes, mut types) = (vec![size; names.len()], vec!["F"; names.len()]);
    if !mesh.colours.is_empty() {
        names.push("rgb");
        sizes.push("4");
        types.push("U");
    }
    let ones = vec!["1"; names.len()];
    let data = if options.encoding == Encoding::Text {
        "ascii"
    } else {
        "binary"
    };
    let count = mesh.points.len();
    writeln!(
        out,
        "# .PCD v0.7 - {}",
        options
            .comment
            .unwrap_or("Point Cloud Data")
            .replace(['\n', '\r'], " ")
    )?;
    writeln!(
        out,
        "VERSION 0.7\nFIELDS {}\nSIZE {}",
        names.join(" "),
        sizes.join(" ")
    )?;
    writeln!(out, "TYPE {}\nCOUNT {}", types.join(" "), ones.join(" "))?;
    writeln!(
        out,
        "WIDTH {count}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {count}\nDATA {data}"
    )?;
    for i in 0..mesh.points.len() {
        let further = mesh.properties.iter().filter_map(|p| p.values().get(i));
        let numbers = mesh.numbers(i).chain(further);
        let colour = mesh
            .colours
            .get(i)
            .map(|[r, g, b]| u32::from_le_bytes([*b, *g, *r, 0]));
        if options.encoding == Encoding::Text {
            let words = numbers.map(|v| options.precision.text(*v));
            let words: Vec<String> = words.chain(colour.map(|c| c.to_string())).collect();
            writeln!(out, "{}", words.join(" "))?;
        } else {
            for v in numbers {
                match options.precision {
                    Precision::Single => out.write_all(&(*v as f32).to_le_bytes())?,
                    Precision::Double => out.write_all(&v.to_le_bytes())?,
                }
            }
            colour.map_or(Ok(()), |c| out.write_all(&c.to_le_bytes()))?;
        }
    }
    out.flush()
}
