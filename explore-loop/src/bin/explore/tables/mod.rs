//! `explore tables`: studies over many runs.
//!
//! ```text
//! studies ─► jobs ─► shard ─► run, side by side ─► a result file each ─┬─► summary ─► CSV, Markdown, SVG
//!                                         results of other machines ───┘ merge
//! ```
//!
//! | file | question |
//! |---|---|
//! | `study`, `studies` | what is compared, and which figures are shown? |
//! | `job` | what is run as a whole, and by which machine? |
//! | `run` | how is it run, interrupted and continued? |
//! | `progress` | how long will the rest take? |
//! | `result` | what is kept of it? |
//! | `ending` | how did a run end, and who caused it? |
//! | `summary` | what do the runs of a row say together? |
//! | `text`, `plot` | how is it written and drawn? |
//! | `merge` | what do the results of several machines say together? |
//! | `seeds` | how do the runs of one object from many seeds compare? |
//!
//! This file handles the command line: all of that, `--list`, or `--merge`.

mod ending;
mod job;
mod merge;
mod plot;
mod progress;
mod result;
mod run;
mod seeds;
mod studies;
mod study;
mod summary;
mod text;

use crate::output::write_whole;
use crate::{Failure, TablesArgs};
pub(crate) use job::Shard;
use job::{Job, jobs};
use mesh_io::program::unless_closed;
use progress::{Times, duration};
use result::Ran;
use run::{Runner, done};
use std::collections::{BTreeMap, BTreeSet};
use std::io::Write as _;
use study::Study;
use summary::Summary;

/// The study `seeds`, which runs any object from many seeds and is not part of the default.
const SEEDS: &str = "seeds";

/// The names that `--only` takes.
pub(crate) fn names() -> Vec<&'static str> {
    let all = studies::all();
    std::iter::once(SEEDS)
        .chain(all.iter().map(|s| s.name))
        .collect()
}

/// Makes the tables; true when every run finished.
pub(crate) fn tables(args: &TablesArgs) -> Result<bool, Failure> {
    if args.only.iter().any(|name| name == SEEDS) {
        return match args.only.len() {
            1 if args.shard.is_none()
                && args.merge.is_empty()
                && !args.list
                && args.jobs == 1
                && args.further.is_empty() => seeds::seeds(args),
            _ => Err(
                "--only seeds cannot be combined with other studies, --jobs, --shard, --merge, --list or further options"
                    .into(),
            ),
        };
    }
    if args.object.is_given() || args.arms.is_some() || args.session.is_some() {
        return Err("--scene, --mesh, --session and --arms are for --only seeds: the other studies have objects and arms of their own".into());
    }
    let chosen =
        |study: &Study| args.only.is_empty() || args.only.iter().any(|name| name == study.name);
    let mut studies: Vec<Study> = studies::all().into_iter().filter(chosen).collect();
    for row in studies.iter_mut().flat_map(|study| &mut study.rows) {
        row.run.extend_from_slice(&args.further);
    }
    if args.list {
        list(args, &studies)
    } else if args.merge.is_empty() {
        study_all(args, &studies)
    } else {
        merge::merge(args, &studies)
    }
}

/// The seeds of a study: those asked for, or its own.
fn seeds_of(args: &TablesArgs, study: &Study) -> Vec<u64> {
    let asked = args.seeds.as_ref().map(|seeds| seeds.0.clone());
    asked.unwrap_or_else(|| (0..study.seeds).collect())
}

/// The jobs of this machine.
fn jobs_of(args: &TablesArgs, studies: &[Study]) -> Vec<Job> {
    let all = studies
        .iter()
        .flat_map(|s| jobs(s, &seeds_of(args, s)))
        .collect();
    match args.shard {
        Some(shard) => shard.of(all),
        None => all,
    }
}

fn study_all(args: &TablesArgs, studies: &[Study]) -> Result<bool, Failure> {
    // The folder is tested before the first run, which takes minutes.
    let _out = crate::output::OutputFolder::create(&args.out)?;
    let whole = Runner::new(&args.out, args.output)?.carry_out(jobs_of(args, studies), args.jobs);
    if args.shard.is_some() {
        let dir = args.out.display();
        args.output.note(&format!(
            "tables of all shards: explore tables --merge {dir} … --out DIR"
        ));
        return whole;
    }
    // An interrupted study still writes the tables of its finished jobs.
    let mut answers = Vec::new();
    for study in studies {
        let seeds: BTreeSet<u64> = seeds_of(args, study).into_iter().collect();
        answers.extend(write_tables(args, study, &seeds)?);
    }
    answer(args, &answers)?;
    whole
}

/// A study in `--json`: the lines of its CSV, keyed by column.
#[derive(serde::Serialize)]
struct Answer {
    study: &'static str,
    rows: Vec<BTreeMap<String, String>>,
}

fn answer(args: &TablesArgs, answers: &[Answer]) -> Result<(), Failure> {
    Ok(unless_closed(args.output.object(&answers))?)
}

/// Writes the tables of a study from the results in a folder, if there are any.
fn write_tables(
    args: &TablesArgs,
    study: &Study,
    seeds: &BTreeSet<u64>,
) -> Result<Option<Answer>, Failure> {
    let out = &args.out;
    let all: Vec<u64> = seeds.iter().copied().collect();
    let (mut runs, mut missing) = (Vec::new(), 0);
    for job in jobs(study, &all) {
        let Some(result) = done(out, &job)? else {
            missing += 1;
            continue;
        };
        let wanted = |ran: &Ran| job.rows.iter().any(|row| row.values == ran.row);
        let wanted = result.runs.into_iter().filter(wanted);
        runs.extend(wanted.map(|ran| (job.seed, ran)));
    }
    let summaries = Summary::all(study, &runs);
    if summaries.is_empty() {
        args.output
            .note(&format!("{}: no job is finished, no table", study.name));
        return Ok(None);
    }
    let mut made_by = format!(
        "explore tables --only {} --seeds {}",
        study.name,
        ranges(&all)
    );
    if !args.further.is_empty() {
        made_by.extend([" -- ", &args.further.join(" ")]);
    }
    let markdown = text::markdown(study, &summaries, &made_by, missing);
    let file = |ending: &str| out.join(format!("{}{ending}", study.name));
    let summary = text::summary_csv(study, &summaries)?;
    write_whole(&file(".csv"), &summary)?;
    write_whole(&file("_runs.csv"), &text::runs_csv(study, &summaries)?)?;
    write_whole(&file(".md"), markdown.as_bytes())?;
    write_whole(&file(".svg"), plot::svg(study, &summaries)?.as_bytes())?;
    let table = markdown.split("\n## Runs").next().unwrap_or_default();
    unless_closed(writeln!(args.output.words(), "{table}"))?;
    let rows = csv::Reader::from_reader(summary.as_slice())
        .deserialize()
        .collect::<Result<_, csv::Error>>()?;
    Ok(Some(Answer {
        study: study.name,
        rows,
    }))
}

/// Numbers in ascending order as `0-4,7`.
fn ranges(numbers: &[u64]) -> String {
    let mut runs: Vec<[u64; 2]> = Vec::new();
    for &number in numbers {
        match runs.last_mut() {
            Some([_, last]) if *last + 1 == number => *last = number,
            _ => runs.push([number; 2]),
        }
    }
    let text = |[first, last]: &[u64; 2]| {
        if first == last {
            first.to_string()
        } else {
            format!("{first}-{last}")
        }
    };
    runs.iter().map(text).collect::<Vec<_>>().join(",")
}

/// Assumed time of a job when none was timed, seconds: that of the exploration of a liver on two cores.
const TYPICAL: f64 = 75.0;

fn list(args: &TablesArgs, studies: &[Study]) -> Result<bool, Failure> {
    let all = jobs_of(args, studies);
    let (times, _) = Times::of(&args.out, &all)?;
    let mut out = args.output.words();
    writeln!(
        out,
        "{:<12} {:>5} {:>5}  {:<14} what",
        "study", "jobs", "done", "left"
    )?;
    for study in studies {
        let own: Vec<Job> = all
            .iter()
            .filter(|j| j.study == study.name)
            .cloned()
            .collect();
        let (_, open) = Times::of(&args.out, &own)?;
        let (seconds, guessed) = match times.rest(open.iter().copied(), args.jobs) {
            Some(seconds) => (seconds, ""),
            None => (TYPICAL * open.len() as f64 / args.jobs as f64, " ?"),
        };
        let left = format!("{}{guessed}", duration(seconds));
        let (name, count, ended) = (study.name, own.len(), own.len() - open.len());
        writeln!(
            out,
            "{name:<12} {count:>5} {ended:>5}  {left:<14} {}: {}",
            study.title, study.about
        )?;
    }
    writeln!(
        out,
        "time left: from the jobs timed in {}; with ? an assumed {TYPICAL:.0} s for each job",
        args.out.display()
    )?;
    Ok(true)
}
