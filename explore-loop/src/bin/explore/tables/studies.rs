//! The available studies: those of the paper, and one that measures what each part of this method contributes.

use super::ending::Ending;
use super::study::{
    ACCURACY, ACCURACY_P95, AT_END, AT_START, BELOW_TABLE, COMPLETENESS, COMPLETENESS_P95,
    DIFFERENCE, DIFFERENCE_REL, DOUBLED, F_SCORE, FASTEST, GAIN, HIDDEN, MANIPULATIONS, NEEDED,
    NON_MANIFOLD, Plot, REGISTRATION, ROBOT_TIME, Row, SLIDE, Study, TROUBLES, VERTICES,
};
use super::summary::Summary;

/// All studies.
pub(super) fn all() -> Vec<Study> {
    vec![
        spacing(),
        planning(),
        speed(),
        baseline(),
        objects(),
        constraints(),
        filter(),
        colour(),
        additions(),
    ]
}

fn nothing(_: &[Summary]) -> Vec<String> {
    Vec::new()
}

const LIVER: [&str; 4] = ["--scene", "liver", "--arms", "3"];

/// The options of a run of the liver, and more.
fn liver<'a>(more: &[&'a str]) -> Vec<&'a str> {
    [&LIVER, more].concat()
}

fn spacing() -> Study {
    let row = |mm: &&str| Row::explored(&[mm], &liver(&["--spacing", mm]));
    Study {
        name: "spacing",
        title: "Spacing of the model",
        about: "Liver, three arms, sampled at several spacings (table 2 of the paper).",
        seeds: 5,
        keys: &["spacing, mm"],
        rows: ["4", "5", "7", "10"].iter().map(row).collect(),
        columns: vec![
            MANIPULATIONS,
            DIFFERENCE,
            DIFFERENCE_REL,
            ACCURACY,
            ACCURACY_P95,
            COMPLETENESS,
            NON_MANIFOLD,
            VERTICES,
            REGISTRATION,
        ],
        plot: Plot::Curves {
            over: 0,
            panels: &["shape_difference_mm", "registration_median_ms"],
        },
        remark: nothing,
    }
}

fn planning() -> Study {
    let mut rows = Vec::new();
    for arms in ["2", "3"] {
        for grips in ["planned", "random"] {
            let run = ["--scene", "liver", "--arms", arms, "--grips", grips];
            rows.push(Row::explored(&[arms, grips], &run));
        }
    }
    Study {
        name: "planning",
        title: "Planned against random grips",
        about: "Liver, two and three arms (figure 13 of the paper). Random grips are drawn on the boundary and moved by the same motion planner.",
        seeds: 10,
        keys: &["arms", "grips"],
        rows,
        columns: vec![NEEDED, GAIN, AT_START, AT_END, TROUBLES, ACCURACY],
        plot: Plot::Explored,
        remark: planned_over_random,
    }
}

/// Ratio of the manipulations of planned grips to those of random ones, for each number of arms.
fn planned_over_random(summaries: &[Summary]) -> Vec<String> {
    let needed = |arms: &str, grips: &str| {
        let row = summaries.iter().find(|s| s.row.values == [arms, grips])?;
        Some(row.figure(NEEDED.key)?.mean)
    };
    let line = |arms: &&str| {
        let ratio = needed(arms, "planned")? / needed(arms, "random")?;
        Some(format!(
            "With {arms} arms, planned grips need {ratio:.2} times the manipulations of random ones."
        ))
    };
    ["2", "3"].iter().filter_map(line).collect()
}

fn speed() -> Study {
    let row = |speed: &&str| {
        let run = liver(&["--speed", speed, "--without", "speed-limit"]);
        Row::explored(&[speed], &run)
    };
    Study {
        name: "speed",
        title: "Speed of the grips",
        about: "Liver, three arms, clouds at 10 Hz, grips led at the speed given from beginning to end (figure 14 of the paper): without a ramp, \
                without slowing down where frames fit badly, and without limits on rotation and on the motion of the surface between frames.",
        seeds: 5,
        keys: &["speed, mm/s"],
        rows: ["15", "30", "60", "90", "120", "200", "250"]
            .iter()
            .map(row)
            .collect(),
        columns: vec![
            FASTEST,
            MANIPULATIONS,
            TROUBLES,
            DIFFERENCE,
            ACCURACY,
            ACCURACY_P95,
            HIDDEN,
            SLIDE,
            ROBOT_TIME,
        ],
        plot: Plot::Curves {
            over: 0,
            panels: &[
                "shape_difference_mm",
                "prediction_error_held_mm",
                "robot_time_s",
            ],
        },
        remark: failing_speed,
    }
}

/// The slowest speed at which not every run closed.
fn failing_speed(summaries: &[Summary]) -> Vec<String> {
    let speed = |s: &Summary| s.row.values[0].clone();
    let fails = summaries.iter().find(|s| !s.all_closed());
    vec![match (fails, summaries.last()) {
        (Some(s), _) => format!(
            "Failing speed: {} mm/s, at which {} of {} runs closed.",
            speed(s),
            s.ended(Ending::Closed),
            s.runs.len()
        ),
        (None, Some(last)) => format!(
            "No failing speed: every run closed up to {} mm/s.",
            speed(last)
        ),
        (None, None) => return Vec::new(),
    }]
}

fn baseline() -> Study {
    let mut rows = Vec::new();
    for scene in ["liver", "ellipsoid", "tube"] {
        let run = ["--scene", scene, "--arms", "3"];
        rows.push(Row::replayed(&[scene, OURS], &run, &[]));
        let other = ["--reconstruction", "dynamic-fusion"];
        rows.push(Row::replayed(&[scene, "DynamicFusion"], &run, &other));
    }
    Study {
        name: "baseline",
        title: "Against DynamicFusion",
        about: "The same recordings reconstructed with the elastic body and with a volume fused through a warp field (table 3 of the paper).",
        seeds: 5,
        keys: &["object", "reconstruction"],
        rows,
        columns: vec![
            ACCURACY,
            ACCURACY_P95,
            COMPLETENESS,
            COMPLETENESS_P95,
            DIFFERENCE,
            HIDDEN,
            SLIDE,
            DOUBLED,
            REGISTRATION,
        ],
        plot: Plot::Whiskers {
            panels: &["accuracy_mean_mm", "prediction_error_held_mm"],
        },
        remark: improvement,
    }
}

/// The name of this crate's reconstruction in the study of baselines.
const OURS: &str = "elastic body";

/// By how much the mean distance to the truth is smaller than that of the baseline, for each object.
fn improvement(summaries: &[Summary]) -> Vec<String> {
    let accuracy = |s: &Summary| Some(s.figure(ACCURACY.key)?.mean);
    let line = |ours: &Summary| {
        let object = &ours.row.values[0];
        let same = |s: &&Summary| s.row.values[0] == *object && s.row.values[1] != OURS;
        let other = summaries.iter().find(same)?;
        let gained = 100.0 * (1.0 - accuracy(ours)? / accuracy(other)?);
        let word = if gained < 0.0 { "worse" } else { "better" };
        let (gained, other) = (gained.abs(), &other.row.values[1]);
        Some(format!(
            "{object}: the {OURS} is {gained:.0} % {word} than {other} in accuracy, on the mean of the runs."
        ))
    };
    let ours = summaries.iter().filter(|s| s.row.values[1] == OURS);
    ours.filter_map(line).collect()
}

fn objects() -> Study {
    let row = |(scene, arms): (&str, &str)| {
        Row::explored(&[scene, arms], &["--scene", scene, "--arms", arms])
    };
    let objects = [
        ("glove", "2"),
        ("beanie", "2"),
        ("liver", "3"),
        ("colon", "2"),
    ];
    Study {
        name: "objects",
        title: "The four objects",
        about: "Glove, beanie, liver and colon, with as many arms as in the paper (tables 4 and 5). What was explored before each manipulation, and the \
                Betti numbers then, are in the list of runs.",
        seeds: 3,
        keys: &["object", "arms"],
        rows: objects.map(row).to_vec(),
        columns: vec![
            MANIPULATIONS,
            AT_START,
            AT_END,
            DIFFERENCE,
            ACCURACY,
            ACCURACY_P95,
            COMPLETENESS,
            COMPLETENESS_P95,
            F_SCORE,
            DOUBLED,
            ROBOT_TIME,
        ],
        plot: Plot::Explored,
        remark: nothing,
    }
}

/// Rows that replay the same explorations of some objects, each with other parts left out.
fn replays(objects: &[(&str, &str)], left_out: &[(&str, &str)]) -> Vec<Row> {
    let mut rows = Vec::new();
    for (scene, arms) in objects {
        let run = ["--scene", *scene, "--arms", *arms];
        for (name, parts) in left_out {
            let without = ["--without", *parts];
            let options = if parts.is_empty() { &[][..] } else { &without };
            rows.push(Row::replayed(&[scene, name], &run, options));
        }
    }
    rows
}

fn constraints() -> Study {
    Study {
        name: "constraints",
        title: "Constraints on and off",
        about: "The same recordings replayed with and without what keeps the body above the table and out of itself (the paper's validation of the \
                constraints on the beanie).",
        seeds: 5,
        keys: &["object", "left out"],
        rows: replays(
            &[("beanie", "2"), ("liver", "3")],
            &[
                ("nothing", ""),
                ("table", "table"),
                ("self-contact", "self-contact"),
                ("both", "table,self-contact"),
            ],
        ),
        columns: vec![
            BELOW_TABLE,
            HIDDEN,
            SLIDE,
            ACCURACY,
            ACCURACY_P95,
            COMPLETENESS,
            DOUBLED,
        ],
        plot: Plot::Whiskers {
            panels: &["below_table_mm", "prediction_error_held_mm"],
        },
        remark: nothing,
    }
}

fn filter() -> Study {
    Study {
        name: "filter",
        title: "Filter on and off",
        about: "The same recordings replayed with the filter, and with registration alone: no momentum, no weight, no grips before the data, no \
                constraints.",
        seeds: 5,
        keys: &["object", "left out"],
        rows: replays(
            &[("liver", "3"), ("ellipsoid", "3")],
            &[("nothing", ""), ("filter", "filter")],
        ),
        columns: vec![
            HIDDEN,
            SLIDE,
            BELOW_TABLE,
            ACCURACY,
            ACCURACY_P95,
            COMPLETENESS,
            DOUBLED,
            REGISTRATION,
        ],
        plot: Plot::Whiskers {
            panels: &["prediction_error_held_mm", "accuracy_mean_mm"],
        },
        remark: nothing,
    }
}

fn colour() -> Study {
    let mut rows = Vec::new();
    for scene in ["liver", "tube", "box"] {
        let run = ["--scene", scene, "--arms", "3", "--features", "on"];
        for features in ["off", "on"] {
            rows.push(Row::replayed(
                &[scene, features],
                &run,
                &["--features", features],
            ));
        }
    }
    Study {
        name: "colour",
        title: "Colour features on and off",
        about: "The same recordings replayed with features of the colour image as landmarks, and without.",
        seeds: 3,
        keys: &["object", "features"],
        rows,
        columns: vec![
            SLIDE,
            HIDDEN,
            ACCURACY,
            ACCURACY_P95,
            COMPLETENESS,
            COMPLETENESS_P95,
            DOUBLED,
            REGISTRATION,
        ],
        plot: Plot::Whiskers {
            panels: &["slide_mm", "prediction_error_held_mm"],
        },
        remark: nothing,
    }
}

fn additions() -> Study {
    let row = |(scene, arms, part): (&str, &str, &str)| {
        let mut run = vec!["--scene", scene, "--arms", arms];
        if part != "nothing" {
            run.extend(["--without", part]);
        }
        Row::explored(&[scene, part], &run)
    };
    let of = |scene: &'static str, arms: &'static str, parts: &[&'static str]| {
        let parts = std::iter::once("nothing").chain(parts.iter().copied());
        parts
            .map(|part| row((scene, arms, part)))
            .collect::<Vec<Row>>()
    };
    let liver = [
        "weight",
        "weight-estimate",
        "friction",
        "refusion",
        "refit",
        "surface-test",
        "hollow",
        "lying",
        "recovery",
    ];
    Study {
        name: "additions",
        title: "Each addition on and off",
        about: "Explorations with one part left out at a time, on an object that needs the part.",
        seeds: 5,
        keys: &["object", "left out"],
        rows: [
            of("liver", "3", &liver),
            of("glove", "2", &["pieces", "self-contact"]),
            of("beanie", "2", &["hollow", "stretching"]),
        ]
        .concat(),
        columns: vec![
            MANIPULATIONS,
            TROUBLES,
            AT_END,
            ACCURACY,
            ACCURACY_P95,
            COMPLETENESS,
            COMPLETENESS_P95,
            DOUBLED,
            HIDDEN,
            SLIDE,
        ],
        plot: Plot::Whiskers {
            panels: &[
                "accuracy_mean_mm",
                "completeness_mean_mm",
                "prediction_error_held_mm",
            ],
        },
        remark: nothing,
    }
}
