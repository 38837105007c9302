//! Prints what a session holds: `cargo run --example session_info -- [--topic ROLE=/name]… RECORDING…`.
//!
//! A recording is an MCAP file or a rosbag2 directory. Roles are `points`, `table`, `truth`, `PSM1/measured_cp`,
//! `PSM1/jaw/measured_js`, ….
#![allow(clippy::print_stdout, reason = "printing is what this program is for")]

use std::process::ExitCode;

use dvrk_io::session::{Role, SessionReader};

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> Result<(), Box<dyn std::error::Error>> {
    let mut reader = SessionReader::default();
    let mut paths = Vec::new();
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        if argument == "--topic" {
            let mapping = arguments.next().unwrap_or_default();
            let (role, topic) = mapping.split_once('=').ok_or("--topic wants ROLE=/name")?;
            reader = reader.with_topic(role.parse::<Role>()?, topic);
        } else {
            paths.push(argument);
        }
    }
    if paths.is_empty() {
        return Err("no recording given: session_info [--topic ROLE=/name]… RECORDING…".into());
    }
    paths.iter().try_for_each(|path| print(&reader, path))
}

fn print(reader: &SessionReader, path: &str) -> Result<(), Box<dyn std::error::Error>> {
    let mut frames = reader.frames(path)?;
    let end = if frames.complete() {
        "complete"
    } else {
        "ends early"
    };
    println!("{path} ({end})");
    for topic in frames.topics() {
        println!(
            "  {:>6}  {:<28} {}",
            topic.count, topic.topic, topic.type_name
        );
    }
    let stamps: Vec<f64> = frames.stamps().collect();
    let arms = frames.arm_names().to_vec();
    let (mut count, mut points, mut posed) = (0, 0, vec![0; arms.len()]);
    for frame in frames.by_ref() {
        let frame = frame?;
        count += 1;
        points += frame.points.len();
        for (posed, arm) in posed.iter_mut().zip(&frame.arms) {
            *posed += usize::from(arm.pose.is_some());
        }
    }
    if let (Some(first), Some(last), true) = (stamps.first(), stamps.last(), count > 0) {
        println!(
            "  {count} frames from {first:.3} s to {last:.3} s, {} points on average",
            points / count
        );
    }
    if let Some((normal, offset)) = frames.table() {
        println!(
            "  table: normal ({:.3}, {:.3}, {:.3}), offset {offset:.3} m",
            normal.x, normal.y, normal.z
        );
    }
    for (name, posed) in arms.iter().zip(posed) {
        println!("  {name}: pose in {posed} frames");
    }
    let skipped = frames.skipped();
    if !skipped.is_empty() {
        println!(
            "  not readable: {} messages, in {} places",
            skipped.messages, skipped.places
        );
        skipped.first.iter().for_each(|skip| println!("    {skip}"));
    }
    let truth = reader.read_truth(path)?.frames;
    let points = truth.first().map_or(0, |frame| frame.points.len());
    println!("  truth: {} frames of {points} points", truth.len());
    Ok(())
}
