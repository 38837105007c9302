//! Draws a sheet of nodes that is rolled up, and the deformation of a grid around it.
//!
//! `cargo run --release -p gpwrm --example bent_sheet [-- OUT.svg]` writes `doc/bent_sheet.svg` of this crate, the picture of the README.

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;

use gpwrm::{Field, FieldOptions, Sample};
use mesh_io::program::{self, Failure, Output};
use nalgebra::{Point3, Vector3};
use serde_json::json;

/// Radius the sheet is rolled to, m.
const ROLL: f64 = 0.045;
/// Spacing of the nodes, m.
const SPACING: f64 = 0.01;
/// Spacing of the grid that stands on the sheet, m.
const GRID: f64 = 0.004;
/// Grid lines along the sheet on either side of it.
const LAYERS: i32 = 7;
/// Grid lines across.
const COLUMNS: i32 = 21;

/// Draws a sheet of nodes that is rolled up, and prints how far the field is from a solid that rolls with it
#[derive(Debug, clap::Parser)]
#[command(name = "bent_sheet", after_help = "Example: bent_sheet sheet.svg")]
struct Arguments {
    /// The picture
    #[arg(value_name = "OUT.svg", default_value = concat!(env!("CARGO_MANIFEST_DIR"), "/doc/bent_sheet.svg"), hide_default_value = true)]
    picture: PathBuf,
    #[command(flatten)]
    output: Output,
}

fn main() -> ExitCode {
    program::run(draw)
}

fn draw(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let path = &arguments.picture;
    let nodes: Vec<Point3<f64>> = (0..63)
        .map(|k| Point3::new(f64::from(k % 9), f64::from(k / 9), 0.0) * SPACING)
        .collect();
    let motion: Vec<Vector3<f64>> = nodes.iter().map(|x| rolled(x) - x).collect();
    let field = Field::new(&nodes, &motion, &FieldOptions::default())?;

    let curtain: Vec<Point3<f64>> = (-LAYERS..=LAYERS)
        .flat_map(|layer| (0..COLUMNS).map(move |column| (column, layer)))
        .map(|(column, layer)| {
            let (x, z) = (f64::from(column) * GRID, f64::from(layer) * GRID);
            Point3::new(x, 0.03, z)
        })
        .collect();
    let samples = field.evaluate_all(&curtain);
    std::fs::write(path, picture(&field, &curtain, &samples))
        .map_err(|error| format!("{}: {error}", path.display()))?;

    let off = |layer: i32| -> f64 {
        let start = ((layer + LAYERS) * COLUMNS) as usize;
        let row = start..start + COLUMNS as usize;
        let sum: f64 = row
            .map(|k| (curtain[k] + samples[k].displacement - rolled(&curtain[k])).norm())
            .sum();
        sum / f64::from(COLUMNS) * 1e3
    };
    let [on, outside, inside] = [0, -2, 2].map(off);
    writeln!(
        arguments.output.words(),
        "{}\nmean distance to the rolled solid, mm: {on:.3} on the sheet, {outside:.3} and {inside:.3} at 8 mm outside and inside",
        path.display()
    )?;
    arguments.output.object(&json!({
        "picture": path,
        "distance_mm": { "on": on, "outside": outside, "inside": inside },
    }))?;
    Ok(ExitCode::SUCCESS)
}

/// The sheet rolled about an axis along y, normals staying normals.
fn rolled(p: &Point3<f64>) -> Point3<f64> {
    let angle = p.x / ROLL;
    let radius = ROLL - p.z;
    Point3::new(radius * angle.sin(), p.y, ROLL - radius * angle.cos())
}

fn picture(field: &Field, curtain: &[Point3<f64>], samples: &[Sample]) -> String {
    let moved: Vec<Point3<f64>> = curtain
        .iter()
        .zip(samples)
        .map(|(p, s)| p + s.displacement)
        .collect();
    let mut svg = String::from(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 760 440\" font-family=\"sans-serif\" font-size=\"14\">\n\
         <style>.near{stroke:#1f6fb2}.far{stroke:#e08a2e}.sheet{stroke:#333;stroke-opacity:.45}\
         polyline{fill:none;stroke-width:1.1}circle{fill:#222}text{fill:#444}</style>\n\
         <rect width=\"760\" height=\"440\" fill=\"#fff\"/>\n",
    );
    let mut panel = |left: f64, nodes: &[Point3<f64>], grid: &[Point3<f64>]| {
        // Back to front: the far half of the sheet, the grid in its middle, the near half.
        sheet(&mut svg, left, nodes, 3..7);
        lines(&mut svg, left, grid, samples);
        sheet(&mut svg, left, nodes, 0..4);
    };
    panel(30.0, field.nodes(), curtain);
    panel(430.0, &field.live_nodes(), &moved);
    svg.push_str(
        "<text x=\"30\" y=\"425\">rest: nodes, and a grid that stands on the sheet</text>\n\
         <text x=\"400\" y=\"425\">live \
         (<tspan fill=\"#1f6fb2\">within reach of a node</tspan>, <tspan fill=\"#e08a2e\">beyond</tspan>)</text>\n</svg>\n",
    );
    svg
}

/// Rows of nodes, and what joins them.
fn sheet(svg: &mut String, left: f64, nodes: &[Point3<f64>], rows: std::ops::Range<usize>) {
    for row in rows.clone() {
        polyline(svg, left, "sheet", nodes[9 * row..9 * row + 9].iter());
    }
    for column in 0..9 {
        let along = rows.clone().map(|row| &nodes[9 * row + column]);
        polyline(svg, left, "sheet", along);
    }
    for node in &nodes[9 * rows.start..9 * rows.end] {
        let (x, y) = seen(left, node);
        let _ = writeln!(svg, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"2.2\"/>");
    }
}

/// The grid, piece by piece, coloured by position.
fn lines(svg: &mut String, left: f64, grid: &[Point3<f64>], samples: &[Sample]) {
    let width = COLUMNS as usize;
    for k in 0..grid.len() {
        let class = if samples[k].extrapolated {
            "far"
        } else {
            "near"
        };
        let right = (k % width + 1 < width).then_some(k + 1);
        let above = (k + width < grid.len()).then_some(k + width);
        for other in [right, above].into_iter().flatten() {
            polyline(svg, left, class, [&grid[k], &grid[other]].into_iter());
        }
    }
}

fn polyline<'a>(
    svg: &mut String,
    left: f64,
    class: &str,
    points: impl Iterator<Item = &'a Point3<f64>>,
) {
    let path: Vec<String> = points
        .map(|p| seen(left, p))
        .map(|(x, y)| format!("{x:.1},{y:.1}"))
        .collect();
    let _ = writeln!(
        svg,
        "<polyline class=\"{class}\" points=\"{}\"/>",
        path.join(" ")
    );
}

/// Where a point is drawn: seen from the front, a little from above and the left.
fn seen(left: f64, p: &Point3<f64>) -> (f64, f64) {
    let scale = 3300.0;
    (
        left + scale * (p.x + 0.42 * p.y),
        325.0 - scale * (p.z + 0.30 * p.y),
    )
}
