//! Prints what a session file holds: `cargo run --example session_info -- FILE.mcap`.
#![allow(clippy::print_stdout, reason = "printing is what this program is for")]

use dvrk_io::Error;
use dvrk_io::session::{SessionReader, read_truth};

fn main() -> Result<(), Error> {
    for path in std::env::args().skip(1) {
        let session = SessionReader::open(&path)?;
        let end = if session.complete {
            "complete"
        } else {
            "ends early"
        };
        println!("{path} ({end})");
        for topic in &session.topics {
            println!(
                "  {:>6}  {:<28} {}",
                topic.count, topic.topic, topic.type_name
            );
        }
        let (first, last) = (session.frames.first(), session.frames.last());
        if let (Some(first), Some(last)) = (first, last) {
            let points = session
                .frames
                .iter()
                .map(|frame| frame.points.len())
                .sum::<usize>();
            let count = session.frames.len();
            println!(
                "  {count} frames from {:.3} s to {:.3} s, {} points on average",
                first.stamp,
                last.stamp,
                points / count
            );
        }
        if let Some((normal, offset)) = session.table {
            println!(
                "  table: normal ({:.3}, {:.3}, {:.3}), offset {offset:.3} m",
                normal.x, normal.y, normal.z
            );
        }
        for (index, name) in session.arm_names.iter().enumerate() {
            let posed = session
                .frames
                .iter()
                .filter(|frame| frame.arms[index].pose.is_some())
                .count();
            println!("  {name}: pose in {posed} frames");
        }
        let truth = read_truth(&path)?;
        println!(
            "  truth: {} frames of {} points",
            truth.len(),
            truth.first().map_or(0, |frame| frame.points.len())
        );
    }
    Ok(())
}
