//! How often Betti numbers are right, by sampling and noise: with the proposal for the cloud, and with cylinders of 1.25 spacings at one scale.
//!
//! `cargo run --release -p cech-complex --features manifolds --example proposals -- 5` (clouds per surface)

mod surfaces;

use cech_complex::manifolds::{Manifold, OrientedCloud};
use cech_complex::nalgebra::Point3;
use cech_complex::{Complex, Cylinder, Error, Options, Orientation, epsilon_net, propose};
use mesh_io::program::{self, Failure, Output};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::io::Write;
use std::process::ExitCode;
use surfaces::ROUND;

/// Counts how often the Betti numbers of sampled surfaces are right
#[derive(Debug, clap::Parser)]
#[command(
    name = "proposals",
    after_help = "Example: proposals 5

Columns: sampling, noise in spacings, clouds, how many have the Betti numbers of their surface between the two proposed scales (thinned first where
that is proposed), and at the single scale 1 under cylinders with a radius of 1.25 spacings and half as high."
)]
struct Arguments {
    /// Clouds of each surface, sampling and noise
    #[arg(default_value_t = 2)]
    clouds: u64,
    #[command(flatten)]
    output: Output,
}

/// Beside the round ones.
const SURFACES: [(Manifold, usize); 5] = [
    (
        Manifold::Genus2 {
            hole: 1.0,
            web: 0.2,
            tube: 0.55,
        },
        1500,
    ),
    (
        Manifold::TwoSpheres {
            radius: 1.0,
            gap: 0.8,
        },
        1500,
    ),
    (
        Manifold::Annulus {
            inner: 0.5,
            outer: 1.0,
        },
        600,
    ),
    (
        Manifold::Tube {
            radius: 0.5,
            length: 1.5,
        },
        800,
    ),
    (
        Manifold::Cap {
            radius: 1.0,
            angle: 1.2,
        },
        600,
    ),
];

#[derive(Debug, Clone, Copy)]
enum Sampling {
    Net,
    Voxels,
    Random,
}

impl Sampling {
    fn name(self) -> &'static str {
        match self {
            Self::Net => "ε-net",
            Self::Voxels => "voxel grid",
            Self::Random => "random",
        }
    }

    /// About `count` points with a noise of `noise` spacings and a tilt of the normals of as many radians.
    fn cloud(self, surface: Manifold, count: usize, noise: f64, seed: u64) -> OrientedCloud {
        let noisy = |cloud: OrientedCloud| {
            let offset = noise * cloud.spacing;
            cloud.with_noise(offset, noise, seed + 1)
        };
        match self {
            Self::Net => noisy(surface.net(count, seed)),
            Self::Random => noisy(surface.uniform(4 * count, seed)),
            Self::Voxels => {
                let mut dense = surface.uniform(20 * count, seed);
                dense.spacing = (surface.area() / count as f64).sqrt();
                voxels(surface, &noisy(dense))
            }
        }
    }
}

/// One point of each occupied cell: the one nearest to its centre.
fn voxels(surface: Manifold, dense: &OrientedCloud) -> OrientedCloud {
    let edge = dense.spacing;
    let mut nearest = BTreeMap::<[i64; 3], (f64, usize)>::new();
    for (i, point) in dense.points.iter().enumerate() {
        let cell = [point.x, point.y, point.z].map(|c| (c / edge).floor());
        let centre = cell.map(|c| (c + 0.5) * edge);
        let distance = (point - Point3::from(centre)).norm();
        let entry = nearest
            .entry(cell.map(|c| c as i64))
            .or_insert((distance, i));
        if distance < entry.0 {
            *entry = (distance, i);
        }
    }
    let kept: Vec<usize> = nearest.into_values().map(|(_, i)| i).collect();
    OrientedCloud {
        points: kept.iter().map(|&i| dense.points[i]).collect(),
        normals: kept.iter().map(|&i| dense.normals[i]).collect(),
        spacing: (surface.area() / kept.len() as f64).sqrt(),
    }
}

fn thinned(cloud: &OrientedCloud, covering_radius: f64) -> Result<OrientedCloud, Error> {
    let kept = epsilon_net(&cloud.points, covering_radius)?;
    Ok(OrientedCloud {
        points: kept.iter().map(|&i| cloud.points[i]).collect(),
        normals: kept.iter().map(|&i| cloud.normals[i]).collect(),
        spacing: cloud.spacing,
    })
}

/// Betti numbers with the proposed cylinder and scales.
fn proposed(cloud: &OrientedCloud) -> Result<[usize; 3], Error> {
    let orientation = Orientation::default();
    let mut proposal = propose(&cloud.points, &cloud.normals, orientation)?;
    let mut cloud = cloud.clone();
    if let Some(covering_radius) = proposal.thin_to {
        cloud = thinned(&cloud, covering_radius)?;
        proposal = propose(&cloud.points, &cloud.normals, orientation)?;
    }
    let options = Options::default().with_max_scale(proposal.to);
    let complex = Complex::build(&cloud.points, &cloud.normals, proposal.cylinder, &options)?;
    Ok(complex.persistent_betti(proposal.from, proposal.to))
}

/// Betti numbers at one scale.
fn single(cloud: &OrientedCloud) -> Result<[usize; 3], Error> {
    let radius = 1.25 * cloud.spacing;
    let cylinder = Cylinder::new(radius, radius)?;
    let complex = Complex::build(&cloud.points, &cloud.normals, cylinder, &Options::default())?;
    Ok(complex.betti(1.0))
}

fn main() -> ExitCode {
    program::run(count)
}

fn count(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let mut words = arguments.output.words();
    let mut rows: Vec<Value> = Vec::new();
    for sampling in [Sampling::Net, Sampling::Voxels, Sampling::Random] {
        for noise in [0.0, 0.05, 0.1, 0.2] {
            let (mut clouds, mut right, mut right_single) = (0, 0, 0);
            for (surface, count) in ROUND.into_iter().chain(SURFACES) {
                for seed in 0..arguments.clouds {
                    let cloud = sampling.cloud(surface, count, noise, seed);
                    let found = proposed(&cloud);
                    clouds += 1;
                    right += u64::from(found == Ok(surface.betti()));
                    right_single += u64::from(single(&cloud) == Ok(surface.betti()));
                }
            }
            writeln!(
                words,
                "{:<12} {noise:<5} {clouds:>4} {right:>4} {right_single:>4}",
                sampling.name()
            )?;
            rows.push(json!({
                "sampling": sampling.name(), "noise_spacings": noise, "clouds": clouds,
                "right_as_proposed": right, "right_at_one_scale": right_single,
            }));
        }
    }
    arguments.output.object(&json!({ "rows": rows }))?;
    Ok(ExitCode::SUCCESS)
}
