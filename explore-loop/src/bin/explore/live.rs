//! `--live`: shows a run in the Rerun viewer while it goes on, and records it to a file that the viewer opens.

use crate::Failure;
use crate::output::OutputFolder;
#[cfg(not(feature = "rerun"))]
use absent::{LiveView, Viewer};
use explore_loop::canonical::CanonicalModel;
use explore_loop::cell::CellInfo;
use explore_loop::explore::{Event, Watcher};
#[cfg(feature = "rerun")]
use explore_loop::report::live::{LiveView, Viewer};
use std::path::PathBuf;

#[cfg(not(feature = "rerun"))]
mod absent;

/// Whether a run is shown while it goes on, and where.
#[derive(Debug, Clone, Default, clap::Args)]
pub(crate) struct LiveArgs {
    #[arg(
        long,
        value_name = "VIEWER",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "here",
        value_parser = viewer,
        help = HELP
    )]
    live: Option<Viewer>,
}

#[cfg(feature = "rerun")]
const HELP: &str = "Show the run in the Rerun viewer while it goes on, and write live.rrd, which `rerun` opens later: in the viewer on this machine, \
    started where none is open, or with =HOST:PORT in one elsewhere; =file writes the file alone";

#[cfg(not(feature = "rerun"))]
const HELP: &str = "Show the run in the Rerun viewer while it goes on (only in a program built with --features rerun)";

#[cfg(feature = "rerun")]
#[allow(
    clippy::unnecessary_wraps,
    reason = "the signature of a command-line parser"
)]
fn viewer(text: &str) -> Result<Viewer, String> {
    Ok(match text {
        "here" => Viewer::Here,
        "file" => Viewer::None,
        address => Viewer::At(address.to_owned()),
    })
}

#[cfg(not(feature = "rerun"))]
fn viewer(_: &str) -> Result<Viewer, String> {
    Err("this program was built without the live view: cargo build --release -p explore-loop --features rerun".into())
}

/// The live view of a run, if it was asked for. A failure of the view is reported and does not stop the run.
pub(crate) struct Live(Option<LiveView>);

impl Live {
    /// Opens the view, with a file in the result folder; a resumed run gets a new file.
    pub fn open(
        args: &LiveArgs,
        out: &OutputFolder,
        goes_on: bool,
        title: &str,
        cell: &CellInfo,
        spacing: f64,
    ) -> Result<Self, Failure> {
        let Some(viewer) = &args.live else {
            return Ok(Self(None));
        };
        let file = file(out, goes_on);
        let view = LiveView::open(&file, viewer, title, cell, spacing)?;
        Ok(Self(Some(view)))
    }

    /// Whether [`Event::Uncertainty`] is wanted.
    pub fn wants_uncertainty(&self) -> bool {
        self.0.as_ref().is_some_and(Watcher::wants_uncertainty)
    }

    /// Shows an event; returns messages about the view itself.
    #[must_use]
    pub fn show(&mut self, event: Event<'_>, model: &CanonicalModel) -> Vec<String> {
        let Some(view) = &mut self.0 else {
            return Vec::new();
        };
        let failed = view.event(event, model).err();
        let mut remarks = view.take_remarks();
        remarks.extend(failed.map(|error| error.to_string()));
        remarks
    }

    /// Shows how much of the true surface the model covers.
    pub fn explored(&mut self, share: f64) {
        if let Some(view) = &mut self.0 {
            view.explored(share);
        }
    }

    /// Waits until everything is shown and written; returns messages about what is not.
    #[must_use]
    pub fn finish(&mut self) -> Vec<String> {
        self.0.take().map_or_else(Vec::new, LiveView::finish)
    }
}

/// The file of the view: a resumed run does not overwrite an earlier one.
fn file(out: &OutputFolder, goes_on: bool) -> PathBuf {
    let mut file = out.file("live.rrd");
    let mut times = 0;
    while goes_on && file.exists() {
        times += 1;
        file = out.file(&format!("live_{times}.rrd"));
    }
    file
}
