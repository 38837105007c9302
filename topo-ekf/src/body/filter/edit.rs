//! Changes of the material: cells that are new or filled anew, and where the body stands.

use nalgebra::Vector3;

use super::BodyFilter;
use crate::Error;
use crate::body::lattice::Lattice;
use crate::body::weight::Foot;

impl BodyFilter {
    /// The cell at a place, made with the given fill (held within 0 and 1) if there is none: surface was seen in it.
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

    /// Says where the body stands on the table at rest; until then the middle of every cell at the table does. [`Self::step`] refuses
    /// feet in cells that there are not and loads that are negative.
    pub fn set_feet(&mut self, feet: Vec<Foot>) {
        self.feet = feet;
    }

    /// Where the body stands on the table at rest.
    pub fn feet(&self) -> &[Foot] {
        &self.feet
    }

    /// As [`Self::try_edit`]; a change that is refused is undone in silence.
    pub fn edit(&mut self, change: impl FnOnce(&mut Lattice)) {
        // The lattice is then what it was: nothing to hand on.
        let _refused = self.try_edit(change);
    }

    /// Changes the lattice: cells may be added and refilled, none taken away. New nodes are carried along by the nearest cells.
    ///
    /// # Errors
    /// Cells taken away or moved, negative fill; the lattice is then as before.
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
        // What was solved on other nodes says nothing of these.
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
