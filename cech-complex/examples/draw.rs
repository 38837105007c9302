//! Draws the pictures of the documentation: `doc/barcode.svg` and `doc/complex.svg`.
//!
//! `cargo run --release -p cech-complex --features manifolds --example draw -- cech-complex/doc`
//!
//! The same input gives the same files, byte for byte.

use cech_complex::manifolds::Manifold;
use cech_complex::nalgebra::Point3;
use cech_complex::{Bar, Complex, Cylinder, Options, VertexKind};
use mesh_io::program::{self, Failure, Output};
use serde_json::json;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;

const COLOURS: [&str; 3] = ["#888888", "#c44e52", "#4c72b0"];

/// Draws the pictures of the documentation: barcode.svg and complex.svg
#[derive(Debug, clap::Parser)]
#[command(name = "draw", after_help = "Example: draw cech-complex/doc")]
struct Arguments {
    /// Folder for the pictures
    #[arg(default_value = "doc")]
    folder: PathBuf,
    #[command(flatten)]
    output: Output,
}

fn main() -> ExitCode {
    program::run(draw)
}

fn draw(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let barcode = arguments.folder.join("barcode.svg");
    let picture = arguments.folder.join("complex.svg");
    std::fs::create_dir_all(&arguments.folder)
        .map_err(|error| format!("{}: {error}", arguments.folder.display()))?;
    for (path, svg) in [(&barcode, torus()?), (&picture, annulus()?)] {
        std::fs::write(path, svg).map_err(|error| format!("{}: {error}", path.display()))?;
        writeln!(arguments.output.words(), "{}", path.display())?;
    }
    let answer = json!({ "pictures": [barcode, picture] });
    arguments.output.object(&answer)?;
    Ok(ExitCode::SUCCESS)
}

/// The bars of a torus.
fn torus() -> Result<String, cech_complex::Error> {
    let torus = Manifold::Torus {
        major: 1.0,
        minor: 0.4,
    }
    .net(400, 1);
    let radius = 1.25 * torus.spacing;
    let options = Options::default().with_max_scale(2.0);
    let cylinder = Cylinder::new(radius, 0.5 * radius)?;
    let complex = Complex::build(&torus.points, &torus.normals, cylinder, &options)?;
    Ok(barcode(&complex))
}

/// The complex of an annulus.
fn annulus() -> Result<String, cech_complex::Error> {
    let annulus = Manifold::Annulus {
        inner: 0.3,
        outer: 1.0,
    }
    .net(420, 1);
    let radius = 1.25 * annulus.spacing;
    let cylinder = Cylinder::new(radius, 0.5 * radius)?;
    let complex = Complex::build(
        &annulus.points,
        &annulus.normals,
        cylinder,
        &Options::default(),
    )?;
    picture(&complex, annulus.spacing)
}

/// Bars by dimension from top to bottom, scale from left to right. Short-lived components, which are the single samples, are left out.
fn barcode(complex: &Complex) -> String {
    let drawn =
        |bar: &&Bar| bar.persistence() > 0.03 && (bar.dimension > 0 || bar.death.is_infinite());
    let bars: Vec<&Bar> = complex.barcode().bars().iter().filter(drawn).collect();
    let last = complex.max_scale();
    let across = |scale: f64| 40.0 + 500.0 * scale.min(last) / last;
    let pitch = (420.0 / bars.len().max(1) as f64).min(8.0);
    let bottom = 30.0 + pitch * bars.len() as f64;
    let mut svg = open_svg(580.0, bottom + 40.0);
    for (row, bar) in bars.iter().enumerate() {
        let y = 24.0 + pitch * row as f64;
        line(
            &mut svg,
            [across(bar.birth), y],
            [across(bar.death), y],
            COLOURS[bar.dimension],
            if bar.death.is_finite() {
                0.7 * pitch
            } else {
                2.0
            },
        );
    }
    line(&mut svg, [40.0, bottom], [540.0, bottom], "#444444", 1.0);
    for tick in 0..=4 {
        let scale = 0.25 * f64::from(tick) * last;
        line(
            &mut svg,
            [across(scale), bottom],
            [across(scale), bottom + 5.0],
            "#444444",
            1.0,
        );
        label(
            &mut svg,
            [across(scale) - 8.0, bottom + 20.0],
            "#444444",
            &format!("{scale:.1}"),
        );
    }
    let names = ["component", "loop", "cavity"];
    for (k, (name, colour)) in names.iter().zip(COLOURS).enumerate() {
        label(&mut svg, [40.0 + 100.0 * k as f64, 14.0], colour, name);
    }
    label(&mut svg, [500.0, bottom + 34.0], "#444444", "scale");
    svg + "</svg>\n"
}

/// The flat complex seen from above: triangles, edges, vertices by kind, boundary loops and the shortest loop.
fn picture(complex: &Complex, spacing: f64) -> Result<String, cech_complex::Error> {
    let at = |p: &Point3<f64>| [260.0 + 240.0 * p.x, 260.0 - 240.0 * p.y];
    let place = |v: u32| at(&complex.points()[v as usize]);
    let mut svg = open_svg(520.0, 520.0);
    // One path for all triangles and one for all edges keep the file small.
    let corner = |v: u32| place(v).map(|x| format!("{x:.0}")).join(" ");
    let mut path = |simplices: &mut dyn Iterator<Item = Vec<u32>>, style: &str| {
        let mut outlines = String::new();
        for vertices in simplices {
            let corners: Vec<String> = vertices.iter().map(|&v| corner(v)).collect();
            outlines += "M";
            outlines += &corners.join("L");
        }
        let _ = writeln!(svg, "<path d=\"{outlines}\" {style}/>");
    };
    path(
        &mut complex.triangles().iter().map(|t| t.to_vec()),
        "fill=\"#dfe6f2\"",
    );
    path(
        &mut complex.edges().iter().map(|e| e.to_vec()),
        "stroke=\"#aab4c8\" stroke-width=\"0.4\"",
    );
    let kinds = complex.classify(spacing)?;
    for rim in complex.boundary_loops(&kinds)? {
        let corners: Vec<[f64; 2]> = rim.points(complex).iter().map(at).collect();
        polygon(
            &mut svg,
            &corners,
            "fill=\"none\" stroke=\"#dd8452\" stroke-width=\"2.5\"",
        );
    }
    for around in complex.representative_loops(1.0) {
        let corners: Vec<[f64; 2]> = around.points(complex).iter().map(at).collect();
        polygon(
            &mut svg,
            &corners,
            "fill=\"none\" stroke=\"#c44e52\" stroke-width=\"2\" stroke-dasharray=\"5 4\"",
        );
    }
    for (point, kind) in complex.points().iter().zip(&kinds) {
        let colour = if *kind == VertexKind::Interior {
            "#4c72b0"
        } else {
            "#dd8452"
        };
        let [x, y] = at(point);
        let _ = writeln!(
            svg,
            "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"2.6\" fill=\"{colour}\"/>"
        );
    }
    Ok(svg + "</svg>\n")
}

fn open_svg(width: f64, height: f64) -> String {
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" font-family=\"sans-serif\" font-size=\"12\">\n\
         <rect width=\"{width}\" height=\"{height}\" fill=\"white\"/>\n"
    )
}

// Writing to a string cannot fail.
fn line(svg: &mut String, [x1, y1]: [f64; 2], [x2, y2]: [f64; 2], colour: &str, width: f64) {
    let _ = writeln!(
        svg,
        "<line x1=\"{x1:.1}\" y1=\"{y1:.1}\" x2=\"{x2:.1}\" y2=\"{y2:.1}\" stroke=\"{colour}\" stroke-width=\"{width}\"/>"
    );
}

fn polygon(svg: &mut String, corners: &[[f64; 2]], style: &str) {
    let corners: Vec<String> = corners
        .iter()
        .map(|[x, y]| format!("{x:.1},{y:.1}"))
        .collect();
    let _ = writeln!(svg, "<polygon points=\"{}\" {style}/>", corners.join(" "));
}

fn label(svg: &mut String, [x, y]: [f64; 2], colour: &str, text: &str) {
    let _ = writeln!(
        svg,
        "<text x=\"{x:.1}\" y=\"{y:.1}\" fill=\"{colour}\">{text}</text>"
    );
}
