//! Tracks a mesh through a table of observations.
//!
//! ```text
//! track REST.ply OBSERVATIONS.csv [--plane A,B,C,D]... [--sigma METRES] --out STATES.csv
//! ```
//!
//! `REST.ply` is a mesh with faces (ASCII or binary), metres. `OBSERVATIONS.csv` has the columns `frame,vertex,x,y,z`, sorted by frame;
//! frames without a line are predicted. Every plane `A x + B y + C z + D ≥ 0` is kept, and the surface does not pass through itself.
//! `STATES.csv` has `frame,vertex,x,y,z,sd` for every vertex of every frame. The last line on standard output is a JSON object with
//! the times of the steps.
#![allow(clippy::print_stdout, reason = "an example talks to its reader")]

use std::collections::BTreeSet;
use std::error::Error;
use std::io::Write;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use nalgebra::{Point3, UnitVector3, Vector3};
use topo_ekf::{Filter, Frame, Observation, Options, Plane, Status};

#[path = "support/ply.rs"]
mod ply;

const USAGE: &str =
    "usage: track REST.ply OBSERVATIONS.csv [--plane A,B,C,D]... [--sigma METRES] --out STATES.csv";

type Failure = Box<dyn Error>;

struct Arguments {
    rest: String,
    observations: String,
    planes: Vec<Plane>,
    sigma: f64,
    out: String,
}

fn main() -> ExitCode {
    match arguments(std::env::args().skip(1)).and_then(|a| track(&a)) {
        Ok(line) => {
            println!("{line}");
            ExitCode::SUCCESS
        }
        Err(failure) => {
            eprintln!("track: {failure}");
            ExitCode::FAILURE
        }
    }
}

fn track(arguments: &Arguments) -> Result<String, Failure> {
    let mesh = ply::read(&arguments.rest)?;
    if mesh.faces.is_empty() {
        return Err(format!("{}: the mesh has no faces", arguments.rest).into());
    }
    let table = std::fs::read_to_string(&arguments.observations)
        .map_err(|e| format!("{}: {e}", arguments.observations))?;
    let frames =
        frames(&table, arguments.sigma).map_err(|e| format!("{}: {e}", arguments.observations))?;
    let mut filter = Filter::new(&mesh.points, &edges(&mesh.faces), &Options::default())?;
    // Written beside and moved into place at the end: a failure leaves no half table behind.
    let partial = format!("{}.partial", arguments.out);
    let times = run(
        &mut filter,
        &frames,
        &mesh.faces,
        &arguments.planes,
        &partial,
    );
    let times = match times {
        Ok(times) => times,
        Err(failure) => {
            // The partial table is of no use; that it may not exist does not matter.
            let _ = std::fs::remove_file(&partial);
            return Err(failure);
        }
    };
    std::fs::rename(&partial, &arguments.out).map_err(|e| format!("{}: {e}", arguments.out))?;
    Ok(times.json(mesh.points.len()))
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
    planes: &[Plane],
    out: &str,
) -> Result<Times, Failure> {
    let file = std::fs::File::create(out).map_err(|e| format!("{out}: {e}"))?;
    let mut file = std::io::BufWriter::new(file);
    writeln!(file, "frame,vertex,x,y,z,sd")?;
    let mut times = Times::default();
    let mut next = frames.first().map_or(0, |f| f.0);
    for (number, observations) in frames {
        // Frames that show nothing still pass: everything is a little less certain after them.
        while next <= *number {
            let seen = if next == *number {
                &observations[..]
            } else {
                &[]
            };
            let start = Instant::now();
            let frame = Frame::new(seen).with_planes(planes).with_triangles(faces);
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
                writeln!(file, "{next},{vertex},{},{},{},{sd}", p.x, p.y, p.z)?;
            }
            next += 1;
        }
    }
    file.flush()?;
    Ok(times)
}

impl Times {
    fn json(&self, vertices: usize) -> String {
        let [step, sigmas] = [&self.step, &self.sigmas].map(|times| {
            let mut ms: Vec<f64> = times.iter().map(|t| t.as_secs_f64() * 1e3).collect();
            ms.sort_by(f64::total_cmp);
            let at = |share: f64| ms[((ms.len() - 1) as f64 * share).round() as usize];
            format!(
                r#"{{"median":{:.3},"p95":{:.3},"max":{:.3}}}"#,
                at(0.5),
                at(0.95),
                at(1.0)
            )
        });
        format!(
            r#"{{"vertices":{vertices},"frames":{},"constrained":{},"unsettled":{},"infeasible":{},"step_ms":{step},"sigmas_ms":{sigmas}}}"#,
            self.step.len(),
            self.constrained,
            self.unsettled,
            self.infeasible
        )
    }
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
fn frames(table: &str, sigma: f64) -> Result<Vec<(u64, Vec<Observation>)>, Failure> {
    let mut frames: Vec<(u64, Vec<Observation>)> = vec![];
    for (number, line) in table.lines().enumerate() {
        let line = line.trim();
        if line.is_empty() || (number == 0 && line.starts_with("frame")) {
            continue;
        }
        let (frame, observation) = parse(line, sigma)
            .ok_or_else(|| format!("line {}: `{line}` is not frame,vertex,x,y,z", number + 1))?;
        match frames.last_mut() {
            Some((last, list)) if *last == frame => list.push(observation),
            Some((last, _)) if *last > frame => {
                return Err(
                    format!("line {}: frame {frame} after frame {last}", number + 1).into(),
                );
            }
            Some((last, _)) if frame - *last > 100_000 => {
                return Err(format!(
                    "line {}: {} frames are missing",
                    number + 1,
                    frame - *last - 1
                )
                .into());
            }
            _ => frames.push((frame, vec![observation])),
        }
    }
    if frames.is_empty() {
        return Err("no observations".into());
    }
    Ok(frames)
}

fn parse(line: &str, sigma: f64) -> Option<(u64, Observation)> {
    let fields: Vec<&str> = line.split(',').map(str::trim).collect();
    let &[frame, vertex, x, y, z] = &fields[..] else {
        return None;
    };
    let position = Point3::new(x.parse().ok()?, y.parse().ok()?, z.parse().ok()?);
    let observation = Observation {
        vertex: vertex.parse().ok()?,
        position,
        sigma,
    };
    Some((frame.parse().ok()?, observation))
}

fn arguments(mut given: impl Iterator<Item = String>) -> Result<Arguments, Failure> {
    let (mut files, mut planes, mut out, mut sigma) = (vec![], vec![], None, 0.5e-3);
    while let Some(word) = given.next() {
        let mut value = || given.next().ok_or(format!("{word} needs a value\n{USAGE}"));
        match word.as_str() {
            "--plane" => planes.push(plane(&value()?)?),
            "--out" => out = Some(value()?),
            "--sigma" => {
                let text = value()?;
                sigma = text
                    .parse()
                    .map_err(|_| format!("--sigma {text}: not a number"))?;
            }
            option if option.starts_with("--") => {
                return Err(format!("unknown option {option}\n{USAGE}").into());
            }
            _ => files.push(word),
        }
    }
    let [rest, observations] = <[String; 2]>::try_from(files).map_err(|_| USAGE)?;
    Ok(Arguments {
        rest,
        observations,
        planes,
        sigma,
        out: out.ok_or(USAGE)?,
    })
}

/// `A,B,C,D` of `A x + B y + C z + D ≥ 0`; the normal may have any length but zero.
fn plane(text: &str) -> Result<Plane, Failure> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|n| n.trim().parse()).collect();
    let Ok(&[a, b, c, d]) = numbers.as_deref() else {
        return Err(format!("--plane {text}: four numbers A,B,C,D are needed").into());
    };
    let normal = Vector3::new(a, b, c);
    let length = normal.norm();
    if !(length.is_finite() && length > 0.0 && d.is_finite()) {
        return Err(format!("--plane {text}: the normal A,B,C must not vanish").into());
    }
    Ok(Plane {
        normal: UnitVector3::new_unchecked(normal / length),
        offset: d / length,
    })
}
