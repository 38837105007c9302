//! The tables of a study: CSV for programs, Markdown for people.
//!
//! | file | a line for each |
//! |---|---|
//! | `NAME.csv` | row and figure: numbers of runs by ending, then count, mean, minimum, quartiles, maximum |
//! | `NAME_runs.csv` | run: ending, figures, share explored and Betti numbers before each manipulation, command |
//! | `NAME.md` | row, with medians and quartiles, or means; then one for each run |

use super::ending::Ending;
use super::result::Ran;
use super::study::{Column, Plot, Show, Study};
use super::summary::{Spread, Summary};
use crate::Failure;
use std::fmt::Write as _;

/// Formats a number for a CSV.
fn number(value: f64) -> String {
    let rounded = format!("{value:.6}");
    let short = rounded.trim_end_matches('0').trim_end_matches('.');
    if short == "-0" {
        "0".into()
    } else {
        short.to_owned()
    }
}

fn bytes(writer: csv::Writer<Vec<u8>>) -> Result<Vec<u8>, Failure> {
    Ok(writer
        .into_inner()
        .map_err(csv::IntoInnerError::into_error)?)
}

/// Keys as names of columns: the part before a comma, in lower case.
fn names(study: &Study) -> Vec<String> {
    let name = |key: &&str| key.replace(", ", "_").replace([' ', '/'], "_");
    study.keys.iter().map(name).collect()
}

/// `NAME.csv`.
pub(super) fn summary_csv(study: &Study, summaries: &[Summary]) -> Result<Vec<u8>, Failure> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    let endings = Ending::ALL.map(|e| format!("ended_{}", e.word()));
    let mut header = names(study);
    header.push("runs".into());
    header.extend(endings);
    header.push("figure".into());
    header.extend(Spread::NAMES.map(String::from));
    writer.write_record(&header)?;
    for summary in summaries {
        for column in &study.columns {
            let mut line = summary.row.values.clone();
            line.push(summary.runs.len().to_string());
            line.extend(Ending::ALL.map(|e| summary.ended(e).to_string()));
            line.push(column.key.into());
            line.extend(match summary.figure(column.key) {
                Some(spread) => spread.values().map(number),
                None => Spread::NAMES.map(|name| match name {
                    "count" => "0".into(),
                    _ => String::new(),
                }),
            });
            writer.write_record(&line)?;
        }
    }
    bytes(writer)
}

/// `NAME_runs.csv`.
pub(super) fn runs_csv(study: &Study, summaries: &[Summary]) -> Result<Vec<u8>, Failure> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    let mut header = names(study);
    header.extend(["seed", "ended", "stop", "reason"].map(String::from));
    header.extend(study.columns.iter().map(|c| c.key.to_owned()));
    header.extend(["explored_percent", "betti", "command"].map(String::from));
    writer.write_record(&header)?;
    for (seed, ran) in summaries.iter().flat_map(|s| &s.runs) {
        let mut line = ran.row.clone();
        line.extend([
            seed.to_string(),
            Ending::of(ran).word().into(),
            ran.stop().into(),
            ran.reason().unwrap_or_default().into(),
        ]);
        let value = |c: &Column| (c.of)(ran).map_or_else(String::new, number);
        line.extend(study.columns.iter().map(value));
        line.extend([explored(ran, " "), betti(ran), ran.command.clone()]);
        writer.write_record(&line)?;
    }
    bytes(writer)
}

/// The share explored before each manipulation and at the end, within two spacings as the paper counts it, in percent.
fn explored(ran: &Ran, between: &str) -> String {
    let shares = ran.metrics.as_ref().and_then(|m| m.explored_2eps.as_ref());
    let texts: Vec<String> = shares
        .into_iter()
        .flatten()
        .map(|s| format!("{:.1}", 100.0 * s))
        .collect();
    texts.join(between)
}

/// The Betti numbers before each manipulation and at the end.
fn betti(ran: &Ran) -> String {
    let all = ran.metrics.iter().flat_map(|m| &m.betti_before);
    let texts: Vec<String> = all
        .map(|[b0, b1, b2]| format!("({b0} {b1} {b2})"))
        .collect();
    texts.join(" ")
}

/// `NAME.md`; `made_by` is the command, and `missing` the number of jobs that are not finished.
pub(super) fn markdown(
    study: &Study,
    summaries: &[Summary],
    made_by: &str,
    missing: usize,
) -> String {
    let mut text = format!("# {}\n\n{}\n\n", study.title, study.about);
    // Writing to a String cannot fail.
    let _ = writeln!(text, "Made by `{made_by}`{}.\n", unfinished(missing));
    text += &rows_table(study, summaries);
    text += &how_to_read(study, summaries);
    for line in (study.remark)(summaries) {
        let _ = writeln!(text, "\n{line}");
    }
    let (title, name) = (study.title, study.name);
    let _ = writeln!(
        text,
        "\n![{title}]({name}.svg)\n\n{}\n\n## Runs\n",
        caption(study.plot)
    );
    text += &runs_table(study, summaries);
    text
}

/// What the plot shows.
fn caption(plot: Plot) -> &'static str {
    match plot {
        Plot::Curves { .. } => "Medians and quartiles; a red cross where not every run closed.",
        Plot::Whiskers { .. } => {
            "Medians and quartiles; of explorations, red where not every run closed."
        }
        Plot::Explored => {
            "Means over the runs; a finished run adds nothing more. Manipulations without runs ended by a system fault."
        }
    }
}

fn unfinished(missing: usize) -> String {
    match missing {
        0 => String::new(),
        1 => "; 1 of its jobs is not done yet".into(),
        _ => format!("; {missing} of its jobs are not done yet"),
    }
}

/// A line of a Markdown table.
fn line(cells: &[String]) -> String {
    let cells: Vec<String> = cells
        .iter()
        .map(|c| c.replace('|', "/").replace('\n', " "))
        .collect();
    format!("| {} |\n", cells.join(" | "))
}

fn heading(cells: &[String]) -> String {
    format!("{}|{}\n", line(cells), "---|".repeat(cells.len()))
}

/// The endings that get a column: `closed`, and those that occurred.
fn endings(summaries: &[Summary]) -> Vec<Ending> {
    let occurs = |e: &Ending| *e == Ending::Closed || summaries.iter().any(|s| s.ended(*e) > 0);
    Ending::ALL.into_iter().filter(occurs).collect()
}

/// The notes below the table: which runs its figures are taken from.
fn how_to_read(study: &Study, summaries: &[Summary]) -> String {
    let mut text = String::from(
        "\nFigures are medians with quartiles in brackets, or means where the heading says so, of all runs that have the figure, however they ended; \
         shares explored are within two spacings, as the paper counts them.\n\n",
    );
    // Writing to a String cannot fail.
    for ending in endings(summaries) {
        let _ = writeln!(text, "- *{}*: {}.", ending.heading(), ending.meaning());
    }
    for column in &study.columns {
        if let Some(rule) = column.rule {
            let _ = writeln!(text, "- *{}*: {rule}.", column.heading);
        }
    }
    text
}

fn rows_table(study: &Study, summaries: &[Summary]) -> String {
    let endings = endings(summaries);
    let mut head: Vec<String> = study.keys.iter().map(ToString::to_string).collect();
    head.push("runs".into());
    head.extend(endings.iter().map(|e| e.heading().to_owned()));
    head.extend(study.columns.iter().map(|c| match c.show {
        Show::Median => c.heading.to_owned(),
        Show::Mean => format!("{} (mean)", c.heading),
    }));
    let mut text = heading(&head);
    for summary in summaries {
        let mut cells = summary.row.values.clone();
        cells.push(summary.runs.len().to_string());
        cells.extend(endings.iter().map(|e| summary.ended(*e).to_string()));
        cells.extend(study.columns.iter().map(|column| {
            let spread = summary.figure(column.key);
            spread.map_or("–".into(), |s| shown(column, &s))
        }));
        text += &line(&cells);
    }
    text
}

fn shown(column: &Column, spread: &Spread) -> String {
    let digits = column.digits;
    match column.show {
        Show::Mean => format!("{:.digits$}", spread.mean),
        Show::Median => format!(
            "{:.digits$} ({:.digits$}–{:.digits$})",
            spread.median, spread.lower_quartile, spread.upper_quartile
        ),
    }
}

fn runs_table(study: &Study, summaries: &[Summary]) -> String {
    let mut head: Vec<String> = study.keys.iter().map(ToString::to_string).collect();
    let further = [
        "seed",
        "ended",
        "why",
        "explored, %",
        "Betti numbers",
        "accuracy mean / p95, mm",
    ];
    head.extend(further.map(String::from));
    let mut text = heading(&head);
    for (seed, ran) in summaries.iter().flat_map(|s| &s.runs) {
        let accuracy = ran.metrics.as_ref().and_then(|m| m.accuracy_m);
        let mut cells = ran.row.clone();
        cells.extend([
            seed.to_string(),
            Ending::of(ran).heading().to_owned(),
            if ran.stop() == "closed" {
                String::new()
            } else {
                why(ran)
            },
            explored(ran, ", "),
            betti(ran),
            accuracy.map_or("–".into(), |a| {
                format!("{:.2} / {:.2}", 1e3 * a.mean, 1e3 * a.p95)
            }),
        ]);
        text += &line(&cells);
    }
    text
}

/// How a run ended, with the reason where there is one.
fn why(ran: &Ran) -> String {
    match ran.reason() {
        Some(reason) => format!("{}: {reason}", ran.stop()),
        None => ran.stop().to_owned(),
    }
}
