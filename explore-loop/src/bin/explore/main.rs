//! The `explore` program: a robot explores an unknown soft object.
//!
//! Exit codes: 0 if the surface closed (`run`, `robot`), the whole recording was reconstructed (`replay`), every run of a study finished (`tables`),
//! there is a report (`view`), all checks passed (`robot --dry-run`) or Ctrl-C ended it (`serve`); 1 if not, or on an error; 2 if the command line
//! is wrong; 3 if the surface closed except for a place that could not be shown (`run`, `robot`). Errors are one line on standard error.

mod closing;
mod final_mesh;
mod live;
mod object;
mod output;
mod pace;
mod recorder;
mod recording;
mod replay;
mod replay_args;
#[cfg(feature = "dvrk")]
mod robot;
mod run;
mod saved;
#[cfg(feature = "dvrk")]
mod serve;
mod tables;
mod view;
mod without;
mod words;

use crate::live::LiveArgs;
use crate::object::ObjectArgs;
use crate::replay_args::ReplayArgs;
use crate::tables::Shard;
use crate::without::Part;
use clap::builder::PossibleValuesParser;
use clap::{Parser, Subcommand, ValueEnum};
use explore_loop::baseline::{DynamicFusion, DynamicFusionOptions};
use explore_loop::canonical::genus::Genus;
use explore_loop::cell::sim::ArmModel;
use explore_loop::explore::ExploreOptions;
use explore_loop::mesh::Format;
use explore_loop::reconstruct::{Reconstruct, ReconstructOptions, Reconstructor};
use mesh_io::program::{self, Failure, Output, not_negative, numbers, positive};
use std::path::PathBuf;
use std::process::ExitCode;

/// Where results are written, and in which formats.
#[derive(Debug, Clone, clap::Args)]
struct ResultArgs {
    /// Folder for the results
    #[arg(long, value_name = "DIR", default_value = "explored")]
    out: PathBuf,
    /// Also write the model as canonical.obj, .glb, .stl, .off, .pcd, .xyz or .npy
    #[arg(long, value_name = "ENDINGS", value_delimiter = ',')]
    export: Vec<Format>,
    #[command(flatten)]
    live: LiveArgs,
    /// Print the metrics as one JSON object
    #[arg(long)]
    json: bool,
    /// Print nothing but errors, and the metrics if --json asks for them
    #[arg(long)]
    quiet: bool,
}

impl ResultArgs {
    fn output(&self) -> Output {
        let (json, quiet) = (self.json, self.quiet);
        Output { json, quiet }
    }
}

impl Default for ResultArgs {
    /// The defaults of the command line.
    fn default() -> Self {
        Self {
            out: "explored".into(),
            export: Vec::new(),
            live: LiveArgs::default(),
            json: false,
            quiet: false,
        }
    }
}

/// What is explored, and when the exploration ends.
#[derive(Debug, Clone, clap::Args)]
struct AimArgs {
    /// Spacing of the model, mm
    #[arg(long, value_name = "MM", default_value_t = 5.0, value_parser = positive)]
    spacing: f64,
    /// A point on or next to the body to explore where there are several, camera frame, m; otherwise the largest is explored
    #[arg(long, value_name = "X,Y,Z", value_parser = numbers::<3>, allow_hyphen_values = true)]
    seed_point: Option<[f64; 3]>,
    /// Number of handles that the object is known to have (0 for a ball, 1 for a ring); otherwise any number is accepted
    #[arg(long, value_name = "N")]
    genus: Option<usize>,
    /// Give up after this many manipulations
    #[arg(long, default_value_t = 8)]
    max_manipulations: usize,
}

impl AimArgs {
    /// The options of an exploration at a speed, mm/s.
    fn options(&self, speed: f64) -> ExploreOptions {
        let mut options = ExploreOptions::new(self.spacing * 1e-3, speed * 1e-3);
        options.max_manipulations = self.max_manipulations;
        options.genus = self.genus.map_or(Genus::Any, Genus::Exactly);
        options
    }
}

impl Default for AimArgs {
    /// The defaults of the command line.
    fn default() -> Self {
        Self {
            spacing: 5.0,
            seed_point: None,
            genus: None,
            max_manipulations: 8,
        }
    }
}

/// Robots explore unknown soft objects.
#[derive(Debug, Parser)]
#[command(
    name = "explore",
    version,
    about,
    after_help = "Example: explore run --scene ellipsoid && explore view"
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Explore an object in the simulated cell
    Run(RunArgs),
    /// Reconstruct a model from a recorded session
    Replay(ReplayArgs),
    /// Explore with the arms and the camera of a dVRK over ROS 2, real or simulated
    #[cfg(feature = "dvrk")]
    Robot(robot::RobotArgs),
    /// Serve the simulated cell as a dVRK over ROS 2, in real time, for any CRTK client
    #[cfg(feature = "dvrk")]
    Serve(serve::ServeArgs),
    /// Make the tables of a study over many runs
    Tables(TablesArgs),
    /// Open the report of a run in the browser
    View(ViewArgs),
}

/// How grips are chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Grips {
    /// By null-space coverage and the torque with which they turn the object
    Planned,
    /// At random among the candidates (the paper's baseline)
    Random,
}

/// The joints of the simulated arms.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Arms {
    /// None: every pose within 0.65 m of the base is possible
    Free,
    /// Those of a dVRK (S or Si, large needle driver) with their limits, as `explore serve` has them
    Psm,
}

impl From<Arms> for ArmModel {
    fn from(arms: Arms) -> Self {
        match arms {
            Arms::Free => Self::Free,
            Arms::Psm => Self::Psm,
        }
    }
}

/// The simulated depth camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Camera {
    /// Independent Gaussian noise; its clouds hold nothing but the object
    Ideal,
    /// Like a RealSense D435: noise and steps that grow with the square of depth, dropouts, mixed pixels, a clock of its own; the object is segmented
    /// from its images as with a real camera
    Realsense,
}

/// Whether features of the colour image are used as landmarks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Features {
    /// Colour is only displayed
    Off,
    /// Features of the colour image hold the model where its shape does not determine how it slides along itself
    On,
}

/// What builds the model from the frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Reconstruction {
    /// An elastic body, deformed from its rest shape to every frame
    Body,
    /// A volume fused through a warp field (the baseline): without arms and table, and without --resume
    DynamicFusion,
}

impl Reconstruction {
    /// An empty reconstruction; `without` lists the parts that `options` leave out.
    fn begin(
        self,
        options: ReconstructOptions,
        without: &[Part],
    ) -> Result<Box<dyn Reconstruct>, Failure> {
        Ok(match self {
            Self::Body => Box::new(Reconstructor::new(options)?),
            Self::DynamicFusion if !without.is_empty() => {
                return Err("--without is for --reconstruction body".into());
            }
            Self::DynamicFusion => {
                let options = DynamicFusionOptions::new(options.spacing);
                Box::new(DynamicFusion::new(options)?)
            }
        })
    }
}

#[allow(clippy::struct_excessive_bools, reason = "options of a command line")]
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Example: explore run --mesh liver.stl --units mm --arms 2 --out liver

Exit code 0: the surface closed; 3: it closed but for a place that could not be shown; 1: it did not; 2: the command line is wrong."
)]
struct RunArgs {
    #[command(flatten)]
    object: ObjectArgs,
    /// Number of arms
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u8).range(2..=3))]
    arms: u8,
    /// The joints of the arms
    #[arg(long, value_enum, default_value_t = Arms::Free)]
    arm_model: Arms,
    /// How grips are chosen
    #[arg(long, value_enum, default_value_t = Grips::Planned)]
    grips: Grips,
    /// Seed of the random numbers
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Largest speed of the grips, mm/s
    #[arg(long, value_name = "MM_S", default_value_t = 30.0, value_parser = positive)]
    speed: f64,
    /// What builds the model
    #[arg(long, value_enum, default_value_t = Reconstruction::Body)]
    reconstruction: Reconstruction,
    /// The depth camera
    #[arg(long, value_enum, default_value_t = Camera::Ideal)]
    camera: Camera,
    /// Standard deviation of the depth noise of the ideal camera, mm
    #[arg(long, value_name = "MM", default_value_t = 0.5, value_parser = not_negative)]
    noise: f64,
    /// Whether features of the colour image are landmarks
    #[arg(long, value_enum, default_value_t = Features::Off)]
    features: Features,
    /// Swing the camera by this angle about the centre of the table, there and back in 12 s; its pose is known in every frame
    #[arg(long, value_name = "DEGREES", value_parser = positive)]
    sway: Option<f64>,
    #[command(flatten)]
    aim: AimArgs,
    /// Leave parts of the method out, to measure what each contributes
    #[arg(long, value_enum, value_name = "PARTS", value_delimiter = ',')]
    without: Vec<Part>,
    /// Continue the interrupted run in the folder; the other options must be the same as then
    #[arg(long)]
    resume: bool,
    /// Also write a picture of the model after every manipulation
    #[arg(long)]
    pictures: bool,
    #[command(flatten)]
    results: ResultArgs,
}

#[derive(Debug, clap::Args)]
#[command(after_help = "Example: explore view explored")]
struct ViewArgs {
    /// Folder that a run or a replay wrote its results to
    #[arg(default_value = "explored")]
    dir: PathBuf,
    #[command(flatten)]
    output: Output,
}

impl Default for RunArgs {
    /// The defaults of the command line.
    fn default() -> Self {
        Self {
            object: ObjectArgs::default(),
            arms: 3,
            arm_model: Arms::Free,
            grips: Grips::Planned,
            seed: 0,
            speed: 30.0,
            reconstruction: Reconstruction::Body,
            camera: Camera::Ideal,
            noise: 0.5,
            features: Features::Off,
            sway: None,
            aim: AimArgs::default(),
            without: Vec::new(),
            resume: false,
            pictures: false,
            results: ResultArgs::default(),
        }
    }
}

#[derive(Debug, clap::Args)]
#[command(
    after_help = "Example: explore tables --only seeds --scene ellipsoid --seeds 0-4 --out study"
)]
struct TablesArgs {
    /// The studies to run; otherwise all but seeds
    #[arg(long, value_name = "NAMES", value_delimiter = ',', value_parser = PossibleValuesParser::new(tables::names()))]
    only: Vec<String>,
    /// List the studies, their numbers of jobs, and how long those will take
    #[arg(long)]
    list: bool,
    #[command(flatten)]
    object: ObjectArgs,
    /// With --only seeds: replay this recording, with points moved by noise, instead of exploring an object
    #[arg(long, value_name = "FILE", conflicts_with_all = ["scene", "mesh", "arms", "keep"])]
    session: Option<PathBuf>,
    /// Standard deviation of that noise, mm: enough for other results, too little for worse ones
    #[arg(long, value_name = "MM", default_value_t = 0.05, value_parser = not_negative, requires = "session")]
    noise: f64,
    /// Number of arms of --only seeds: 2 or 3, otherwise 3
    #[arg(long, value_parser = clap::value_parser!(u8).range(2..=3))]
    arms: Option<u8>,
    /// Seeds: numbers and ranges, such as 0-19 or 0,3,7-9; otherwise as many as the study has
    #[arg(long, value_name = "LIST", value_parser = seeds)]
    seeds: Option<Seeds>,
    /// Jobs at a time
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = at_a_time)]
    jobs: usize,
    /// Run only the Ith of N shares of the jobs, to divide them among machines; I from 1
    #[arg(long, value_name = "I/N", conflicts_with = "merge")]
    shard: Option<Shard>,
    /// Run nothing: make the tables from the results in these folders
    #[arg(long, value_name = "DIR", num_args = 1.., conflicts_with = "list")]
    merge: Vec<PathBuf>,
    /// Folder for the tables and the results of the runs; jobs finished there are not run again
    #[arg(long, value_name = "DIR", default_value = "tables")]
    out: PathBuf,
    /// With --only seeds: keep the finished runs that are in the folder
    #[arg(long)]
    keep: bool,
    #[command(flatten)]
    output: Output,
    /// Further options of `explore run` for every run of the studies, such as --camera realsense; in studies that compare replays they change the
    /// recording, not the replays
    #[arg(last = true, value_name = "RUN_OPTIONS")]
    further: Vec<String>,
}

/// Most jobs at a time.
const MOST_JOBS: usize = 1024;

fn at_a_time(text: &str) -> Result<usize, String> {
    let number = text.parse().ok().filter(|n| (1..=MOST_JOBS).contains(n));
    number.ok_or_else(|| format!("'{text}' is not a number from 1 to {MOST_JOBS}"))
}

/// Seeds in the order in which they were given.
#[derive(Debug, Clone)]
struct Seeds(Vec<u64>);

/// Most seeds of one study: a typing error must not ask for a year of runs.
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

fn main() -> ExitCode {
    let success = |()| ExitCode::SUCCESS;
    let whole = |every_run_ended: bool| {
        if every_run_ended {
            ExitCode::SUCCESS
        } else {
            ExitCode::from(1)
        }
    };
    program::run(|cli: &Cli| match &cli.command {
        Command::Run(args) => run::run(args),
        Command::Replay(args) => replay::replay(args).map(|_| ExitCode::SUCCESS),
        #[cfg(feature = "dvrk")]
        Command::Robot(args) => robot::robot(args),
        #[cfg(feature = "dvrk")]
        Command::Serve(args) => serve::serve(args),
        Command::Tables(args) => tables::tables(args).map(whole),
        Command::View(args) => view::view(args).map(success),
    })
}
