//! The material that carries the surface: filled from the first view, later from what was seen since, and finally from the closed surface; and the
//! embedding of surface points in it.
//!
//! ```text
//! cell of a point      the one it lies in; where material is divided: the copy whose material is nearest to a point slightly behind the surface
//! ```

use super::Track;
use super::grips::Grip;
use crate::Error;
use crate::canonical::graph;
use crate::cell::Plane;
use crate::reconstruct::fill::{self, Columns, Seen};
use crate::reconstruct::pieces::{Pieces, Walls};
use crate::reconstruct::view::FrameView;
use crate::reconstruct::{Material, ReconstructOptions};
use nalgebra::{Point3, Rotation3, UnitVector3};
use std::collections::BTreeSet;
use std::sync::Arc;
use topo_ekf::body::{Embedding, Foot, Lattice};

/// Largest amount of material in a body, in cells.
const MOST_CELLS: f64 = 300.0;
/// The body is filled anew when it has grown by this many vertices, and by this fraction of them (one in so many).
const LEAST_GROWN: usize = 30;
const SHARE_GROWN: usize = 25;
/// Cells without material, surface and grips are removed when they are more than this fraction of all (one in so many): each removal costs a new
/// analysis of the equations.
const MOST_ABANDONED: usize = 4;

/// How the columns under the points of the first view are filled.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub(crate) struct Fill {
    /// Stiffness and mass below the surface cells, relative to full ones.
    pub inner: f64,
}

/// The lattice of cells under the first view, filled with the assumed material, and its feet.
pub(super) fn filled(
    view: &FrameView,
    table: &Plane,
    options: &ReconstructOptions,
    fill: Fill,
) -> Result<(Lattice, Vec<Foot>), Error> {
    let normal = table.normal;
    let (u, v) = crate::canonical::tangent::tangents(&normal);
    let matrix = nalgebra::Matrix3::from_columns(&[u, v, normal.into_inner()]);
    let axes = Rotation3::from_matrix_unchecked(matrix);
    let sum: nalgebra::Vector3<f64> = view.points.iter().map(|p| p.coords).sum();
    let centre = Point3::from(sum / view.points.len().max(1) as f64);
    let origin = centre - normal.into_inner() * table.height(&centre);
    let seen = Seen {
        points: &view.points,
        normals: &view.normals,
    };
    let under = |lattice: &Lattice| Columns::under(seen, Seen::NOTHING, lattice, options.spacing);
    let mut lattice = Lattice::new(options.cell, origin, axes);
    let mut columns = under(&lattice);
    // A large body gets larger cells, because the time of a frame grows faster than their number.
    let crowd = columns.volume() / MOST_CELLS;
    if crowd > 1.0 {
        lattice = Lattice::new(options.cell * crowd.cbrt(), origin, axes);
        columns = under(&lattice);
    }
    let surface: BTreeSet<[i32; 3]> = view.points.iter().map(|p| lattice.locate(p).0).collect();
    let walls = Walls::default();
    let found = Pieces::new(
        &columns,
        &lattice,
        &surface,
        fill.inner,
        options.material,
        &walls,
    );
    lattice.set_pieces(&found.all, &found.joined)?;
    let feet = columns.feet(&lattice);
    Ok((lattice, feet))
}

/// Distance behind the surface at which its material is searched for, in cells; and how much nearer the material of a neighbouring cell must be than
/// that of the point's own.
const BEHIND: f64 = 0.15;
const NEARER: f64 = 0.15;

/// Embeds a surface point in the material behind it: of the copies of its cell, and of the surrounding cells where material is divided, the one whose
/// material is nearest is used.
pub(crate) fn embed_beside(
    lattice: &Lattice,
    rest: &Point3<f64>,
    normal: &UnitVector3<f64>,
) -> Option<Embedding> {
    let (place, xi) = lattice.locate(rest);
    if !lattice.is_parted(place) {
        return lattice.cell_at(place).map(|cell| Embedding::new(cell, xi));
    }
    let inward = lattice.axes().inverse() * normal.into_inner() * -BEHIND;
    let mut best: Option<(f64, u32, [f64; 3])> = None;
    let steps = (0..27).map(|k| [(k + 1) % 3 - 1, (k / 3 + 1) % 3 - 1, (k / 9 + 1) % 3 - 1]);
    for step in steps {
        let there = [0, 1, 2].map(|a| place[a] + step[a]);
        let local = [0, 1, 2].map(|a| xi[a] - f64::from(step[a]));
        let probe = [0, 1, 2].map(|a| local[a] + inward[a]);
        for &cell in lattice.copies(there) {
            let own = if step == [0; 3] { 0.0 } else { NEARER };
            let gap = lattice.away(cell, &probe) + own;
            if gap.is_finite() && best.is_none_or(|b| gap < b.0) {
                best = Some((gap, cell, local));
            }
        }
    }
    best.map(|(_, cell, local)| Embedding::new(cell, local))
}

impl Track {
    /// Embeds a point at rest whose material is behind it, against `normal`; adds a cell if there is none.
    pub fn embed(&mut self, rest: &Point3<f64>, normal: &UnitVector3<f64>) -> Embedding {
        embed_beside(self.body.lattice(), rest, normal).unwrap_or_else(|| {
            let (place, xi) = self.body.lattice().locate(rest);
            Embedding::new(self.body.ensure(place, fill::LEAST), xi)
        })
    }

    /// Fills every cell from the columns, separates what is not connected in a cell, and sets the feet of the body. `contacts` are loops at rest around places
    /// where parts touch.
    pub fn refill(
        &mut self,
        columns: &Columns,
        inner: f64,
        material: Material,
        contacts: &[Vec<Point3<f64>>],
    ) {
        let walls = Walls::new(contacts, self.body.lattice());
        let cells = self.body.lattice().cells();
        let place = |at: &Embedding| cells[at.cell as usize].place;
        let surface: BTreeSet<[i32; 3]> = self.embeddings.iter().map(place).collect();
        let found = Pieces::new(
            columns,
            self.body.lattice(),
            &surface,
            inner,
            material,
            &walls,
        );
        let mut cells = None;
        let edited = self.body.try_edit(|lattice| {
            cells = lattice.set_pieces(&found.all, &found.joined).ok();
        });
        let feet = columns.feet(self.body.lattice());
        if !feet.is_empty() {
            self.body.set_feet(feet);
        }
        self.embed_anew();
        // The pieces cover every needed cell, and are joined only where they touch; if that fails nonetheless, the body is as before.
        if let Some(cells) = cells.filter(|_| edited.is_ok()) {
            self.remove_abandoned(&cells[..found.filled]);
        }
    }

    /// Removes the cells without material, surface and grips, if they are more than a share of all: where the rest shape has changed often, they would
    /// accumulate, and with them the time of a frame. `filled` are the cells with material.
    fn remove_abandoned(&mut self, filled: &[u32]) {
        let kept = self.keyframes.all().iter();
        let gripped = kept
            .flat_map(|k| &k.grips)
            .chain(self.grips.iter().flatten().flatten());
        let feet = self.body.feet().iter().map(|foot| foot.at.cell);
        let held = gripped.map(|(at, _)| at.cell).chain(feet);
        let surface = self.embeddings.iter().map(|at| at.cell);
        let mut keep = vec![false; self.body.lattice().cells().len()];
        for cell in filled.iter().copied().chain(surface).chain(held) {
            keep[cell as usize] = true;
        }
        let abandoned = keep.iter().filter(|keep| !**keep).count();
        if abandoned * MOST_ABANDONED <= keep.len() {
            return;
        }
        self.keyframes.extend(self.body.lattice());
        // The cells of the feet are kept, so this succeeds; if not, the body only stays larger than it needs to be.
        let Ok(renumbered) = self.body.retain_cells(&keep) else {
            return;
        };
        let follow = |at: &mut Embedding| *at = renumbered.embedding(at).unwrap_or(*at);
        self.embeddings.iter_mut().for_each(follow);
        let keyframes = self.keyframes.all_mut();
        let grips = keyframes.iter_mut().map(|k| {
            k.pose = renumbered.pose(&k.pose);
            &mut k.grips
        });
        let held = self.grips.iter_mut().flatten();
        for (at, _) in grips.chain(held).flatten() {
            follow(at);
        }
    }

    /// Embeds everything again in the new copies of the cells.
    fn embed_anew(&mut self) {
        let lattice = self.body.lattice();
        for (i, at) in self.embeddings.iter_mut().enumerate() {
            let (rest, normal) = (&self.model.rest()[i], &self.model.rest_normals()[i]);
            if let Some(there) = embed_beside(lattice, rest, normal) {
                *at = there;
            }
        }
        let tree = graph::tree(self.model.rest());
        let embeddings = &self.embeddings;
        // What is held was surface of the model; it follows its nearest vertex.
        let renew = |grip: &mut Grip| {
            for (at, _) in grip {
                let place = lattice.cells()[at.cell as usize].place;
                if !lattice.is_parted(place) {
                    continue;
                }
                let rest = lattice.rest_at(place, at.xi);
                let near = tree
                    .as_ref()
                    .map(|t| graph::near(t, &rest, f64::INFINITY, 1));
                if let Some(&(i, _)) = near.as_ref().and_then(|n| n.first()) {
                    let with = &lattice.cells()[embeddings[i].cell as usize];
                    let xi = [0, 1, 2].map(|a| f64::from(place[a] - with.place[a]) + at.xi[a]);
                    *at = Embedding::new(embeddings[i].cell, xi);
                }
            }
        };
        self.grips.iter_mut().flatten().for_each(renew);
        self.keyframes
            .all_mut()
            .iter_mut()
            .for_each(|k| renew(&mut k.grips));
    }

    /// Fills the body anew from what was seen since the first view, if that has grown enough.
    pub fn refill_as_seen(&mut self, options: &ReconstructOptions) {
        let spacing = options.spacing;
        let later: Vec<usize> = (0..self.model.len())
            .filter(|&i| self.model.born()[i] > 0)
            .collect();
        let enough = LEAST_GROWN.max(self.model.len() / SHARE_GROWN);
        if later.len() < self.filled_with + enough {
            return;
        }
        self.filled_with = later.len();
        let Some(first) = self.keyframes.all().first().map(|k| Arc::clone(&k.view)) else {
            return;
        };
        let points: Vec<Point3<f64>> = later.iter().map(|&i| self.model.rest()[i]).collect();
        let normals: Vec<UnitVector3<f64>> = later
            .iter()
            .map(|&i| self.model.rest_normals()[i])
            .collect();
        let first = Seen {
            points: &first.points,
            normals: &first.normals,
        };
        let later = Seen {
            points: &points,
            normals: &normals,
        };
        let columns = Columns::under(first, later, self.body.lattice(), spacing);
        self.refill(&columns, self.fill.inner, options.material, &[]);
        self.renew_contact(spacing);
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use crate::cell::{ArmState, Observation};
    use nalgebra::{Isometry3, Vector3};

    const TABLE: f64 = 0.5;

    /// The upper half of a ball of 50 mm on a table, in the jaws of an arm at its top.
    fn ball() -> (Observation, Plane) {
        let grid = (-24..=24).flat_map(|x| (-24..=24).map(move |y| (x, y)));
        let points = grid.filter_map(|(x, y)| {
            let (x, y) = (0.002 * f64::from(x), 0.002 * f64::from(y));
            let squared = 0.05_f64.powi(2) - x * x - y * y;
            (squared > 4e-4).then(|| Point3::new(x, y, TABLE - squared.sqrt()))
        });
        let arm = ArmState {
            camera_from_tip: Isometry3::translation(0.0, 0.0, TABLE - 0.05),
            jaw: 0.0,
            holding: true,
            moving: false,
        };
        let observation = Observation {
            stamp: 0.0,
            camera: None,
            points: points.collect(),
            colours: None,
            features: None,
            arms: vec![arm],
        };
        let table = Plane {
            normal: -Vector3::z_axis(),
            offset: TABLE,
        };
        (observation, table)
    }

    /// Where the surface, what is held and what was held are.
    fn positions(track: &Track) -> Vec<Point3<f64>> {
        let lattice = track.body.lattice();
        let mut all: Vec<Point3<f64>> = Vec::new();
        for (pose, grips) in track.keyframes.all().iter().map(|k| (&k.pose, &k.grips)) {
            let embedded = track
                .embeddings
                .iter()
                .chain(grips.iter().map(|(at, _)| at));
            all.extend(embedded.map(|at| pose.position(lattice, at)));
        }
        let held = track.grips.iter().flatten().flatten().map(|(at, _)| at);
        let embedded = track.embeddings.iter().chain(held);
        all.extend(embedded.map(|at| track.body.pose().position(lattice, at)));
        all
    }

    #[test]
    fn abandoned_cells_are_removed_and_nothing_moves() {
        let (observation, table) = ball();
        let options = ReconstructOptions::new(5e-3);
        let view = Arc::new(FrameView::new(&observation, 5e-3).unwrap().unwrap());
        let mut track = Track::begin(&view, &table, &options, Fill { inner: 1.0 }).unwrap();
        track.take_grips(&observation.arms, options.grip_radius);
        track.keep_keyframe(Arc::clone(&view), &observation.arms, true);
        let (needed, before) = (track.body.lattice().cells().len(), positions(&track));
        let seen = Seen {
            points: &view.points,
            normals: &view.normals,
        };
        let refill = |track: &mut Track| {
            let columns = Columns::under(seen, Seen::NOTHING, track.body.lattice(), 5e-3);
            track.refill(&columns, 1.0, options.material, &[]);
        };
        // Surface was assumed here once; fewer such cells than a fourth are not worth a new analysis.
        let plant = |track: &mut Track, count: usize| {
            for k in (0..).take(count) {
                track.body.ensure([20 + k, 0, 2], fill::LEAST);
            }
            track.body.lattice().cells().len()
        };
        let few = plant(&mut track, needed / MOST_ABANDONED);
        refill(&mut track);
        assert_eq!(track.body.lattice().cells().len(), few);
        plant(&mut track, needed);
        track.keep_keyframe(view.clone(), &observation.arms, true);
        refill(&mut track);
        assert!(track.body.lattice().cells().len() <= needed);
        track.keyframes.extend(track.body.lattice());
        let after = positions(&track);
        let first_keyframe = before.len() / 2;
        assert_eq!(after[..first_keyframe], before[..first_keyframe]);
        assert_eq!(
            after[after.len() - first_keyframe..],
            before[first_keyframe..]
        );
        track.check_read().unwrap();
        track
            .follow(&view, None, &observation.arms, &options)
            .unwrap();
        assert!(track.fits(), "{} {}", track.residual, track.share);
    }
}
