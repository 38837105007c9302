//! Runs recorded sessions through both reconstructions, this crate's and the DynamicFusion-style baseline, with the same measures.
//!
//! ```sh
//! cargo run --release -p explore-loop --example compare_baseline -- SESSION.mcap...
//! cargo run --release -p explore-loop --example compare_baseline -- --sweep SESSION.mcap...
//! ```
//! Prints Markdown: one row per session, mm; an improvement is `1 − ours / baseline`. With `--sweep` it runs the baseline only, varying one setting at
//! a time, and prints means over the sessions; `--try NAME=VALUE,...` adds a row with given settings, and `--set NAME=VALUE,...` changes the base
//! settings (lengths in mm).
use dvrk_io::session::TruthFrame;
use explore_loop::baseline::{Association, DynamicFusion, DynamicFusionOptions};
use explore_loop::canonical::{surface, topology};
use explore_loop::cell::replay::ReplayCell;
use explore_loop::cell::{Cell, CellError};
use explore_loop::measure::{Measurer, MeshMeasures, Sampling, Spread, TrueSurface};
use explore_loop::reconstruct::{Reconstruct, ReconstructOptions, Reconstructor};
use mesh_io::program::{self, Failure, Output};
use serde_json::{Value, json};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Spacing of both models, m.
const SPACING: f64 = 0.005;

/// Runs recorded sessions through this crate's reconstruction and the DynamicFusion-style baseline, and compares their errors
#[derive(Debug, clap::Parser)]
#[command(
    name = "compare_baseline",
    after_help = "Example: compare_baseline liver.mcap rod.mcap

Prints Markdown, mean / 95 % in mm; an improvement is 1 - ours / baseline. Some minutes a session."
)]
struct Arguments {
    /// Recordings with ground truth
    #[arg(required = true, value_name = "SESSION.mcap")]
    sessions: Vec<PathBuf>,
    /// Run the baseline only, varying one setting at a time; means over the sessions
    #[arg(long)]
    sweep: bool,
    /// One more row of the sweep: settings of the baseline, lengths in mm
    #[arg(long = "try", value_name = "NAME=VALUE,...")]
    tried: Vec<String>,
    /// Base settings
    #[arg(long, value_name = "NAME=VALUE,...")]
    set: Option<String>,
    #[command(flatten)]
    output: Output,
}

fn main() -> ExitCode {
    program::run(work)
}

fn work(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let mut options = DynamicFusionOptions::new(SPACING);
    if let Some(settings) = &arguments.set {
        options = set(options, settings)?;
    }
    let read = |path: &PathBuf| {
        Session::read(path).map_err(|error| format!("{}: {error}", path.display()))
    };
    let sessions: Vec<Session> = arguments
        .sessions
        .iter()
        .map(read)
        .collect::<Result<_, _>>()?;
    let mut tried: Vec<String> = Vec::new();
    if arguments.sweep {
        tried.extend(TRIED.map(String::from));
    }
    tried.extend(arguments.tried.iter().cloned());
    let mut words = arguments.output.words();
    let answer = if tried.is_empty() {
        compare(&mut words, &sessions, &options)?
    } else {
        sweep(&mut words, &sessions, &options, &tried)?
    };
    arguments.output.object(&answer)?;
    Ok(ExitCode::SUCCESS)
}

/// Settings of the baseline by name, `NAME=VALUE,...`; lengths in mm.
fn set(mut options: DynamicFusionOptions, text: &str) -> Result<DynamicFusionOptions, Failure> {
    for setting in text.split(',') {
        let (name, value) = setting.split_once('=').ok_or("a setting is NAME=VALUE")?;
        set_one(&mut options, name, value)?;
    }
    Ok(options)
}

fn set_one(options: &mut DynamicFusionOptions, name: &str, value: &str) -> Result<(), Failure> {
    if name == "association" {
        options.association = match value {
            "nearest" => Association::Nearest,
            "projective" => Association::Projective,
            other => return Err(format!("there is no association {other}").into()),
        };
        return Ok(());
    }
    let number: f64 = value.parse()?;
    let metres = number * 1e-3;
    match name {
        "voxel" => options.voxel = metres,
        "truncation" => options.truncation = metres,
        "nodes" => options.nodes = metres,
        "influence" => options.influence = number,
        "reach" => options.reach = number,
        "levels" => options.levels = number as usize,
        "coarsening" => options.coarsening = number,
        "rigidity" => options.rigidity = number,
        "huber" => options.huber = metres,
        "tukey_first" => options.tukey[0] = metres,
        "tukey_last" => options.tukey[1] = metres,
        "rigid_iterations" => options.rigid_iterations = number as usize,
        "iterations" => options.iterations = number as usize,
        "least_weight" => options.weight[0] = number,
        "most_weight" => options.weight[1] = number,
        "grip_radius" => options.grip_radius = metres,
        other => return Err(format!("the baseline has no setting {other}").into()),
    }
    Ok(())
}

/// A recording and its ground truth.
struct Session {
    path: PathBuf,
    truth: Vec<TruthFrame>,
    rest: TrueSurface,
}

/// Measures of a reconstruction of a session.
struct Outcome {
    accuracy: Spread,
    completeness: Spread,
    f_score: f64,
    /// Accuracy of the closed surface through the points of the model.
    through_points: f64,
    difference: f64,
    explored: f64,
    hidden: f64,
    slide: f64,
    frame_ms: f64,
}

impl Session {
    fn read(path: &Path) -> Result<Self, Failure> {
        let truth = dvrk_io::session::read_truth(path)?;
        let first = truth.first().ok_or("the session has no truth")?;
        Ok(Self {
            path: path.to_owned(),
            rest: TrueSurface::from_points(&first.points)?,
            truth,
        })
    }

    fn name(&self) -> String {
        let stem = self.path.file_stem().unwrap_or_default().to_string_lossy();
        if stem == "session" {
            let folder = self.path.parent().and_then(Path::file_name);
            return folder.unwrap_or_default().to_string_lossy().into_owned();
        }
        stem.into_owned()
    }

    /// Reconstructs it and measures the result.
    fn run(&self, reconstructor: &mut dyn Reconstruct) -> Result<Outcome, Failure> {
        let mut measurer = Measurer::new(self.rest.clone())?;
        let mut cell = ReplayCell::new(dvrk_io::session::SessionReader::open(&self.path)?)?;
        let mut times = Vec::new();
        loop {
            let observation = match cell.observe() {
                Ok(observation) => observation,
                Err(CellError::Ended) => break,
                Err(error) => return Err(error.into()),
            };
            let report = reconstructor.process(&observation, &cell.info().table)?;
            times.push(report.frame_ms);
            let away = |f: &TruthFrame| (f.stamp - observation.stamp).abs();
            let nearest = self.truth.iter().min_by(|a, b| away(a).total_cmp(&away(b)));
            if let Some(now) = nearest.filter(|f| away(f) < 0.02) {
                let now = TrueSurface {
                    vertices: now.points.clone(),
                    triangles: self.rest.triangles.clone(),
                };
                let held = observation.arms.iter().any(|arm| arm.holding);
                measurer.frame(reconstructor.model(), &report.measured, held, &now)?;
            }
        }
        reconstructor.consolidate(&cell.info().table);
        times.sort_by(f64::total_cmp);
        outcome(&*reconstructor, &measurer, times[times.len() / 2])
    }
}

impl Outcome {
    fn json(&self) -> Value {
        let spread = |s: &Spread| json!({ "mean": s.mean, "p95": s.p95 });
        json!({
            "accuracy_m": spread(&self.accuracy),
            "completeness_m": spread(&self.completeness),
            "f_score_5mm": self.f_score,
            "shape_difference_m": self.difference,
            "explored": self.explored,
            "hidden_while_held_m": self.hidden,
            "slide_m": self.slide,
            "frame_ms": self.frame_ms,
        })
    }
}

/// Measures what was reconstructed.
fn outcome(
    reconstructor: &dyn Reconstruct,
    measurer: &Measurer,
    frame_ms: f64,
) -> Result<Outcome, Failure> {
    let model = reconstructor.model();
    let (vertices, triangles) = match topology::analyse(model, SPACING)?.surface {
        Some(surface) => (surface.vertices, surface.triangles),
        None => (
            model.rest().to_vec(),
            surface::triangulate(model.rest(), model.rest_normals(), SPACING),
        ),
    };
    let truth = measurer.surface();
    let measure = |vertices: &[_], triangles: &[_]| -> Result<_, Failure> {
        let sampling = Sampling::default();
        let of = MeshMeasures::of(
            vertices,
            triangles,
            model.rest(),
            SPACING,
            Some(truth),
            sampling,
        );
        of?.truth.ok_or_else(|| "no surface to measure".into())
    };
    let through_points = measure(&vertices, &triangles)?;
    let shown = match reconstructor.surface() {
        Some(own) => measure(&own.vertices, &own.triangles)?,
        None => through_points,
    };
    let shape = measurer.shape(model, SPACING);
    let tracking = measurer.tracking();
    Ok(Outcome {
        accuracy: shown.accuracy,
        completeness: shown.completeness,
        f_score: shown.f_score.at_5mm,
        through_points: through_points.accuracy.mean,
        difference: shape.difference,
        explored: shape.explored,
        hidden: tracking.prediction_error_held.unwrap_or(f64::NAN),
        slide: tracking.slide.unwrap_or(f64::NAN),
        frame_ms,
    })
}

fn baseline(session: &Session, options: &DynamicFusionOptions) -> Result<Outcome, Failure> {
    session.run(&mut DynamicFusion::new(options.clone())?)
}

/// Both reconstructions side by side.
fn compare(
    words: &mut dyn Write,
    sessions: &[Session],
    options: &DynamicFusionOptions,
) -> Result<Value, Failure> {
    let mut rows = Vec::new();
    writeln!(
        words,
        "| session | accuracy: ours | baseline | improvement | completeness: ours | baseline | shape difference: ours | baseline | improvement | hidden while held: ours | baseline | ours / baseline |"
    )?;
    writeln!(words, "|---|---|---|---|---|---|---|---|---|---|---|---|")?;
    let mut ratios: [Vec<f64>; 3] = Default::default();
    for session in sessions {
        let ours = session.run(&mut Reconstructor::new(ReconstructOptions::new(SPACING))?)?;
        let theirs = baseline(session, options)?;
        let found = [
            ours.accuracy.mean / theirs.accuracy.mean,
            ours.difference / theirs.difference,
            ours.hidden / theirs.hidden,
        ];
        rows.push(json!({
            "session": session.name(), "ours": ours.json(), "baseline": theirs.json(),
        }));
        writeln!(
            words,
            "| {} | {} | {} | {:.1} % | {} | {} | {:.2} | {:.2} | {:.1} % | {:.2} | {:.2} | {:.2} |",
            session.name(),
            both(&ours.accuracy),
            both(&theirs.accuracy),
            100.0 * (1.0 - found[0]),
            both(&ours.completeness),
            both(&theirs.completeness),
            1e3 * ours.difference,
            1e3 * theirs.difference,
            100.0 * (1.0 - found[1]),
            1e3 * ours.hidden,
            1e3 * theirs.hidden,
            found[2],
        )?;
        for (ratio, found) in ratios.iter_mut().zip(found) {
            ratio.push(found);
        }
    }
    let [accuracy, difference, hidden] = ratios.map(|r| r.iter().sum::<f64>() / r.len() as f64);
    writeln!(
        words,
        "\nMean improvement: accuracy {:.1} %, shape difference {:.1} %; mean of hidden-part errors, ours / baseline: {hidden:.2}.",
        100.0 * (1.0 - accuracy),
        100.0 * (1.0 - difference),
    )?;
    Ok(json!({ "sessions": rows }))
}

/// The settings of the sweep.
const TRIED: [&str; 19] = [
    "voxel=3",
    "voxel=5",
    "truncation=8",
    "truncation=16",
    "nodes=20",
    "nodes=40",
    "influence=0.7",
    "influence=1.5",
    "levels=1",
    "coarsening=4",
    "rigidity=1",
    "rigidity=5",
    "huber=0.1",
    "huber=10",
    "tukey_last=8",
    "rigid_iterations=0",
    "iterations=16",
    "association=nearest",
    "grip_radius=10",
];

/// The baseline with varied settings.
fn sweep(
    words: &mut dyn Write,
    sessions: &[Session],
    options: &DynamicFusionOptions,
    tried: &[String],
) -> Result<Value, Failure> {
    writeln!(
        words,
        "| setting | accuracy | through its points | completeness | F at 5 mm | shape difference | explored | hidden while held | slide | frame, ms |"
    )?;
    writeln!(words, "|---|---|---|---|---|---|---|---|---|---|")?;
    let mut rows = vec![row(words, "default", sessions, options)?];
    for setting in tried {
        let options = set(options.clone(), setting)?;
        rows.push(row(words, setting, sessions, &options)?);
    }
    Ok(json!({ "settings": rows }))
}

/// Means over the sessions.
fn row(
    words: &mut dyn Write,
    name: &str,
    sessions: &[Session],
    options: &DynamicFusionOptions,
) -> Result<Value, Failure> {
    let outcomes: Vec<Outcome> = sessions
        .iter()
        .map(|session| baseline(session, options))
        .collect::<Result<_, _>>()?;
    let mean = |value: fn(&Outcome) -> f64| {
        outcomes.iter().map(value).sum::<f64>() / outcomes.len() as f64
    };
    writeln!(
        words,
        "| {name} | {:.2} | {:.2} | {:.2} | {:.1} % | {:.2} | {:.1} % | {:.2} | {:.2} | {:.0} |",
        1e3 * mean(|o| o.accuracy.mean),
        1e3 * mean(|o| o.through_points),
        1e3 * mean(|o| o.completeness.mean),
        100.0 * mean(|o| o.f_score),
        1e3 * mean(|o| o.difference),
        100.0 * mean(|o| o.explored),
        1e3 * mean(|o| o.hidden),
        1e3 * mean(|o| o.slide),
        mean(|o| o.frame_ms),
    )?;
    Ok(json!({
        "setting": name,
        "accuracy_m": mean(|o| o.accuracy.mean),
        "completeness_m": mean(|o| o.completeness.mean),
        "hidden_while_held_m": mean(|o| o.hidden),
        "slide_m": mean(|o| o.slide),
    }))
}

/// Mean and 95th percentile, mm.
fn both(spread: &Spread) -> String {
    format!("{:.2} / {:.2}", 1e3 * spread.mean, 1e3 * spread.p95)
}
