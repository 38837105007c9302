//! `--live` and `--rrd`: the run in the Rerun viewer.

use crate::Failure;
use explore_loop::cell::CellInfo;
use std::path::PathBuf;

/// Where a run is shown while it goes on.
#[derive(Debug, Clone, Default, clap::Args)]
pub(crate) struct LiveArgs {
    /// Show the run in the Rerun viewer while it goes on; starts one where none is open (feature `rerun`)
    #[arg(long)]
    pub live: bool,
    /// Write what the Rerun viewer shows to a file instead (feature `rerun`)
    #[arg(long, value_name = "FILE.rrd", conflicts_with = "live")]
    pub rrd: Option<PathBuf>,
}

#[cfg(feature = "rerun")]
pub(crate) use explore_loop::report::live::LiveView;

#[cfg(feature = "rerun")]
impl LiveArgs {
    /// The view that was asked for.
    pub fn open(&self, cell: &CellInfo, spacing: f64) -> Result<Option<LiveView>, Failure> {
        Ok(match &self.rrd {
            Some(path) => Some(LiveView::file(path, cell, spacing)?),
            None if self.live => Some(LiveView::viewer(cell, spacing)?),
            None => None,
        })
    }
}

/// There is none in a program that was built without the feature.
#[cfg(not(feature = "rerun"))]
#[derive(Debug)]
pub(crate) enum LiveView {}

#[cfg(not(feature = "rerun"))]
impl LiveArgs {
    pub fn open(&self, _: &CellInfo, _: f64) -> Result<Option<LiveView>, Failure> {
        if self.live || self.rrd.is_some() {
            return Err("this program has no live view: build it with --features rerun".into());
        }
        Ok(None)
    }
}

#[cfg(not(feature = "rerun"))]
impl LiveView {
    pub fn finish(self) -> Result<(), explore_loop::Error> {
        match self {}
    }
}

#[cfg(not(feature = "rerun"))]
impl explore_loop::explore::Watcher for LiveView {
    fn event(
        &mut self,
        _: explore_loop::explore::Event<'_>,
        _: &explore_loop::canonical::CanonicalModel,
    ) -> Result<(), explore_loop::Error> {
        match *self {}
    }
}
