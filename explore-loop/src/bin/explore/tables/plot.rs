//! The plot of a study as an SVG. Text stays text, in the reader's sans-serif font.

use super::ending::Ending;
use super::study::{MANIPULATIONS, Plot, Study};
use super::summary::{Spread, Summary};
use crate::Failure;
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

const WIDTH: u32 = 860;
/// Heights in a panel: of the curves, of a line of whiskers, of a bar, and of everything else.
const CURVES: u32 = 300;
const LINE: u32 = 30;
const AROUND: u32 = 90;
/// Width for the names of the rows, and for how they ended.
const NAMES: u32 = 170;
const ENDS: u32 = 230;

const BLUE_INK: RGBColor = RGBColor(38, 92, 168);
const FAILED: RGBColor = RGBColor(200, 30, 40);
const PALE: RGBColor = RGBColor(222, 222, 222);
/// Colours: before the first manipulation, then after one, two, …
const STAGES: [RGBColor; 9] = [
    RGBColor(120, 120, 120),
    RGBColor(38, 92, 168),
    RGBColor(230, 140, 40),
    RGBColor(60, 150, 80),
    RGBColor(180, 60, 130),
    RGBColor(110, 80, 170),
    RGBColor(150, 110, 60),
    RGBColor(60, 160, 170),
    RGBColor(200, 180, 60),
];

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// Draws a study; its summaries must not be empty.
pub(super) fn svg(study: &Study, summaries: &[Summary]) -> Result<String, Failure> {
    let mut text = String::new();
    {
        let rows = summaries.len() as u32;
        let (panels, height) = match study.plot {
            Plot::Curves { panels, .. } => (panels, CURVES),
            Plot::Whiskers { panels } => (panels, AROUND + LINE * rows),
            Plot::Explored => (&["explored"][..], AROUND + LINE * rows),
        };
        let size = (WIDTH, 40 + height * panels.len() as u32);
        let root = SVGBackend::with_string(&mut text, size).into_drawing_area();
        root.fill(&WHITE)?;
        let area = root.titled(study.title, ("sans-serif", 20))?;
        for (panel, area) in panels.iter().zip(area.split_evenly((panels.len(), 1))) {
            match study.plot {
                Plot::Curves { over, .. } => curve(study, summaries, over, panel, &area)?,
                Plot::Whiskers { .. } => whiskers(study, summaries, panel, &area)?,
                Plot::Explored => explored(study, summaries, &area)?,
            }
        }
        root.present()?;
    }
    Ok(text)
}

/// The column with this key, and the values of each row.
fn figure(
    study: &Study,
    summaries: &[Summary],
    key: &str,
) -> Option<(&'static str, Vec<Option<Spread>>)> {
    let column = study.columns.iter().find(|c| c.key == key)?;
    let values = summaries.iter().map(|s| s.figure(key)).collect();
    Some((column.heading, values))
}

fn most(values: impl Iterator<Item = f64>) -> f64 {
    let most = values.fold(0.0, f64::max);
    if most > 0.0 { 1.1 * most } else { 1.0 }
}

/// Median and quartiles over a numeric key.
fn curve(
    study: &Study,
    summaries: &[Summary],
    over: usize,
    key: &str,
    area: &Area<'_>,
) -> Result<(), Failure> {
    let Some((heading, spreads)) = figure(study, summaries, key) else {
        return Ok(());
    };
    let at = |s: &Summary| s.row.values[over].parse::<f64>().unwrap_or(f64::NAN);
    let places: Vec<f64> = summaries.iter().map(at).collect();
    let right = most(places.iter().copied());
    let top = most(spreads.iter().flatten().map(|s| s.upper_quartile));
    let mut chart = ChartBuilder::on(area)
        .margin(12)
        .x_label_area_size(42)
        .y_label_area_size(64)
        .build_cartesian_2d(0.0..right, 0.0..top)?;
    chart
        .configure_mesh()
        .light_line_style(WHITE)
        .bold_line_style(PALE)
        .x_desc(study.keys[over])
        .y_desc(heading)
        .label_style(("sans-serif", 13))
        .axis_desc_style(("sans-serif", 14))
        .draw()?;
    let known: Vec<(f64, Spread)> = places
        .iter()
        .zip(&spreads)
        .filter_map(|(x, s)| Some((*x, (*s)?)))
        .collect();
    chart.draw_series(LineSeries::new(
        known.iter().map(|(x, s)| (*x, s.median)),
        BLUE_INK.stroke_width(2),
    ))?;
    for (x, spread) in &known {
        let ends = vec![(*x, spread.lower_quartile), (*x, spread.upper_quartile)];
        chart.draw_series([PathElement::new(ends, BLUE_INK.stroke_width(2))])?;
        chart.draw_series([Circle::new((*x, spread.median), 4, BLUE_INK.filled())])?;
    }
    let failed = summaries
        .iter()
        .zip(&places)
        .zip(&spreads)
        .filter(|((s, _), _)| !s.all_closed());
    for ((summary, x), spread) in failed {
        let y = spread.map_or(0.0, |s| s.median);
        chart.draw_series([Cross::new((*x, y), 8, FAILED.stroke_width(3))])?;
        let count = format!(
            "{} of {} closed",
            summary.ended(Ending::Closed),
            summary.runs.len()
        );
        let style = ("sans-serif", 12)
            .into_font()
            .color(&FAILED)
            .pos(Pos::new(HPos::Center, VPos::Bottom));
        chart.draw_series([EmptyElement::at((*x, y)) + Text::new(count, (0, -12), style)])?;
    }
    Ok(())
}

/// Names of the rows at the left of a chart whose rows count downwards.
fn name_rows(
    study: &Study,
    summaries: &[Summary],
    area: &Area<'_>,
    of: impl Fn(usize) -> i32,
) -> Result<(), Failure> {
    let style = ("sans-serif", 13)
        .into_font()
        .color(&BLACK)
        .pos(Pos::new(HPos::Right, VPos::Center));
    for (k, summary) in summaries.iter().enumerate() {
        let told = summary.row.values.iter().zip(study.keys);
        // A number is shown with what it counts.
        let word = |(value, key): (&String, &&str)| match value.parse::<f64>() {
            Ok(_) => format!("{value} {key}"),
            Err(_) => value.clone(),
        };
        let name = told.map(word).collect::<Vec<_>>().join(", ");
        area.draw(&Text::new(
            name,
            (NAMES.cast_signed() + 2, of(k)),
            style.clone(),
        ))?;
    }
    Ok(())
}

/// Median and quartiles, a line for each row.
fn whiskers(
    study: &Study,
    summaries: &[Summary],
    key: &str,
    area: &Area<'_>,
) -> Result<(), Failure> {
    let Some((heading, spreads)) = figure(study, summaries, key) else {
        return Ok(());
    };
    let rows = summaries.len() as f64;
    let right = most(spreads.iter().flatten().map(|s| s.upper_quartile));
    let mut chart = ChartBuilder::on(area)
        .margin(12)
        .x_label_area_size(42)
        .y_label_area_size(NAMES)
        .build_cartesian_2d(0.0..right, rows..0.0)?;
    chart
        .configure_mesh()
        .disable_y_mesh()
        .light_line_style(WHITE)
        .bold_line_style(PALE)
        .y_labels(0)
        .x_desc(heading)
        .label_style(("sans-serif", 13))
        .axis_desc_style(("sans-serif", 14))
        .draw()?;
    for (k, (summary, spread)) in summaries.iter().zip(&spreads).enumerate() {
        let y = k as f64 + 0.5;
        let Some(spread) = spread else { continue };
        let ink = if summary.all_closed() || summary.row.replay.is_some() {
            BLUE_INK
        } else {
            FAILED
        };
        let ends = vec![(spread.lower_quartile, y), (spread.upper_quartile, y)];
        chart.draw_series([PathElement::new(ends, ink.stroke_width(3))])?;
        chart.draw_series([Circle::new((spread.median, y), 5, ink.filled())])?;
    }
    let down = |k: usize| chart.backend_coord(&(0.0, k as f64 + 0.5)).1;
    let origin = area.get_pixel_range().1.start;
    name_rows(study, summaries, area, |k| down(k) - origin)
}

/// The share explored at the start, and what each manipulation added, as a mean over the runs of a row; finished runs add nothing more.
fn stages(summary: &Summary) -> Vec<f64> {
    let shares = summary
        .runs
        .iter()
        .filter_map(|(_, ran)| ran.metrics.as_ref()?.explored_2eps.clone());
    let shares: Vec<Vec<f64>> = shares.filter(|s| !s.is_empty()).collect();
    let longest = shares.iter().map(Vec::len).max().unwrap_or(0);
    let mean = |k: usize| {
        let at = shares.iter().map(|s| s[k.min(s.len() - 1)]);
        at.sum::<f64>() / shares.len() as f64
    };
    (0..longest).map(mean).collect()
}

fn explored(study: &Study, summaries: &[Summary], area: &Area<'_>) -> Result<(), Failure> {
    let rows = summaries.len() as f64;
    let mut chart = ChartBuilder::on(area)
        .margin(12)
        .x_label_area_size(42)
        .y_label_area_size(NAMES)
        .right_y_label_area_size(ENDS)
        .build_cartesian_2d(0.0..100.0, rows..0.0)?;
    chart
        .configure_mesh()
        .disable_y_mesh()
        .light_line_style(WHITE)
        .bold_line_style(PALE)
        .y_labels(0)
        .x_desc("explored, %: at the start (grey), then added by the first, second, … manipulation")
        .label_style(("sans-serif", 13))
        .axis_desc_style(("sans-serif", 14))
        .draw()?;
    for (k, summary) in summaries.iter().enumerate() {
        let (top, bottom) = (k as f64 + 0.18, k as f64 + 0.82);
        let mut from = 0.0;
        for (stage, share) in stages(summary).into_iter().enumerate() {
            let to = 100.0 * share;
            let ink = STAGES[stage.min(STAGES.len() - 1)];
            chart.draw_series([Rectangle::new(
                [(from, top), (to.max(from), bottom)],
                ink.filled(),
            )])?;
            from = to.max(from);
        }
    }
    let (down, right) = (
        |k: usize| chart.backend_coord(&(0.0, k as f64 + 0.5)).1,
        chart.backend_coord(&(100.0, 0.0)).0,
    );
    let origin = area.get_pixel_range().1.start;
    name_rows(study, summaries, area, |k| down(k) - origin)?;
    let style = ("sans-serif", 13)
        .into_font()
        .color(&BLACK)
        .pos(Pos::new(HPos::Left, VPos::Center));
    for (k, summary) in summaries.iter().enumerate() {
        let counted = summary
            .runs
            .iter()
            .filter_map(|(_, r)| (MANIPULATIONS.of)(r));
        let after = Spread::of(&counted.collect::<Vec<f64>>())
            .map_or(String::new(), |s| format!(", {:.1} manipulations", s.mean));
        let (closed, runs) = (summary.ended(Ending::Closed), summary.runs.len());
        let closed = format!("{closed} of {runs} closed{after}");
        area.draw(&Text::new(
            closed,
            (right + 8, down(k) - origin),
            style.clone(),
        ))?;
    }
    Ok(())
}
