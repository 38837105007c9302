//! Registers one cloud onto another:
//! `register -- SOURCE TARGET [--landmarks L.csv] [--features F.csv] [--spacing M] [--align] [--units m|cm|mm] --out MOVED`
//!
//! Clouds or meshes (PLY, PCD, XYZ, NPY, OBJ, STL, OFF); `--units` is the unit of all files, `MOVED` included, which has the points of SOURCE in their
//! order with their colours and other numbers. `--spacing` is the node spacing in m. Clouds without normals get them by principal components,
//! turned to the origin (the camera). `--align` first finds the rigid motion between the two, for turns of any size. Prints one JSON line.
//!
//! Ends with 0; with 1 if there is no result; with 3 if there is one that cannot be believed, and why.
#![allow(clippy::print_stdout)] // the JSON line is what the program is for

mod cloud;

use std::error::Error;
use std::path::Path;
use std::process::ExitCode;
use std::time::Instant;

use cloud::{Oriented, PointPair, read_pairs};
use mesh_io::{Encoding, Format, Load, Mesh, Vertices};
use nalgebra::Point3;
use nonrigid_reg::{Feature, Landmark, Options, Registrar, Registration, Status, align_rigid};

const USAGE: &str = "usage: register SOURCE TARGET [--landmarks L.csv] [--features F.csv] [--spacing M] [--align] [--units m|cm|mm] --out MOVED

  example: register before.ply after.pcd --landmarks grips.csv --out moved.ply
  SOURCE, TARGET, MOVED: PLY, PCD, XYZ, NPY, OBJ, STL or OFF; L.csv, F.csv: sx,sy,sz,tx,ty,tz";

/// Diagonals of what is registered, m: nodes are some millimetres apart.
const EXTENT: [f64; 2] = [1e-3, 10.0];

/// Exit code of a result that cannot be believed.
const DOUBTFUL: u8 = 3;

fn main() -> ExitCode {
    if std::env::args()
        .skip(1)
        .any(|word| word == "--help" || word == "-h")
    {
        println!("{USAGE}");
        return ExitCode::SUCCESS;
    }
    match arguments().and_then(|arguments| arguments.register()) {
        Ok(None) => ExitCode::SUCCESS,
        Ok(Some(doubt)) => {
            eprintln!("register: written, but not to be believed: {doubt}");
            ExitCode::from(DOUBTFUL)
        }
        Err(error) => {
            eprintln!("register: {error}");
            ExitCode::FAILURE
        }
    }
}

/// What was asked for.
struct Arguments {
    source: String,
    target: String,
    landmarks: Option<String>,
    features: Option<String>,
    options: Options,
    load: Load,
    align: bool,
    out: String,
}

fn arguments() -> Result<Arguments, Box<dyn Error>> {
    let (mut files, mut out, mut align) = (Vec::new(), None, false);
    let (mut landmarks, mut features) = (None, None);
    let mut options = Options::default();
    // Vertices in the order of the file: MOVED has the same.
    let mut load = Load::default()
        .with_vertices(Vertices::AsInFile)
        .with_extent(EXTENT);
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        let mut next = || arguments.next().ok_or(USAGE);
        match argument.as_str() {
            "--landmarks" => landmarks = Some(next()?),
            "--features" => features = Some(next()?),
            "--spacing" => {
                let given = next()?;
                let spacing = given.parse();
                options.node_spacing = spacing
                    .map_err(|_| format!("--spacing {given}: a length in metres is wanted"))?;
            }
            "--units" => load.units = next()?.parse()?,
            "--align" => align = true,
            "--out" => out = Some(next()?),
            other if other.starts_with("--") => {
                return Err(format!("unknown option {other}\n{USAGE}").into());
            }
            _ => files.push(argument),
        }
    }
    let ([source, target], Some(out)) = (&files[..], out) else {
        return Err(USAGE.into());
    };
    Ok(Arguments {
        source: source.clone(),
        target: target.clone(),
        landmarks,
        features,
        options,
        load,
        align,
        out,
    })
}

impl Arguments {
    /// Registers and writes; what speaks against believing it.
    fn register(&self) -> Result<Option<String>, Box<dyn Error>> {
        let source = Oriented::read(&self.source, &self.load)?;
        let target = Oriented::read(&self.target, &self.load)?;
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
            let found = align_rigid(&source.cloud(), &target.cloud())?;
            Some(found.displacements(source.mesh.points()))
        } else {
            None
        };
        let result = Registrar::new(self.options.clone()).register(
            &source.cloud(),
            &target.cloud(),
            &landmarks,
            &features,
            initial.as_deref(),
        )?;
        let ms = start.elapsed().as_secs_f64() * 1e3;
        let points = source.mesh.points().iter().zip(&result.displacements);
        self.write(&source.mesh, points.map(|(p, u)| p + u).collect())?;
        println!("{}", summary(&result, ms));
        Ok(doubt(&result, self.align))
    }

    fn pairs(
        &self,
        path: Option<&String>,
    ) -> Result<impl Iterator<Item = PointPair> + use<>, Box<dyn Error>> {
        let metres = self.load.units.metres();
        let read = path.map(|path| read_pairs(path, metres));
        Ok(read.transpose()?.unwrap_or_default().into_iter())
    }

    /// The points of `source` elsewhere, with what else is known of each. Normals turn with the surface, and are not written.
    fn write(&self, source: &Mesh, points: Vec<Point3<f64>>) -> Result<(), Box<dyn Error>> {
        let mut moved = Mesh::new(points)?.with_triangles(source.triangles().to_vec())?;
        if !source.colours().is_empty() {
            moved = moved.with_colours(source.colours().to_vec())?;
        }
        for property in source.properties() {
            moved = moved.with_property(property.clone())?;
        }
        let moved = moved.scaled(1.0 / self.load.units.metres());
        let path = Path::new(&self.out);
        // Text that any script reads, where the format has a choice.
        let text = matches!(Format::of(path), Ok(Format::Ply | Format::Pcd));
        let encoding = if text {
            Encoding::Text
        } else {
            Encoding::Binary
        };
        Ok(moved.save(path, mesh_io::Options::default().with_encoding(encoding))?)
    }
}

/// Least share of matched points at which running out of iterations is no bad sign.
const OVERLAP: f64 = 0.95;

/// Why the motion found may not be the true one.
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
            Some(format!("matches are {:.3} mm apart{hint}", 1e3 * residual))
        }
        Status::Undetermined { free_motions } => Some(format!(
            "the surface slides on itself in {free_motions} ways: landmarks are needed"
        )),
        _ => None,
    }
}

fn summary(result: &Registration, ms: f64) -> String {
    let status = match result.status {
        Status::Converged => "converged",
        Status::MaxIterations => "max_iterations",
        Status::Undetermined { .. } => "undetermined",
        Status::LowOverlap { .. } => "low_overlap",
        Status::HighResidual { .. } => "high_residual",
        _ => "other",
    };
    format!(
        "{{\"status\":\"{status}\",\"iterations\":{},\"overlap\":{:.4},\"residual_m\":{:.6},\"ms\":{ms:.2}}}",
        result.iterations, result.overlap, result.residuals.rms
    )
}
