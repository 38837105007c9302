//! Closes the surface of points with normals: reads an ASCII PLY with `x y z nx ny nz` first on each vertex line (metres), writes a closed mesh
//! as PLY.
//!
//! ```text
//! cargo run --release -p explore-loop --example close_surface -- points.ply closed.ply 0.005
//! ```
#![allow(clippy::print_stderr)]

use explore_loop::canonical::closed_surface::{ClosedSurfaceOptions, closed_surface};
use explore_loop::nalgebra::{Point3, UnitVector3, Vector3};
use std::error::Error;
use std::fmt::Write;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [from, to, spacing] = &arguments[..] else {
        return Err("usage: close_surface POINTS.ply CLOSED.ply SPACING_IN_METRES".into());
    };
    let (points, normals) = read(&std::fs::read_to_string(from)?)?;
    let options = ClosedSurfaceOptions::new(spacing.parse()?);
    let surface = closed_surface(&points, &normals, &vec![1.0; points.len()], &options)?;
    eprintln!(
        "{} vertices, {:.2} % of the surface without points, {} points left out",
        surface.vertices.len(),
        100.0 * surface.bare,
        surface.strays.len()
    );
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         property float nx\nproperty float ny\nproperty float nz\nelement face {}\n\
         property list uchar int vertex_indices\nend_header\n",
        surface.vertices.len(),
        surface.triangles.len()
    );
    for (p, n) in surface.vertices.iter().zip(&surface.normals) {
        writeln!(text, "{} {} {} {} {} {}", p.x, p.y, p.z, n.x, n.y, n.z)?;
    }
    for [a, b, c] in &surface.triangles {
        writeln!(text, "3 {a} {b} {c}")?;
    }
    Ok(std::fs::write(to, text)?)
}

type Oriented = (Vec<Point3<f64>>, Vec<UnitVector3<f64>>);

fn read(text: &str) -> Result<Oriented, Box<dyn Error>> {
    let (header, body) = text
        .split_once("end_header\n")
        .ok_or("not an ASCII PLY file: no end of the header")?;
    let count: usize = header
        .lines()
        .find_map(|line| line.strip_prefix("element vertex "))
        .ok_or("the header names no vertices")?
        .trim()
        .parse()?;
    let (mut points, mut normals) = (Vec::new(), Vec::new());
    for (number, line) in body.lines().take(count).enumerate() {
        let values: Vec<f64> = line
            .split_whitespace()
            .take(6)
            .map(str::parse)
            .collect::<Result<_, _>>()?;
        let &[x, y, z, nx, ny, nz] = &values[..] else {
            return Err(format!("vertex {number} has no position and normal").into());
        };
        points.push(Point3::new(x, y, z));
        let normal = UnitVector3::try_new(Vector3::new(nx, ny, nz), 1e-9);
        normals.push(normal.ok_or_else(|| format!("vertex {number} has a normal of length 0"))?);
    }
    Ok((points, normals))
}
