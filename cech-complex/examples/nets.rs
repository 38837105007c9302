//! Writes an ε-net of a surface as `STEM.ply` (x y z nx ny nz, ASCII) and `STEM.txt` (x y z): `nets SURFACE COUNT SEED STEM`.
//!
//! `cargo run --release -p cech-complex --features manifolds --example nets -- torus 2000 1 torus`
#![allow(clippy::print_stdout, reason = "an example talks")]

use cech_complex::manifolds::Manifold;
use std::fmt::Write as _;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [surface, count, seed, stem] = words.as_slice() else {
        return Err("usage: nets sphere|torus|genus2|tube|junction COUNT SEED STEM".into());
    };
    let surface = match surface.as_str() {
        "sphere" => Manifold::Sphere { radius: 1.0 },
        "torus" => Manifold::Torus {
            major: 1.0,
            minor: 0.4,
        },
        "genus2" => Manifold::Genus2 {
            hole: 0.8,
            web: 0.2,
            tube: 0.4,
        },
        "tube" => Manifold::Tube {
            radius: 0.5,
            length: 1.5,
        },
        "junction" => Manifold::TJunction { radius: 1.0 },
        other => return Err(format!("no surface is called {other}").into()),
    };
    let cloud = surface.net(count.parse()?, seed.parse()?);
    let mut ply = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\n",
        cloud.points.len()
    );
    for name in ["x", "y", "z", "nx", "ny", "nz"] {
        writeln!(ply, "property double {name}")?;
    }
    ply += "end_header\n";
    let mut text = String::new();
    for (p, n) in cloud.points.iter().zip(&cloud.normals) {
        writeln!(ply, "{} {} {} {} {} {}", p.x, p.y, p.z, n.x, n.y, n.z)?;
        writeln!(text, "{} {} {}", p.x, p.y, p.z)?;
    }
    std::fs::write(format!("{stem}.ply"), ply)?;
    std::fs::write(format!("{stem}.txt"), text)?;
    let [b0, b1, b2] = surface.betti();
    println!(
        "{{\"spacing\":{},\"covering_radius\":{},\"betti\":[{b0},{b1},{b2}]}}",
        cloud.spacing,
        surface.covering_radius(&cloud.points)
    );
    Ok(())
}
