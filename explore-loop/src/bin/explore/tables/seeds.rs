//! The study `seeds`.
//!
//! Explores the same object once for each seed, with the defaults of `explore run`, or replays the same recording with points moved by other noise, and lists
//! the measures that matter to a user side by side.

use super::summary::Spread;
use crate::output::OutputFolder;
use crate::{Failure, ReplayArgs, ResultArgs, RunArgs, TablesArgs};
use crate::{replay, run};
use explore_loop::report::metrics::Metrics;
use mesh_io::program::unless_closed;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// Number of seeds by default, from 0.
const USUAL: u64 = 20;

/// Number of arms by default.
const ARMS: u8 = 3;

/// The outcome for a seed.
struct Row {
    seed: u64,
    outcome: Result<Metrics, String>,
}

/// The content of `seeds.json`.
#[derive(Serialize)]
struct Seeds<'a> {
    scene: &'a str,
    /// `null` for a recording.
    arms: Option<u8>,
    runs: Vec<&'a Metrics>,
    failed: Vec<Failed<'a>>,
    closed: usize,
    median: BTreeMap<&'static str, Option<f64>>,
}

#[derive(Serialize)]
struct Failed<'a> {
    seed: u64,
    error: &'a str,
}

/// Explores from every seed; true when every run finished.
pub(super) fn seeds(args: &TablesArgs) -> Result<bool, Failure> {
    // The object is read before the first run; its name identifies kept runs.
    let scene = match &args.session {
        Some(session) => session.display().to_string(),
        None => args.object.read()?.name().to_owned(),
    };
    let out = OutputFolder::create(&args.out)?;
    let mut rows = Vec::new();
    let asked = args.seeds.as_ref().map(|seeds| seeds.0.clone());
    for seed in asked.unwrap_or_else(|| (0..USUAL).collect()) {
        let folder = out.file(&format!("seed_{seed}"));
        let kept = args
            .keep
            .then(|| kept(&folder, args, &scene, seed))
            .flatten();
        let outcome = match kept {
            Some(metrics) => Ok(metrics),
            None => one(args, seed, folder).map_err(|e| e.to_string()),
        };
        match &outcome {
            Ok(metrics) => args.output.note(&format!(
                "seed {seed}: {}, {:.0} s",
                metrics.stop, metrics.wall_s
            )),
            Err(error) => args.output.note(&format!("seed {seed}: {error}")),
        }
        rows.push(Row { seed, outcome });
        // Written after each seed, so that an interrupted study keeps what it has.
        write(&out, args, &scene, &rows)?;
    }
    unless_closed(write!(args.output.words(), "{}", markdown(&rows)))?;
    unless_closed(args.output.object(&summary(args, &scene, &rows)))?;
    Ok(rows.iter().all(|row| row.outcome.is_ok()))
}

/// The exploration or the replay of a seed.
fn one(args: &TablesArgs, seed: u64, out: PathBuf) -> Result<Metrics, Failure> {
    let results = ResultArgs {
        out,
        quiet: true,
        ..ResultArgs::default()
    };
    match &args.session {
        Some(session) => replay::replay(&ReplayArgs {
            noise: args.noise,
            seed,
            results,
            ..ReplayArgs::of(session)
        }),
        None => run::explore(&RunArgs {
            object: args.object.clone(),
            arms: args.arms.unwrap_or(ARMS),
            seed,
            results,
            ..RunArgs::default()
        }),
    }
}

/// The metrics of a finished run of the same object, arms and seed.
fn kept(folder: &Path, args: &TablesArgs, scene: &str, seed: u64) -> Option<Metrics> {
    let text = std::fs::read(folder.join("metrics.json")).ok()?;
    let metrics: Metrics = serde_json::from_slice(&text).ok()?;
    let same = metrics.scene == scene
        && metrics.arms == usize::from(args.arms.unwrap_or(ARMS))
        && metrics.seed == seed;
    same.then_some(metrics)
}

fn write(out: &OutputFolder, args: &TablesArgs, scene: &str, rows: &[Row]) -> Result<(), Failure> {
    let mut json = serde_json::to_vec_pretty(&summary(args, scene, rows))?;
    json.push(b'\n');
    out.write("seeds.json", &json)?;
    Ok(out.write("seeds.md", markdown(rows).as_bytes())?)
}

fn summary<'a>(args: &TablesArgs, scene: &'a str, rows: &'a [Row]) -> Seeds<'a> {
    Seeds {
        scene,
        arms: args.session.is_none().then(|| args.arms.unwrap_or(ARMS)),
        runs: finished(rows),
        failed: rows
            .iter()
            .filter_map(|row| {
                row.outcome.as_ref().err().map(|error| Failed {
                    seed: row.seed,
                    error,
                })
            })
            .collect(),
        closed: closed(rows),
        median: COLUMNS
            .iter()
            .map(|column| (column.key, median(rows, column.value)))
            .collect(),
    }
}

fn finished(rows: &[Row]) -> Vec<&Metrics> {
    rows.iter()
        .filter_map(|row| row.outcome.as_ref().ok())
        .collect()
}

fn closed(rows: &[Row]) -> usize {
    finished(rows).iter().filter(|m| m.stop == "closed").count()
}

/// A column: its heading, its key in the file, its value for a run, and its format.
struct Column {
    heading: &'static str,
    key: &'static str,
    value: Value,
    show: fn(f64) -> String,
}

type Value = fn(&Metrics) -> Option<f64>;

impl Column {
    const fn number(heading: &'static str, key: &'static str, value: Value) -> Self {
        Self {
            heading,
            key,
            value,
            show: |value| format!("{value:.0}"),
        }
    }

    /// A column of lengths in metres, shown in mm.
    const fn millimetres(heading: &'static str, key: &'static str, value: Value) -> Self {
        Self {
            heading,
            key,
            value,
            show: |value| format!("{:.2}", 1e3 * value),
        }
    }

    /// A column of shares, shown in percent.
    const fn percent(heading: &'static str, key: &'static str, value: Value) -> Self {
        Self {
            heading,
            key,
            value,
            show: |value| format!("{:.1}", 100.0 * value),
        }
    }
}

const COLUMNS: [Column; 11] = [
    Column::number("manipulations", "manipulations", |m| {
        Some(m.manipulations as f64)
    }),
    // A manipulation that was given up is not counted as finished, but the robot did make it.
    Column::number("troubles", "troubles", |m| Some(m.troubles.len() as f64)),
    Column::millimetres("accuracy mean, mm", "accuracy_mean_m", |m| {
        Some(m.accuracy_m?.mean)
    }),
    Column::millimetres("accuracy p95, mm", "accuracy_p95_m", |m| {
        Some(m.accuracy_m?.p95)
    }),
    Column::millimetres("completeness mean, mm", "completeness_mean_m", |m| {
        Some(m.completeness_m?.mean)
    }),
    Column::millimetres("completeness p95, mm", "completeness_p95_m", |m| {
        Some(m.completeness_m?.p95)
    }),
    Column::percent("F at 5 mm, %", "f_score_5mm", |m| Some(m.f_score?.at_5mm)),
    Column::percent("doubled, %", "doubled", |m| m.doubled),
    Column::number("Euler", "euler", |m| Some(m.mesh.euler as f64)),
    Column::millimetres("hidden while held, mm", "prediction_error_held_m", |m| {
        m.prediction_error_held_m
    }),
    Column::number("wall time, s", "wall_s", |m| Some(m.wall_s)),
];

fn median(rows: &[Row], value: Value) -> Option<f64> {
    let values: Vec<f64> = finished(rows).into_iter().filter_map(value).collect();
    Spread::of(&values).map(|spread| spread.median)
}

fn markdown(rows: &[Row]) -> String {
    let mut text = String::from("| seed | stop | watertight |");
    for column in &COLUMNS {
        text.extend([" ", column.heading, " |"]);
    }
    text += "\n|---|---|---|";
    text += &"---:|".repeat(COLUMNS.len());
    text.push('\n');
    for row in rows {
        // Writing to a String cannot fail.
        let _ = match &row.outcome {
            Ok(metrics) => writeln!(
                text,
                "| {} | {} | {} |{}",
                row.seed,
                metrics.stop,
                yes_no(metrics.mesh.watertight),
                cells(|column| (column.value)(metrics))
            ),
            Err(error) => writeln!(
                text,
                "| {} | {} | – |{}",
                row.seed,
                error.replace(['|', '\n'], " "),
                cells(|_| None)
            ),
        };
    }
    let watertight = finished(rows).iter().filter(|m| m.mesh.watertight).count();
    let _ = writeln!(
        text,
        "| median | {} of {} closed | {watertight} of {} |{}",
        closed(rows),
        rows.len(),
        rows.len(),
        cells(|column| median(rows, column.value))
    );
    text
}

fn yes_no(value: bool) -> &'static str {
    if value { "yes" } else { "no" }
}

fn cells(value: impl Fn(&Column) -> Option<f64>) -> String {
    let mut text = String::new();
    for column in &COLUMNS {
        let shown = value(column).map_or("–".into(), column.show);
        text.extend([" ", &shown, " |"]);
    }
    text
}
