//! Writes a closed mesh to try `explore run --mesh` with: an ellipsoid, or a tube bent through 120 degrees.
//!
//! ```text
//! cargo run --release -p explore-loop --example meshes -- tube tube.obj
//! cargo run --release -p explore-loop --bin explore -- run --mesh tube.obj
//! ```
#![allow(clippy::print_stderr)]

use explore_loop::cell::sim::Scene;
use explore_loop::nalgebra::{Point3, Vector3};
use std::error::Error;
use std::fmt::Write;

/// Radius of the bend, of the tube, and its angle.
const BEND: f64 = 0.09;
const TUBE: f64 = 0.022;
const ANGLE: f64 = 2.0 / 3.0 * std::f64::consts::PI;
/// Points around the tube, rings along it, rings of a round end.
const AROUND: usize = 28;
const ALONG: usize = 60;
const END: usize = 8;

type Mesh = (Vec<Point3<f64>>, Vec<[usize; 3]>);

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [shape, path] = &arguments[..] else {
        return Err("usage: meshes ellipsoid|tube FILE.obj".into());
    };
    let (vertices, triangles) = match shape.as_str() {
        "ellipsoid" => {
            let scene = Scene::ellipsoid([0.075, 0.05, 0.035])?;
            (
                scene.mesh().vertices.clone(),
                scene.mesh().triangles.clone(),
            )
        }
        "tube" => tube(),
        other => return Err(format!("no shape '{other}': ellipsoid or tube").into()),
    };
    std::fs::write(path, obj(&vertices, &triangles)?)?;
    eprintln!(
        "{path}: {} vertices, {} triangles",
        vertices.len(),
        triangles.len()
    );
    Ok(())
}

fn obj(vertices: &[Point3<f64>], triangles: &[[usize; 3]]) -> Result<String, std::fmt::Error> {
    let mut text = String::new();
    for p in vertices {
        writeln!(text, "v {:.7} {:.7} {:.7}", p.x, p.y, p.z)?;
    }
    for t in triangles {
        writeln!(text, "f {} {} {}", t[0] + 1, t[1] + 1, t[2] + 1)?;
    }
    Ok(text)
}

/// A circle swept along an arc in the plane of the table, with half spheres at both ends.
fn tube() -> Mesh {
    let quarter = |k: usize| (k as f64 / END as f64) * std::f64::consts::FRAC_PI_2;
    // Each ring: place along the arc (0 to 1), way beyond it, radius.
    let mut rings: Vec<(f64, f64, f64)> = Vec::new();
    rings.extend((1..END).map(|k| (0.0, -TUBE * quarter(k).cos(), TUBE * quarter(k).sin())));
    rings.extend((0..=ALONG).map(|k| (k as f64 / ALONG as f64, 0.0, TUBE)));
    rings.extend(
        (1..END)
            .rev()
            .map(|k| (1.0, TUBE * quarter(k).cos(), TUBE * quarter(k).sin())),
    );
    let frame = |t: f64| {
        let (s, c) = (t * ANGLE).sin_cos();
        (
            Point3::new(BEND * c, BEND * s, 0.0),
            Vector3::new(-s, c, 0.0),
            Vector3::new(c, s, 0.0),
        )
    };
    let mut vertices = Vec::new();
    for &(t, beyond, radius) in &rings {
        let (centre, along, out) = frame(t);
        for j in 0..AROUND {
            let (s, c) = (std::f64::consts::TAU * j as f64 / AROUND as f64).sin_cos();
            vertices.push(centre + beyond * along + radius * (c * out + s * Vector3::z()));
        }
    }
    let mut triangles = Vec::new();
    for i in 0..rings.len() - 1 {
        for j in 0..AROUND {
            let [a, b] = [i * AROUND + j, i * AROUND + (j + 1) % AROUND];
            triangles.extend([[a, b, b + AROUND], [a, b + AROUND, a + AROUND]]);
        }
    }
    let (first, last) = (vertices.len(), (rings.len() - 1) * AROUND);
    let ((c0, a0, _), (c1, a1, _)) = (frame(0.0), frame(1.0));
    vertices.extend([c0 - TUBE * a0, c1 + TUBE * a1]);
    for j in 0..AROUND {
        let next = (j + 1) % AROUND;
        triangles.extend([[first, next, j], [first + 1, last + j, last + next]]);
    }
    (vertices, triangles)
}
