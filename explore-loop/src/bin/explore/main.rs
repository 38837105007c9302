//! The `explore` program: a robot explores an unknown soft object.
//!
//! Exit codes: 0 the surface closed (`run`), the whole recording was reconstructed (`replay`), every run of a study came to an end
//! (`tables`), or there is a report (`view`); 1 it did not, or something failed; 2 the command line is wrong; 3 the surface closed but for a part
//! that is held to the table (`run`). Errors are one line on standard error.

mod object;
mod output;
mod recorder;
mod replay;
mod run;
mod saved;
mod tables;
mod view;

use crate::object::ObjectArgs;
use clap::{Parser, Subcommand, ValueEnum};
use explore_loop::baseline::{DynamicFusion, DynamicFusionOptions};
use explore_loop::mesh::Format;
use explore_loop::reconstruct::{Reconstruct, ReconstructOptions, Reconstructor};
use std::path::PathBuf;
use std::process::ExitCode;

/// Robots explore unknown soft objects.
#[derive(Debug, Parser)]
#[command(name = "explore", version, about)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Explore an object in the simulated cell
    Run(RunArgs),
    /// Reconstruct from a recorded session
    Replay(ReplayArgs),
    /// Make the tables of a study over many runs
    Tables(TablesArgs),
    /// Open the report of a run in the browser
    View(ViewArgs),
}

/// How grips are chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Grips {
    /// By null-space coverage and turning lever
    Planned,
    /// At random among the candidates (the paper's baseline)
    Random,
}

/// The simulated depth camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Camera {
    /// White noise alone; nothing but the object in its clouds
    Ideal,
    /// As a RealSense D435: noise and steps that grow with the square of depth, dropouts, mixed pixels, a clock of its own; the object is found
    /// in its images as in those of a real one
    Realsense,
}

/// What builds the model from the frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Reconstruction {
    /// An elastic body bent from rest to every frame
    Body,
    /// A volume fused through a warp field: what this is compared with. It knows no arms and no table, and cannot be resumed
    DynamicFusion,
}

impl Reconstruction {
    /// Nothing seen yet; `spacing` in metres.
    fn begin(self, spacing: f64) -> Result<Box<dyn Reconstruct>, Failure> {
        Ok(match self {
            Self::Body => Box::new(Reconstructor::new(ReconstructOptions::new(spacing))?),
            Self::DynamicFusion => {
                Box::new(DynamicFusion::new(DynamicFusionOptions::new(spacing))?)
            }
        })
    }
}

#[derive(Debug, clap::Args)]
struct RunArgs {
    #[command(flatten)]
    object: ObjectArgs,
    /// Number of arms
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u8).range(2..=3))]
    arms: u8,
    /// How grips are chosen
    #[arg(long, value_enum, default_value_t = Grips::Planned)]
    grips: Grips,
    /// Seed of everything random
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Fastest grip speed, mm/s
    #[arg(long, value_name = "MM_S", default_value_t = 30.0, value_parser = positive)]
    speed: f64,
    /// Spacing of the model, mm
    #[arg(long, value_name = "MM", default_value_t = 5.0, value_parser = positive)]
    spacing: f64,
    /// What builds the model
    #[arg(long, value_enum, default_value_t = Reconstruction::Body)]
    reconstruction: Reconstruction,
    /// The depth camera
    #[arg(long, value_enum, default_value_t = Camera::Ideal)]
    camera: Camera,
    /// Standard deviation of the depth noise of the ideal camera, mm
    #[arg(long, value_name = "MM", default_value_t = 0.5, value_parser = not_negative)]
    noise: f64,
    /// A point on or next to the body to explore where there are several, camera frame, m; otherwise the largest is explored
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    seed_point: Option<[f64; 3]>,
    /// Handles that the object is known to have (0 a ball, 1 a ring); any number is accepted otherwise
    #[arg(long, value_name = "N")]
    genus: Option<usize>,
    /// Most manipulations before giving up
    #[arg(long, default_value_t = 8)]
    max_manipulations: usize,
    /// Folder for the results
    #[arg(long, value_name = "DIR", default_value = "explored")]
    out: PathBuf,
    /// Go on where the run in the folder was broken off; the other options as they were then
    #[arg(long)]
    resume: bool,
    /// Also write a picture of the model after every manipulation
    #[arg(long)]
    pictures: bool,
    /// Also write the model as canonical.obj, .glb, .stl, .off, .pcd, .xyz or .npy
    #[arg(long, value_name = "ENDINGS", value_delimiter = ',')]
    export: Vec<Format>,
    /// Print nothing but errors
    #[arg(long)]
    quiet: bool,
}

#[derive(Debug, clap::Args)]
struct ReplayArgs {
    /// The recording (MCAP with ROS 2 messages, or a rosbag2 directory)
    session: PathBuf,
    /// Topic of the cloud, the table, the truth or an arm: points, table, truth, PSM1/measured_cp or PSM1/jaw/measured_js
    #[arg(long = "topic", value_name = "ROLE=/NAME", value_parser = topic)]
    topics: Vec<(dvrk_io::session::Role, String)>,
    /// Spacing of the model, mm
    #[arg(long, value_name = "MM", default_value_t = 5.0, value_parser = positive)]
    spacing: f64,
    /// What builds the model
    #[arg(long, value_enum, default_value_t = Reconstruction::Body)]
    reconstruction: Reconstruction,
    /// Folder for the results
    #[arg(long, value_name = "DIR", default_value = "explored")]
    out: PathBuf,
    /// Also write a picture of the model every N frames
    #[arg(long, value_name = "N")]
    pictures: Option<u32>,
    /// Also write the model as canonical.obj, .glb, .stl, .off, .pcd, .xyz or .npy
    #[arg(long, value_name = "ENDINGS", value_delimiter = ',')]
    export: Vec<Format>,
    /// Stop this long after the first frame, seconds
    #[arg(long, value_name = "SECONDS", value_parser = not_negative)]
    until: Option<f64>,
    /// Print nothing but errors
    #[arg(long)]
    quiet: bool,
}

#[derive(Debug, clap::Args)]
struct ViewArgs {
    /// Folder that a run or a replay wrote its results to
    #[arg(default_value = "explored")]
    dir: PathBuf,
}

impl Default for RunArgs {
    /// As if nothing had been given on the command line.
    fn default() -> Self {
        Self {
            object: ObjectArgs::default(),
            arms: 3,
            grips: Grips::Planned,
            seed: 0,
            speed: 30.0,
            spacing: 5.0,
            reconstruction: Reconstruction::Body,
            camera: Camera::Ideal,
            noise: 0.5,
            seed_point: None,
            genus: None,
            max_manipulations: 8,
            out: "explored".into(),
            resume: false,
            pictures: false,
            export: Vec::new(),
            quiet: false,
        }
    }
}

/// A study of many runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Study {
    /// The same object once for each seed
    Seeds,
}

#[derive(Debug, clap::Args)]
struct TablesArgs {
    /// The study to make
    #[arg(long, value_enum, default_value_t = Study::Seeds)]
    only: Study,
    #[command(flatten)]
    object: ObjectArgs,
    /// Number of arms
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u8).range(2..=3))]
    arms: u8,
    /// Seeds: numbers and ranges, such as 0-19 or 0,3,7-9
    #[arg(long, value_name = "LIST", default_value = "0-19", value_parser = seeds)]
    seeds: Seeds,
    /// Folder for the tables, with a folder for each run
    #[arg(long, value_name = "DIR", default_value = "tables")]
    out: PathBuf,
    /// Take over the runs that are finished in the folder already
    #[arg(long)]
    keep: bool,
}

/// Seeds in the order in which they were given.
#[derive(Debug, Clone)]
struct Seeds(Vec<u64>);

/// Most seeds of one study: a slip of the finger shall not ask for a year of runs.
const MOST_SEEDS: u64 = 10_000;

fn seeds(text: &str) -> Result<Seeds, String> {
    let number = |word: &str| {
        word.trim()
            .parse::<u64>()
            .map_err(|_| format!("'{word}' is not a seed"))
    };
    let mut list = Vec::new();
    for part in text.split(',') {
        let (first, last) = match part.split_once('-') {
            Some((first, last)) => (number(first)?, number(last)?),
            None => (number(part)?, number(part)?),
        };
        if last < first || last - first >= MOST_SEEDS {
            return Err(format!(
                "'{part}' is not a range of at most {MOST_SEEDS} seeds"
            ));
        }
        list.extend(first..=last);
    }
    Ok(Seeds(list))
}

/// `ROLE=/NAME`.
fn topic(text: &str) -> Result<(dvrk_io::session::Role, String), String> {
    let (role, topic) = text
        .split_once('=')
        .ok_or_else(|| format!("'{text}' is not ROLE=/NAME"))?;
    let role = role.parse().map_err(|error| format!("{error}"))?;
    Ok((role, topic.to_owned()))
}

/// `X,Y,Z`.
fn point(text: &str) -> Result<[f64; 3], String> {
    let numbers: Vec<f64> = text
        .split(',')
        .map(|word| word.trim().parse::<f64>().ok().filter(|x| x.is_finite()))
        .collect::<Option<_>>()
        .ok_or_else(|| format!("'{text}' is not X,Y,Z in metres"))?;
    numbers
        .try_into()
        .map_err(|_| format!("'{text}' is not X,Y,Z in metres"))
}

fn positive(text: &str) -> Result<f64, String> {
    let value: f64 = text
        .parse()
        .map_err(|_| format!("'{text}' is not a number"))?;
    if value.is_finite() && value > 0.0 {
        Ok(value)
    } else {
        Err(format!("{value} is not positive"))
    }
}

fn not_negative(text: &str) -> Result<f64, String> {
    let value: f64 = text
        .parse()
        .map_err(|_| format!("'{text}' is not a number"))?;
    if value.is_finite() && value >= 0.0 {
        Ok(value)
    } else {
        Err(format!("{value} is negative or not finite"))
    }
}

/// What ends the program early; its text is the line the user reads.
type Failure = Box<dyn std::error::Error>;

fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) if error.use_stderr() => {
            eprintln!("{} (see explore --help)", one_line(&error));
            return ExitCode::from(2);
        }
        Err(help) => {
            let _ = help.print();
            return ExitCode::SUCCESS;
        }
    };
    let whole = |ended: bool| {
        if ended {
            ExitCode::SUCCESS
        } else {
            ExitCode::from(1)
        }
    };
    let outcome = match &cli.command {
        Command::Run(args) => run::run(args),
        Command::Replay(args) => replay::replay(args).map(whole),
        Command::Tables(args) => tables::tables(args).map(whole),
        Command::View(args) => view::view(args).map(whole),
    };
    outcome.unwrap_or_else(|failure| {
        eprintln!("error: {failure}");
        ExitCode::from(1)
    })
}

/// What is wrong with the command line, in one line.
fn one_line(error: &clap::Error) -> String {
    if error.kind() == clap::error::ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand {
        return "error: no command given: run, replay, tables or view".into();
    }
    let text = error.to_string();
    // The first paragraph: clap lists missing arguments on lines of their own.
    let words: Vec<&str> = text
        .lines()
        .take_while(|line| !line.is_empty())
        .map(str::trim)
        .collect();
    words.join(" ")
}
