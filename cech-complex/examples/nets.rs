//! Writes an ε-net of a surface as `STEM.ply` (x y z nx ny nz, ASCII) and `STEM.txt` (x y z): `nets SURFACE COUNT SEED STEM`.
//!
//! `cargo run --release -p cech-complex --features manifolds --example nets -- torus 2000 1 torus`

use cech_complex::manifolds::Manifold;
use mesh_io::program::{self, Failure, Output};
use mesh_io::three_digits;
use serde_json::json;
use std::fmt::Write as _;
use std::io::Write as _;
use std::process::ExitCode;

/// Writes points spread evenly over a surface, with normals
#[derive(Debug, clap::Parser)]
#[command(name = "nets", after_help = "Example: nets torus 2000 1 torus")]
struct Arguments {
    surface: Surface,
    /// Number of points
    count: usize,
    /// Seed of the net
    seed: u64,
    /// The files are STEM.ply (x y z nx ny nz) and STEM.txt (x y z)
    stem: String,
    #[command(flatten)]
    output: Output,
}

/// The available surfaces; lengths are about 1.
#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum Surface {
    Sphere,
    Torus,
    Genus2,
    Tube,
    Junction,
}

impl Surface {
    fn manifold(self) -> Manifold {
        match self {
            Self::Sphere => Manifold::Sphere { radius: 1.0 },
            Self::Torus => Manifold::Torus {
                major: 1.0,
                minor: 0.4,
            },
            Self::Genus2 => Manifold::Genus2 {
                hole: 0.8,
                web: 0.2,
                tube: 0.4,
            },
            Self::Tube => Manifold::Tube {
                radius: 0.5,
                length: 1.5,
            },
            Self::Junction => Manifold::TJunction { radius: 1.0 },
        }
    }
}

fn main() -> ExitCode {
    program::run(net)
}

fn net(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let surface = arguments.surface.manifold();
    let cloud = surface.net(arguments.count, arguments.seed);
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
    for (ending, content) in [("ply", ply), ("txt", text)] {
        let path = format!("{}.{ending}", arguments.stem);
        std::fs::write(&path, content).map_err(|error| format!("{path}: {error}"))?;
    }
    let (spacing, covering) = (cloud.spacing, surface.covering_radius(&cloud.points));
    let betti = surface.betti();
    writeln!(
        arguments.output.words(),
        "spacing {}, covering radius {}, Betti numbers {betti:?}",
        three_digits(spacing),
        three_digits(covering)
    )?;
    let answer = json!({ "spacing": spacing, "covering_radius": covering, "betti": betti });
    arguments.output.object(&answer)?;
    Ok(ExitCode::SUCCESS)
}
