//! PLY files: the canonical model as vertices with normals, and faces.

use nalgebra::{Point3, UnitVector3};
use std::io::{self, Write};

/// Writes a mesh as ASCII PLY: `x y z nx ny nz` per vertex (metres), then triangles.
///
/// # Errors
/// The writer fails.
pub fn write_mesh(
    mut out: impl Write,
    points: &[Point3<f64>],
    normals: &[UnitVector3<f64>],
    triangles: &[[u32; 3]],
) -> io::Result<()> {
    write_mesh_with(&mut out, points, normals, triangles, None, &[])
}

/// The same with colours (`red green blue`, grey where one is missing) and with further numbers for every vertex, each a name and a value a vertex (missing values are written as NaN).
///
/// # Errors
/// The writer fails.
pub fn write_mesh_with(
    mut out: impl Write,
    points: &[Point3<f64>],
    normals: &[UnitVector3<f64>],
    triangles: &[[u32; 3]],
    colors: Option<&[[u8; 3]]>,
    further: &[(&str, &[f64])],
) -> io::Result<()> {
    write!(
        out,
        "ply\nformat ascii 1.0\ncomment metres, frame of the first observation\n"
    )?;
    writeln!(out, "element vertex {}", points.len())?;
    for name in ["x", "y", "z", "nx", "ny", "nz"] {
        writeln!(out, "property double {name}")?;
    }
    for name in ["red", "green", "blue"].iter().filter(|_| colors.is_some()) {
        writeln!(out, "property uchar {name}")?;
    }
    for (name, _) in further {
        writeln!(out, "property float {name}")?;
    }
    write!(
        out,
        "element face {}\nproperty list uchar int vertex_indices\nend_header\n",
        triangles.len()
    )?;
    for (i, (p, n)) in points.iter().zip(normals).enumerate() {
        write!(
            out,
            "{:.7} {:.7} {:.7} {:.6} {:.6} {:.6}",
            p.x, p.y, p.z, n.x, n.y, n.z
        )?;
        if let Some(colors) = colors {
            let [red, green, blue] = colors.get(i).copied().unwrap_or([128; 3]);
            write!(out, " {red} {green} {blue}")?;
        }
        for (_, values) in further {
            write!(out, " {:.6}", values.get(i).copied().unwrap_or(f64::NAN))?;
        }
        writeln!(out)?;
    }
    for [a, b, c] in triangles {
        writeln!(out, "3 {a} {b} {c}")?;
    }
    out.flush()
}
