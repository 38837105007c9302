//! One hypothesis of the body, followed frame by frame: the model, the elastic body that carries it, and what it was seen to do.

use super::ReconstructOptions;
use super::fill::{self, Columns, Seen};
use super::keyframe::{Keyframe, Keyframes};
use super::matching::{Gates, Match, Posed, matches, rows};
use super::pieces::Pieces;
use super::view::FrameView;
use crate::Error;
use crate::canonical::{CanonicalModel, NewVertex, graph};
use crate::cell::{ArmState, Plane};
use crate::visibility::{Sight, facing};
use kiddo::ImmutableKdTree;
use nalgebra::{Point3, Rotation3, UnitVector3};
use std::collections::BTreeSet;
use std::sync::Arc;
use topo_ekf::body::{AtRest, BodyFilter, BodyFrame, Embedding, Foot, Lattice};

/// A vertex is seen when its match is this close along the normal, metres, and this close across it, in spacings.
const SEEN: f64 = 0.0025;
const SEEN_ASIDE: f64 = 1.2;
/// Frames between two looks at the weight while something is held.
const WEIGH_EVERY: u32 = 4;
/// Cells whose inverse map is tried for a point.
const CELLS_TRIED: usize = 24;
/// Most cells' worth of material in a body.
const MOST_CELLS: f64 = 300.0;
/// The body is filled anew when it has grown by this many vertices, and by one in so many of them.
const LEAST_GROWN: usize = 30;
const SHARE_GROWN: usize = 25;
/// Fewest vertices a jaw is taken to hold.
const LEAST_HELD: usize = 4;

/// How the column under each point of the first view is filled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Fill {
    /// Stiffness and mass below the surface cells, relative to full ones.
    pub inner: f64,
}

/// A jaw that holds the body: places in the material and where they are in the frame of the tip.
type Grip = Vec<(Embedding, Point3<f64>)>;

/// One hypothesis.
pub(crate) struct Track {
    pub model: CanonicalModel,
    pub body: BodyFilter,
    /// Where each vertex lies in the lattice.
    pub embeddings: Vec<Embedding>,
    pub keyframes: Keyframes,
    /// Vertices measured in the last frame.
    pub seen: Vec<bool>,
    /// Mean distance along the normals of the matches, metres.
    pub residual: f64,
    /// Share of the vertices that face the camera and are seen.
    pub share: f64,
    /// Mean move of the nodes in the last frame, metres.
    pub moved: f64,
    /// Frames in a row without motion and without grips.
    pub still: usize,
    grips: Vec<Option<Grip>>,
    frame: u32,
    /// Innovation of every frame in which the body was held, metres.
    innovations: Vec<f64>,
    carried: f64,
    fill: Fill,
    /// Vertices beyond the first view when the body was filled last.
    filled_with: usize,
}

impl Track {
    /// The first frame: rest is where things are now.
    pub fn begin(
        view: &FrameView,
        table: &Plane,
        options: &ReconstructOptions,
        fill: Fill,
    ) -> Result<Self, Error> {
        let (lattice, feet) = filled(view, table, options, fill)?;
        let plane = topo_ekf::Plane {
            normal: table.normal,
            offset: table.offset,
        };
        let mut body = BodyFilter::new(lattice, plane, &options.body)?;
        body.set_feet(feet);
        let mut track = Self {
            model: CanonicalModel::default(),
            body,
            embeddings: Vec::new(),
            keyframes: Keyframes::default(),
            seen: Vec::new(),
            residual: 0.0,
            share: 1.0,
            moved: 0.0,
            still: 0,
            grips: Vec::new(),
            frame: 0,
            innovations: Vec::new(),
            carried: 0.0,
            fill,
            filled_with: 0,
        };
        // Poisson-disc thinning keeps the spacing even where the voxel grid does not.
        let apart = 0.85 * options.spacing;
        let mut taken: Vec<Point3<f64>> = Vec::new();
        for (point, normal) in view.points.iter().zip(&view.normals) {
            if facing(point, normal) < 0.2 || taken.iter().any(|t| (t - point).norm() < apart) {
                continue;
            }
            taken.push(*point);
            track.push(NewVertex {
                rest: *point,
                rest_normal: *normal,
                live: *point,
                rotation: nalgebra::Matrix3::identity(),
            });
        }
        track.model.edges = graph::surface_edges(&track.model, options.spacing);
        track.seen = vec![true; track.model.len()];
        Ok(track)
    }

    /// Adds a vertex and the cell it lies in.
    pub fn push(&mut self, vertex: NewVertex) {
        let at = self.embed(&vertex.rest, &vertex.rest_normal);
        self.model.push(vertex, self.frame);
        self.embeddings.push(at);
        self.seen.push(true);
    }

    /// Where a place at rest lies whose material is behind it, against `normal`; a cell is made there if there is none.
    pub fn embed(&mut self, rest: &Point3<f64>, normal: &UnitVector3<f64>) -> Embedding {
        embed_beside(self.body.lattice(), rest, normal).unwrap_or_else(|| {
            let (place, xi) = self.body.lattice().locate(rest);
            Embedding::new(self.body.ensure(place, fill::LEAST), xi)
        })
    }

    /// Moves the body to a frame and judges the fit.
    pub fn follow(
        &mut self,
        view: &FrameView,
        arms: &[ArmState],
        options: &ReconstructOptions,
    ) -> Result<(), Error> {
        let grips = self.grips_now(arms);
        let (model, embeddings) = (&self.model, &self.embeddings);
        let look = |lattice: &Lattice, pose: &topo_ekf::body::Pose, gates: Gates| {
            let posed = Posed::new(model, embeddings, lattice, pose);
            let facing = options.min_facing;
            matches(
                &posed,
                &model.times_seen,
                view,
                gates,
                facing,
                options.spacing,
            )
        };
        let mut innovation = None;
        let frame = BodyFrame::new(&grips, embeddings);
        let report = self.body.step(
            &frame,
            &mut |lattice, pose, progress| {
                rows(&look(lattice, pose, Gates::at(progress)), embeddings, view)
            },
            &mut |lattice, pose| {
                innovation = Some(mean_residual(&look(lattice, pose, Gates::PREDICTION)));
            },
        )?;
        let found = look(self.body.lattice(), self.body.pose(), Gates::JUDGE);
        if let Some(innovation) = innovation {
            self.innovations.push(innovation);
            self.carried += report.moved;
        }
        self.moved = report.moved;
        self.pose();
        self.judge(&found, view, options.spacing);
        let rests = self.moved < options.rest_motion && grips.is_empty() && !self.body.is_falling();
        self.still = if rests { self.still + 1 } else { 0 };
        if self.frame.is_multiple_of(WEIGH_EVERY) && self.share > 0.6 && self.residual < 0.002 {
            let seen: Vec<(Embedding, UnitVector3<f64>)> = (0..self.model.len())
                .filter(|&i| self.seen[i])
                .map(|i| (self.embeddings[i], self.model.live_normal(i)))
                .collect();
            let frame = BodyFrame::new(&grips, &self.embeddings);
            // A look that cannot be weighed says nothing of the weight; the frame stands.
            let _unweighed = self.body.weigh(&frame, &seen);
        }
        self.frame += 1;
        Ok(())
    }

    /// Live positions and rotations of the vertices from the body's pose.
    pub fn pose(&mut self) {
        let (lattice, pose) = (self.body.lattice(), self.body.pose());
        for (i, at) in self.embeddings.iter().enumerate() {
            self.model.live[i] = pose.position(lattice, at);
            let normal = pose.normal(lattice, at, &self.model.rest_normals[i]);
            let turn = pose.turns[at.cell as usize];
            // The rotation that carries the rest normal to the live one and is otherwise the cell's.
            let correction =
                Rotation3::rotation_between(&(turn * self.model.rest_normals[i]), &normal)
                    .unwrap_or_else(Rotation3::identity);
            self.model.rotations[i] = *(correction * turn).matrix();
        }
    }

    /// Which vertices this frame measured, and how well the whole fits.
    fn judge(&mut self, found: &[Match], view: &FrameView, spacing: f64) {
        self.seen = vec![false; self.model.len()];
        for m in found {
            self.seen[m.vertex] = m.residual.abs() < SEEN && m.aside < SEEN_ASIDE * spacing;
        }
        self.residual = mean_residual(found);
        let visible = (0..self.model.len()).filter(|&i| {
            let at = &self.model.live[i];
            facing(at, &self.model.live_normal(i)) > 0.3
                && !matches!(
                    view.depth.sight(at, f64::INFINITY, 3.0 * spacing),
                    Sight::Occluded
                )
        });
        let count = self.seen.iter().filter(|s| **s).count();
        self.share = count as f64 / visible.count().max(1) as f64;
        for (i, seen) in self.seen.iter().enumerate() {
            if *seen {
                self.model.last_seen[i] = self.frame;
                self.model.times_seen[i] += 1;
            }
        }
    }

    /// Whether the frame fits well enough to learn from.
    pub fn fits(&self) -> bool {
        self.residual < 0.0012 && self.share > 0.75
    }

    /// Held places and where the tips have carried them.
    pub fn grips_now(&self, arms: &[ArmState]) -> Vec<(Embedding, Point3<f64>)> {
        let mut held = Vec::new();
        for (arm, grip) in arms.iter().zip(&self.grips) {
            if let Some(grip) = grip.as_ref().filter(|_| arm.holding) {
                held.extend(
                    grip.iter()
                        .map(|(at, place)| (*at, arm.camera_from_tip * place)),
                );
            }
        }
        held
    }

    /// Notes which arms hold what, for the next frame.
    pub fn take_grips(&mut self, arms: &[ArmState], radius: f64) {
        self.grips.resize_with(arms.len(), || None);
        for (k, arm) in arms.iter().enumerate() {
            let finite = arm
                .camera_from_tip
                .to_homogeneous()
                .iter()
                .all(|x| x.is_finite());
            if !arm.holding {
                self.grips[k] = None;
            } else if !finite {
                // Taken as soon as the arm says where it is.
            } else if self.grips[k].is_none() {
                let tip = Point3::from(arm.camera_from_tip.translation.vector);
                let mut near: Vec<(f64, usize)> = self
                    .model
                    .live
                    .iter()
                    .enumerate()
                    .map(|(i, p)| ((p - tip).norm(), i))
                    .collect();
                near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
                let within = near.iter().filter(|n| n.0 < radius).count();
                let tip_from_camera = arm.camera_from_tip.inverse();
                let grip = near[..within.max(LEAST_HELD).min(near.len())]
                    .iter()
                    .map(|&(_, i)| (self.embeddings[i], tip_from_camera * self.model.live[i]))
                    .collect();
                self.grips[k] = Some(grip);
            }
        }
    }

    /// Whether an arm has just taken hold: its grip is not known yet.
    pub fn takes_hold(&self, arms: &[ArmState]) -> bool {
        let unknown = |k: usize| self.grips.get(k).is_none_or(Option::is_none);
        arms.iter()
            .enumerate()
            .any(|(k, a)| a.holding && unknown(k))
    }

    /// Frames in which the body was held, so that grips, table and weight alone predicted it.
    pub fn held_frames(&self) -> usize {
        self.innovations.len()
    }

    /// Mean innovation over the later half of the held frames, metres.
    pub fn mean_innovation(&self) -> f64 {
        let late = &self.innovations[self.innovations.len() / 2..];
        late.iter().sum::<f64>() / late.len().max(1) as f64
    }

    /// How far the body has moved while held, metres.
    pub fn carried(&self) -> f64 {
        self.carried
    }

    /// Whether some arm holds the body, as far as is known.
    pub fn is_held(&self) -> bool {
        self.grips.iter().any(Option::is_some)
    }

    /// Number of the next frame.
    pub fn frame(&self) -> u32 {
        self.frame
    }

    /// Search tree over the centres of the cells now.
    pub fn cell_tree(&self) -> Option<ImmutableKdTree<f64, 3>> {
        cell_tree(self.body.lattice(), &self.body.pose().live)
    }

    /// Carries a live point to rest.
    pub fn to_rest(
        &self,
        point: &Point3<f64>,
        cells: Option<&ImmutableKdTree<f64, 3>>,
    ) -> Option<AtRest> {
        to_rest(self.body.lattice(), self.body.pose(), point, cells)
    }
}

/// Search tree over the centres of all cells in a pose.
pub(crate) fn cell_tree(
    lattice: &Lattice,
    live: &[Point3<f64>],
) -> Option<ImmutableKdTree<f64, 3>> {
    let centres: Vec<Point3<f64>> = (0..lattice.cells().len() as u32)
        .map(|c| lattice.centre(live, c))
        .collect();
    graph::tree(&centres)
}

/// Carries a live point to rest through the nearest cells that are stiff enough to be trusted.
pub(crate) fn to_rest(
    lattice: &Lattice,
    pose: &topo_ekf::body::Pose,
    point: &Point3<f64>,
    cells: Option<&ImmutableKdTree<f64, 3>>,
) -> Option<AtRest> {
    let near = graph::near(cells?, point, 3.0 * lattice.size(), CELLS_TRIED);
    let firm = near
        .into_iter()
        .map(|(c, _)| c as u32)
        .filter(|&c| lattice.mass(c) >= 0.02);
    pose.inverse(lattice, point, firm)
}

fn mean_residual(found: &[Match]) -> f64 {
    let sum: f64 = found.iter().map(|m| m.residual.abs()).sum();
    sum / found.len().max(1) as f64
}

/// Cells under the first view, filled as far as material is taken to be in them, and where they stand.
fn filled(
    view: &FrameView,
    table: &Plane,
    options: &ReconstructOptions,
    fill: Fill,
) -> Result<(Lattice, Vec<Foot>), Error> {
    let normal = table.normal;
    let (u, v) = crate::canonical::surface::tangents(&normal);
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
    // A large body gets larger cells: the time of a frame grows faster than their number.
    let crowd = columns.volume() / MOST_CELLS;
    if crowd > 1.0 {
        lattice = Lattice::new(options.cell * crowd.cbrt(), origin, axes);
        columns = under(&lattice);
    }
    let surface: BTreeSet<[i32; 3]> = view.points.iter().map(|p| lattice.locate(p).0).collect();
    let found = Pieces::new(&columns, &lattice, &surface, fill.inner);
    lattice.set_pieces(&found.pieces, &found.joined)?;
    let feet = columns.feet(&lattice);
    Ok((lattice, feet))
}

/// How far behind the surface its material is looked for, in cells, and how much nearer material of a neighbouring cell must be than that of a
/// place's own.
const BEHIND: f64 = 0.15;
const NEARER: f64 = 0.15;

/// Where a place of the surface lies, in the material behind it: of the copies of its cell, and of the cells around where the material parts, the one
/// whose material is nearest.
fn embed_beside(
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
    /// Keeps a frame for re-fusion.
    pub fn keep_keyframe(&mut self, view: Arc<FrameView>, arms: &[ArmState], at_rest: bool) {
        self.keyframes.keep(Keyframe {
            view,
            pose: self.body.pose().clone(),
            arms: arms.to_vec(),
            grips: self.grips_now(arms),
            at_rest,
            frame: self.frame,
        });
    }

    /// Fits the poses of the keyframes anew to their clouds, now that the shape is known better. A pose that cannot be fitted stays.
    pub fn refit_keyframes(&mut self, options: &ReconstructOptions) {
        let mut keyframes = std::mem::take(&mut self.keyframes);
        for keyframe in keyframes.all_mut().iter_mut().filter(|k| k.frame > 0) {
            let (model, embeddings, view) = (&self.model, &self.embeddings, &keyframe.view);
            let frame = BodyFrame::new(&keyframe.grips, embeddings);
            let refitted =
                self.body
                    .refit(&keyframe.pose, &frame, &mut |lattice, pose, progress| {
                        let posed = Posed::new(model, embeddings, lattice, pose);
                        let gates = Gates::again(progress);
                        let (facing, spacing) = (options.min_facing, options.spacing);
                        let found =
                            matches(&posed, &model.times_seen, view, gates, facing, spacing);
                        rows(&found, embeddings, view)
                    });
            if let Ok(pose) = refitted {
                keyframe.pose = pose;
            }
        }
        self.keyframes = keyframes;
    }

    /// Fills every cell as far as the columns say, parts what is not connected in a cell, and lets the body stand where the columns do.
    pub fn refill(&mut self, columns: &Columns, inner: f64) {
        let cells = self.body.lattice().cells();
        let place = |at: &Embedding| cells[at.cell as usize].place;
        let surface: BTreeSet<[i32; 3]> = self.embeddings.iter().map(place).collect();
        let found = Pieces::new(columns, self.body.lattice(), &surface, inner);
        self.body.edit(|lattice| {
            // Pieces are given for every place, and joined only where they touch.
            let _cells = lattice.set_pieces(&found.pieces, &found.joined);
        });
        let feet = columns.feet(self.body.lattice());
        if !feet.is_empty() {
            self.body.set_feet(feet);
        }
        self.embed_anew();
    }

    /// Embeds everything in the copies of the cells as they now are.
    fn embed_anew(&mut self) {
        let lattice = self.body.lattice();
        for (i, at) in self.embeddings.iter_mut().enumerate() {
            let (rest, normal) = (&self.model.rest[i], &self.model.rest_normals[i]);
            if let Some(there) = embed_beside(lattice, rest, normal) {
                *at = there;
            }
        }
        let tree = graph::tree(&self.model.rest);
        let embeddings = &self.embeddings;
        // What is held was surface of the model; it stays with the vertex nearest to it.
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

    /// Fills the body anew from what was seen since the first view, once that has grown by enough.
    pub fn refill_as_seen(&mut self, spacing: f64) {
        let later: Vec<usize> = (0..self.model.len())
            .filter(|&i| self.model.born[i] > 0)
            .collect();
        let enough = LEAST_GROWN.max(self.model.len() / SHARE_GROWN);
        if later.len() < self.filled_with + enough {
            return;
        }
        self.filled_with = later.len();
        let Some(first) = self.keyframes.all().first().map(|k| Arc::clone(&k.view)) else {
            return;
        };
        let points: Vec<Point3<f64>> = later.iter().map(|&i| self.model.rest[i]).collect();
        let normals: Vec<UnitVector3<f64>> =
            later.iter().map(|&i| self.model.rest_normals[i]).collect();
        let first = Seen {
            points: &first.points,
            normals: &first.normals,
        };
        let later = Seen {
            points: &points,
            normals: &normals,
        };
        let columns = Columns::under(first, later, self.body.lattice(), spacing);
        self.refill(&columns, self.fill.inner);
    }

    /// Gives the vertices identities that `other` never used, but for those of the first frame, which are the same vertices.
    pub fn renamed_after(&mut self, other: &Self) {
        self.model.rename_after(&other.model);
    }

    /// Keeps the vertices marked.
    pub fn retain(&mut self, keep: &[bool]) {
        let stays = self.model.retain(keep);
        self.embeddings = stays.iter().map(|&i| self.embeddings[i as usize]).collect();
        self.seen = stays.iter().map(|&i| self.seen[i as usize]).collect();
    }

    /// The surface graph of the vertices as they are.
    pub fn settle_edges(&mut self, spacing: f64) {
        self.model.edges = graph::surface_edges(&self.model, spacing);
    }
}
