//! Error rates of `classify`: counts of vertices by kind and by distance to the boundary or junction, over many nets.
//!
//! `cargo run --release -p cech-complex --features manifolds --example kinds -- 30` (nets per surface and cylinder)
//!
//! Distances are in covering radii ε of the net; the cylinder is at least as wide as ε, so that it covers the surface.

mod surfaces;

use cech_complex::manifolds::Manifold;
use cech_complex::nalgebra::Point3;
use cech_complex::{Complex, Cylinder, Error, Options, VertexKind};
use mesh_io::program::{self, Failure, Output};
use serde_json::{Value, json};
use std::io::Write;
use std::process::ExitCode;
use surfaces::ROUND;

/// Counts vertices of sampled surfaces that are classified wrongly
#[derive(Debug, clap::Parser)]
#[command(
    name = "kinds",
    after_help = "Example: kinds 30

Columns: surface, height/radius of the cylinder, vertices, how many were falsely called non-manifold; on surfaces with a rim the largest distance
at which a vertex was called boundary, the least at which one was called interior (covering radii), and how many within 1.5 were missed;
at junctions how many within one covering radius were found."
)]
struct Arguments {
    /// Nets for each surface and cylinder
    #[arg(default_value_t = 5)]
    nets: u64,
    #[command(flatten)]
    output: Output,
}

/// Beside the round ones.
const SURFACES: [(Manifold, usize); 9] = [
    (
        Manifold::Genus2 {
            hole: 0.8,
            web: 0.2,
            tube: 0.4,
        },
        1500,
    ),
    (
        Manifold::Plate {
            radius: 1.0,
            thickness: 0.5,
        },
        1000,
    ),
    (
        Manifold::TwoSpheres {
            radius: 1.0,
            gap: 0.6,
        },
        1500,
    ),
    (Manifold::Disc { radius: 1.0 }, 800),
    (
        Manifold::Annulus {
            inner: 0.5,
            outer: 1.0,
        },
        800,
    ),
    (
        Manifold::Tube {
            radius: 0.5,
            length: 1.5,
        },
        800,
    ),
    (Manifold::PinchedSphere { radius: 1.0 }, 1200),
    (Manifold::CrossingSheets { radius: 1.0 }, 1200),
    (Manifold::TJunction { radius: 1.0 }, 1500),
];

/// Counts of classifications.
#[derive(Default)]
struct Tally {
    vertices: usize,
    /// Classified as non-manifold farther than 4 ε from any junction.
    false_junction: usize,
    /// Within 1.5 ε of the boundary and not classified as boundary.
    missed: usize,
    /// Largest distance at which a vertex was classified as boundary, and smallest at which one was not.
    last_boundary: f64,
    first_interior: Option<f64>,
    /// Within ε of a junction: their number, and how many were classified as non-manifold.
    at_junction: usize,
    found: usize,
}

impl Tally {
    fn add(&mut self, kind: VertexKind, rim: f64, junction: f64) {
        self.vertices += 1;
        let far = junction > 4.0;
        self.false_junction += usize::from(far && kind == VertexKind::NonManifold);
        if far && kind == VertexKind::Boundary {
            self.last_boundary = self.last_boundary.max(rim);
        }
        if far && rim.is_finite() && kind == VertexKind::Interior {
            self.first_interior = Some(self.first_interior.map_or(rim, |first| first.min(rim)));
        }
        self.missed += usize::from(far && rim <= 1.5 && kind != VertexKind::Boundary);
        // Where a junction ends at the boundary, either answer is accepted.
        if junction < 1.0 && rim > 4.0 {
            self.at_junction += 1;
            self.found += usize::from(kind == VertexKind::NonManifold);
        }
    }
}

fn main() -> ExitCode {
    program::run(kinds)
}

fn kinds(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let output = arguments.output;
    writeln!(
        output.words(),
        "surface, height/radius: vertices, false NM, boundary up to, interior from (ε), missed within 1.5 ε, NM within ε of a junction"
    )?;
    let heights = [0.5, 1.0];
    let surfaces = ROUND.into_iter().chain(SURFACES);
    let rows = surfaces.clone().count() * heights.len();
    let bar = output.progress(rows as u64 * arguments.nets, "nets");
    let mut found = Vec::new();
    for (surface, count) in surfaces {
        for height in heights {
            let mut tally = Tally::default();
            for seed in 0..arguments.nets {
                add_net(&mut tally, surface, count, height, seed)?;
                bar.inc(1);
            }
            let name = format!("{surface:?}");
            let name = name.split(' ').next().unwrap_or_default();
            let line = format!("{name:15} {height}: {}", tally.words());
            bar.suspend(|| writeln!(output.words(), "{line}"))?;
            found.push(tally.object(name, height));
        }
    }
    bar.finish_and_clear();
    output.object(&json!({ "nets": arguments.nets, "surfaces": found }))?;
    Ok(ExitCode::SUCCESS)
}

impl Tally {
    fn words(&self) -> String {
        let mut line = format!("{:6} {:4}", self.vertices, self.false_junction);
        if let Some(first) = self.first_interior {
            let more = format!("   {:.2} {first:.2} {}", self.last_boundary, self.missed);
            line.push_str(&more);
        }
        if self.at_junction > 0 {
            let more = format!("   {} of {}", self.found, self.at_junction);
            line.push_str(&more);
        }
        line
    }

    fn object(&self, surface: &str, height: f64) -> Value {
        json!({
            "surface": surface,
            "height_over_radius": height,
            "vertices": self.vertices,
            "false_non_manifold": self.false_junction,
            "last_boundary": self.last_boundary,
            "first_interior": self.first_interior,
            "missed_boundary": self.missed,
            "at_junction": self.at_junction,
            "found_at_junction": self.found,
        })
    }
}

fn add_net(
    tally: &mut Tally,
    surface: Manifold,
    count: usize,
    height: f64,
    seed: u64,
) -> Result<(), Error> {
    let cloud = surface.net(count, seed);
    let covering = surface.covering_radius(&cloud.points);
    let radius = covering.max(1.25 * cloud.spacing);
    let cylinder = Cylinder::new(radius, height * radius)?;
    let complex = Complex::build(&cloud.points, &cloud.normals, cylinder, &Options::default())?;
    let kinds = complex.classify(cloud.spacing)?;
    let in_gaps = |p: &Point3<f64>| {
        (
            surface.boundary_distance(p) / covering,
            surface.junction_distance(p) / covering,
        )
    };
    for (kind, point) in kinds.iter().zip(&cloud.points) {
        let (rim, junction) = in_gaps(point);
        tally.add(*kind, rim, junction);
    }
    Ok(())
}
