//! Closes the surface of points: reads a cloud in metres (PLY, PCD, XYZ …; normals are estimated where there are none), writes a closed mesh.
//!
//! ```text
//! cargo run --release -p explore-loop --example close_surface -- points.ply closed.ply 0.005
//! ```
#![allow(clippy::print_stderr)]

use explore_loop::canonical::closed_surface::{ClosedSurfaceOptions, closed_surface};
use explore_loop::mesh::{self, Mesh};
use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [from, to, spacing] = &arguments[..] else {
        return Err("usage: close_surface POINTS CLOSED SPACING_IN_METRES".into());
    };
    let cloud = mesh::read(from.as_ref())?;
    let normals = cloud.unit_normals_or_estimated()?;
    let points = cloud.points();
    let options = ClosedSurfaceOptions::new(spacing.parse()?);
    let surface = closed_surface(points, &normals, &vec![1.0; points.len()], &options)?;
    eprintln!(
        "{} vertices, {:.2} % of the surface without points, {} points left out",
        surface.vertices.len(),
        100.0 * surface.bare,
        surface.strays.len()
    );
    let normals = surface.normals.iter().map(|n| n.into_inner()).collect();
    let closed = Mesh::new(surface.vertices)?
        .with_normals(normals)?
        .with_triangles(surface.triangles)?;
    Ok(closed.save(to.as_ref(), mesh::Options::default())?)
}
