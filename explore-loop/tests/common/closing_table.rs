//! The closing table of a report, compared with `metrics.json` number by number.

use super::browser::Page;
use serde_json::Value;
use std::collections::BTreeMap;

/// Numbers in a text, in order, each with how many decimals it has.
fn decimals(text: &str) -> Vec<(f64, i32)> {
    let mut found = Vec::new();
    let mut word = String::new();
    for c in text.chars().chain([' ']) {
        let minus = c == '-' && word.is_empty();
        if c.is_ascii_digit() || (c == '.' && !word.is_empty()) || minus {
            word.push(c);
        } else {
            let number = word.trim_end_matches('.');
            let after = number.split_once('.').map_or(0, |(_, after)| after.len());
            let after = i32::try_from(after).unwrap();
            found.extend(number.parse().ok().map(|value| (value, after)));
            word.clear();
        }
    }
    found
}

/// The numbers alone.
pub fn numbers(text: &str) -> Vec<f64> {
    decimals(text).into_iter().map(|(value, _)| value).collect()
}

/// The numbers that a row of the closing table must show.
fn expected(row: &str, m: &Value) -> Option<Vec<f64>> {
    let at = |path: &str| -> f64 {
        let value = path.split('.').fold(m, |value, key| &value[key]);
        value.as_f64().unwrap_or_else(|| panic!("{path} of {m}"))
    };
    let list = |key: &str| -> Vec<f64> { serde_json::from_value(m[key].clone()).unwrap() };
    let percent = |key: &str| list(key).into_iter().map(|v| 100.0 * v).collect();
    // The name `p95` holds a number of its own.
    let spread = |key: &str| {
        let part = |k: &str| 1e3 * at(&format!("{key}.{k}"));
        vec![part("mean"), part("p95"), 95.0, part("max")]
    };
    let timing = |key: &str| {
        let part = |k: &str| at(&format!("{key}.{k}"));
        vec![part("median"), part("p95"), 95.0]
    };
    Some(match row {
        "stop" => numbers(m["reason"].as_str().unwrap_or("")),
        "Betti numbers" => list("betti"),
        "frames" if m["grips"] == "recorded" => vec![at("frames"), at("failed_frames")],
        "manipulations" | "vertices" | "frames" => vec![at(row)],
        "explored" => percent("explored"),
        "explored, two spacings" => percent("explored_2eps"),
        "accuracy" => spread("accuracy_m"),
        "completeness" => spread("completeness_m"),
        "F-score" => {
            let [near, far] = ["f_score.2mm", "f_score.5mm"].map(|k| 100.0 * at(k));
            vec![near, 2.0, far, 5.0]
        }
        "doubled" | "unsupported" => vec![100.0 * at(row)],
        "mesh" => ["euler", "open_edges", "non_manifold_edges", "components"]
            .map(|k| at(&format!("mesh.{k}")))
            .to_vec(),
        "shape difference" => vec![
            1e3 * at("shape_difference_m"),
            100.0 * at("shape_difference_rel"),
        ],
        "prediction error" => {
            let held = m["prediction_error_held_m"].as_f64().map(|v| 1e3 * v);
            let all = [1e3 * at("prediction_error_m")];
            all.into_iter().chain(held).collect()
        }
        "slide" => vec![1e3 * at("slide_m")],
        "stiffness over weight" => vec![at("stiffness_over_weight")],
        "contacts separated" => vec![at("contacts")],
        "never seen" => {
            let places = m["unseen"].as_array()?;
            let share: f64 = places.iter().filter_map(|p| p["share"].as_f64()).sum();
            let vector = |v: &Value| -> Vec<f64> {
                v.as_array()
                    .into_iter()
                    .flatten()
                    .filter_map(Value::as_f64)
                    .collect()
            };
            let named = places.iter().take(3).flat_map(|p| {
                let area = 1e4 * p["area_m2"].as_f64().unwrap_or(f64::NAN);
                [vec![area], vector(&p["middle_m"]), vector(&p["facing"])].concat()
            });
            let more = (places.len() > 3).then(|| (places.len() - 3) as f64);
            let first = std::iter::once(100.0 * share);
            first.chain(named).chain(more).collect()
        }
        "pixel tracks" => vec![
            1e3 * at("tracks.error_m.mean"),
            1e3 * at("tracks.error_m.p95"),
            95.0,
            1e3 * at("tracks.slide_m"),
            at("tracks.tied"),
            at("tracks.tracks"),
        ],
        "registration" => timing("registration_ms"),
        "frame time" => timing("frame_ms"),
        "robot time" => vec![at("robot_time_s")],
        "wall time" => vec![at("wall_s")],
        _ => return None,
    })
}

/// Every number in the closing table is that of `metrics.json`, to the decimals shown.
pub fn check_table(page: &mut Page, metrics: &Value) {
    let rows = page.value("[...document.querySelectorAll('#closing tr')].map(r => [...r.children].map(c => c.textContent))");
    let rows: Vec<[String; 2]> = serde_json::from_value(rows).unwrap();
    assert!(rows.len() >= 15, "{rows:?}");
    for [name, shown] in &rows {
        let silent = ["no ground truth", "nothing was lifted"].contains(&shown.as_str());
        // What keeps it from being closed is not in the metrics.
        if silent || name == "not closed" {
            continue;
        }
        let wanted = expected(name, metrics).unwrap_or_else(|| panic!("what is {name}?"));
        let found = decimals(shown);
        assert_eq!(found.len(), wanted.len(), "{name}: {shown}");
        for ((found, after), wanted) in found.iter().zip(&wanted) {
            let half = 0.5 * 10f64.powi(-after) + 1e-9;
            assert!(
                (found - wanted).abs() <= half,
                "{name}: {found}, not {wanted}"
            );
        }
        if name == "mesh" {
            let watertight = !shown.contains("not watertight");
            assert_eq!(watertight, metrics["mesh"]["watertight"] == true);
        }
        if name == "stop" {
            let stop = metrics["stop"].as_str().unwrap();
            assert!(shown.starts_with(stop), "{shown}");
        }
    }
}

/// The reader of numbers reads numbers.
#[test]
fn numbers_are_read_from_words() {
    let all = BTreeMap::from([
        (
            "0.70 mm mean, 2.95 mm p95, 4.57 mm max",
            vec![0.7, 2.95, 95.0, 4.57],
        ),
        ("[1, 0, 1]", vec![1.0, 0.0, 1.0]),
        (
            "watertight, Euler -2, 0 open and 12 non-manifold edges, 1 component",
            vec![-2.0, 0.0, 12.0, 1.0],
        ),
        ("closed", vec![]),
        ("12.30 %, not 5.", vec![12.3, 5.0]),
    ]);
    for (text, wanted) in all {
        assert_eq!(numbers(text), wanted, "{text}");
    }
}
