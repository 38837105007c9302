//! The closing table of a run or a replay: one line with name and value for each measure.

use crate::Failure;
use explore_loop::measure::{MeshReport, Spread};
use explore_loop::report::metrics::{Metrics, UnseenPlace};
use mesh_io::program::{Output, unless_closed};
use std::io::Write;

/// Prints the closing table. A reader that has gone is no failure: the results are in the folder.
pub fn table(output: Output, rows: &[(&str, String)]) -> Result<(), Failure> {
    let width = rows.iter().map(|(name, _)| name.len()).max().unwrap_or(0);
    let line = |(name, value): &(&str, String)| format!("  {name:<width$}  {value}\n");
    let text: String = rows.iter().map(line).collect();
    Ok(unless_closed(write!(output.words(), "{text}"))?)
}

/// The rows of the closing table that describe the model.
pub fn measure_rows(metrics: &Metrics) -> Vec<(&'static str, String)> {
    let mut rows = shape_rows(metrics);
    rows.extend(motion_rows(metrics));
    if let Some(of) = metrics.model_of.filter(|of| *of < metrics.manipulations) {
        rows.push((
            "model",
            format!("as after {of} manipulations: later ones have spoiled it"),
        ));
    }
    if metrics.contacts > 0 {
        rows.push(("contacts separated", metrics.contacts.to_string()));
    }
    rows.extend(unseen(&metrics.unseen).map(|text| ("never seen", text)));
    rows
}

fn unknown() -> String {
    "no ground truth".to_owned()
}

fn percent(share: f64) -> String {
    format!("{:.1} %", 100.0 * share)
}

/// The shape at rest.
fn shape_rows(metrics: &Metrics) -> Vec<(&'static str, String)> {
    let list = |shares: &Option<Vec<f64>>| {
        shares.as_ref().map_or_else(unknown, |shares| {
            let texts: Vec<String> = shares.iter().map(|s| percent(*s)).collect();
            texts.join(", ")
        })
    };
    let spread = |spread: Option<Spread>| {
        spread.map_or_else(unknown, |s| {
            format!("{} mean, {} p95, {} max", mm(s.mean), mm(s.p95), mm(s.max))
        })
    };
    vec![
        ("explored", list(&metrics.explored)),
        ("explored, two spacings", list(&metrics.explored_2eps)),
        ("accuracy", spread(metrics.accuracy_m)),
        ("completeness", spread(metrics.completeness_m)),
        (
            "F-score",
            metrics.f_score.map_or_else(unknown, |f| {
                format!(
                    "{} at 2 mm, {} at 5 mm",
                    percent(f.at_2mm),
                    percent(f.at_5mm)
                )
            }),
        ),
        ("doubled", metrics.doubled.map_or_else(unknown, percent)),
        (
            "unsupported",
            metrics
                .unsupported
                .map_or_else(|| "no mesh".to_owned(), percent),
        ),
        ("mesh", mesh_text(&metrics.mesh)),
        (
            "shape difference",
            match (metrics.shape_difference_m, metrics.shape_difference_rel) {
                (Some(metres), Some(share)) => {
                    format!("{} ({} of the size)", mm(metres), percent(share))
                }
                _ => unknown(),
            },
        ),
    ]
}

/// The motion and the material.
fn motion_rows(metrics: &Metrics) -> [(&'static str, String); 3] {
    [
        (
            "prediction error",
            match (metrics.prediction_error_m, metrics.prediction_error_held_m) {
                (Some(all), Some(held)) => format!("{}, {} while held", mm(all), mm(held)),
                (Some(all), None) => mm(all),
                (None, _) => unknown(),
            },
        ),
        ("slide", metrics.slide_m.map_or_else(unknown, mm)),
        (
            "stiffness over weight",
            metrics
                .stiffness_over_weight
                .map_or_else(|| "nothing was lifted".to_owned(), |s| format!("{s:.2} m")),
        ),
    ]
}

/// Most places named in the closing table; `metrics.json` has them all.
const MOST_PLACES: usize = 3;

/// Where the surface was never seen, if anywhere.
fn unseen(places: &[UnseenPlace]) -> Option<String> {
    if places.is_empty() {
        return None;
    }
    let three = |v: [f64; 3], digits: usize| v.map(|x| format!("{x:.digits$}")).join(" ");
    let named = places.iter().take(MOST_PLACES).map(|place| {
        format!(
            "{:.2} cm² around {} m, facing {}",
            1e4 * place.area_m2,
            three(place.middle_m, 3),
            three(place.facing, 1)
        )
    });
    let mut texts: Vec<String> = named.collect();
    if places.len() > MOST_PLACES {
        texts.push(format!("{} smaller places", places.len() - MOST_PLACES));
    }
    let share: f64 = places.iter().map(|place| place.share).sum();
    Some(format!(
        "{:.2} % of the surface: {}",
        100.0 * share,
        texts.join("; ")
    ))
}

fn mesh_text(mesh: &MeshReport) -> String {
    let watertight = if mesh.watertight {
        "watertight"
    } else {
        "not watertight"
    };
    let components = if mesh.components == 1 {
        "1 component".to_owned()
    } else {
        format!("{} components", mesh.components)
    };
    format!(
        "{watertight}, Euler {}, {} open and {} non-manifold edges, {components}",
        mesh.euler, mesh.open_edges, mesh.non_manifold_edges
    )
}

/// A length in mm for people.
pub fn mm(metres: f64) -> String {
    format!("{:.2} mm", metres * 1e3)
}
