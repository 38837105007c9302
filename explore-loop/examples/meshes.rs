//! Writes one of the built-in scenes as a closed mesh to try `explore run --mesh` with, at any size.
//!
//! ```text
//! cargo run --release -p explore-loop --example meshes -- tube tube.obj
//! cargo run --release -p explore-loop --example meshes -- star star.obj 0.22
//! cargo run --release --bin explore -- run --mesh tube.obj
//! ```
//! The third argument is the longest extent in metres, 0.1 to 0.25. The mesh stands on the plane z = 0, z up.
#![allow(clippy::print_stderr)]

use explore_loop::cell::sim::{SCENES, Scene, TriangleMesh};
use explore_loop::mesh::{self, Mesh};
use explore_loop::nalgebra::Vector3;
use std::error::Error;
use std::process::ExitCode;

fn main() -> ExitCode {
    match write_mesh() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn write_mesh() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (scene, path) = match &arguments[..] {
        [name, path] => (Scene::named(name)?, path),
        [name, path, size] => {
            let size = size
                .parse()
                .map_err(|_| format!("'{size}' is not a size in metres"))?;
            (Scene::sized(name, size)?, path)
        }
        _ => {
            let names = SCENES.join("|");
            return Err(format!("usage: meshes {names} FILE [SIZE in metres]").into());
        }
    };
    let mesh = scene.mesh();
    standing(mesh)?.save(path.as_ref(), mesh::Options::default())?;
    let (low, high) = mesh.bounds();
    let [x, y, z]: [f64; 3] = ((high - low) * 1e3).into();
    eprintln!(
        "{path}: {x:.0} x {y:.0} x {z:.0} mm, {} vertices, {} triangles",
        mesh.vertices.len(),
        mesh.triangles.len()
    );
    Ok(())
}

/// The mesh with its lowest vertex at z = 0.
fn standing(mesh: &TriangleMesh) -> Result<Mesh, mesh::Error> {
    let ground = Vector3::new(0.0, 0.0, mesh.bounds().0.z);
    let triangles = mesh.triangles.iter().map(|t| t.map(|v| v as u32));
    Mesh::new(mesh.vertices.iter().map(|p| p - ground).collect())?
        .with_triangles(triangles.collect())
}
