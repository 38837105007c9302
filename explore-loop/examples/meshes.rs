//! Writes one of the built-in scenes as a closed mesh to try `explore run --mesh` with, at any size.
//!
//! ```text
//! cargo run --release -p explore-loop --example meshes -- tube tube.obj
//! cargo run --release -p explore-loop --example meshes -- star star.obj 0.22
//! cargo run --release -p explore-loop --bin explore -- run --mesh tube.obj
//! ```
//! The third argument is the longest extent in metres, 0.1 to 0.25. The mesh stands on the plane z = 0, z up.
#![allow(clippy::print_stderr)]

use explore_loop::cell::sim::{SCENES, Scene, TriangleMesh};
use std::error::Error;
use std::fmt::Write;
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
            return Err(format!("usage: meshes {names} FILE.obj [SIZE in metres]").into());
        }
    };
    let mesh = scene.mesh();
    std::fs::write(path, obj(mesh)?)?;
    let (low, high) = mesh.bounds();
    let [x, y, z]: [f64; 3] = ((high - low) * 1e3).into();
    eprintln!(
        "{path}: {x:.0} x {y:.0} x {z:.0} mm, {} vertices, {} triangles",
        mesh.vertices.len(),
        mesh.triangles.len()
    );
    Ok(())
}

fn obj(mesh: &TriangleMesh) -> Result<String, std::fmt::Error> {
    let ground = mesh.bounds().0.z;
    let mut text = String::new();
    for p in &mesh.vertices {
        writeln!(text, "v {:.7} {:.7} {:.7}", p.x, p.y, p.z - ground)?;
    }
    for t in &mesh.triangles {
        writeln!(text, "f {} {} {}", t[0] + 1, t[1] + 1, t[2] + 1)?;
    }
    Ok(text)
}
