//! Accuracy on generated pairs, for visible and hidden points: `cargo bench -p nonrigid-reg --bench bars [-- --write FOLDER]`
//!
//! Prints, in mm, mean and 95th percentile over the source points, the mean over the surface that the source does not show (by
//! `gpwrm::Field` through the nodes), and milliseconds with a fresh registrar (best of three). `--write` puts the pairs into FOLDER as
//! PLY and CSV files instead, for other programs.
#![allow(missing_docs, clippy::unwrap_used, clippy::print_stdout)]

mod generator;

use std::fmt::Write as _;
use std::path::Path;
use std::time::Instant;

use generator::{Case, Motion, Pair, Shape, error_mm, moved};
use nalgebra::Point3;
use nonrigid_reg::{Options, Registrar};

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    if let Some(at) = arguments.iter().position(|a| a == "--write") {
        let folder = arguments.get(at + 1).expect("--write FOLDER");
        return write_all(Path::new(folder));
    }
    println!(
        "{:34} {:>6} {:>6} {:>7} {:>6}",
        "generated pairs", "mean", "p95", "hidden", "ms"
    );
    for mode in ["landmarks", "none", "features"] {
        row(mode, "core, 5 mm", &Case::core(0.005));
    }
    let with = |change: fn(&mut Case)| {
        let mut cases = Case::sweep(0.005);
        cases.iter_mut().for_each(change);
        cases
    };
    row("landmarks", "1 mm", &Case::sweep(0.001));
    row("landmarks", "20 mm", &Case::sweep(0.02));
    row("features", "20 mm", &Case::sweep(0.02));
    row("landmarks", "40 mm", &Case::sweep(0.04));
    row("landmarks", "no noise", &with(|c| c.noise = 0.0));
    row("landmarks", "1,000 points", &with(|c| c.count = 1000));
    row("landmarks", "10,000 points", &with(|c| c.count = 10_000));
    row("landmarks", "occluded", &with(|c| c.occluded = true));
    row(
        "landmarks",
        "at rest",
        &[Case::new(Shape::Liver, Motion::Rest, 0.0)],
    );
}

/// Means over the cases.
fn row(mode: &str, what: &str, cases: &[Case]) {
    let mut sums = [0.0; 4];
    for case in cases {
        let score = score(&case.make(), mode);
        for (sum, value) in sums.iter_mut().zip(score) {
            *sum += value / cases.len() as f64;
        }
        if std::env::args().any(|a| a == "--each") {
            println!(
                "  {:32} {:6.3} {:6.3} {:7.3} {:6.1}",
                case.name(),
                score[0],
                score[1],
                score[2],
                score[3]
            );
        }
    }
    println!(
        "{:34} {:6.3} {:6.3} {:7.3} {:6.1}",
        format!("{what}, {mode}"),
        sums[0],
        sums[1],
        sums[2],
        sums[3]
    );
}

fn score(pair: &Pair, mode: &str) -> [f64; 4] {
    let landmarks: &[_] = if mode == "none" { &[] } else { &pair.landmarks };
    let features: &[_] = if mode == "features" {
        &pair.features
    } else {
        &[]
    };
    let run = || {
        let mut registrar = Registrar::new(Options::default());
        let start = Instant::now();
        let (source, target) = (pair.source.cloud(), pair.target.cloud());
        let result = registrar
            .register(&source, &target, landmarks, features, None)
            .unwrap();
        (result, start.elapsed().as_secs_f64() * 1e3)
    };
    let (result, first) = run();
    let ms = first.min(run().1).min(run().1);
    let (mean, p95) = error_mm(
        &moved(&pair.source.points, &result.displacements),
        &pair.truth,
    );
    // Registered nodes carry some noise, and what is hidden is far from them: wide supports, more shrinkage.
    let options = gpwrm::FieldOptions::default()
        .with_support(gpwrm::Support::Nearest(64))
        .with_shrinkage(0.03);
    let field =
        gpwrm::Field::new(&result.node_positions, &result.node_displacements, &options).unwrap();
    let (hidden, _) = error_mm(&field.warp(&pair.hidden), &pair.hidden_truth);
    [mean, p95, hidden, ms]
}

fn write_all(folder: &Path) {
    let mut cases = Case::core(0.005);
    cases.extend(Case::sweep(0.02));
    cases.extend(Case::sweep(0.005).into_iter().map(|c| Case {
        occluded: true,
        ..c
    }));
    for case in cases {
        let pair = case.make();
        let path = folder.join(case.name());
        std::fs::create_dir_all(&path).unwrap();
        let file = |name: &str, text: String| std::fs::write(path.join(name), text).unwrap();
        let oriented = |view: &generator::View| -> Vec<Vec<f64>> {
            let rows = view.points.iter().zip(&view.normals);
            rows.map(|(p, n)| vec![p.x, p.y, p.z, n.x, n.y, n.z])
                .collect()
        };
        let bare = |points: &[Point3<f64>]| {
            points
                .iter()
                .map(|p| vec![p.x, p.y, p.z])
                .collect::<Vec<_>>()
        };
        file("source.ply", ply(&oriented(&pair.source)));
        file("target.ply", ply(&oriented(&pair.target)));
        file("truth.ply", ply(&bare(&pair.truth)));
        file("hidden.ply", ply(&bare(&pair.hidden)));
        file("hidden_truth.ply", ply(&bare(&pair.hidden_truth)));
        let pairs = |rows: Vec<(Point3<f64>, Point3<f64>)>| {
            let mut text = String::from("sx,sy,sz,tx,ty,tz\n");
            for (s, t) in rows {
                writeln!(text, "{},{},{},{},{},{}", s.x, s.y, s.z, t.x, t.y, t.z).unwrap();
            }
            text
        };
        file(
            "landmarks.csv",
            pairs(
                pair.landmarks
                    .iter()
                    .map(|l| (l.source, l.target))
                    .collect(),
            ),
        );
        file(
            "features.csv",
            pairs(pair.features.iter().map(|f| (f.source, f.target)).collect()),
        );
        println!("{}", path.display());
    }
}

fn ply(rows: &[Vec<f64>]) -> String {
    let names = ["x", "y", "z", "nx", "ny", "nz"];
    let mut text = format!("ply\nformat ascii 1.0\nelement vertex {}\n", rows.len());
    for name in &names[..rows.first().map_or(3, Vec::len)] {
        writeln!(text, "property double {name}").unwrap();
    }
    text.push_str("end_header\n");
    for row in rows {
        let line: Vec<String> = row.iter().map(f64::to_string).collect();
        writeln!(text, "{}", line.join(" ")).unwrap();
    }
    text
}
