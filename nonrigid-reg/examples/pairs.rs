//! Errors over a folder of pairs with ground truth: `pairs -- FOLDER [landmarks|features|none] [NAME=VALUE …]`
//!
//! Every sub-folder has `source.ply`, `target.ply`, `truth.ply` (where each source point went), `landmarks.csv` and
//! `features.csv`. Prints mean and 95th percentile of the distance to the truth in mm, and milliseconds.
#![allow(clippy::print_stdout, clippy::print_stderr)] // a table is what the program is for

#[path = "register/ply.rs"]
mod ply;

use std::error::Error;
use std::time::Instant;

use nonrigid_reg::{Cloud, Feature, Landmark, Options, Registrar};
use ply::{Ply, read_pairs};

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let folder = arguments.next().ok_or("usage: pairs FOLDER [landmarks|features|none] [NAME=VALUE …]")?;
    let mode = arguments.next().unwrap_or_else(|| "landmarks".into());
    let mut options = Options::default();
    for setting in arguments {
        set(&mut options, &setting)?;
    }
    let mut folders: Vec<_> = std::fs::read_dir(&folder)?
        .filter_map(Result::ok)
        .map(|entry| entry.path())
        .filter(|path| path.is_dir())
        .collect();
    folders.sort();
    let mut registrar = Registrar::new(options);
    let mut core = Vec::new();
    let mut groups = vec![("M20", Vec::new()), ("occluded", Vec::new()), ("static", Vec::new())];
    println!("{:24} {:>6} {:>6} {:>6} {:>7} {:>5} {:>6} {:>5} status", "pair", "mean", "p95", "static", "overlap", "rms", "ms", "nodes");
    for path in folders {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let file = |f: &str| path.join(f).to_string_lossy().into_owned();
        let (source, target) = (Ply::read(&file("source.ply"))?, Ply::read(&file("target.ply"))?);
        let truth = Ply::read(&file("truth.ply"))?;
        let landmarks: Vec<Landmark> = match mode.as_str() {
            "none" => Vec::new(),
            _ => read_pairs(&file("landmarks.csv"))?
                .into_iter()
                .map(|(source, target)| Landmark { source, target, sigma: 0.0 })
                .collect(),
        };
        let features: Vec<Feature> = match mode.as_str() {
            "features" => read_pairs(&file("features.csv"))?
                .into_iter()
                .map(|(source, target)| Feature { source, target })
                .collect(),
            _ => Vec::new(),
        };
        let from = Cloud { points: &source.points, normals: &source.normals };
        let to = Cloud { points: &target.points, normals: &target.normals };
        let mut fastest = f64::INFINITY;
        let mut result = None;
        for _ in 0..3 {
            let start = Instant::now();
            result = Some(registrar.register(&from, &to, &landmarks, &features, None)?);
            fastest = fastest.min(start.elapsed().as_secs_f64() * 1e3);
        }
        let Some(result) = result else { continue };
        let mut errors: Vec<f64> = (0..source.points.len())
            .map(|i| (source.points[i] + result.displacements[i] - truth.points[i]).norm() * 1e3)
            .collect();
        let still: f64 = (0..source.points.len())
            .map(|i| (source.points[i] - truth.points[i]).norm() * 1e3)
            .sum::<f64>() / errors.len() as f64;
        let mean = errors.iter().sum::<f64>() / errors.len() as f64;
        errors.sort_by(f64::total_cmp);
        let p95 = errors[errors.len() * 95 / 100];
        if name.ends_with("_M5") {
            core.push((mean, p95, fastest));
        }
        for (group, means) in &mut groups {
            if name.contains(*group) {
                means.push(mean);
            }
        }
        println!(
            "{name:24} {mean:6.3} {p95:6.3} {still:6.3} {:7.3} {:5.2} {fastest:6.1} {:5} {:2} {:?}",
            result.overlap, result.residual_rms * 1e3, result.node_positions.len(), result.iterations, result.status
        );
    }
    let count = core.len() as f64;
    let mean = |f: fn(&(f64, f64, f64)) -> f64| core.iter().map(f).sum::<f64>() / count;
    for (group, means) in &groups {
        print!("{group} {:.3} ", means.iter().sum::<f64>() / means.len() as f64);
    }
    println!("core {} mean {:.3} p95 {:.3} ms {:.1}", core.len(), mean(|c| c.0), mean(|c| c.1), mean(|c| c.2));
    Ok(())
}

/// `bending=1.5` and the like.
fn set(options: &mut Options, setting: &str) -> Result<(), Box<dyn Error>> {
    let (name, value) = setting.split_once('=').ok_or("settings are NAME=VALUE")?;
    if name == "gates" {
        options.gates = value.split('>').map(str::parse).collect::<Result<_, _>>()?;
        options.iterations = options.gates.len();
        return Ok(());
    }
    let value: f64 = value.parse()?;
    match name {
        "spacing" => options.node_spacing = value,
        "bending" => options.bending = value,
        "strain" => options.strain = value,
        "drag" => options.drag = value,
        "cosine" => options.normal_cosine = value,
        "rim" => options.boundary_weight = value,
        "angle" => options.boundary_angle = value.to_radians(),
        "tolerance" => options.tolerance = value,
        "iterations" => options.iterations = value as usize,
        "feature_sigma" => options.feature_sigma = value,
        _ => return Err(format!("no setting {name}").into()),
    }
    Ok(())
}
