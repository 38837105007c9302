//! The result folder and what is written to it.

use crate::Failure;
use explore_loop::Error;
use explore_loop::canonical::{CanonicalModel, surface};
use explore_loop::nalgebra::Point3;
use explore_loop::report::metrics::Metrics;
use explore_loop::report::{frames, picture, ply};
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
    fn write(&self, name: &str, content: &[u8]) -> Result<(), Error> {
        let path = self.file(name);
        let partial = self.file(&format!("{name}.part"));
        let refused = |source| Error::Write {
            path: path.clone(),
            source,
        };
        std::fs::write(&partial, content).map_err(refused)?;
        std::fs::rename(&partial, &path).map_err(refused)
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

    /// Writes `canonical.ply`: the model at rest, with faces and normals.
    pub fn model(&self, model: &CanonicalModel, spacing: f64) -> Result<(), Failure> {
        let triangles = surface::triangulate(&model.rest, &model.rest_normals, spacing);
        let mut text = Vec::new();
        ply::write_mesh(&mut text, &model.rest, &model.rest_normals, &triangles)?;
        Ok(self.write("canonical.ply", &text)?)
    }

    /// Writes a picture of the model at rest from six sides, coloured by when each part was first seen.
    pub fn picture(&self, name: &str, model: &CanonicalModel, spacing: f64) -> Result<(), Error> {
        self.draw(name, model, &model.rest, spacing)
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

/// First seen early: blue; late: yellow.
fn colours(model: &CanonicalModel) -> Vec<picture::Rgb> {
    let last = model.born.iter().copied().max().unwrap_or(0).max(1);
    let early = [60.0, 110.0, 200.0];
    let late = [250.0, 200.0, 60.0];
    let mix = |share: f64| std::array::from_fn(|c| (early[c] + share * (late[c] - early[c])) as u8);
    model
        .born
        .iter()
        .map(|b| mix(f64::from(*b) / f64::from(last)))
        .collect()
}

/// Prints the closing table: a name and a value a line.
pub fn table(rows: &[(&str, String)]) -> Result<(), Failure> {
    let width = rows.iter().map(|(name, _)| name.len()).max().unwrap_or(0);
    let mut out = std::io::stdout().lock();
    for (name, value) in rows {
        writeln!(out, "  {name:<width$}  {value}")?;
    }
    Ok(())
}

/// A length in mm for people.
pub fn mm(metres: f64) -> String {
    format!("{:.2} mm", metres * 1e3)
}
