//! Tracks a mesh through a table of observations: `cargo run --release -p topo-ekf --example track -- --help`.
//!
//! `REST` is a mesh with faces; its vertices keep their numbers in the file (in STL, which has none, the number of their first corner).
//! `OBSERVATIONS.csv` has the columns `frame,vertex,x,y,z`, sorted by frame; frames without a line are predicted. Observations that are spread
//! much more, or much less, than the same vertices at rest are assumed to be in another unit, and rejected. Every plane `A x + B y + C z + D ≥ 0`
//! is a constraint, and the surface does not pass through itself.
//! `STATES.csv` has `frame,vertex,x,y,z,sd` for every vertex of every frame. The program prints the number of frames and the times of the steps.

use std::collections::BTreeSet;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use mesh_io::program::{self, Failure, Loading, Output, numbers, positive};
use mesh_io::{Error as MeshError, Load, Units, Vertices, read_table, three_digits};
use nalgebra::{Point3, UnitVector3, Vector3};
use serde_json::{Value, json};
use topo_ekf::{Filter, Frame, Observation, Options, Plane, Status};

/// Tracks a surface from a table of observations of its vertices
#[derive(Debug, clap::Parser)]
#[command(
    name = "track",
    after_help = "Example: track sheet.obj seen.csv --plane 0,0,1,0 --units mm --out states.csv"
)]
struct Arguments {
    /// The surface at rest: a mesh with faces (PLY, OBJ, STL, OFF)
    rest: PathBuf,
    /// Table frame,vertex,x,y,z, sorted by frame
    observations: PathBuf,
    /// A plane that the surface stays above: A x + B y + C z + D >= 0, metres; may be given several times
    #[arg(long = "plane", value_name = "A,B,C,D", value_parser = plane, allow_hyphen_values = true)]
    planes: Vec<Plane>,
    /// Standard deviation of an observation, m
    #[arg(long, value_name = "METRES", default_value_t = 0.5e-3, value_parser = positive)]
    sigma: f64,
    #[command(flatten)]
    loading: Loading,
    /// Unit of the observations: m, cm or mm
    #[arg(long, value_name = "UNIT", default_value = "m")]
    observation_units: Units,
    /// Table frame,vertex,x,y,z,sd of every vertex in every frame, metres
    #[arg(long, value_name = "STATES.csv")]
    out: PathBuf,
    #[command(flatten)]
    output: Output,
}

fn main() -> ExitCode {
    program::run(track)
}

fn track(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let path = &arguments.rest;
    // Observations refer to vertices by their numbers in the file. The limits are far outside the sizes of soft bodies on a table.
    let load = Load::default()
        .with_vertices(Vertices::AsInFile)
        .with_extent([1e-3, 10.0]);
    let mesh = arguments.loading.of(load).read(path)?;
    if mesh.triangles().is_empty() {
        return Err(MeshError::NoFaces.in_file(path).into());
    }
    let (points, faces) = mesh.into_parts();
    let in_table = |e: Failure| format!("{}: {e}", arguments.observations.display());
    let table = std::fs::read(&arguments.observations).map_err(|e| in_table(e.into()))?;
    let frames = frames(&table, arguments).map_err(in_table)?;
    same_units(&points, &frames).map_err(in_table)?;
    let mut filter = Filter::new(&points, &edges(&faces), &Options::default())?;
    // Written to a temporary file and renamed at the end, so that a failure leaves no incomplete table.
    let partial = PathBuf::from(format!("{}.partial", arguments.out.display()));
    let tracked = run(&mut filter, &frames, &faces, arguments, &partial);
    if tracked.is_err() {
        // The partial table is removed; it may not exist.
        let _ = std::fs::remove_file(&partial);
    }
    let times = tracked?;
    let out = &arguments.out;
    std::fs::rename(&partial, out).map_err(|e| format!("{}: {e}", out.display()))?;
    writeln!(
        arguments.output.words(),
        "{}",
        times.words(points.len(), out)
    )?;
    arguments.output.object(&times.object(points.len()))?;
    Ok(ExitCode::SUCCESS)
}

#[derive(Default)]
struct Times {
    step: Vec<Duration>,
    sigmas: Vec<Duration>,
    constrained: usize,
    unsettled: usize,
    infeasible: usize,
}

fn run(
    filter: &mut Filter,
    frames: &[(u64, Vec<Observation>)],
    faces: &[[u32; 3]],
    arguments: &Arguments,
    out: &Path,
) -> Result<Times, Failure> {
    let in_out = |e: std::io::Error| format!("{}: {e}", out.display());
    let file = std::fs::File::create(out).map_err(in_out)?;
    let mut file = std::io::BufWriter::new(file);
    writeln!(file, "frame,vertex,x,y,z,sd").map_err(in_out)?;
    let whole = frames.last().map_or(0, |f| f.0) - frames.first().map_or(0, |f| f.0) + 1;
    let bar = arguments.output.progress(whole, "frames");
    let mut times = Times::default();
    let mut next = frames.first().map_or(0, |f| f.0);
    for (number, observations) in frames {
        // Frames without observations are predicted too: the uncertainty grows.
        while next <= *number {
            let seen = if next == *number {
                &observations[..]
            } else {
                &[]
            };
            let start = Instant::now();
            let frame = Frame::new(seen)
                .with_planes(&arguments.planes)
                .with_triangles(faces);
            let report = filter
                .step(&frame)
                .map_err(|e| format!("frame {next}: {e}"))?;
            times.step.push(start.elapsed());
            match report.status {
                Status::Constrained => times.constrained += 1,
                Status::Unsettled => times.unsettled += 1,
                Status::Infeasible => times.infeasible += 1,
                _ => {}
            }
            let start = Instant::now();
            let sigmas = filter.marginal_sigmas()?;
            times.sigmas.push(start.elapsed());
            for (vertex, (p, sd)) in filter.live().iter().zip(sigmas).enumerate() {
                writeln!(file, "{next},{vertex},{},{},{},{sd}", p.x, p.y, p.z).map_err(in_out)?;
            }
            bar.inc(1);
            next += 1;
        }
    }
    file.flush().map_err(in_out)?;
    bar.finish_and_clear();
    Ok(times)
}

impl Times {
    fn object(&self, vertices: usize) -> Value {
        let spread = |times: &[Duration]| {
            let [median, p95, max] = [0.5, 0.95, 1.0].map(|share| at(times, share));
            json!({ "median": median, "p95": p95, "max": max })
        };
        json!({
            "vertices": vertices,
            "frames": self.step.len(),
            "constrained": self.constrained,
            "unsettled": self.unsettled,
            "infeasible": self.infeasible,
            "step_ms": spread(&self.step),
            "sigmas_ms": spread(&self.sigmas),
        })
    }

    fn words(&self, vertices: usize, out: &Path) -> String {
        format!(
            "{} frames of {vertices} vertices, {:.1} ms each, written to {}; {} with active constraints, {} unsettled, {} infeasible",
            self.step.len(),
            at(&self.step, 0.5) + at(&self.sigmas, 0.5),
            out.display(),
            self.constrained,
            self.unsettled,
            self.infeasible
        )
    }
}

/// The time, in ms, that this share of the steps does not exceed.
fn at(times: &[Duration], share: f64) -> f64 {
    let mut ms: Vec<f64> = times.iter().map(|t| t.as_secs_f64() * 1e3).collect();
    ms.sort_by(f64::total_cmp);
    let last = ms.len().saturating_sub(1);
    ms.get((last as f64 * share).round() as usize)
        .copied()
        .unwrap_or(0.0)
}

/// Every edge of every face once.
fn edges(faces: &[[u32; 3]]) -> Vec<[u32; 2]> {
    let sides = |f: &[u32; 3]| [[f[0], f[1]], [f[1], f[2]], [f[2], f[0]]];
    let sorted = |[a, b]: [u32; 2]| [a.min(b), a.max(b)];
    faces
        .iter()
        .flat_map(sides)
        .map(sorted)
        .filter(|[a, b]| a != b)
        .collect::<BTreeSet<_>>()
        .into_iter()
        .collect()
}

/// The observations of each frame, in order.
fn frames(table: &[u8], arguments: &Arguments) -> Result<Vec<(u64, Vec<Observation>)>, Failure> {
    let table = read_table(table, ["frame", "vertex", "x", "y", "z"])?;
    let metres = arguments.observation_units.metres();
    let mut frames: Vec<(u64, Vec<Observation>)> = vec![];
    for (&[frame, vertex, x, y, z], line) in table.rows.iter().zip(table.lines) {
        let whole = |n: f64, name: &str| {
            let is = n >= 0.0 && n.fract() == 0.0 && n <= f64::from(u32::MAX);
            let wrong = || format!("line {line}: {n} is not the number of a {name}");
            is.then_some(n as u64).ok_or_else(wrong)
        };
        let frame = whole(frame, "frame")?;
        let observation = Observation {
            vertex: whole(vertex, "vertex")? as u32,
            position: Point3::new(x, y, z) * metres,
            sigma: arguments.sigma,
        };
        match frames.last_mut() {
            Some((last, list)) if *last == frame => list.push(observation),
            Some((last, _)) if *last > frame => {
                return Err(format!("line {line}: frame {frame} after frame {last}").into());
            }
            Some((last, _)) if frame - *last > 100_000 => {
                let missing = frame - *last - 1;
                return Err(format!("line {line}: {missing} frames are missing").into());
            }
            _ => frames.push((frame, vec![observation])),
        }
    }
    if frames.is_empty() {
        return Err("no observations".into());
    }
    Ok(frames)
}

/// Largest change of the extent of the seen part, by stretching and folding.
const MOST_STRETCH: f64 = 20.0;

/// Whether the first frame with three vertices has them about as far apart as at rest.
fn same_units(rest: &[Point3<f64>], frames: &[(u64, Vec<Observation>)]) -> Result<(), Failure> {
    let Some((frame, seen)) = frames.iter().find(|(_, seen)| seen.len() > 2) else {
        return Ok(());
    };
    let now = spread(seen.iter().map(|o| o.position));
    let then = spread(
        seen.iter()
            .filter_map(|o| rest.get(o.vertex as usize).copied()),
    );
    if then > 0.0 && now > 0.0 && !(1.0 / MOST_STRETCH..=MOST_STRETCH).contains(&(now / then)) {
        let (now, then) = (three_digits(now), three_digits(then));
        return Err(format!(
            "frame {frame}: what is seen is spread over {now} m, the same vertices at rest over {then} m: are both in metres? \
             Else give --units (of the mesh) or --observation-units"
        )
        .into());
    }
    Ok(())
}

/// Diagonal of the bounding box.
fn spread(mut points: impl Iterator<Item = Point3<f64>>) -> f64 {
    points.next().map_or(0.0, |first| {
        let (low, high) = points.fold((first, first), |(low, high), p| (low.inf(&p), high.sup(&p)));
        (high - low).norm()
    })
}

/// `A,B,C,D` of `A x + B y + C z + D ≥ 0`; the normal may have any length but zero.
fn plane(text: &str) -> Result<Plane, String> {
    let [a, b, c, d] = numbers(text)?;
    let normal = Vector3::new(a, b, c);
    let length = normal.norm();
    if !(length.is_finite() && length > 0.0) {
        return Err("the normal A,B,C must not be zero".into());
    }
    Ok(Plane {
        normal: UnitVector3::new_unchecked(normal / length),
        offset: d / length,
    })
}
