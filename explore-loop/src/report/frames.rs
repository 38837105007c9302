//! `frames.csv`: one line for each frame, to find where an exploration went wrong.

use crate::canonical::CanonicalModel;
use crate::reconstruct::FrameReport;
use std::fmt::Write;

/// Header of the file.
pub const HEADER: &str = "frame,stamp_s,vertices,measured,added,fused,residual_mm,overlap,seen_error_mm,hidden_error_mm,hollow_over_solid,grip_force_weights,active,near_itself,infeasible,violation_um,below_table_um,registration_ms,frame_ms,failure\n";

/// Mean of the errors of the vertices for which `seen` equals `wanted`, in mm; empty when there is none.
fn mean_mm(errors: &[f64], seen: &[bool], wanted: bool) -> String {
    let chosen: Vec<f64> = errors
        .iter()
        .zip(seen)
        .filter(|(_, s)| **s == wanted)
        .map(|(e, _)| *e)
        .collect();
    if chosen.is_empty() {
        String::new()
    } else {
        format!(
            "{:.3}",
            1e3 * chosen.iter().sum::<f64>() / chosen.len() as f64
        )
    }
}

/// One line; `errors` are the distances of the vertices from their true positions, empty where these are unknown.
pub fn line(stamp: f64, report: &FrameReport, model: &CanonicalModel, errors: &[f64]) -> String {
    let mut text = String::new();
    // Writing to a String cannot fail.
    let _ = writeln!(
        text,
        "{},{stamp:.3},{},{},{},{},{:.3},{:.3},{},{},{},{},{},{},{},{:.3},{:.1},{:.2},{:.2},{}",
        report.frame,
        model.len(),
        report.measured.iter().filter(|m| **m).count(),
        report.added,
        report.fused,
        report.residual * 1e3,
        report.overlap,
        mean_mm(errors, &report.measured, true),
        mean_mm(errors, &report.measured, false),
        report
            .hollow_over_solid
            .map_or_else(String::new, |r| format!("{r:.3}")),
        report
            .grip_force
            .map_or_else(String::new, |f| format!("{:.3}", f.norm())),
        report.constraints.active,
        report.constraints.near_itself,
        report.constraints.infeasible,
        report.constraints.violation * 1e6,
        report.constraints.below_table * 1e6,
        report.registration_ms,
        report.frame_ms,
        report.failure.as_deref().unwrap_or("").replace(',', ";"),
    );
    text
}
