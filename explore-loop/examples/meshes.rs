//! Writes a built-in scene as a closed mesh of any size, to try `explore run --mesh`.
//!
//! ```text
//! cargo run --release -p explore-loop --example meshes -- tube tube.obj
//! cargo run --release -p explore-loop --example meshes -- star star.obj 0.22
//! cargo run --release --bin explore -- run --mesh tube.obj
//! ```
//! The mesh stands on the plane z = 0, z up.

use explore_loop::cell::sim::{SCENES, Scene, TriangleMesh};
use explore_loop::mesh::{self, Mesh};
use explore_loop::nalgebra::Vector3;
use mesh_io::program::{self, Failure, Output};
use serde_json::json;
use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;

/// Writes a built-in scene as a closed mesh
#[derive(Debug, clap::Parser)]
#[command(name = "meshes", after_help = "Example: meshes star star.obj 0.22")]
struct Arguments {
    #[arg(value_parser = SCENES, hide_possible_values = true, help = format!("One of {}", SCENES.join(", ")))]
    scene: String,
    /// The mesh (PLY, OBJ, STL, OFF, GLB)
    file: PathBuf,
    /// Longest extent, 0.1 to 0.25 m
    #[arg(value_parser = program::positive)]
    size: Option<f64>,
    #[command(flatten)]
    output: Output,
}

fn main() -> ExitCode {
    program::run(write_mesh)
}

fn write_mesh(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let scene = match arguments.size {
        None => Scene::named(&arguments.scene)?,
        Some(size) => Scene::sized(&arguments.scene, size)?,
    };
    let (mesh, path) = (scene.mesh(), &arguments.file);
    standing(mesh)?.save(path, mesh::Options::default())?;
    let (low, high) = mesh.bounds();
    let extent = high - low;
    let [x, y, z]: [f64; 3] = (extent * 1e3).into();
    let (vertices, triangles) = (mesh.vertices.len(), mesh.triangles.len());
    writeln!(
        arguments.output.words(),
        "{}: {x:.0} x {y:.0} x {z:.0} mm, {vertices} vertices, {triangles} triangles",
        path.display()
    )?;
    arguments.output.object(&json!({
        "mesh": path,
        "extent_m": extent.as_slice(),
        "vertices": vertices,
        "triangles": triangles,
    }))?;
    Ok(ExitCode::SUCCESS)
}

/// The mesh with its lowest vertex at z = 0.
fn standing(mesh: &TriangleMesh) -> Result<Mesh, mesh::Error> {
    let ground = Vector3::new(0.0, 0.0, mesh.bounds().0.z);
    let triangles = mesh.triangles.iter().map(|t| t.map(|v| v as u32));
    Mesh::new(mesh.vertices.iter().map(|p| p - ground).collect())?
        .with_triangles(triangles.collect())
}
