//! The live view in a program that was built without it: types without values.

use explore_loop::Error;
use explore_loop::canonical::CanonicalModel;
use explore_loop::cell::CellInfo;
use explore_loop::explore::{Event, Watcher};
use std::path::Path;

#[derive(Debug, Clone)]
pub enum Viewer {}

pub enum LiveView {}

impl LiveView {
    pub fn open(_: &Path, viewer: &Viewer, _: &str, _: &CellInfo, _: f64) -> Result<Self, Error> {
        match *viewer {}
    }

    pub fn explored(&mut self, _: f64) {
        match *self {}
    }

    pub fn take_remarks(&mut self) -> Vec<String> {
        match *self {}
    }

    pub fn finish(self) -> Vec<String> {
        match self {}
    }
}

impl Watcher for LiveView {
    fn event(&mut self, _: Event<'_>, _: &CanonicalModel) -> Result<(), Error> {
        match *self {}
    }
}
