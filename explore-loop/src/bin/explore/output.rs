//! The result folder and what is written to it.

use crate::Failure;
use explore_loop::Error;
use explore_loop::canonical::topology::Topology;
use explore_loop::canonical::{CanonicalModel, graph, surface};
use explore_loop::measure::{
    Comparison, MeasureError, Measurer, MeshMeasures, MeshReport, Sampling, Spread, Surface,
    TrueSurface, compare,
};
use explore_loop::mesh::{self, Format, Mesh, Property};
use explore_loop::nalgebra::{Point3, UnitVector3};
use explore_loop::reconstruct::RestSurface;
use explore_loop::report::html::{self, AgainstTruth, Closing, Report};
use explore_loop::report::metrics::{Metrics, UnseenPlace};
use explore_loop::report::{colour, frames, picture};
use mesh_io::program::{Output, unless_closed};
use std::io::Write;
use std::path::{Path, PathBuf};

/// A folder that could be written to when the run began.
pub struct OutputFolder {
    path: PathBuf,
}

impl OutputFolder {
    /// Creates the folder and tries to write in it, so that a run of minutes does not fail at its end.
    pub fn create(path: &Path) -> Result<Self, Error> {
        let refused = |source| Error::Write {
            path: path.to_owned(),
            source,
        };
        std::fs::create_dir_all(path).map_err(refused)?;
        let probe = path.join(".probe");
        std::fs::write(&probe, b"").map_err(refused)?;
        std::fs::remove_file(&probe).map_err(refused)?;
        Ok(Self {
            path: path.to_owned(),
        })
    }

    /// A file in the folder.
    pub fn file(&self, name: &str) -> PathBuf {
        self.path.join(name)
    }

    /// Writes a file whole or not at all: a reader never sees half of it.
    pub fn write(&self, name: &str, content: &[u8]) -> Result<(), Error> {
        write_whole(&self.file(name), content)
    }

    /// Writes `metrics.json`.
    pub fn metrics(&self, metrics: &Metrics) -> Result<(), Failure> {
        let mut text = serde_json::to_vec_pretty(metrics)?;
        text.push(b'\n');
        Ok(self.write("metrics.json", &text)?)
    }

    /// Writes `frames.csv`.
    pub fn frames(&self, lines: &str) -> Result<(), Error> {
        self.write("frames.csv", [frames::HEADER, lines].concat().as_bytes())
    }

    /// Writes `canonical.ply`, and `canonical` in the other formats asked for: the mesh of the model at rest, with normals and what is known of each
    /// vertex ([`FinalMesh`]).
    pub fn mesh(&self, mesh: &FinalMesh, export: &[Format]) -> Result<(), Failure> {
        let mesh = mesh.written()?;
        for format in [&[Format::Ply], export].concat() {
            let bytes = mesh.to_bytes(format, in_metres())?;
            self.write(&format!("canonical.{}", format.ending()), &bytes)?;
        }
        Ok(())
    }

    /// Writes `report.html`: `rows` are those of the closing table.
    pub fn report(
        &self,
        report: &Report,
        metrics: &Metrics,
        rows: Vec<(&'static str, String)>,
    ) -> Result<(), Failure> {
        let metrics = serde_json::to_value(metrics)?;
        let page = report.page(&Closing { rows, metrics });
        Ok(self.write("report.html", page.as_bytes())?)
    }

    /// Writes `truth.ply`: the true surface at rest, to compare `canonical.ply` with in any mesh tool.
    pub fn truth(&self, truth: &TrueSurface) -> Result<(), Failure> {
        let mesh = oriented(&truth.vertices, &truth.normals(), &truth.triangles)?;
        let bytes = mesh.to_bytes(Format::Ply, in_metres())?;
        Ok(self.write("truth.ply", &bytes)?)
    }

    /// Writes a picture of the model's vertices at rest from six sides, coloured by when each part was first seen.
    pub fn picture(&self, name: &str, model: &CanonicalModel, spacing: f64) -> Result<(), Error> {
        self.draw(name, model, &model.rest, spacing)
    }

    /// The same of the surface that is written.
    pub fn surface_picture(&self, name: &str, mesh: &FinalMesh) -> Result<(), Error> {
        let first_seen = mesh.further.iter().find(|(name, _)| *name == "first_seen");
        let born: Vec<f64> = first_seen.map_or_else(Vec::new, |(_, values)| values.clone());
        let last = born
            .iter()
            .copied()
            .filter(|b| b.is_finite())
            .fold(1.0, f64::max);
        let at = |i: usize| {
            born.get(i)
                .copied()
                .filter(|b| b.is_finite())
                .unwrap_or(0.0)
        };
        let colours: Vec<colour::Rgb> = (0..mesh.vertices.len())
            .map(|i| colour::first_seen(at(i) / last))
            .collect();
        let drawing = picture::Drawing {
            points: &mesh.vertices,
            triangles: &mesh.triangles,
            colours: &colours,
        };
        let path = self.file(name);
        picture::write_six_views(&path, &drawing).map_err(|source| Error::Write { path, source })
    }

    /// The same in the live frame.
    pub fn live_picture(
        &self,
        name: &str,
        model: &CanonicalModel,
        spacing: f64,
    ) -> Result<(), Error> {
        self.draw(name, model, &model.live, spacing)
    }

    /// Draws the mesh of the model with its vertices at `points`.
    fn draw(
        &self,
        name: &str,
        model: &CanonicalModel,
        points: &[Point3<f64>],
        spacing: f64,
    ) -> Result<(), Error> {
        let triangles = surface::triangulate(&model.rest, &model.rest_normals, spacing);
        let colours = colours(model);
        let drawing = picture::Drawing {
            points,
            triangles: &triangles,
            colours: &colours,
        };
        let path = self.file(name);
        picture::write_six_views(&path, &drawing).map_err(|source| Error::Write { path, source })
    }
}

/// Writes a file beside its place and renames it.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), Error> {
    let refused = |source| Error::Write {
        path: path.to_owned(),
        source,
    };
    // Several programs may share the folder.
    let aside = PathBuf::from(format!("{}.{}.part", path.display(), std::process::id()));
    std::fs::write(&aside, bytes).map_err(refused)?;
    std::fs::rename(&aside, path).map_err(refused)
}

/// The mesh that is written, measured and drawn: the only place that says how the model becomes a surface.
///
/// With each vertex goes, from the nearest vertex of the model that faces alike: `support`, its distance, m; `first_seen`, the frame in which it
/// entered the model; `confidence`, 0 to 1, by how often it was seen and how near it is.
pub struct FinalMesh {
    further: Vec<(&'static str, Vec<f64>)>,
    vertices: Vec<Point3<f64>>,
    normals: Vec<UnitVector3<f64>>,
    triangles: Vec<[u32; 3]>,
    /// Red, green and blue of each vertex, where the camera has colours; grey where none is known.
    colours: Option<Vec<[u8; 3]>>,
}

/// Said in the header of every mesh.
fn in_metres() -> mesh::Options<'static> {
    mesh::Options::default().with_comment("metres, frame of the first observation")
}

/// A surface with its normals.
fn oriented(
    vertices: &[Point3<f64>],
    normals: &[UnitVector3<f64>],
    triangles: &[[u32; 3]],
) -> Result<Mesh, mesh::Error> {
    let normals = normals.iter().map(|n| n.into_inner()).collect();
    Mesh::new(vertices.to_vec())?
        .with_normals(normals)?
        .with_triangles(triangles.to_vec())
}

impl FinalMesh {
    /// As it is written.
    fn written(&self) -> Result<Mesh, mesh::Error> {
        let mut mesh = oriented(&self.vertices, &self.normals, &self.triangles)?;
        if let Some(colours) = &self.colours {
            mesh = mesh.with_colours(colours.clone())?;
        }
        self.further.iter().try_fold(mesh, |mesh, (name, values)| {
            mesh.with_property(Property::new(name, values.clone()))
        })
    }

    /// Of a model at rest: the surface its topology was judged by; the local triangulation of its vertices where none could be drawn.
    pub fn of(model: &CanonicalModel, topology: &Topology, spacing: f64) -> Self {
        let mut mesh = Self::uncoloured(model, topology, spacing);
        let places = mesh.vertices.iter().zip(&mesh.normals);
        let colour = |(p, n): (&Point3<f64>, &UnitVector3<f64>)| {
            model.colours.at(p, n, spacing).unwrap_or([128; 3])
        };
        mesh.colours = (!model.colours.is_empty()).then(|| places.map(colour).collect());
        mesh
    }

    /// The surface that a reconstruction draws itself.
    pub fn as_drawn(model: &CanonicalModel, own: RestSurface, spacing: f64) -> Self {
        let (nearest, distance) = nearest_facing(model, &own, spacing);
        Self {
            further: known(model, &nearest, &distance, spacing),
            vertices: own.vertices,
            normals: own.normals,
            triangles: own.triangles,
            colours: None,
        }
    }

    fn uncoloured(model: &CanonicalModel, topology: &Topology, spacing: f64) -> Self {
        match &topology.surface {
            Some(surface) => Self {
                further: known(model, &surface.nearest, &surface.distance, spacing),
                vertices: surface.vertices.clone(),
                normals: surface.normals.clone(),
                triangles: surface.triangles.clone(),
                colours: None,
            },
            None => Self {
                further: Vec::new(),
                vertices: model.rest.clone(),
                normals: model.rest_normals.clone(),
                triangles: surface::triangulate(&model.rest, &model.rest_normals, spacing),
                colours: None,
            },
        }
    }

    /// Measures it: `points` are the observations it was fused from.
    pub fn measure(
        &self,
        points: &[Point3<f64>],
        spacing: f64,
        truth: Option<&Surface>,
    ) -> Result<MeshMeasures, MeasureError> {
        MeshMeasures::of(
            &self.vertices,
            &self.triangles,
            points,
            spacing,
            truth,
            Sampling::default(),
        )
    }

    /// As the report shows it, with the distance to the truth where it is known.
    pub fn page(&self, truth: Option<&Surface>) -> html::Mesh {
        let known = self.further.iter().map(|(name, values)| {
            let (name, unit, scale) = match *name {
                "support" => ("distance to the nearest measurement", "mm", 1e3),
                "first_seen" => ("first seen", "s", 1.0),
                name => (name, "", 1.0),
            };
            html::Quantity {
                name,
                unit,
                values: values.iter().map(|v| scale * v).collect(),
            }
        });
        let distance = |surface: &Surface| html::Quantity {
            name: "distance to the truth",
            unit: "mm",
            values: self
                .vertices
                .iter()
                .map(|v| 1e3 * surface.distance(v))
                .collect(),
        };
        let mut quantities: Vec<html::Quantity> = known.chain(truth.map(distance)).collect();
        // What a reader looks for first comes first.
        quantities.sort_by_key(|q| q.name != "first seen");
        html::Mesh {
            vertices: self.vertices.clone(),
            triangles: self.triangles.clone(),
            quantities,
            colours: self.colours.clone(),
        }
    }

    /// What the truth says of the mesh and of the model's points.
    pub fn against(
        &self,
        measurer: Option<&Measurer>,
        model: &CanonicalModel,
        spacing: f64,
    ) -> AgainstTruth {
        let Some(measurer) = measurer else {
            return AgainstTruth::default();
        };
        // A mesh without an area is compared with nothing.
        let surface = Surface::new(&self.vertices, &self.triangles).ok();
        let compared = surface.map(|s| compare(&s, measurer.surface(), Sampling::default()));
        AgainstTruth {
            shape: Some(measurer.shape(model, spacing)),
            accuracy: compared.as_ref().map(Comparison::accuracy),
            completeness: compared.as_ref().map(Comparison::completeness),
        }
    }
}

/// The command that is being carried out, as one would type it.
pub fn command_line() -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./=:,+@%".contains(c);
    let word = |argument: std::ffi::OsString| {
        let text = argument.to_string_lossy().into_owned();
        if !text.is_empty() && text.chars().all(plain) {
            text
        } else {
            format!("'{}'", text.replace('\'', "'\\''"))
        }
    };
    let words: Vec<String> = std::env::args_os().skip(1).map(word).collect();
    format!("explore {}", words.join(" "))
}

/// For every vertex of a surface the nearest vertex of the model that does not face away from it, `u32::MAX` if there is none within four spacings, and
/// its distance.
fn nearest_facing(
    model: &CanonicalModel,
    surface: &RestSurface,
    spacing: f64,
) -> (Vec<u32>, Vec<f64>) {
    let tree = graph::tree(&model.rest);
    let places = surface.vertices.iter().zip(&surface.normals);
    let found = places.map(|(p, n)| {
        let near = tree
            .as_ref()
            .map_or_else(Vec::new, |tree| graph::near(tree, p, 4.0 * spacing, 24));
        let facing = |(i, _): &(usize, f64)| model.rest_normals[*i].dot(n) > 0.0;
        near.into_iter()
            .find(facing)
            .map_or((u32::MAX, f64::INFINITY), |(i, d)| (i as u32, d))
    });
    found.unzip()
}

/// Frames after which a vertex counts as well seen.
const OFTEN: f64 = 10.0;

/// What the model knows of the vertices of its surface.
fn known(
    model: &CanonicalModel,
    nearest: &[u32],
    distance: &[f64],
    spacing: f64,
) -> Vec<(&'static str, Vec<f64>)> {
    let at = |v: &u32| (*v as usize) < model.len();
    let born = |v: &u32| {
        if at(v) {
            f64::from(model.born[*v as usize])
        } else {
            f64::NAN
        }
    };
    let trust = |(v, distance): (&u32, &f64)| {
        if !at(v) {
            return 0.0;
        }
        let times = f64::from(model.times_seen[*v as usize]);
        (times / (times + OFTEN)) * (-(distance / spacing).powi(2)).exp()
    };
    vec![
        ("support", distance.to_vec()),
        ("first_seen", nearest.iter().map(born).collect()),
        (
            "confidence",
            nearest.iter().zip(distance).map(trust).collect(),
        ),
    ]
}

/// Colours of the vertices of a model by when they were first seen.
fn colours(model: &CanonicalModel) -> Vec<colour::Rgb> {
    let last = model.born.iter().copied().max().unwrap_or(0).max(1);
    let share = |b: &u32| f64::from(*b) / f64::from(last);
    model
        .born
        .iter()
        .map(|b| colour::first_seen(share(b)))
        .collect()
}

/// Prints the closing table: a name and a value a line. Nobody may be there to read it any more: what was written to the folder counts.
pub fn table(output: Output, rows: &[(&str, String)]) -> Result<(), Failure> {
    let width = rows.iter().map(|(name, _)| name.len()).max().unwrap_or(0);
    let line = |(name, value): &(&str, String)| format!("  {name:<width$}  {value}\n");
    let text: String = rows.iter().map(line).collect();
    Ok(unless_closed(write!(output.words(), "{text}"))?)
}

/// The rows of the closing table that say what a user would see.
pub fn measure_rows(metrics: &Metrics) -> Vec<(&'static str, String)> {
    let unknown = || "no ground truth".to_owned();
    let percent = |share: f64| format!("{:.1} %", 100.0 * share);
    let list = |shares: &Option<Vec<f64>>| {
        shares.as_ref().map_or_else(unknown, |shares| {
            let texts: Vec<String> = shares.iter().map(|s| percent(*s)).collect();
            texts.join(", ")
        })
    };
    let spread = |spread: Option<Spread>| {
        spread.map_or_else(unknown, |s| {
            format!("{} mean, {} p95, {} max", mm(s.mean), mm(s.p95), mm(s.max))
        })
    };
    let mut rows = vec![
        ("explored", list(&metrics.explored)),
        ("explored, two spacings", list(&metrics.explored_2eps)),
        ("accuracy", spread(metrics.accuracy_m)),
        ("completeness", spread(metrics.completeness_m)),
        (
            "F-score",
            metrics.f_score.map_or_else(unknown, |f| {
                format!(
                    "{} at 2 mm, {} at 5 mm",
                    percent(f.at_2mm),
                    percent(f.at_5mm)
                )
            }),
        ),
        ("doubled", metrics.doubled.map_or_else(unknown, percent)),
        (
            "unsupported",
            metrics
                .unsupported
                .map_or_else(|| "no mesh".to_owned(), percent),
        ),
        ("mesh", mesh_text(&metrics.mesh)),
        (
            "shape difference",
            match (metrics.shape_difference_m, metrics.shape_difference_rel) {
                (Some(metres), Some(share)) => {
                    format!("{} ({} of the size)", mm(metres), percent(share))
                }
                _ => unknown(),
            },
        ),
        (
            "prediction error",
            match (metrics.prediction_error_m, metrics.prediction_error_held_m) {
                (Some(all), Some(held)) => format!("{}, {} while held", mm(all), mm(held)),
                (Some(all), None) => mm(all),
                (None, _) => unknown(),
            },
        ),
        ("slide", metrics.slide_m.map_or_else(unknown, mm)),
        (
            "stiffness over weight",
            metrics
                .stiffness_over_weight
                .map_or_else(|| "nothing was lifted".to_owned(), |s| format!("{s:.2} m")),
        ),
    ];
    rows.extend(unseen(&metrics.unseen).map(|text| ("never seen", text)));
    rows
}

/// Most places named in the closing table; `metrics.json` has them all.
const MOST_PLACES: usize = 3;

/// Where the surface was never seen, if anywhere.
fn unseen(places: &[UnseenPlace]) -> Option<String> {
    if places.is_empty() {
        return None;
    }
    let three = |v: [f64; 3], digits: usize| v.map(|x| format!("{x:.digits$}")).join(" ");
    let named = places.iter().take(MOST_PLACES).map(|place| {
        format!(
            "{:.2} cm² around {} m, facing {}",
            1e4 * place.area_m2,
            three(place.middle_m, 3),
            three(place.facing, 1)
        )
    });
    let mut texts: Vec<String> = named.collect();
    if places.len() > MOST_PLACES {
        texts.push(format!("{} smaller places", places.len() - MOST_PLACES));
    }
    let share: f64 = places.iter().map(|place| place.share).sum();
    Some(format!(
        "{:.2} % of the surface: {}",
        100.0 * share,
        texts.join("; ")
    ))
}

fn mesh_text(mesh: &MeshReport) -> String {
    let watertight = if mesh.watertight {
        "watertight"
    } else {
        "not watertight"
    };
    let components = if mesh.components == 1 {
        "1 component".to_owned()
    } else {
        format!("{} components", mesh.components)
    };
    format!(
        "{watertight}, Euler {}, {} open and {} non-manifold edges, {components}",
        mesh.euler, mesh.open_edges, mesh.non_manifold_edges
    )
}

/// A length in mm for people.
pub fn mm(metres: f64) -> String {
    format!("{:.2} mm", metres * 1e3)
}
