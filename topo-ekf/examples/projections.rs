//! Compares estimate projection, gain projection and no projection in two scenes.
//!
//! - *table*: a strip on a table is lifted at one end, and only that end is seen.
//! - *pin*: a hidden part of a sheet is lifted by a pin of known height, a single inequality.
//!
//! Prints, over runs with different noise, the mean error of the hidden vertices, the largest strain of an edge caused by the projection, and the
//! normalised estimation error (1 for a consistent filter).

use std::io::Write;
use std::process::ExitCode;

use mesh_io::program::{self, Failure, Output};
use nalgebra::{Point3, UnitVector3, Vector3};
use serde_json::json;
use topo_ekf::{Error, Filter, Frame, Inequality, Observation, Options, Plane, Projection};

#[path = "../tests/common/mod.rs"]
mod common;
use common::{Noise, mean_error, sheet};

/// Compares ways to enforce a constraint: none, gain projection, estimate projection
#[derive(Debug, clap::Parser)]
#[command(name = "projections", after_help = "Example: projections --json")]
struct Arguments {
    #[command(flatten)]
    output: Output,
}

const FRAMES: usize = 30;
const RUNS: u64 = 12;
const LENGTH: f64 = 0.12;
/// Length of the seen part of the strip.
const SEEN: f64 = 0.04;

/// An elastic strip held at the height `h`: its height falls with the cube of the distance to the contact point, and then it lies flat. Arc length is
/// kept by integrating along the curve.
fn laid(rest: &[Point3<f64>], share: f64) -> Vec<Point3<f64>> {
    let (height, touch) = (0.025 * share, 0.04 + 0.05 * share);
    let steps = 2000;
    let ds = LENGTH / f64::from(steps);
    let (mut x, mut curve) = (0.0, vec![]);
    for _ in 0..=steps {
        let left = (1.0 - x / touch).max(0.0);
        curve.push((x, height * left.powi(3)));
        let slope = -3.0 * height / touch * left.powi(2);
        x += ds / (1.0 + slope * slope).sqrt();
    }
    let at = |p: &Point3<f64>| curve[(p.x / ds).round() as usize];
    rest.iter()
        .map(|p| Point3::new(at(p).0, p.y, at(p).1))
        .collect()
}

struct Score {
    error: f64,
    strain: f64,
    consistency: f64,
}

type Truth = fn(&[Point3<f64>], f64) -> Vec<Point3<f64>>;

/// A scene: rest shape and graph, the true shape at a share of the motion, which part is seen, and the constraints.
struct Scene {
    name: &'static str,
    rest: Vec<Point3<f64>>,
    edges: Vec<[u32; 2]>,
    truth: Truth,
    seen: fn(&Point3<f64>) -> bool,
    planes: Vec<Plane>,
    pin: Option<u32>,
}

fn strip() -> Scene {
    let (square, square_edges, _) = sheet(31, LENGTH / 30.0);
    let inside = |k: usize| square[k].y < 0.03;
    Scene {
        name: "table",
        rest: (0..square.len())
            .filter(|&k| inside(k))
            .map(|k| square[k])
            .collect(),
        edges: square_edges
            .into_iter()
            .filter(|e| e.iter().all(|&k| inside(k as usize)))
            .collect(),
        truth: laid,
        seen: |p| p.x < SEEN,
        planes: vec![Plane {
            normal: UnitVector3::new_unchecked(Vector3::z()),
            offset: 0.0,
        }],
        pin: None,
    }
}

fn pinned() -> Scene {
    let (rest, edges, _) = sheet(25, 4e-3);
    Scene {
        name: "pin",
        rest,
        edges,
        truth: |rest, share| {
            let off = |p: &Point3<f64>| (p.x - 0.048).powi(2) + (p.y - 0.048).powi(2);
            let height =
                |p: &Point3<f64>| 6e-3 * share * (-off(p) / (2.0 * 15e-3f64.powi(2))).exp();
            rest.iter().map(|p| p + Vector3::z() * height(p)).collect()
        },
        seen: |p| (p.x - 0.048).hypot(p.y - 0.048) > 0.035,
        planes: vec![],
        pin: Some(12 * 25 + 12),
    }
}

fn run(scene: &Scene, projection: Option<Projection>, seed: u64) -> Result<Score, Error> {
    let Scene { rest, edges, .. } = scene;
    let options = Options::default().with_projection(projection.unwrap_or(Projection::Estimate));
    let mut filter = Filter::new(rest, edges, &options)?;
    let mut noise = Noise(seed);
    let mut score = Score {
        error: 0.0,
        strain: 0.0,
        consistency: 0.0,
    };
    for frame in 1..=FRAMES {
        let truth = (scene.truth)(rest, frame as f64 / FRAMES as f64);
        let observations: Vec<_> = (0..rest.len())
            .filter(|&i| (scene.seen)(&rest[i]))
            .map(|i| Observation {
                vertex: i as u32,
                position: truth[i] + noise.vector(5e-4),
                sigma: 5e-4,
            })
            .collect();
        let above = |v: u32| Inequality {
            terms: vec![(v, Vector3::z())],
            bound: truth[v as usize].z,
        };
        let known: Vec<_> = scene.pin.map(above).into_iter().collect();
        let mut given = Frame::new(&observations);
        if projection.is_some() {
            given = given.with_planes(&scene.planes).with_inequalities(&known);
        }
        filter.step(&given)?;
        let share = 1.0 / FRAMES as f64;
        score.error += share * mean_error(filter.live(), &truth, |i| !(scene.seen)(&rest[i]));
        score.consistency += share * filter.error_statistic(&truth)?.mean();
        for [i, j] in filter.edges() {
            let (i, j) = (*i as usize, *j as usize);
            let length = |p: &[Point3<f64>]| (p[i] - p[j]).norm();
            let strain = length(filter.live()) / length(filter.unconstrained()) - 1.0;
            score.strain = score.strain.max(strain.abs());
        }
    }
    Ok(score)
}

fn main() -> ExitCode {
    program::run(projections)
}

fn projections(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let (output, mut rows) = (arguments.output, Vec::new());
    writeln!(
        output.words(),
        "scene   projection   hidden error (mm)   largest strain by projection   normalised error"
    )?;
    let scenes = [strip(), pinned()];
    let kinds = [
        ("none", None),
        ("gain", Some(Projection::Gain)),
        ("estimate", Some(Projection::Estimate)),
    ];
    let bar = output.progress((scenes.len() * kinds.len()) as u64 * RUNS, "runs");
    for scene in &scenes {
        for (name, projection) in kinds {
            let scored = (0..RUNS).map(|seed| {
                bar.inc(1);
                run(scene, projection, seed)
            });
            let scores: Vec<Score> = scored.collect::<Result<_, _>>()?;
            let mean = |of: fn(&Score) -> f64| scores.iter().map(of).sum::<f64>() / RUNS as f64;
            let (error, strain) = (1e3 * mean(|s| s.error), mean(|s| s.strain));
            let consistency = mean(|s| s.consistency);
            let line = format!(
                "{:<7} {name:<12} {error:>17.3}   {strain:>20.3}   {consistency:>16.2}",
                scene.name
            );
            bar.suspend(|| writeln!(output.words(), "{line}"))?;
            rows.push(json!({
                "scene": scene.name,
                "projection": name,
                "hidden_error_mm": error,
                "largest_strain": strain,
                "normalised_error": consistency,
            }));
        }
    }
    bar.finish_and_clear();
    output.object(&json!({ "rows": rows }))?;
    Ok(ExitCode::SUCCESS)
}
