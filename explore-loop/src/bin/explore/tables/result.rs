//! What is kept of a job: one small JSON file, written aside and renamed, so that it is there whole or not at all.

use crate::Failure;
use crate::output::write_whole;
use explore_loop::report::metrics::{Metrics, Timing};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// The content of the file of a job that is done.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Done {
    pub study: String,
    pub seed: u64,
    /// How long it took.
    pub seconds: f64,
    /// Of the program that did it.
    pub version: String,
    /// A run for each of its rows.
    pub runs: Vec<Ran>,
}

/// What became of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Ran {
    /// The row that it belongs to.
    pub row: Vec<String>,
    /// What was run, as one would type it.
    pub command: String,
    pub metrics: Option<Metrics>,
    /// Why there are none.
    pub error: Option<String>,
}

impl Ran {
    /// The word for its end: that of the metrics, or `error`.
    pub fn stop(&self) -> &str {
        self.metrics.as_ref().map_or("error", |m| &m.stop)
    }

    /// Why it ended so, where a word does not say it.
    pub fn reason(&self) -> Option<&str> {
        let told = self.metrics.as_ref().and_then(|m| m.reason.as_deref());
        told.or(self.error.as_deref())
    }

    /// Without what differs from one time to another: the times, and where the recording of a replay lay.
    fn without_times(&self) -> Self {
        let metrics = self.metrics.clone().map(|m| Metrics {
            scene: String::new(),
            registration_ms: Timing::default(),
            frame_ms: Timing::default(),
            wall_s: 0.0,
            ..m
        });
        Self {
            metrics,
            ..self.clone()
        }
    }
}

impl Done {
    /// Whether two results are of the same job and say the same, but for the times that it took.
    pub fn agrees_with(&self, other: &Self) -> bool {
        let plain = |done: &Self| done.runs.iter().map(Ran::without_times).collect::<Vec<_>>();
        (&self.study, self.seed) == (&other.study, other.seed) && plain(self) == plain(other)
    }

    /// Reads the file of a job; `None` if there is none.
    pub fn read(path: &Path) -> Result<Option<Self>, Failure> {
        match std::fs::read(path) {
            Ok(bytes) => serde_json::from_slice(&bytes)
                .map(Some)
                .map_err(|error| format!("{}: {error}", path.display()).into()),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
            Err(error) => Err(format!("{}: {error}", path.display()).into()),
        }
    }

    /// Writes it, whole or not at all.
    pub fn write(&self, path: &Path) -> Result<(), Failure> {
        let mut bytes = serde_json::to_vec_pretty(self)?;
        bytes.push(b'\n');
        Ok(write_whole(path, &bytes)?)
    }
}
