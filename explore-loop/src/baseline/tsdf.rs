//! The canonical volume: a truncated signed distance at every node of a grid, averaged over all frames.
//!
//! ```text
//! sd(x) = depth along the ray of W(x) − depth of W(x)                  projective signed distance, positive before the surface
//! if sd > −τ:   V(x) ← (V(x) C(x) + c min(sd/τ, 1)) / (C(x) + c),   C(x) ← min(C(x) + c, C_max)
//! ```
//! (Curless and Levoy 1996; Newcombe, Fox and Seitz 2015, section 3.2: a voxel is warped to the live frame and compared there.) `c` is the
//! cosine between the observed surface and the ray, and falls with the distance of the voxel from the nodes that warp it. Voxels beyond the
//! reach of the warp are not updated. The surface is the zero level set among the measured voxels; it ends where nothing was seen.

use super::depth::DepthMap;
use super::warp::{Skin, Warp};
use crate::canonical::closed_surface::{Field, Grid, extract_where, vertex_normals};
use crate::reconstruct::RestSurface;
use crate::visibility::facing;
use nalgebra::{Point3, Vector3};

/// Cosine below which a surface is seen too obliquely to be used.
const SLANT: f64 = 0.1;
/// A piece of the surface with less than this share of the triangles of the largest is noise, or fused out of place.
const LEAST_PIECE: f64 = 0.1;

/// Marks a voxel that no node warps.
const OUT: u32 = u32::MAX;

/// The volume, and which of its voxels the warp reaches.
pub(super) struct Volume {
    /// Signed distances in truncation distances, positive inside: the field decreases outwards.
    inside: Field,
    weight: Vec<f64>,
    truncation: f64,
    most: f64,
    least: f64,
    /// Voxels within the reach of the warp, and the nodes that move them.
    reached: Vec<(u32, Skin)>,
    slot: Vec<u32>,
}

impl Volume {
    /// An empty volume in a box: `voxel` and `truncation` in m; a voxel counts from weight `least` on, and its weight is capped at `most`.
    pub fn new(
        low: &Point3<f64>,
        high: &Point3<f64>,
        voxel: f64,
        truncation: f64,
        [least, most]: [f64; 2],
    ) -> Self {
        let nodes = [0, 1, 2].map(|a| ((high[a] - low[a]) / voxel).ceil() as usize + 1);
        let grid = Grid {
            origin: *low,
            step: voxel,
            nodes,
        };
        let count = grid.len();
        Self {
            inside: Field::zero(grid),
            weight: vec![0.0; count],
            truncation,
            most,
            least,
            reached: Vec::new(),
            slot: vec![OUT; count],
        }
    }

    /// Fuses the first frame into the whole box, without a warp.
    pub fn integrate_still(&mut self, depth: &DepthMap) {
        let grid = self.inside.grid.clone();
        grid.inner(|node, index| {
            if let Some((sd, c)) = self.measure(depth, &grid.place(node)) {
                self.add(index, sd, c);
            }
        });
    }

    /// Fuses a frame.
    pub fn integrate(&mut self, depth: &DepthMap, warp: &Warp, reach: f64) {
        let reached = std::mem::take(&mut self.reached);
        for (index, skin) in &reached {
            let place = self.place(*index as usize);
            if let Some((sd, c)) = self.measure(depth, &warp.blend(skin).apply(&place)) {
                let near = (place - warp.rest(skin.nodes[0])).norm() / reach;
                self.add(*index as usize, sd, c * (-near * near).exp());
            }
        }
        self.reached = reached;
    }

    /// The truncated distance of a live point from the observed surface, in truncation distances, and its weight.
    fn measure(&self, depth: &DepthMap, x: &Point3<f64>) -> Option<(f64, f64)> {
        let hit = depth.at(x)?;
        let sd = (hit.point.z - x.z) / self.truncation;
        let c = facing(&hit.point, &hit.normal, &Point3::origin());
        (sd > -1.0 && c > SLANT).then_some((sd.min(1.0), c))
    }

    fn add(&mut self, index: usize, sd: f64, c: f64) {
        let (value, weight) = (&mut self.inside.values[index], &mut self.weight[index]);
        *value = (*value * *weight - sd * c) / (*weight + c);
        *weight = (*weight + c).min(self.most);
    }

    fn place(&self, index: usize) -> Point3<f64> {
        let [_, row, layer] = self.inside.grid.strides();
        let node = [index % row, index % layer / row, index / layer];
        self.inside.grid.place(node)
    }

    /// Adds the voxels within `reach` of the new nodes to those that are warped, and updates the weights of those that were already.
    pub fn reach(&mut self, fresh: &[Point3<f64>], warp: &Warp, reach: f64) {
        let grid = self.inside.grid.clone();
        let mut touched: Vec<usize> = Vec::new();
        for node in fresh {
            let local = grid.local(node);
            let span = (reach / grid.step).ceil();
            let range = |a: usize| {
                let last = grid.nodes[a] - 1;
                let at = |x: f64| (x.max(0.0) as usize).min(last);
                at(local[a] - span)..=at(local[a] + span)
            };
            for z in range(2) {
                for y in range(1) {
                    for x in range(0) {
                        if (grid.place([x, y, z]) - node).norm() <= reach {
                            touched.push(grid.index([x, y, z]));
                        }
                    }
                }
            }
        }
        touched.sort_unstable();
        touched.dedup();
        for index in touched {
            let Some(skin) = warp.skin(&self.place(index)) else {
                continue;
            };
            match self.slot[index] {
                OUT => {
                    self.slot[index] = self.reached.len() as u32;
                    self.reached.push((index as u32, skin));
                }
                slot => self.reached[slot as usize].1 = skin,
            }
        }
    }

    /// The surface where it was measured.
    pub fn surface(&self) -> RestSurface {
        let known = |index: usize| self.weight[index] >= self.least;
        let (vertices, triangles) = extract_where(&self.inside, 0.0, known);
        let (vertices, triangles) = without_specks(&vertices, &triangles);
        RestSurface {
            normals: vertex_normals(&vertices, &triangles),
            vertices,
            triangles,
        }
    }
}

/// Removes small pieces, and the vertices that no triangle uses afterwards.
fn without_specks(
    vertices: &[Point3<f64>],
    triangles: &[[u32; 3]],
) -> (Vec<Point3<f64>>, Vec<[u32; 3]>) {
    let mut piece: Vec<u32> = (0..vertices.len() as u32).collect();
    for t in triangles {
        for v in [t[1], t[2]] {
            let (a, b) = (root(&mut piece, t[0]), root(&mut piece, v));
            piece[a.max(b) as usize] = a.min(b);
        }
    }
    let mut size = vec![0_u32; vertices.len()];
    for t in triangles {
        size[root(&mut piece, t[0]) as usize] += 1;
    }
    let largest = size.iter().copied().max().unwrap_or(0);
    let least = LEAST_PIECE * f64::from(largest);
    let mut kept = Vec::new();
    let mut renumbered = vec![u32::MAX; vertices.len()];
    let mut whole = Vec::new();
    for t in triangles {
        if f64::from(size[root(&mut piece, t[0]) as usize]) < least {
            continue;
        }
        whole.push(t.map(|v| {
            let new = &mut renumbered[v as usize];
            if *new == u32::MAX {
                *new = kept.len() as u32;
                kept.push(vertices[v as usize]);
            }
            *new
        }));
    }
    (kept, whole)
}

fn root(piece: &mut [u32], mut v: u32) -> u32 {
    while piece[v as usize] != v {
        piece[v as usize] = piece[piece[v as usize] as usize];
        v = piece[v as usize];
    }
    v
}

/// The bounding box of points, enlarged by `margin` on every side, m.
pub(super) fn around(points: &[Point3<f64>], margin: f64) -> Option<[Point3<f64>; 2]> {
    let first = *points.first()?;
    let low = points.iter().fold(first, |a, p| a.inf(p));
    let high = points.iter().fold(first, |a, p| a.sup(p));
    let margin = Vector3::repeat(margin);
    Some([low - margin, high + margin])
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::super::depth::tests::ball;
    use super::*;
    use crate::measure::MeshReport;
    use nalgebra::{Isometry3, Translation3, UnitQuaternion};

    /// A ball that turns about its centre always gives the camera the same cloud: only the warp tells its volume of the rotation.
    #[test]
    fn a_ball_seen_from_all_around_is_the_ball() {
        let (centre, radius, voxel) = (Point3::new(0.01, -0.02, 0.5), 0.05, 0.004);
        let cloud = ball(&centre, radius);
        let depth = DepthMap::new(&cloud).unwrap().unwrap();
        let [low, high] = around(&[centre], 0.09).unwrap();
        let mut volume = Volume::new(&low, &high, voxel, 0.012, [0.3, 60.0]);
        volume.integrate_still(&depth);
        let mut warp = Warp::new(0.02, 0.02, 3, 2.0);
        let grow = |volume: &mut Volume, warp: &mut Warp| {
            let fresh = warp.support(&volume.surface().vertices);
            volume.reach(&fresh, warp, 0.04);
        };
        grow(&mut volume, &mut warp);
        for k in 0..48 {
            let axis = if k < 24 { Vector3::x() } else { Vector3::y() };
            let turn = UnitQuaternion::from_scaled_axis(axis * (15.0_f64).to_radians());
            let shift = centre.coords - turn * centre.coords;
            warp.carry(&Isometry3::from_parts(Translation3::from(shift), turn));
            volume.integrate(&depth, &warp, 0.04);
            grow(&mut volume, &mut warp);
        }
        let surface = volume.surface();
        let report = MeshReport::of(&surface.vertices, &surface.triangles);
        assert!(report.watertight && report.euler == 2, "{report:?}");
        let off: Vec<f64> = surface
            .vertices
            .iter()
            .map(|v| ((v - centre).norm() - radius).abs())
            .collect();
        let mean = off.iter().sum::<f64>() / off.len() as f64;
        let worst = off.iter().copied().fold(0.0, f64::max);
        // A projective distance is not the distance to the surface: it is longer at a slant, and the mean of many slants is off by a share of a voxel.
        assert!(mean < 0.1 * voxel && worst < 0.4 * voxel, "{mean} {worst}");
    }
}
