//! Changes of the material: cells that are new, filled again or removed, and the feet of the body.

use nalgebra::Vector3;

use super::BodyFilter;
use crate::Error;
use crate::body::lattice::Lattice;
use crate::body::removal::Renumbered;
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

    /// Keeps the marked cells and removes the others; the pose of those kept stays as it is. Embedded points and poses that the caller holds must be given the
    /// new indices, which are returned. For bodies that are refilled many times: the time of a step grows with the number of cells, so cells that have
    /// lost their material should go.
    ///
    /// # Errors
    /// Not one mark for each cell, no cell marked, or a foot ([`Self::set_feet`]) in a cell that would be removed; the body is then unchanged.
    ///
    /// # Complexity
    /// Cells times logarithm of cells; the next step analyses its equations anew.
    pub fn retain_cells(&mut self, keep: &[bool]) -> Result<Renumbered, Error> {
        let stands = |foot: &Foot| keep.get(foot.at.cell as usize) == Some(&true);
        if let Some(index) = self.feet.iter().position(|foot| !stands(foot)) {
            return Err(Error::CellOutOfRange {
                what: "foot",
                index,
                cell: self.feet[index].at.cell,
                cells: keep.iter().filter(|keep| **keep).count(),
            });
        }
        let renumbered = self.lattice.retain_cells(keep)?;
        for foot in &mut self.feet {
            foot.at = renumbered.embedding(&foot.at).unwrap_or(foot.at);
        }
        let state = &mut self.state;
        state.pose = renumbered.pose(&state.pose);
        state.displacement = renumbered.of_nodes(&state.displacement);
        state.raised = renumbered.of_nodes(&state.raised);
        self.last = None;
        Ok(renumbered)
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
