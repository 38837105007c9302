//! Prints what a recording holds: `cargo run --release -p dvrk-io --example session_info -- --help`.

use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use dvrk_io::session::{Role, SessionReader, Skipped, TopicCount};
use mesh_io::program::{self, Failure, Output};
use serde_json::{Value, json};

/// Prints what recordings hold: topics, frames, arms, the table, the truth, and what could not be read
#[derive(Debug, clap::Parser)]
#[command(
    name = "session_info",
    after_help = "Examples:
  session_info session.mcap
  session_info --topic points=/camera/depth/points recording.mcap --json

Exit code 0: all could be read; 1: one could not, or it is damaged; 2: the command line is wrong."
)]
struct Arguments {
    /// MCAP files or rosbag2 directories
    #[arg(required = true)]
    recordings: Vec<PathBuf>,
    /// Topic of a role: points, table, truth, PSM1/measured_cp, PSM1/jaw/measured_js, …
    #[arg(long = "topic", value_name = "ROLE=/NAME", value_parser = topic)]
    topics: Vec<(Role, String)>,
    #[command(flatten)]
    output: Output,
}

fn topic(text: &str) -> Result<(Role, String), String> {
    let (role, topic) = text.split_once('=').ok_or("ROLE=/NAME is wanted")?;
    let role = role.parse().map_err(|error| format!("{error}"))?;
    Ok((role, topic.to_owned()))
}

fn main() -> ExitCode {
    program::run(session_info)
}

fn session_info(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let mut reader = SessionReader::default();
    for (role, topic) in &arguments.topics {
        reader = reader.with_topic(role.clone(), topic);
    }
    let (mut words, mut failed, mut objects) = (arguments.output.words(), false, Vec::new());
    for path in &arguments.recordings {
        // A recording that cannot be read does not hide the others.
        match Info::read(&reader, path) {
            Ok(info) => {
                info.print(&mut words)?;
                objects.push(info.object());
            }
            Err(error) => {
                failed = true;
                let error = program::of_file(path, &error);
                program::warn(&format!("error: {error}"));
                objects.push(json!({ "recording": path, "error": error }));
            }
        }
    }
    arguments.output.object(&json!({ "recordings": objects }))?;
    Ok(if failed {
        ExitCode::FAILURE
    } else {
        ExitCode::SUCCESS
    })
}

/// The content of a recording.
struct Info {
    path: PathBuf,
    complete: bool,
    topics: Vec<TopicCount>,
    frames: usize,
    /// Stamps of the first and the last frame, s.
    span: Option<[f64; 2]>,
    /// Points of all frames together.
    points: usize,
    /// Normal and offset (m) of the table.
    table: Option<([f64; 3], f64)>,
    /// Arms, and in how many frames each has a pose.
    arms: Vec<(String, usize)>,
    skipped: Skipped,
    /// Frames of the truth, and points of its first.
    truth: [usize; 2],
}

impl Info {
    fn read(reader: &SessionReader, path: &Path) -> Result<Self, dvrk_io::Error> {
        let mut frames = reader.frames(path)?;
        let complete = frames.complete();
        let topics = frames.topics().to_vec();
        let stamps: Vec<f64> = frames.stamps().collect();
        let names = frames.arm_names().to_vec();
        let (mut count, mut points, mut posed) = (0, 0, vec![0; names.len()]);
        for frame in frames.by_ref() {
            let frame = frame?;
            count += 1;
            points += frame.points.len();
            for (posed, arm) in posed.iter_mut().zip(&frame.arms) {
                *posed += usize::from(arm.pose.is_some());
            }
        }
        let truth = reader.read_truth(path)?.frames;
        Ok(Self {
            path: path.to_owned(),
            complete,
            topics,
            frames: count,
            span: stamps.first().zip(stamps.last()).map(|(a, b)| [*a, *b]),
            points,
            table: frames.table().map(|(n, offset)| ([n.x, n.y, n.z], offset)),
            arms: names.into_iter().zip(posed).collect(),
            skipped: frames.skipped().clone(),
            truth: [truth.len(), truth.first().map_or(0, |t| t.points.len())],
        })
    }

    fn print(&self, out: &mut dyn Write) -> io::Result<()> {
        let end = if self.complete {
            "complete"
        } else {
            "ends early"
        };
        writeln!(out, "{} ({end})", self.path.display())?;
        for topic in &self.topics {
            writeln!(
                out,
                "  {:>6}  {:<28} {}",
                topic.count, topic.topic, topic.type_name
            )?;
        }
        if let (Some([first, last]), true) = (self.span, self.frames > 0) {
            writeln!(
                out,
                "  {} frames from {first:.3} s to {last:.3} s, {} points on average",
                self.frames,
                self.points / self.frames
            )?;
        }
        if let Some(([x, y, z], offset)) = self.table {
            writeln!(
                out,
                "  table: normal ({x:.3}, {y:.3}, {z:.3}), offset {offset:.3} m"
            )?;
        }
        for (name, posed) in &self.arms {
            writeln!(out, "  {name}: pose in {posed} frames")?;
        }
        if !self.skipped.is_empty() {
            let (messages, places) = (self.skipped.messages, self.skipped.places);
            writeln!(
                out,
                "  not readable: {messages} messages, in {places} places"
            )?;
            for skip in &self.skipped.first {
                writeln!(out, "    {skip}")?;
            }
        }
        let [frames, points] = self.truth;
        writeln!(out, "  truth: {frames} frames of {points} points")
    }

    fn object(&self) -> Value {
        let topic =
            |t: &TopicCount| json!({ "topic": t.topic, "type": t.type_name, "messages": t.count });
        let arm =
            |(name, posed): &(String, usize)| json!({ "name": name, "frames_with_pose": posed });
        let skip = |skip: &dvrk_io::session::Skip| skip.to_string();
        json!({
            "recording": self.path,
            "complete": self.complete,
            "topics": self.topics.iter().map(topic).collect::<Vec<_>>(),
            "frames": self.frames,
            "span_s": self.span,
            "points": self.points,
            "table": self.table.map(|(normal, offset)| json!({ "normal": normal, "offset_m": offset })),
            "arms": self.arms.iter().map(arm).collect::<Vec<_>>(),
            "not_readable": {
                "messages": self.skipped.messages,
                "places": self.skipped.places,
                "first": self.skipped.first.iter().map(skip).collect::<Vec<_>>(),
            },
            "truth_frames": self.truth[0],
        })
    }
}
