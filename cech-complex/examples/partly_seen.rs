//! A sphere seen from above: the boundary of its visible part, and the vector area, tell where the rest is.
//!
//! `cargo run --release -p cech-complex --features manifolds --example partly_seen`

use cech_complex::manifolds::Manifold;
use cech_complex::{
    Complex, Cylinder, Options, VertexKind, missing_vector_area, vector_area_of_loop,
};
use mesh_io::program::{self, Failure, Output};
use serde_json::json;
use std::io::Write;
use std::process::ExitCode;

/// Shows what the boundary and the vector area of a sphere seen from above tell about the rest
#[derive(Debug, clap::Parser)]
#[command(name = "partly_seen", after_help = "Example: partly_seen --json")]
struct Arguments {
    #[command(flatten)]
    output: Output,
}

fn main() -> ExitCode {
    program::run(compare)
}

fn compare(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let mut words = arguments.output.words();
    let mut views = Vec::new();
    let ball = Manifold::Sphere { radius: 0.05 };
    let count = 2000;
    let cloud = ball.net(count, 1);
    // The camera is far up the z axis and sees the surface up to a grazing angle of 75°.
    let seen = |i: &usize| cloud.normals[*i].z > 0.26;
    let visible: Vec<usize> = (0..count).filter(seen).collect();
    let points: Vec<_> = visible.iter().map(|&i| cloud.points[i]).collect();
    let normals: Vec<_> = visible.iter().map(|&i| cloud.normals[i]).collect();

    for (name, points, normals) in [
        ("whole", &cloud.points, &cloud.normals),
        ("seen from above", &points, &normals),
    ] {
        let cylinder = Cylinder::from_spacing_and_reach(cloud.spacing, 0.05)?;
        let complex = Complex::build(points, normals, cylinder, &Options::default())?;
        writeln!(
            words,
            "{name}: {:?} simplices, Betti numbers {:?}",
            complex.counts(),
            complex.betti(1.0)
        )?;
        let kinds = complex.classify(cloud.spacing)?;
        let rim = kinds
            .iter()
            .filter(|kind| **kind == VertexKind::Boundary)
            .count();
        writeln!(words, "  {rim} of {} vertices on the boundary", kinds.len())?;
        for rim in complex.boundary_loops(&kinds)? {
            let area = 1e4 * vector_area_of_loop(&rim.points(&complex)).norm();
            writeln!(
                words,
                "  boundary of {:.3} m around {area:.1} cm²",
                rim.length
            )?;
        }
        let areas = vec![cloud.spacing * cloud.spacing; points.len()];
        let missing = missing_vector_area(&areas, normals)? * 1e4;
        writeln!(
            words,
            "  missing vector area ({:.1}, {:.1}, {:.1}) cm²",
            missing.x, missing.y, missing.z
        )?;
        let missing_m2 = [missing.x, missing.y, missing.z].map(|cm2| 1e-4 * cm2);
        views.push(json!({
            "view": name,
            "simplices": complex.counts(),
            "betti": complex.betti(1.0),
            "vertices": kinds.len(),
            "at_the_rim": rim,
            "missing_vector_area_m2": missing_m2,
        }));
    }
    arguments.output.object(&json!({ "views": views }))?;
    Ok(ExitCode::SUCCESS)
}
