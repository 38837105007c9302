//! The result folder and what is written to it.

use crate::Failure;
use crate::final_mesh::{FinalMesh, in_metres, oriented};
use explore_loop::Error;
use explore_loop::canonical::{CanonicalModel, surface};
use explore_loop::measure::TrueSurface;
use explore_loop::mesh::Format;
use explore_loop::nalgebra::Point3;
use explore_loop::report::html::{Closing, Report};
use explore_loop::report::metrics::Metrics;
use explore_loop::report::{colour, frames, picture};
use std::path::{Path, PathBuf};

/// A result folder, writable when the run began.
pub struct OutputFolder {
    path: PathBuf,
}

impl OutputFolder {
    /// Creates the folder and writes a test file to it, so that a run of minutes does not fail at its end.
    pub fn create(path: &Path) -> Result<Self, Error> {
        let refused = |error| Error::Write {
            path: path.to_owned(),
            error,
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

    /// Writes a file atomically: a reader never sees a part of it.
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

    /// Writes `canonical.ply`, and `canonical` in the other requested formats: the mesh of the model at rest, with normals and the values of each
    /// vertex ([`FinalMesh`]).
    pub fn mesh(&self, mesh: &FinalMesh, export: &[Format]) -> Result<(), Failure> {
        let mesh = mesh.written()?;
        for format in [&[Format::Ply], export].concat() {
            let bytes = mesh.to_bytes(format, in_metres())?;
            self.write(&format!("canonical.{}", format.ending()), &bytes)?;
        }
        Ok(())
    }

    /// Writes `report.html` with the rows of the closing table.
    pub fn report(
        &self,
        report: &Report,
        metrics: &Metrics,
        rows: Vec<(&'static str, String)>,
    ) -> Result<(), Failure> {
        let page = report.page(&Closing::new(rows, metrics)?);
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
        self.draw(name, model, model.rest(), spacing)
    }

    /// Writes the same picture of the surface that is written.
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
        picture::write_six_views(&path, &drawing).map_err(|error| Error::Write { path, error })
    }

    /// Writes the same picture in the live frame.
    pub fn live_picture(
        &self,
        name: &str,
        model: &CanonicalModel,
        spacing: f64,
    ) -> Result<(), Error> {
        self.draw(name, model, model.live(), spacing)
    }

    /// Draws the mesh of the model with its vertices at `points`.
    fn draw(
        &self,
        name: &str,
        model: &CanonicalModel,
        points: &[Point3<f64>],
        spacing: f64,
    ) -> Result<(), Error> {
        let triangles = surface::triangulate(model.rest(), model.rest_normals(), spacing);
        let colours = colours(model);
        let drawing = picture::Drawing {
            points,
            triangles: &triangles,
            colours: &colours,
        };
        let path = self.file(name);
        picture::write_six_views(&path, &drawing).map_err(|error| Error::Write { path, error })
    }
}

/// Writes a temporary file next to the target and renames it.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), Error> {
    let refused = |error| Error::Write {
        path: path.to_owned(),
        error,
    };
    // Several programs may share the folder.
    let aside = PathBuf::from(format!("{}.{}.part", path.display(), std::process::id()));
    std::fs::write(&aside, bytes).map_err(refused)?;
    std::fs::rename(&aside, path).map_err(refused)
}

/// The command that is being executed, as one would type it.
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

/// Colours of the vertices of a model by when they were first seen.
fn colours(model: &CanonicalModel) -> Vec<colour::Rgb> {
    let last = model.born().iter().copied().max().unwrap_or(0).max(1);
    let share = |b: &u32| f64::from(*b) / f64::from(last);
    model
        .born()
        .iter()
        .map(|b| colour::first_seen(share(b)))
        .collect()
}
