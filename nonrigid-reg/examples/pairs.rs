//! Errors over a folder of pairs with ground truth: `pairs -- FOLDER [landmarks|features|none] [NAME=VALUE …]`
//!
//! Every sub-folder has `source.ply`, `target.ply`, `truth.ply` (where each source point went), `landmarks.csv` and
//! `features.csv`. Prints, in mm, mean and 95th percentile of the distance to the truth, the mean over the tenth of the points with
//! least and the half with most confidence, the mean over `hidden.ply` (what the source does not show; truth in `hidden_truth.ply`; by
//! `gpwrm::Field` through the nodes) if there is one, the distance before registration, and milliseconds with a fresh registrar (best of three).
#![allow(clippy::print_stdout)] // a table is what the program is for

#[path = "register/cloud.rs"]
mod cloud;

use std::error::Error;
use std::path::Path;
use std::time::Instant;

use cloud::{Oriented, read_pairs};
use mesh_io::Load;
use nalgebra::Point3;
use nonrigid_reg::{Feature, Landmark, Options, Registrar, Registration};

/// What the program needs to know of one pair.
struct Pair {
    source: Oriented,
    target: Oriented,
    truth: Vec<Point3<f64>>,
    landmarks: Vec<Landmark>,
    features: Vec<Feature>,
    /// What the source does not show, and where it went.
    hidden: Option<[Vec<Point3<f64>>; 2]>,
}

/// How well one pair was registered, in mm.
struct Score {
    mean: f64,
    p95: f64,
    doubted: f64,
    trusted: f64,
    /// NaN where nothing is known of what is hidden.
    hidden: f64,
    still: f64,
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let folder = arguments
        .next()
        .ok_or("usage: pairs FOLDER [landmarks|features|none] [NAME=VALUE …]")?;
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

    println!(
        "{:24} {:>6} {:>6} {:>7} {:>7} {:>6} {:>6} {:>7} {:>5} {:>6} {:>5} status",
        "pair",
        "mean",
        "p95",
        "doubted",
        "trusted",
        "hidden",
        "still",
        "overlap",
        "rms",
        "ms",
        "nodes"
    );
    let mut core = Vec::new();
    for path in folders {
        let pair = Pair::read(&path, &mode)?;
        let (result, ms) = pair.register(&options)?;
        let score = pair.score(&result);
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        println!(
            "{name:24} {:6.3} {:6.3} {:7.3} {:7.3} {:6.3} {:6.3} {:7.3} {:5.2} {ms:6.1} {:5} {:?} in {}",
            score.mean,
            score.p95,
            score.doubted,
            score.trusted,
            score.hidden,
            score.still,
            result.overlap,
            result.residuals.rms * 1e3,
            result.node_positions.len(),
            result.status,
            result.iterations,
        );
        if name.ends_with("_M5") {
            core.push((score.mean, score.p95, ms));
        }
    }
    let average =
        |f: fn(&(f64, f64, f64)) -> f64| core.iter().map(f).sum::<f64>() / core.len() as f64;
    println!(
        "core of {}: mean {:.3} p95 {:.3} ms {:.1}",
        core.len(),
        average(|c| c.0),
        average(|c| c.1),
        average(|c| c.2)
    );
    Ok(())
}

impl Pair {
    fn read(path: &Path, mode: &str) -> Result<Self, Box<dyn Error>> {
        let file = |name: &str| path.join(name).to_string_lossy().into_owned();
        let landmark = |(source, target)| Landmark {
            source,
            target,
            sigma: 0.0,
        };
        let landmarks = match mode {
            "none" => Vec::new(),
            _ => read_pairs(&file("landmarks.csv"), 1.0)?,
        };
        let features = match mode {
            "features" => read_pairs(&file("features.csv"), 1.0)?,
            _ => Vec::new(),
        };
        let load = Load::default();
        let points = |name: &str| mesh_io::read(Path::new(name)).map(|mesh| mesh.points().to_vec());
        Ok(Self {
            source: Oriented::read(&file("source.ply"), &load)?,
            target: Oriented::read(&file("target.ply"), &load)?,
            truth: points(&file("truth.ply"))?,
            landmarks: landmarks.into_iter().map(landmark).collect(),
            features: features
                .into_iter()
                .map(|(source, target)| Feature { source, target })
                .collect(),
            hidden: if path.join("hidden.ply").exists() {
                let truth = points(&file("hidden_truth.ply"))?;
                Some([points(&file("hidden.ply"))?, truth])
            } else {
                None
            },
        })
    }

    /// Timed with a fresh registrar, that keeps nothing yet.
    fn register(&self, options: &Options) -> Result<(Registration, f64), nonrigid_reg::Error> {
        let (from, to) = (self.source.cloud(), self.target.cloud());
        let timed = || {
            let mut registrar = Registrar::new(options.clone());
            let start = Instant::now();
            let result = registrar.register(&from, &to, &self.landmarks, &self.features, None)?;
            Ok((result, start.elapsed().as_secs_f64() * 1e3))
        };
        let (result, first) = timed()?;
        let fastest = first.min(timed()?.1).min(timed()?.1);
        Ok((result, fastest))
    }

    /// Registered nodes carry some noise, and what is hidden is far from them: wide supports, more shrinkage.
    fn hidden_error(&self, result: &Registration) -> f64 {
        let options = gpwrm::FieldOptions {
            support: gpwrm::Support::Nearest(64),
            shrinkage: 0.03,
            ..Default::default()
        };
        let field = gpwrm::Field::new(&result.node_positions, &result.node_displacements, &options);
        let (Some([hidden, truth]), Ok(field)) = (&self.hidden, field) else {
            return f64::NAN;
        };
        let found = field.warp(hidden);
        let off = found.iter().zip(truth).map(|(a, b)| (a - b).norm());
        off.sum::<f64>() * 1e3 / found.len() as f64
    }

    fn score(&self, result: &Registration) -> Score {
        let source = self.source.mesh.points();
        let count = source.len();
        let off =
            |i: usize, u: nalgebra::Vector3<f64>| (source[i] + u - self.truth[i]).norm() * 1e3;
        let errors: Vec<f64> = (0..count)
            .map(|i| off(i, result.displacements[i]))
            .collect();
        let mut by_confidence: Vec<usize> = (0..count).collect();
        let confidence = &result.confidence;
        by_confidence.sort_by(|&a, &b| confidence[a].total_cmp(&confidence[b]));
        let mean = |ids: &[usize]| ids.iter().map(|&i| errors[i]).sum::<f64>() / ids.len() as f64;
        let mut sorted = errors.clone();
        sorted.sort_by(f64::total_cmp);
        Score {
            mean: mean(&by_confidence),
            p95: sorted[count * 95 / 100],
            doubted: mean(&by_confidence[..count / 10]),
            trusted: mean(&by_confidence[count / 2..]),
            hidden: self.hidden_error(result),
            still: (0..count)
                .map(|i| off(i, nalgebra::Vector3::zeros()))
                .sum::<f64>()
                / count as f64,
        }
    }
}

/// `bending=1.5` and the like; gates as `gates=.02>.01`.
fn set(options: &mut Options, setting: &str) -> Result<(), Box<dyn Error>> {
    let (name, value) = setting.split_once('=').ok_or("settings are NAME=VALUE")?;
    match name {
        "gates" => options.gates = value.split('>').map(str::parse).collect::<Result<_, _>>()?,
        "iterations" => options.iterations = value.parse()?,
        "spacing" => options.node_spacing = value.parse()?,
        "bending" => options.bending = value.parse()?,
        "strain" => options.strain = value.parse()?,
        "drag" => options.drag = value.parse()?,
        "tolerance" => options.tolerance = value.parse()?,
        "denoise" => options.denoise = value.parse()?,
        "rim" => options.boundary_weight = value.parse()?,
        _ => return Err(format!("no setting {name}").into()),
    }
    Ok(())
}
