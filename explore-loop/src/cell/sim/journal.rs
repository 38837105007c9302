//! The commands that a simulated cell received, by which its state can be reproduced.
//!
//! The physics engine does not guarantee that a world restored from a file continues with the same bits as the original. Repeating the commands from
//! the start does, and takes a fraction of the time of the reconstruction.

use std::sync::{Arc, Mutex, PoisonError};

use nalgebra::Isometry3;
use serde::{Deserialize, Serialize};

/// One call of a method of [`Cell`](crate::cell::Cell).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum Command {
    /// A frame was observed.
    Observe,
    /// An arm was sent to a pose (camera frame) at a speed, m/s.
    Move(usize, Isometry3<f64>, f64),
    /// A jaw was closed.
    Close(usize),
    /// A jaw was opened.
    Open(usize),
    /// All arms were sent home.
    Home,
    /// Everything was stopped.
    Stop,
}

/// The commands so far; clones share them.
#[derive(Debug, Clone, Default)]
pub struct Journal {
    commands: Arc<Mutex<Vec<Command>>>,
}

impl Journal {
    pub(super) fn add(&self, command: Command) {
        let mut commands = self.commands.lock().unwrap_or_else(PoisonError::into_inner);
        commands.push(command);
    }

    /// All commands so far, in order.
    pub fn commands(&self) -> Vec<Command> {
        let commands = self.commands.lock();
        commands.unwrap_or_else(PoisonError::into_inner).clone()
    }
}
