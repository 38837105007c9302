//! Runs that once failed, with their seeds.
#![allow(missing_docs, clippy::unwrap_used, reason = "tests")]

use serde_json::Value;
use std::process::Command;

/// The metrics of a whole run, and the ratio of the hollow to the solid hypothesis frame by frame.
fn run(arguments: &[&str]) -> (Value, Vec<f64>) {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let status = Command::new(env!("CARGO_BIN_EXE_explore"))
        .args(["run", "--quiet", "--out", out])
        .args(arguments)
        .status()
        .unwrap();
    assert!(status.success(), "{arguments:?} did not close");
    let read = |name: &str| std::fs::read_to_string(folder.path().join(name)).unwrap();
    let frames = read("frames.csv");
    let mut lines = frames.lines();
    let mut header = lines.next().unwrap().split(',');
    let column = header.position(|h| h == "hollow_over_solid").unwrap();
    let ratios = lines.filter_map(|line| line.split(',').nth(column)?.parse().ok());
    (
        serde_json::from_str(&read("metrics.json")).unwrap(),
        ratios.collect(),
    )
}

/// In the middle of its lift this solid liver is predicted better as a hollow one, and was taken for that: it ended closed, but 1.8 mm off in
/// the mean and 6.5 mm at 95 %.
#[test]
fn a_solid_body_is_not_taken_for_hollow_in_the_middle_of_a_lift() {
    let (metrics, ratios) = run(&["--scene", "liver", "--arms", "2", "--seed", "2"]);
    let least = ratios.iter().copied().fold(f64::INFINITY, f64::min);
    assert!(least < 0.8, "the run tests nothing any more: {least}");
    assert!(*ratios.last().unwrap() > 0.9, "{ratios:?}");
    for measure in ["accuracy_m", "completeness_m"] {
        let spread = &metrics[measure];
        assert!(spread["mean"].as_f64().unwrap() < 1.1e-3, "{spread}");
        assert!(spread["p95"].as_f64().unwrap() < 4e-3, "{spread}");
    }
    // The fusion of this run gives the body surface that lies 0.08 mm under the table.
    let below = metrics["constraints"]["below_table_m"].as_f64().unwrap();
    assert!(below <= 1e-6, "{below}");
    assert_eq!(metrics["mesh"]["watertight"], true);
    assert_eq!(metrics["mesh"]["euler"], 2);
}
