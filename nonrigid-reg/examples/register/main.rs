//! Registers one cloud onto another: `cargo run --release -p nonrigid-reg --example register -- --help`.
//!
//! MOVED has the points of SOURCE in their order, with their colours and other properties. Clouds without normals get them by principal
//! components, turned to the origin (the camera). `--align` first finds the rigid motion between the two, with rotations of any size.

mod cloud;

use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

use cloud::{Oriented, PointPair, read_pairs};
use mesh_io::program::{self, Failure, Output, positive};
use mesh_io::{Encoding, Format, Load, Mesh, Units, Vertices, three_digits};
use nalgebra::Point3;
use nonrigid_reg::{Feature, Landmark, Options, Registrar, Registration, Status, align_rigid};
use serde_json::{Value, json};

/// Registers one point cloud of a soft body onto another
#[derive(Debug, clap::Parser)]
#[command(
    name = "register",
    after_help = "Example: register before.ply after.pcd --landmarks grips.csv --out moved.ply

Exit code 0: done; 1: no result; 2: the command line is wrong; 3: a result that cannot be believed, and why."
)]
struct Arguments {
    /// The cloud or mesh to move (PLY, PCD, XYZ, NPY, OBJ, STL, OFF)
    source: PathBuf,
    /// The cloud or mesh to register it onto
    target: PathBuf,
    /// Table sx,sy,sz,tx,ty,tz of points known to have moved from s to t
    #[arg(long, value_name = "L.csv")]
    landmarks: Option<PathBuf>,
    /// Table of the same form of points that look alike; some may be wrong
    #[arg(long, value_name = "F.csv")]
    features: Option<PathBuf>,
    /// Spacing of the nodes, m
    #[arg(long, value_name = "METRES", default_value_t = Options::default().node_spacing, value_parser = positive)]
    spacing: f64,
    /// First find the rigid motion between the two
    #[arg(long)]
    align: bool,
    /// Unit of all files: m, cm or mm
    #[arg(long, value_name = "UNIT", default_value = "m")]
    units: Units,
    /// File for the points of SOURCE at their new positions
    #[arg(long, value_name = "MOVED")]
    out: PathBuf,
    #[command(flatten)]
    output: Output,
}

/// Accepted diagonals of the clouds, m: nodes are some millimetres apart.
const EXTENT: [f64; 2] = [1e-3, 10.0];

/// Exit code for a result that is not trustworthy.
const DOUBTFUL: u8 = 3;

fn main() -> ExitCode {
    program::run(Arguments::register)
}

impl Arguments {
    /// Registers and writes the result, then warns if it is doubtful.
    fn register(&self) -> Result<ExitCode, Failure> {
        // Vertices keep the order of the file, so that MOVED has the same order.
        let load = Load::default()
            .with_units(self.units)
            .with_vertices(Vertices::AsInFile)
            .with_extent(EXTENT);
        let source = Oriented::read(&self.source, &load)?;
        let target = Oriented::read(&self.target, &load)?;
        let landmark = |(source, target)| Landmark {
            source,
            target,
            sigma: 0.0,
        };
        let landmarks: Vec<Landmark> = self.pairs(self.landmarks.as_ref())?.map(landmark).collect();
        let feature = |(source, target)| Feature { source, target };
        let features: Vec<Feature> = self.pairs(self.features.as_ref())?.map(feature).collect();

        let start = Instant::now();
        let initial = if self.align {
            let found = align_rigid(&source.cloud(), &target.cloud());
            let found = found.map_err(|error| self.named(&error))?;
            Some(found.displacements(source.mesh.points()))
        } else {
            None
        };
        let options = Options::default().with_node_spacing(self.spacing);
        let (from, to) = (source.cloud(), target.cloud());
        let mut registrar = Registrar::new(options);
        let result = registrar.register(&from, &to, &landmarks, &features, initial.as_deref());
        let result = result.map_err(|error| self.named(&error))?;
        let ms = start.elapsed().as_secs_f64() * 1e3;
        let points = source.mesh.points().iter().zip(&result.displacements);
        self.write(&source.mesh, points.map(|(p, u)| p + u).collect())?;
        let doubt = doubt(&result, self.align);
        writeln!(self.output.words(), "{}", words(&result, ms))?;
        self.output.object(&object(&result, ms, doubt.as_deref()))?;
        Ok(match doubt {
            None => ExitCode::SUCCESS,
            Some(doubt) => {
                let out = self.out.display();
                program::warn(&format!(
                    "{out}: written, but the result is doubtful: {doubt}"
                ));
                ExitCode::from(DOUBTFUL)
            }
        })
    }

    /// An error of the registration, with the names of the files that it concerns.
    fn named(&self, error: &nonrigid_reg::Error) -> String {
        let [source, target] = [&self.source, &self.target].map(|path| path.display());
        format!("{source} onto {target}: {error}")
    }

    fn pairs(
        &self,
        path: Option<&PathBuf>,
    ) -> Result<impl Iterator<Item = PointPair> + use<>, Failure> {
        let metres = self.units.metres();
        let read = path.map(|path| read_pairs(path, metres));
        Ok(read.transpose()?.unwrap_or_default().into_iter())
    }

    /// Writes the points of `source` at new positions, with their other properties. Normals would be turned with the surface and are not written.
    fn write(&self, source: &Mesh, points: Vec<Point3<f64>>) -> Result<(), Failure> {
        let mut moved = Mesh::new(points)?.with_triangles(source.triangles().to_vec())?;
        if !source.colours().is_empty() {
            moved = moved.with_colours(source.colours().to_vec())?;
        }
        for property in source.properties() {
            moved = moved.with_property(property.clone())?;
        }
        let moved = moved.scaled(1.0 / self.units.metres());
        let path = &self.out;
        // Text, which any script can read, where the format has the choice.
        let text = matches!(Format::of(path), Ok(Format::Ply | Format::Pcd));
        let encoding = if text {
            Encoding::Text
        } else {
            Encoding::Binary
        };
        Ok(moved.save(path, mesh_io::Options::default().with_encoding(encoding))?)
    }
}

/// Share of matched points from which on reaching the largest number of iterations is not taken for a failure.
const OVERLAP: f64 = 0.95;

/// Why the result may be wrong.
fn doubt(result: &Registration, aligned: bool) -> Option<String> {
    let hint = if aligned {
        ""
    } else {
        "; if the object was turned or moved as a whole, add --align"
    };
    let percent = 1e2 * result.overlap;
    match result.status {
        Status::MaxIterations if result.overlap < OVERLAP => Some(format!(
            "the iterations ran out with {percent:.0} % of the points matched{hint}"
        )),
        Status::LowOverlap { .. } => Some(format!(
            "only {percent:.0} % of the points found a match{hint}"
        )),
        Status::HighResidual { residual, .. } => {
            let apart = three_digits(1e3 * residual);
            Some(format!("matches are {apart} mm apart{hint}"))
        }
        Status::Undetermined { free_motions } => Some(format!(
            "the surface slides or rolls on itself in {free_motions} {}: landmarks are needed",
            if free_motions == 1 { "way" } else { "ways" }
        )),
        _ => None,
    }
}

/// The status in one word.
fn word(status: Status) -> &'static str {
    match status {
        Status::Converged => "converged",
        Status::MaxIterations => "max_iterations",
        Status::Undetermined { .. } => "undetermined",
        Status::LowOverlap { .. } => "low_overlap",
        Status::HighResidual { .. } => "high_residual",
        _ => "other",
    }
}

fn words(result: &Registration, ms: f64) -> String {
    format!(
        "{} after {} iterations, {:.0} ms; {:.1} % of the points matched, {} mm apart",
        word(result.status).replace('_', " "),
        result.iterations,
        ms,
        1e2 * result.overlap,
        three_digits(1e3 * result.residuals.rms)
    )
}

fn object(result: &Registration, ms: f64, doubt: Option<&str>) -> Value {
    json!({
        "status": word(result.status),
        "iterations": result.iterations,
        "overlap": result.overlap,
        "residual_m": result.residuals.rms,
        "ms": ms,
        "doubt": doubt,
    })
}
