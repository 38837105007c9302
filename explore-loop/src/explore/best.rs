//! The model that is returned when a body that slipped or was lost has spoiled it.
//!
//! ```text
//! known(k) = area of the closed surface that points support, at decision k
//! best     = the decision before the first slip or loss with the largest known(k), the earliest of equal ones
//! at the end:  known < 0.9 known(best)   ⇒   the state of the reconstruction at that decision is restored
//! ```
//! A manipulation only ever adds views, so that much less of the surface is supported afterwards only if frames were misread: a body that was lost
//! and found in a wrong pose, for example one that looks the same from many sides. What is added after that may be surface laid twice, so that a
//! larger area is no evidence of a better model then. The area counts, not its share of the surface: a model of which only a piece is left would
//! have a high share of that piece.

use super::{Event, Explorer};
use crate::Error;
use crate::canonical::surface::vertex_areas;
use crate::canonical::topology::Topology;

/// Share of the largest known area below which a model is spoiled.
const SPOILED: f64 = 0.9;

/// The state of the reconstruction at the decision with the largest known area.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub(super) struct Best {
    known: f64,
    manipulations: usize,
    reconstruction: Vec<u8>,
    /// Whether the body slipped or was lost since.
    lost: bool,
}

/// Area of the supported surface, m².
fn known(topology: &Topology) -> f64 {
    let surface = topology.surface.as_ref();
    surface.map_or(0.0, |s| {
        vertex_areas(&s.vertices, &s.triangles).iter().sum()
    })
}

impl Explorer<'_> {
    /// Keeps the present state if more of the surface is known than ever before, and no body was lost.
    pub(super) fn keep_best(&mut self, topology: &Topology) {
        let (known, best) = (known(topology), self.best.as_ref());
        if best.is_none_or(|best| !best.lost && known > best.known) {
            // A reconstruction that cannot be saved has no best state.
            self.best = self.reconstructor.save().map(|reconstruction| Best {
                known,
                manipulations: self.manipulations,
                reconstruction,
                lost: false,
            });
        }
    }

    /// Keeps the best state from now on: the body slipped or was lost.
    pub(super) fn freeze_best(&mut self) {
        if let Some(best) = &mut self.best {
            best.lost = true;
        }
    }

    /// Restores the best state if the present one is worse; the topology of the model then, and the number of manipulations after which it was like that.
    pub(super) fn restore_best(&mut self, topology: Topology) -> Result<(Topology, usize), Error> {
        let best = self.best.take();
        let Some(best) = best.filter(|best| known(&topology) < SPOILED * best.known) else {
            return Ok((topology, self.manipulations));
        };
        self.reconstructor.restore(&best.reconstruction)?;
        let topology = self.analyse()?;
        self.tell(Event::Restored(best.manipulations, &topology))?;
        Ok((topology, best.manipulations))
    }
}
