//! A ball seen from above: what a camera sees of it has a rim, and the rim and the vector area tell where the rest is.
//!
//! `cargo run --release -p cech-complex --features manifolds --example partly_seen`
#![allow(clippy::print_stdout, reason = "an example talks")]

use cech_complex::manifolds::Manifold;
use cech_complex::{
    Complex, Cylinder, Error, Options, VertexKind, missing_vector_area, vector_area_of_loop,
};

fn main() -> Result<(), Error> {
    let ball = Manifold::Sphere { radius: 0.05 };
    let count = 2000;
    let cloud = ball.net(count, 1);
    // The camera stands far up the z axis and sees what faces it by more than 75° of grazing.
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
        println!(
            "{name}: {:?} simplices, Betti numbers {:?}",
            complex.counts(),
            complex.betti(1.0)
        );
        let kinds = complex.classify(cloud.spacing)?;
        let rim = kinds
            .iter()
            .filter(|kind| **kind == VertexKind::Boundary)
            .count();
        println!("  {rim} of {} vertices at the rim", kinds.len());
        for rim in complex.boundary_loops(&kinds)? {
            let area = 1e4 * vector_area_of_loop(&rim.points(&complex)).norm();
            println!("  rim of {:.3} m around {area:.1} cm²", rim.length);
        }
        let areas = vec![cloud.spacing * cloud.spacing; points.len()];
        let missing = missing_vector_area(&areas, normals)? * 1e4;
        println!(
            "  missing vector area ({:.1}, {:.1}, {:.1}) cm²",
            missing.x, missing.y, missing.z
        );
    }
    Ok(())
}
