//! The kept result of a job: one small JSON file, written atomically.

use crate::Failure;
use crate::output::write_whole;
use explore_loop::report::metrics::{Metrics, Timing};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// The content of the file of a finished job.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Done {
    pub study: String,
    pub seed: u64,
    /// Duration of the job.
    pub seconds: f64,
    /// Version of the program that ran it.
    pub version: String,
    /// One run for each row of the job.
    pub runs: Vec<Ran>,
}

/// The result of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Ran {
    /// The row that the run belongs to.
    pub row: Vec<String>,
    /// The command, as one would type it.
    pub command: String,
    pub metrics: Option<Metrics>,
    /// Why there are no metrics.
    pub error: Option<String>,
}

impl Ran {
    /// How the run ended: `stop` of the metrics, or `error`.
    pub fn stop(&self) -> &str {
        self.metrics.as_ref().map_or("error", |m| &m.stop)
    }

    /// The reason for the ending, where there is one.
    pub fn reason(&self) -> Option<&str> {
        let told = self.metrics.as_ref().and_then(|m| m.reason.as_deref());
        told.or(self.error.as_deref())
    }

    /// Without what differs from one execution to another: times, and the path of the recording.
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
    /// Whether two results are of the same job and equal except for times.
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

    /// Writes the file atomically.
    pub fn write(&self, path: &Path) -> Result<(), Failure> {
        let mut bytes = serde_json::to_vec_pretty(self)?;
        bytes.push(b'\n');
        Ok(write_whole(path, &bytes)?)
    }
}
