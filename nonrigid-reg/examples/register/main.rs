//! Registers one PLY cloud onto another:
//! `register -- SOURCE.ply TARGET.ply [--landmarks L.csv] [--features F.csv] [--spacing M] --out MOVED.ply`
//!
//! `--spacing` is the node spacing in m. Clouds without normals get them by principal components, turned to the origin (the
//! camera). Prints one JSON line.
#![allow(clippy::print_stdout)] // the JSON line is what the program is for

mod ply;

use std::error::Error;
use std::fmt::Write as _;
use std::process::ExitCode;
use std::time::Instant;

use nalgebra::{Point3, UnitVector3};
use nonrigid_reg::{
    Cloud, Feature, Landmark, Options, Registrar, Registration, Status, estimate_normals,
};
use ply::{Ply, read_pairs};

const USAGE: &str = "usage: register SOURCE.ply TARGET.ply [--landmarks L.csv] [--features F.csv] [--spacing M] --out MOVED.ply";

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> Result<(), Box<dyn Error>> {
    let (mut files, mut out) = (Vec::new(), None);
    let (mut landmarks, mut features) = (Vec::new(), Vec::new());
    let mut options = Options::default();
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        let mut next = || arguments.next().ok_or(USAGE);
        match argument.as_str() {
            "--landmarks" => landmarks = read_pairs(&next()?)?,
            "--features" => features = read_pairs(&next()?)?,
            "--spacing" => options.node_spacing = next()?.parse()?,
            "--out" => out = Some(next()?),
            other if other.starts_with("--") => return Err(USAGE.into()),
            _ => files.push(argument),
        }
    }
    let ([source, target], Some(out)) = (&files[..], out) else {
        return Err(USAGE.into());
    };
    let (source, target) = (Ply::read(source)?, Ply::read(target)?);
    let (source_normals, target_normals) = (normals(&source)?, normals(&target)?);
    let landmarks: Vec<Landmark> = landmarks
        .into_iter()
        .map(|(source, target)| Landmark {
            source,
            target,
            sigma: 0.0,
        })
        .collect();
    let features: Vec<Feature> = features
        .into_iter()
        .map(|(source, target)| Feature { source, target })
        .collect();

    let start = Instant::now();
    let result = Registrar::new(options).register(
        &Cloud {
            points: &source.points,
            normals: &source_normals,
        },
        &Cloud {
            points: &target.points,
            normals: &target_normals,
        },
        &landmarks,
        &features,
        None,
    )?;
    let ms = start.elapsed().as_secs_f64() * 1e3;
    let moved: Vec<Point3<f64>> = source
        .points
        .iter()
        .zip(&result.displacements)
        .map(|(p, u)| p + u)
        .collect();
    write(&out, &moved)?;
    println!("{}", summary(&result, ms));
    Ok(())
}

fn normals(cloud: &Ply) -> Result<Vec<UnitVector3<f64>>, nonrigid_reg::Error> {
    if cloud.normals.len() == cloud.points.len() {
        return Ok(cloud.normals.clone());
    }
    estimate_normals(&cloud.points, 16, &Point3::origin())
}

fn summary(result: &Registration, ms: f64) -> String {
    let status = match result.status {
        Status::Converged => "converged",
        Status::MaxIterations => "max_iterations",
        Status::Undetermined { .. } => "undetermined",
        Status::LowOverlap { .. } => "low_overlap",
        Status::HighResidual { .. } => "high_residual",
        _ => "other",
    };
    format!(
        "{{\"status\":\"{status}\",\"iterations\":{},\"overlap\":{:.4},\"residual_m\":{:.6},\"ms\":{ms:.2}}}",
        result.iterations, result.overlap, result.residuals.rms
    )
}

/// Points as an ascii PLY file.
fn write(path: &str, points: &[Point3<f64>]) -> Result<(), Box<dyn Error>> {
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty double x\nproperty double y\nproperty double z\nend_header\n",
        points.len()
    );
    for p in points {
        writeln!(text, "{:e} {:e} {:e}", p.x, p.y, p.z)?;
    }
    Ok(std::fs::write(path, text)?)
}
