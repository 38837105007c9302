//! `explore tables` as a user runs it: studies that are killed, interrupted, divided among machines and merged; its tables of results with
//! known medians; its plots.
#![allow(missing_docs, clippy::unwrap_used, reason = "tests")]

use explore_loop::measure::Spread;
use explore_loop::report::metrics::Metrics;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

fn tables(out: &Path, more: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_explore"));
    command.arg("tables").arg("--out").arg(out).args(more);
    command
}

#[track_caller]
fn succeeds(mut command: Command) -> Output {
    let output = command.output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{said}");
    output
}

/// The program ends with `code` and says why, with these words.
#[track_caller]
fn refuses(mut command: Command, code: i32, words: &[&str]) {
    let output = command.output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(code), "{said}");
    for word in words {
        assert!(said.contains(word), "'{word}' is not in: {said}");
    }
}

/// The lines of a CSV, each with the names of its columns, without the figures that tell how long something took.
fn untimed(path: &Path) -> Vec<BTreeMap<String, String>> {
    let mut reader = csv::Reader::from_path(path).unwrap();
    let mut lines: Vec<BTreeMap<String, String>> =
        reader.deserialize().map(Result::unwrap).collect();
    lines.retain(|line| {
        line.get("figure")
            .is_none_or(|f| f != "registration_median_ms")
    });
    for line in &mut lines {
        line.remove("registration_median_ms");
    }
    assert!(!lines.is_empty());
    // No two columns of one name.
    let header = reader.headers().unwrap();
    let names: std::collections::BTreeSet<&str> = header.iter().collect();
    assert_eq!(names.len(), header.len());
    lines
}

/// The result files of a study in a folder.
fn results(out: &Path, study: &str) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(out.join("jobs").join(study))
        .into_iter()
        .flatten();
    let paths = entries.map(|e| e.unwrap().path());
    paths
        .filter(|p| p.extension().is_some_and(|e| e == "json"))
        .collect()
}

/// Waits until something has come about while a program runs.
#[track_caller]
fn wait_for(child: &mut Child, what: impl Fn() -> bool) {
    let begun = Instant::now();
    while !what() {
        assert!(
            child.try_wait().unwrap().is_none(),
            "ended before it was to be stopped"
        );
        assert!(begun.elapsed() < Duration::from_secs(300));
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// Observation only: no manipulation, a few seconds per run.
const STUDY: [&str; 4] = ["--only", "spacing", "--seeds", "0"];
const LOOKING: [&str; 3] = ["--", "--max-manipulations", "0"];

/// One study in one go, two jobs at a time, and again one by one as two shards: the first is killed after its first job and goes on, the second is interrupted in its first job and
/// goes on. Merged they give the same results, except for times.
#[test]
fn killed_interrupted_sharded_and_merged_it_is_the_study_in_one_go() {
    let folder = tempfile::tempdir().unwrap();
    let [whole, first, second, merged] =
        ["whole", "first", "second", "merged"].map(|name| folder.path().join(name));
    let with = |out: &Path, more: &[&str]| tables(out, &[&STUDY, more, &LOOKING].concat());
    let table = succeeds(with(&whole, &["--jobs", "2"])).stdout;
    assert!(
        String::from_utf8(table)
            .unwrap()
            .contains("# Spacing of the model")
    );

    let shard = ["--shard", "1/2"];
    let mut child = with(&first, &shard).stderr(Stdio::null()).spawn().unwrap();
    wait_for(&mut child, || results(&first, "spacing").len() == 1);
    child.kill().unwrap();
    child.wait().unwrap();
    let done = std::fs::read(&results(&first, "spacing")[0]).unwrap();
    let went_on = String::from_utf8(succeeds(with(&first, &shard)).stderr).unwrap();
    assert!(
        went_on.starts_with("1 of 2 jobs are done; about"),
        "{went_on}"
    );
    assert!(went_on.contains("nothing left"), "{went_on}");
    // What was done was not done again.
    let kept = results(&first, "spacing")
        .iter()
        .any(|p| std::fs::read(p).unwrap() == done);
    assert!(kept);

    let shard = ["--shard", "2/2"];
    let mut child = with(&second, &shard)
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    wait_for(&mut child, || second.join("work/spacing").is_dir());
    let asked = Command::new("kill")
        .args(["-INT", &child.id().to_string()])
        .status()
        .unwrap();
    assert!(asked.success());
    let output = child.wait_with_output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(
        said.lines().last().unwrap().contains("interrupted"),
        "{said}"
    );
    succeeds(with(&second, &shard));
    assert!(
        !second.join("spacing.csv").exists(),
        "a shard has no tables"
    );

    let dirs = [first.to_str().unwrap(), second.to_str().unwrap()];
    succeeds(tables(
        &merged,
        &[&["--merge"][..], &dirs, &LOOKING].concat(),
    ));
    for name in ["spacing.csv", "spacing_runs.csv"] {
        assert_eq!(untimed(&merged.join(name)), untimed(&whole.join(name)));
    }
    let runs = untimed(&whole.join("spacing_runs.csv"));
    let spacings: Vec<&str> = runs.iter().map(|r| r["spacing_mm"].as_str()).collect();
    assert_eq!(spacings, ["4", "5", "7", "10"]);
    for run in &runs {
        assert_eq!(
            (run["ended"].as_str(), run["stop"].as_str()),
            ("grips", "too_many_manipulations")
        );
        let command = format!(
            "explore run --scene liver --arms 3 --spacing {} --max-manipulations 0 --seed 0",
            run["spacing_mm"]
        );
        assert_eq!(run["command"], command);
        let seen: f64 = run["explored_percent"].parse().unwrap();
        assert!((30.0..80.0).contains(&seen), "{seen}");
        assert!(run["betti"].starts_with("(1 "), "{}", run["betti"]);
    }
    // Finer samples, more vertices.
    let vertices: Vec<f64> = runs
        .iter()
        .map(|r| r["vertices"].parse().unwrap())
        .collect();
    assert!(vertices.is_sorted_by(|a, b| a > b), "{vertices:?}");
    // The work is cleared away, and nothing is left to do.
    assert!(
        results(&whole, "spacing").len() == 4
            && !whole.join("work/spacing").read_dir().unwrap().any(|_| true)
    );
    let again = String::from_utf8(succeeds(with(&whole, &[])).stderr).unwrap();
    assert_eq!(again, "4 of 4 jobs are done; nothing left\n");
}

/// Puts the result of a run of the study `planning` into a folder.
fn planned(out: &Path, arms: &str, grips: &str, seed: u64, metrics: &Metrics) {
    let command = format!("explore run --scene liver --arms {arms} --grips {grips} --seed {seed}");
    let name = format!("scene-liver-arms-{arms}-grips-{grips}_seed-{seed}.json");
    let result = json!({
        "study": "planning", "seed": seed, "seconds": 60.0, "version": "0.1.0",
        "runs": [{"row": [arms, grips], "command": command, "metrics": metrics, "error": Value::Null}],
    });
    let folder = out.join("jobs/planning");
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::write(folder.join(name), result.to_string()).unwrap();
}

fn ended(stop: &str, manipulations: usize, accuracy: f64, explored: &[f64]) -> Metrics {
    Metrics {
        stop: stop.into(),
        reason: (stop != "closed").then(|| format!("because of {stop} | told")),
        manipulations,
        accuracy_m: Some(Spread {
            mean: accuracy,
            p95: 3.0 * accuracy,
            max: 4.0 * accuracy,
        }),
        explored_2eps: Some(explored.to_vec()),
        betti_before: vec![[1, 0, 0]; explored.len()],
        ..Metrics::default()
    }
}

/// Results whose figures can be worked out by hand: five of planned grips that close, five of random ones that end in every way.
fn synthetic(out: &Path) {
    for (seed, (manipulations, accuracy)) in
        [(1, 1e-3), (2, 2e-3), (3, 3e-3), (1, 4e-3), (1, 10e-3)]
            .into_iter()
            .enumerate()
    {
        planned(
            out,
            "2",
            "planned",
            seed as u64,
            &ended("closed", manipulations, accuracy, &[0.5, 1.0]),
        );
    }
    let ends = [
        ("closed", 2),
        ("nothing_to_grip", 3),
        ("too_many_manipulations", 8),
        ("lost", 1),
        ("cell_failed", 0),
    ];
    for (seed, (stop, manipulations)) in ends.into_iter().enumerate() {
        planned(
            out,
            "2",
            "random",
            seed as u64,
            &ended(stop, manipulations, 5e-3, &[0.5, 0.7]),
        );
    }
}

#[test]
fn results_with_known_medians_are_summed_up_as_such() {
    let folder = tempfile::tempdir().unwrap();
    let (made, merged) = (folder.path().join("made"), folder.path().join("merged"));
    synthetic(&made);
    succeeds(tables(&merged, &["--merge", made.to_str().unwrap()]));
    let lines = untimed(&merged.join("planning.csv"));
    let line = |grips: &str, figure: &str| {
        let fits = |l: &&BTreeMap<String, String>| l["grips"] == grips && l["figure"] == figure;
        lines.iter().find(fits).unwrap().clone()
    };
    let numbers = |line: &BTreeMap<String, String>, names: &[&str]| -> Vec<f64> {
        names.iter().map(|n| line[*n].parse().unwrap()).collect()
    };
    let all = [
        "count",
        "mean",
        "least",
        "lower_quartile",
        "median",
        "upper_quartile",
        "most",
    ];
    // 1, 2, 3, 4, 10 mm.
    assert_eq!(
        numbers(&line("planned", "accuracy_mean_mm"), &all),
        [5.0, 4.0, 1.0, 2.0, 3.0, 4.0, 10.0]
    );
    // 1, 2, 3, 1, 1 manipulations.
    assert_eq!(
        numbers(&line("planned", "manipulations_needed"), &all),
        [5.0, 1.6, 1.0, 1.0, 1.0, 2.0, 3.0]
    );
    // A closed run with 2, two that their grips ended as 8; what was lost and what failed are faults of ours and no manipulations.
    assert_eq!(
        numbers(&line("random", "manipulations_needed"), &all),
        [3.0, 6.0, 2.0, 5.0, 8.0, 8.0, 8.0]
    );
    let ends = [
        "runs",
        "ended_closed",
        "ended_attached",
        "ended_grips",
        "ended_ours",
        "ended_open",
    ];
    assert_eq!(
        numbers(&line("random", "manipulations_needed"), &ends),
        [5.0, 1.0, 0.0, 2.0, 2.0, 0.0]
    );
    assert_eq!(
        numbers(&line("planned", "manipulations_needed"), &ends),
        [5.0, 5.0, 0.0, 0.0, 0.0, 0.0]
    );
    // 50 % gained by 1, 2, 3, 1 and 1 manipulations.
    let gain = numbers(&line("planned", "gain_percent"), &["mean", "median"]);
    assert!(
        (gain[0] - (150.0 + 25.0 + 50.0 / 3.0) / 5.0).abs() < 1e-5
            && (gain[1] - 50.0).abs() < 1e-12,
        "{gain:?}"
    );

    let markdown = std::fs::read_to_string(merged.join("planning.md")).unwrap();
    assert!(
        markdown.contains(
            "`explore tables --only planning --seeds 0-4`; 10 of its jobs are not done yet"
        ),
        "{markdown}"
    );
    assert!(
        markdown.contains("With 2 arms, planned grips need 0.27 times the manipulations"),
        "{markdown}"
    );
    assert!(!markdown.contains("With 3 arms"), "{markdown}");
    // Below the table: what the ends that occurred mean, and which runs count.
    for words in [
        "- *ended by a system fault*: tracking lost the body",
        "- *manipulations needed, at least*: a run that closed counts its manipulations, at least 1; one that its grips ended counts 8",
        "one ended by a system fault is not counted",
    ] {
        assert!(markdown.contains(words), "{markdown}");
    }
    assert!(!markdown.contains("- *closed but attached*"), "{markdown}");
    assert!(
        markdown.contains("| lost: because of lost / told |"),
        "{markdown}"
    );
    assert!(
        !markdown.contains(folder.path().to_str().unwrap()),
        "{markdown}"
    );
    // Every table has as many cells in each line.
    for table in markdown.split("\n\n").filter(|part| part.starts_with('|')) {
        let cells: Vec<usize> = table.lines().map(|l| l.matches('|').count()).collect();
        assert!(
            cells.len() > 2 && cells.windows(2).all(|w| w[0] == w[1]),
            "{table}"
        );
    }
}

#[test]
fn results_that_do_not_agree_are_not_merged() {
    let folder = tempfile::tempdir().unwrap();
    let [one, other, merged] = ["one", "other", "merged"].map(|name| folder.path().join(name));
    let dirs = ["--merge", one.to_str().unwrap(), other.to_str().unwrap()];
    let mut metrics = ended("closed", 1, 1e-3, &[0.5, 1.0]);
    planned(&one, "2", "planned", 0, &metrics);
    metrics.wall_s = 77.0;
    planned(&other, "2", "planned", 0, &metrics);
    // Another time is no other result.
    succeeds(tables(&merged, &dirs));
    metrics.manipulations = 2;
    planned(&other, "2", "planned", 0, &metrics);
    refuses(
        tables(&merged, &dirs),
        1,
        &["same job and differ", "grips-planned_seed-0.json"],
    );
    std::fs::write(
        other.join("jobs/planning/scene-liver-arms-2-grips-planned_seed-0.json"),
        "{\"study\"",
    )
    .unwrap();
    refuses(
        tables(&merged, &dirs),
        1,
        &["other", "grips-planned_seed-0.json"],
    );
}

/// Elements of a plot with this name.
fn count(svg: &roxmltree::Document<'_>, name: &str) -> usize {
    svg.descendants()
        .filter(|n| n.has_tag_name(("http://www.w3.org/2000/svg", name)))
        .count()
}

#[test]
fn plots_are_well_formed_and_show_what_was_measured() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    synthetic(&out);
    for (speed, stop) in [("15", "closed"), ("30", "closed"), ("60", "lost")] {
        let command = format!(
            "explore run --scene liver --arms 3 --speed {speed} --without speed-limit --seed 0"
        );
        let metrics = Metrics {
            shape_difference_m: Some(1e-3),
            robot_time_s: 60.0,
            ..ended(stop, 1, 1e-3, &[0.5])
        };
        let result = json!({
            "study": "speed", "seed": 0, "seconds": 60.0, "version": "0.1.0",
            "runs": [{"row": [speed], "command": command, "metrics": metrics, "error": Value::Null}],
        });
        let name = format!("scene-liver-arms-3-speed-{speed}-without-speed-limit_seed-0.json");
        std::fs::create_dir_all(out.join("jobs/speed")).unwrap();
        std::fs::write(out.join("jobs/speed").join(name), result.to_string()).unwrap();
    }
    succeeds(tables(&out, &["--merge", out.to_str().unwrap()]));
    let read = |name: &str| std::fs::read_to_string(out.join(name)).unwrap();
    let speed = read("speed.svg");
    let svg = roxmltree::Document::parse(&speed).unwrap();
    let words: Vec<String> = svg
        .descendants()
        .filter_map(|n| n.text())
        .map(|t| t.trim().to_owned())
        .collect();
    let says = |word: &str| words.iter().any(|w| w == word);
    assert!(
        says("Speed of the grips") && says("shape difference, mm") && says("0 of 1 closed"),
        "{words:?}"
    );
    // Two panels with three points, a third whose figure none of the runs has.
    assert_eq!(count(&svg, "circle"), 6);
    assert!(read("speed.md").contains("Failing speed: 60 mm/s, at which 0 of 1 runs closed."));
    let planning = read("planning.svg");
    let svg = roxmltree::Document::parse(&planning).unwrap();
    // The ground, and two stages of two rows.
    assert_eq!(count(&svg, "rect"), 5);
    let size = |name: &str| -> f64 { svg.root_element().attribute(name).unwrap().parse().unwrap() };
    assert!(size("width") > 100.0 && size("height") > 100.0);
}

#[test]
fn studies_are_listed_with_what_is_done_and_left() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    synthetic(&out);
    let list = |more: &[&str]| {
        String::from_utf8(succeeds(tables(&out, &[&["--list"], more].concat())).stdout).unwrap()
    };
    let text = list(&[]);
    for name in [
        "spacing",
        "planning",
        "speed",
        "baseline",
        "objects",
        "constraints",
        "filter",
        "colour",
        "additions",
    ] {
        assert!(text.lines().any(|l| l.starts_with(name)), "{text}");
    }
    let planning = |text: &str| -> Vec<String> {
        let line = text.lines().find(|l| l.starts_with("planning")).unwrap();
        line.split_whitespace().take(5).map(str::to_owned).collect()
    };
    // Four rows, ten seeds; ten are done, a minute each.
    assert_eq!(planning(&text), ["planning", "40", "10", "30", "min"]);
    assert_eq!(
        planning(&list(&["--seeds", "0-6"])),
        ["planning", "28", "10", "18", "min"]
    );
    assert_eq!(
        planning(&list(&["--seeds", "0-6", "--jobs", "2"])),
        ["planning", "28", "10", "9", "min"]
    );
    // Every job is in one shard.
    let shard = |k: usize| list(&["--only", "planning", "--shard", &format!("{k}/3")]);
    let shares: Vec<usize> = (1..=3)
        .map(|k| planning(&shard(k))[1].parse().unwrap())
        .collect();
    assert_eq!(shares, [14, 13, 13]);
}

#[test]
fn what_makes_no_sense_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    for shard in ["0/2", "3/2", "1", "a/b", "1/0"] {
        refuses(tables(&out, &["--shard", shard]), 2, &["--shard", shard]);
    }
    refuses(tables(&out, &["--jobs", "0"]), 2, &["--jobs"]);
    refuses(
        tables(&out, &["--only", "seeds,speed"]),
        1,
        &["seeds cannot be combined"],
    );
    refuses(
        tables(&out, &["--only", "seeds", "--jobs", "2"]),
        1,
        &["seeds cannot be combined", "--jobs"],
    );
    refuses(
        tables(&out, &["--only", "seeds", "--shard", "1/2"]),
        1,
        &["seeds cannot be combined"],
    );
    refuses(
        tables(&out, &["--only", "speed", "--scene", "glove"]),
        1,
        &["--scene", "seeds"],
    );
    refuses(
        tables(
            &out,
            &["--merge", folder.path().join("none").to_str().unwrap()],
        ),
        1,
        &["none"],
    );
    refuses(
        tables(&out, &["--merge", folder.path().to_str().unwrap()]),
        1,
        &["no results"],
    );
    // A run that cannot begin is no result of the method.
    refuses(
        tables(&out, &[&STUDY[..], &["--", "--fly"]].concat()),
        1,
        &["not done", "--fly"],
    );
    assert!(results(&out, "spacing").is_empty());
    let explore = |words: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_explore"));
        command.args(words);
        command
    };
    refuses(explore(&["run", "--without", "gravity"]), 2, &["gravity"]);
    refuses(
        explore(&["run", "--grips", "random", "--without", "speed-limit"]),
        1,
        &["speed-limit", "random grips"],
    );
    refuses(
        explore(&["replay", "a.mcap", "--without", "surface-test"]),
        1,
        &["surface-test", "replay"],
    );
}
