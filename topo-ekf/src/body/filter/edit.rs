//! Changes of the material: cells that are new or filled again, and the feet of the body.

use nalgebra::Vector3;

use super::BodyFilter;
use crate::Error;
use crate::body::lattice::Lattice;
use crate::body::weight::Foot;

impl BodyFilter {
    /// The cell at a place; if there is none it is created with the given fill (clamped to 0 to 1), because surface was seen in it.
    pub fn ensure(&mut self, place: [i32; 3], fill: f64) -> u32 {
        let fill = if fill.is_nan() {
            0.0
        } else {
            fill.clamp(0.0, 1.0)
        };
        let known = self.lattice.cell_at(place);
        known.unwrap_or_else(|| {
            let cell = self.lattice.ensure(place);
            self.lattice.set_fill(cell, fill, fill);
            self.follow_lattice();
            cell
        })
    }

    /// Sets where the body stands on the table at rest; the default is the centre of every cell at the table. [`Self::step`] rejects
    /// feet in cells that do not exist and negative loads.
    pub fn set_feet(&mut self, feet: Vec<Foot>) {
        self.feet = feet;
    }

    /// Where the body stands on the table at rest.
    pub fn feet(&self) -> &[Foot] {
        &self.feet
    }

    /// As [`Self::try_edit`]; a change that is rejected is undone without an error.
    pub fn edit(&mut self, change: impl FnOnce(&mut Lattice)) {
        // The lattice is unchanged then.
        let _refused = self.try_edit(change);
    }

    /// Changes the lattice: cells may be added and refilled, but not removed. New nodes move with the nearest cells.
    ///
    /// # Errors
    /// Cells removed or moved, negative fill; the lattice is then unchanged.
    pub fn try_edit(&mut self, change: impl FnOnce(&mut Lattice)) -> Result<(), Error> {
        let before = self.lattice.clone();
        change(&mut self.lattice);
        let sound = self.lattice.check_grown_from(&before);
        if let Err(error) = sound.and_then(|()| self.lattice.check()) {
            self.lattice = before;
            return Err(error);
        }
        self.follow_lattice();
        Ok(())
    }

    fn follow_lattice(&mut self) {
        // Normal equations for other nodes do not apply to these.
        self.last = self
            .last
            .take()
            .filter(|(e, _)| e.is_wired_as(&self.lattice));
        self.state.pose.extend(&self.lattice);
        for node in self.state.displacement.len()..self.lattice.rest().len() {
            let parent = self.lattice.parent(node as u32);
            let of = |motion: &[Vector3<f64>]| {
                parent.map_or_else(Vector3::zeros, |p| motion[p as usize])
            };
            let (displacement, raised) = (of(&self.state.displacement), of(&self.state.raised));
            self.state.displacement.push(displacement);
            self.state.raised.push(raised);
        }
    }
}
