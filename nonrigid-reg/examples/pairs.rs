//! Errors over a folder of pairs with ground truth: `cargo run --release -p nonrigid-reg --example pairs -- --help`.
//!
//! Every sub-folder has `source.ply`, `target.ply`, `truth.ply` (where each source point went), `landmarks.csv` and
//! `features.csv`. Prints, in mm: mean and 95th percentile of the distance to the truth; the mean over the tenth of the points with the
//! lowest and the half with the highest confidence; the mean over `hidden.ply`, if there is one (points that the source does not show, moved by
//! `gpwrm::Field` through the nodes; truth in `hidden_truth.ply`); the distance before registration; and milliseconds with a fresh registrar (best of three).

#[path = "register/cloud.rs"]
mod cloud;

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

use cloud::{Oriented, read_pairs};
use mesh_io::Load;
use mesh_io::program::{self, Failure, Output};
use nalgebra::Point3;
use nonrigid_reg::{Feature, Landmark, Options, Registrar, Registration};
use serde_json::json;

/// Registers every pair of a folder and prints the distances to the ground truth
#[derive(Debug, clap::Parser)]
#[command(
    name = "pairs",
    after_help = "Example: pairs folder features bending=1.5

Every sub-folder of FOLDER has source.ply, target.ply, truth.ply (where each source point went), landmarks.csv and features.csv.
Settings: gates (as .02>.01), iterations, spacing, bending, strain, drag, tolerance, denoise, boundary."
)]
struct Arguments {
    /// Folder of pairs
    folder: PathBuf,
    /// What is used beside the clouds
    #[arg(value_enum, default_value_t = Known::Landmarks)]
    known: Known,
    /// Settings of the registration
    #[arg(value_name = "NAME=VALUE")]
    settings: Vec<String>,
    #[command(flatten)]
    output: Output,
}

/// What a registration uses beside the clouds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Known {
    /// Landmarks
    Landmarks,
    /// Landmarks and features
    Features,
    /// Nothing
    None,
}

/// The data of one pair.
struct Pair {
    source: Oriented,
    target: Oriented,
    truth: Vec<Point3<f64>>,
    landmarks: Vec<Landmark>,
    features: Vec<Feature>,
    /// Points that the source does not show, and their true new positions.
    hidden: Option<[Vec<Point3<f64>>; 2]>,
}

/// Lower limits of the classes of confidence by which errors are averaged.
const LEVELS: [f64; 4] = [0.0, 0.1, 0.3, 0.6];

/// How well one pair was registered, in mm.
struct Score {
    mean: f64,
    p95: f64,
    doubted: f64,
    trusted: f64,
    /// NaN if the pair has no hidden points.
    hidden: f64,
    still: f64,
}

fn main() -> ExitCode {
    program::run(pairs)
}

fn pairs(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let output = arguments.output;
    let mut options = Options::default();
    for setting in &arguments.settings {
        set(&mut options, setting)?;
    }
    let folders = folders(&arguments.folder)?;
    writeln!(
        output.words(),
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
    )?;
    let bar = output.progress(folders.len() as u64, "pairs");
    let (mut core, mut rows) = (Vec::new(), Vec::new());
    let mut by_level: [Vec<f64>; LEVELS.len()] = Default::default();
    for path in folders {
        let pair = Pair::read(&path, arguments.known)?;
        let in_folder = |error| format!("{}: {error}", path.display());
        let (result, ms) = pair.register(&options).map_err(in_folder)?;
        let score = pair.score(&result);
        for (&confidence, error) in result.confidence.iter().zip(pair.errors(&result)) {
            if let Some(level) = LEVELS.iter().rposition(|from| confidence >= *from) {
                by_level[level].push(error);
            }
        }
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let line = format!(
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
        bar.suspend(|| writeln!(output.words(), "{line}"))?;
        bar.inc(1);
        rows.push(json!({
            "pair": name,
            "mean_mm": score.mean,
            "p95_mm": score.p95,
            "doubted_mm": score.doubted,
            "trusted_mm": score.trusted,
            "hidden_mm": score.hidden,
            "still_mm": score.still,
            "overlap": result.overlap,
            "ms": ms,
        }));
        if name.ends_with("_M5") {
            core.push((score.mean, score.p95, ms));
        }
    }
    bar.finish_and_clear();
    let average =
        |f: fn(&(f64, f64, f64)) -> f64| core.iter().map(f).sum::<f64>() / core.len() as f64;
    let [mean, p95, ms] = [average(|c| c.0), average(|c| c.1), average(|c| c.2)];
    writeln!(
        output.words(),
        "core of {}: mean {mean:.3} p95 {p95:.3} ms {ms:.1}",
        core.len()
    )?;
    let mut levels = Vec::new();
    for (from, mut errors) in LEVELS.into_iter().zip(by_level) {
        errors.sort_by(f64::total_cmp);
        let count = errors.len();
        let mean = errors.iter().sum::<f64>() / count as f64;
        let p95 = errors.get(count * 95 / 100).copied().unwrap_or(f64::NAN);
        writeln!(
            output.words(),
            "confidence from {from:.1}: {count:6} points, mean {mean:.2} p95 {p95:.2}"
        )?;
        levels.push(json!({ "from": from, "points": count, "mean_mm": mean, "p95_mm": p95 }));
    }
    let core = json!({ "pairs": core.len(), "mean_mm": mean, "p95_mm": p95, "ms": ms });
    output.object(&json!({ "pairs": rows, "core": core, "confidence": levels }))?;
    Ok(ExitCode::SUCCESS)
}

/// The sub-folders, sorted.
fn folders(folder: &Path) -> Result<Vec<PathBuf>, Failure> {
    let in_folder = |error| format!("{}: {error}", folder.display());
    let entries = std::fs::read_dir(folder).map_err(in_folder)?;
    let paths = entries.filter_map(Result::ok).map(|entry| entry.path());
    let mut folders: Vec<PathBuf> = paths.filter(|path| path.is_dir()).collect();
    folders.sort();
    if folders.is_empty() {
        return Err(format!("{}: contains no folders of pairs", folder.display()).into());
    }
    Ok(folders)
}

impl Pair {
    fn read(path: &Path, known: Known) -> Result<Self, Failure> {
        let file = |name: &str| path.join(name);
        let landmark = |(source, target)| Landmark {
            source,
            target,
            sigma: 0.0,
        };
        let landmarks = match known {
            Known::None => Vec::new(),
            _ => read_pairs(&file("landmarks.csv"), 1.0)?,
        };
        let features = match known {
            Known::Features => read_pairs(&file("features.csv"), 1.0)?,
            _ => Vec::new(),
        };
        let load = Load::default();
        let source = Oriented::read(&file("source.ply"), &load)?;
        let truth = as_many(&file("truth.ply"), source.mesh.points().len())?;
        Ok(Self {
            source,
            target: Oriented::read(&file("target.ply"), &load)?,
            truth,
            landmarks: landmarks.into_iter().map(landmark).collect(),
            features: features
                .into_iter()
                .map(|(source, target)| Feature { source, target })
                .collect(),
            hidden: if path.join("hidden.ply").exists() {
                let hidden = mesh_io::read(&file("hidden.ply"))?.points().to_vec();
                let truth = as_many(&file("hidden_truth.ply"), hidden.len())?;
                Some([hidden, truth])
            } else {
                None
            },
        })
    }

    /// Registers the pair, timed with a fresh registrar, which has nothing cached.
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

    /// The registered nodes are noisy, and hidden points are far from them: wide supports and more shrinkage.
    fn hidden_error(&self, result: &Registration) -> f64 {
        let options = gpwrm::FieldOptions::default()
            .with_support(gpwrm::Support::Nearest(64))
            .with_shrinkage(0.03);
        let field = gpwrm::Field::new(&result.node_positions, &result.node_displacements, &options);
        let (Some([hidden, truth]), Ok(field)) = (&self.hidden, field) else {
            return f64::NAN;
        };
        let found = field.warp(hidden);
        let off = found.iter().zip(truth).map(|(a, b)| (a - b).norm());
        off.sum::<f64>() * 1e3 / found.len() as f64
    }

    /// Distance in mm between the true position of point `i` and its position displaced by `u`.
    fn off(&self, i: usize, u: nalgebra::Vector3<f64>) -> f64 {
        (self.source.mesh.points()[i] + u - self.truth[i]).norm() * 1e3
    }

    /// Error of every source point, in mm.
    fn errors(&self, result: &Registration) -> Vec<f64> {
        let moves = result.displacements.iter().enumerate();
        moves.map(|(i, u)| self.off(i, *u)).collect()
    }

    fn score(&self, result: &Registration) -> Score {
        let errors = self.errors(result);
        let count = errors.len();
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
                .map(|i| self.off(i, nalgebra::Vector3::zeros()))
                .sum::<f64>()
                / count as f64,
        }
    }
}

/// The points of a file that must have one point for each point of another file.
fn as_many(path: &Path, wanted: usize) -> Result<Vec<Point3<f64>>, Failure> {
    let mesh = mesh_io::read(path)?;
    let found = mesh.points().len();
    if found != wanted {
        let path = path.display();
        return Err(format!(
            "{path}: {found} points, but {wanted} are needed: the new position of each source point"
        )
        .into());
    }
    Ok(mesh.points().to_vec())
}

/// Sets one option from `NAME=VALUE`, such as `bending=1.5`; gates as `gates=.02>.01`.
fn set(options: &mut Options, setting: &str) -> Result<(), Failure> {
    let (name, value) = setting
        .split_once('=')
        .ok_or_else(|| format!("'{setting}' is not NAME=VALUE"))?;
    match name {
        "gates" => options.gates = value.split('>').map(str::parse).collect::<Result<_, _>>()?,
        "iterations" => options.iterations = value.parse()?,
        "spacing" => options.node_spacing = value.parse()?,
        "bending" => options.bending = value.parse()?,
        "strain" => options.strain = value.parse()?,
        "drag" => options.drag = value.parse()?,
        "tolerance" => options.tolerance = value.parse()?,
        "denoise" => options.denoise = value.parse()?,
        "boundary" => options.boundary_weight = value.parse()?,
        _ => return Err(format!("no setting {name}").into()),
    }
    Ok(())
}
