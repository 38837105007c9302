//! Assumed material under the seen surface, down to the table.
//!
//! ```text
//! column     top: the seen surface;  bottom: the table, rounded up toward the outline
//! outline    the seen surface ends at height b, and turns under at height z; the hidden side is assumed to mirror the seen one there, and not to be
//!            blunter than a circle:
//!            bottom(d) = min( b + z − top,  z − √(z² − (z − d)²) ) ≥ 0     at distance d < z inside of it,    0 farther in
//!            z = b, unless a vertical wall has come into view below b: then z is as far down as it was seen, and sides that were not seen yet
//!            are assumed to be like most of the seen ones
//! later      steep surface that comes into view has material behind it
//! cell       fill = share of its volume that lies in columns
//! feet       columns whose bottom is on the table, each carrying its own weight
//! ```
//! This is the paper's assumption of a solid object, used until the other side has been seen; once the surface is closed, the columns
//! are computed from it ([`Columns::of_mesh`]).

use crate::canonical::graph;
use nalgebra::{Point3, UnitVector3};
use std::collections::BTreeMap;
use topo_ekf::body::{Embedding, Foot, Lattice};

/// Columns along the edge of a cell.
pub(crate) const ALONG: i32 = 4;
/// A column is under the seen surface when a point of the cloud is this close to it horizontally, in spacings.
const BESIDE: f64 = 0.85;
/// Steepest slope with which the surface is extrapolated from a point: rise over run.
const STEEPEST: f64 = 1.5;
/// Surface whose normal has a smaller vertical component than this is upright, or steep.
const UPRIGHT: f64 = 0.25;
const STEEP: f64 = 0.7;
/// Depth, in columns, to which a cell is filled behind steep surface that came into view.
const SKIN: i32 = 2;
/// Radius around a column at the outline in which the side of the body is searched for, in spacings; most points used, and fewest upright ones.
const SIDE: f64 = 1.5;
const SIDE_POINTS: usize = 40;
const SIDE_LEAST: usize = 3;
/// A side is a wall when it is upright this far below the boundary of the first view, metres.
const WALL: f64 = 0.02;
/// Number of columns at the outline with known sides, from which on the other sides are assumed to be alike.
const FEWEST_SIDES: usize = 8;
/// Columns whose bottom is lower than this stand on the table, metres.
const STANDS: f64 = 0.0012;
/// Fill of a cell of which only a part of the surface is known.
pub(crate) const LEAST: f64 = 0.12;
/// Least share in every part of a cell: the nodes of an empty cell must be constrained.
pub(crate) const EMPTY: f64 = 0.05;
/// Cells with less material than this, and without surface, are left out.
pub(crate) const SKIPPED: f64 = 0.02;

/// Vertical spans of material over the table, in cells.
pub(crate) struct Columns {
    /// Size of a cell, metres.
    size: f64,
    spans: BTreeMap<[i32; 2], Vec<[f64; 2]>>,
}

impl Columns {
    /// Under the seen surface: `first` are points and normals of the first view, `later` those added since, at rest.
    pub fn under(first: Seen<'_>, later: Seen<'_>, lattice: &Lattice, spacing: f64) -> Self {
        let size = lattice.size();
        let (first, later) = (Local::new(first, lattice), Local::new(later, lattice));
        let pitch = size / f64::from(ALONG);
        let tops = first.heights(pitch, spacing);
        let rim = rim(&tops, &later, pitch, spacing);
        let mut bottoms: BTreeMap<[i32; 2], f64> = tops
            .iter()
            .map(|(key, top)| (*key, rounded(*key, *top, &rim, pitch).min(*top)))
            .collect();
        later.fill_behind(&mut bottoms, pitch);
        let spans = tops
            .iter()
            .map(|(key, top)| (*key, vec![[bottoms[key] / size, top / size]]))
            .collect();
        Self { size, spans }
    }

    /// Inside a closed mesh: every column is intersected with the triangles over it.
    pub fn of_mesh(vertices: &[Point3<f64>], triangles: &[[u32; 3]], lattice: &Lattice) -> Self {
        let size = lattice.size();
        let along = f64::from(ALONG);
        let into = |p: &Point3<f64>| {
            let (place, xi) = lattice.locate(p);
            // Shifted off the grid of columns by an irrational share, so that no column meets an edge exactly.
            let at = [0, 1, 2].map(|a| f64::from(place[a]) + xi[a]);
            [at[0] * along + 1.37e-7, at[1] * along + 2.11e-7, at[2]]
        };
        let local: Vec<[f64; 3]> = vertices.iter().map(into).collect();
        let mut cuts: BTreeMap<[i32; 2], Vec<f64>> = BTreeMap::new();
        for t in triangles {
            let [a, b, c] = t.map(|i| local[i as usize]);
            let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
            if area.abs() < 1e-12 {
                continue;
            }
            let least = |k: usize| a[k].min(b[k]).min(c[k]);
            let most = |k: usize| a[k].max(b[k]).max(c[k]);
            // Columns stand at half indices.
            let from = [0, 1].map(|k| (least(k) - 0.5).ceil() as i32);
            let to = [0, 1].map(|k| (most(k) - 0.5).floor() as i32);
            for x in from[0]..=to[0] {
                for y in from[1]..=to[1] {
                    let (px, py) = (f64::from(x) + 0.5, f64::from(y) + 0.5);
                    let v = ((b[0] - px) * (c[1] - py) - (b[1] - py) * (c[0] - px)) / area;
                    let w = ((c[0] - px) * (a[1] - py) - (c[1] - py) * (a[0] - px)) / area;
                    let u = 1.0 - v - w;
                    if v >= 0.0 && w >= 0.0 && u >= 0.0 {
                        let height = v * a[2] + w * b[2] + u * c[2];
                        cuts.entry([x, y]).or_default().push(height);
                    }
                }
            }
        }
        let spans = cuts
            .into_iter()
            .map(|(key, mut heights)| {
                heights.sort_by(f64::total_cmp);
                let pairs = heights.chunks_exact(2).map(|p| [p[0], p[1]]);
                (key, pairs.collect())
            })
            .collect();
        Self { size, spans }
    }

    /// The spans of every column, ascending, in cells.
    pub fn spans(&self) -> &BTreeMap<[i32; 2], Vec<[f64; 2]>> {
        &self.spans
    }

    /// Volume of the material, in cells.
    pub fn volume(&self) -> f64 {
        let heights = self.spans.values().flatten().map(|s| s[1] - s[0]);
        heights.sum::<f64>() / f64::from(ALONG * ALONG)
    }

    /// Where the body stands on the table: the bottoms of the columns that reach it; if none does, the lowest.
    pub fn feet(&self, lattice: &Lattice) -> Vec<Foot> {
        let lowest = self
            .spans
            .values()
            .filter_map(|s| s.first())
            .map(|s| s[0])
            .fold(f64::INFINITY, f64::min);
        let stands = lowest.max(0.0) + STANDS / self.size;
        let mut feet = Vec::new();
        for (key, spans) in &self.spans {
            let Some(first) = spans.first().filter(|s| s[0] <= stands) else {
                continue;
            };
            let at = [0, 1].map(|a| (f64::from(key[a]) + 0.5) / f64::from(ALONG));
            let bottom = first[0].max(0.0);
            let place = [
                at[0].floor() as i32,
                at[1].floor() as i32,
                bottom.floor() as i32,
            ];
            let xi = [
                at[0] - f64::from(place[0]),
                at[1] - f64::from(place[1]),
                bottom - f64::from(place[2]),
            ];
            // The copy of the node whose material stands there.
            let gap = |cell: u32| lattice.away(cell, &xi);
            let copies = lattice.copies(place).iter().copied();
            let Some(cell) = copies.min_by(|&a, &b| gap(a).total_cmp(&gap(b)).then(a.cmp(&b)))
            else {
                continue;
            };
            let load: f64 = spans.iter().map(|s| s[1] - s[0]).sum();
            feet.push(Foot {
                at: Embedding::new(cell, xi),
                load,
            });
        }
        Foot::bearing_all(feet, lattice)
    }
}

/// Oriented points of the surface at rest.
#[derive(Clone, Copy)]
pub(crate) struct Seen<'a> {
    pub points: &'a [Point3<f64>],
    pub normals: &'a [UnitVector3<f64>],
}

impl Seen<'_> {
    /// No surface.
    pub const NOTHING: Self = Self {
        points: &[],
        normals: &[],
    };
}

/// The points in the frame of the lattice, metres.
struct Local {
    points: Vec<Point3<f64>>,
    normals: Vec<UnitVector3<f64>>,
    /// Over the table.
    flat: Option<graph::Tree>,
}

impl Local {
    fn new(seen: Seen<'_>, lattice: &Lattice) -> Self {
        let size = lattice.size();
        let into = |p: &Point3<f64>| {
            let (place, xi) = lattice.locate(p);
            Point3::from([0, 1, 2].map(|a| (f64::from(place[a]) + xi[a]) * size))
        };
        let points: Vec<Point3<f64>> = seen.points.iter().map(into).collect();
        let normals = seen.normals.iter();
        let flat: Vec<Point3<f64>> = points.iter().map(|p| Point3::new(p.x, p.y, 0.0)).collect();
        Self {
            normals: normals.map(|n| lattice.axes().inverse() * n).collect(),
            flat: graph::tree(&flat),
            points,
        }
    }

    /// Heights of the surface over the columns, metres.
    fn heights(&self, pitch: f64, spacing: f64) -> BTreeMap<[i32; 2], f64> {
        let Some(tree) = &self.flat else {
            return BTreeMap::new();
        };
        let reach = BESIDE * spacing;
        let mut near = std::collections::BTreeSet::new();
        let cells = (reach / pitch).ceil() as i32;
        for p in &self.points {
            let key = [(p.x / pitch).floor() as i32, (p.y / pitch).floor() as i32];
            for x in -cells..=cells {
                for y in -cells..=cells {
                    near.insert([key[0] + x, key[1] + y]);
                }
            }
        }
        let mut heights = BTreeMap::new();
        for key in near {
            let middle = key.map(|k| (f64::from(k) + 0.5) * pitch);
            let at = Point3::new(middle[0], middle[1], 0.0);
            let (mut sum, mut total) = (0.0, 0.0);
            for (i, distance) in graph::near(tree, &at, reach, 4) {
                let (p, n) = (&self.points[i], &self.normals[i]);
                let run = [middle[0] - p.x, middle[1] - p.y];
                let rise = -(n.x * run[0] + n.y * run[1]) / n.z.max(0.1);
                let rise = rise.clamp(-STEEPEST * distance, STEEPEST * distance);
                let weight = 1.0 / (distance + 0.1 * pitch);
                sum += (p.z + rise) * weight;
                total += weight;
            }
            if total > 0.0 && sum > 0.0 {
                heights.insert(key, sum / total);
            }
        }
        heights
    }

    /// Lowers the bottoms of the columns behind steep surface to its height.
    fn fill_behind(&self, bottoms: &mut BTreeMap<[i32; 2], f64>, pitch: f64) {
        let steep = |n: &UnitVector3<f64>| n.z.abs() < STEEP;
        for (p, n) in self.points.iter().zip(&self.normals).filter(|s| steep(s.1)) {
            let inward = -n.xy() / n.xy().norm();
            for column in 1..=SKIN {
                let at = p.xy() + inward * (f64::from(column) * pitch);
                let key = [at.x, at.y].map(|x| (x / pitch).floor() as i32);
                if let Some(bottom) = bottoms.get_mut(&key) {
                    *bottom = bottom.min(p.z.max(0.0));
                }
            }
        }
    }

    /// Height at which the side of the body turns under near a column, as far down as it was seen, metres.
    fn turning_height(&self, key: [i32; 2], pitch: f64, spacing: f64) -> Option<f64> {
        let middle = key.map(|k| (f64::from(k) + 0.5) * pitch);
        let at = Point3::new(middle[0], middle[1], 0.0);
        let near = graph::near(self.flat.as_ref()?, &at, SIDE * spacing, SIDE_POINTS);
        let upright = near
            .into_iter()
            .filter(|(i, _)| self.normals[*i].z.abs() < UPRIGHT);
        let mut heights: Vec<f64> = upright.map(|(i, _)| self.points[i].z.max(0.0)).collect();
        heights.sort_by(f64::total_cmp);
        // The lowest fifth is skipped: normals are noisy, and the lowest points may have turned under already.
        (heights.len() >= SIDE_LEAST).then(|| heights[heights.len() / 5])
    }
}

/// A column at the outline.
#[derive(Clone, Copy)]
struct Side {
    key: [i32; 2],
    /// Height of the boundary of the first view, metres.
    boundary: f64,
    /// Height at which the side turns under, as far down as it was seen, metres: the same, except for a wall.
    turn: f64,
}

/// Columns at the outline, with the sides below them.
fn rim(tops: &BTreeMap<[i32; 2], f64>, later: &Local, pitch: f64, spacing: f64) -> Vec<Side> {
    const BESIDE: [[i32; 2]; 4] = [[1, 0], [-1, 0], [0, 1], [0, -1]];
    let ends = |key: &[i32; 2]| {
        let out = |d: &[i32; 2]| !tops.contains_key(&[key[0] + d[0], key[1] + d[1]]);
        BESIDE.iter().any(out)
    };
    let outline: Vec<([i32; 2], f64)> = tops
        .iter()
        .filter(|(key, _)| ends(key))
        .map(|(key, top)| (*key, *top))
        .collect();
    // The height at which the side turns under, relative to the boundary of the first view, where it is a wall.
    let turned: Vec<Option<f64>> = outline
        .iter()
        .map(|(key, top)| later.turning_height(*key, pitch, spacing).map(|z| (z, top)))
        .map(|known| known.map(|(z, top)| if top - z > WALL { z / top } else { 1.0 }))
        .collect();
    let mut known: Vec<f64> = turned.iter().flatten().copied().collect();
    known.sort_by(f64::total_cmp);
    // Sides that have not been seen are assumed to turn under as those that have.
    let typical = if known.len() < FEWEST_SIDES {
        1.0
    } else {
        known[known.len() / 2]
    };
    let sides: Vec<Side> = std::iter::zip(outline, turned)
        .map(|((key, boundary), turned)| Side {
            key,
            boundary,
            turn: boundary * turned.unwrap_or(typical),
        })
        .collect();
    let smooth = |side: &Side| {
        let beside: Vec<&Side> = sides
            .iter()
            .filter(|s| (0..2).all(|a| (s.key[a] - side.key[a]).abs() <= 2))
            .collect();
        let mean = |of: &dyn Fn(&Side) -> f64| {
            beside.iter().map(|s| of(s)).sum::<f64>() / beside.len().max(1) as f64
        };
        Side {
            key: side.key,
            boundary: mean(&|s| s.boundary),
            turn: mean(&|s| s.turn),
        }
    };
    sides.iter().map(smooth).collect()
}

/// Height of the bottom of a column, metres.
fn rounded(key: [i32; 2], top: f64, rim: &[Side], pitch: f64) -> f64 {
    let squared = |side: &Side| {
        let [x, y] = [0, 1].map(|a| side.key[a] - key[a]);
        x * x + y * y
    };
    let Some(side) = rim.iter().min_by_key(|side| squared(side)) else {
        return 0.0;
    };
    let (height, inside) = (side.turn, f64::from(squared(side)).sqrt() * pitch);
    let left = (height - inside).max(0.0);
    let round = height - (height * height - left * left).max(0.0).sqrt();
    let mirrored = (side.boundary + height - top).max(0.0);
    round.min(mirrored)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Rotation3, Vector3};

    const HALF: [f64; 2] = [0.06, 0.08];
    const HEIGHT: f64 = 0.06;
    const ROUNDING: f64 = 0.015;

    /// The surface of a box with rounded edges that stands on the table, where `keep` accepts position and normal.
    fn surface(
        keep: impl Fn(&Point3<f64>, &Vector3<f64>) -> bool,
    ) -> (Vec<Point3<f64>>, Vec<UnitVector3<f64>>) {
        let core = Vector3::new(HALF[0], HALF[1], 0.5 * HEIGHT).map(|half| half - ROUNDING);
        let middle = Point3::new(0.0, 0.0, 0.5 * HEIGHT);
        // Points of a fine grid within a band around the surface, projected onto it.
        let grid = |half: f64| (-60..=60).map(move |k| half * f64::from(k) / 59.0);
        let points = grid(HALF[0])
            .flat_map(|x| grid(HALF[1]).map(move |y| (x, y)))
            .flat_map(|(x, y)| grid(0.5 * HEIGHT).map(move |z| Vector3::new(x, y, z)))
            .filter_map(|p| {
                let beyond = (p.abs() - core).sup(&Vector3::zeros());
                let off = beyond.norm() - ROUNDING;
                let normal = beyond.component_mul(&p.map(f64::signum));
                let normal = normal.try_normalize(1e-9)?;
                let at = middle + p - normal * off;
                (off.abs() < 0.0007 && keep(&at, &normal)).then_some((at, normal))
            });
        points
            .map(|(at, normal)| (at, UnitVector3::new_unchecked(normal)))
            .unzip()
    }

    fn seen((points, normals): &(Vec<Point3<f64>>, Vec<UnitVector3<f64>>)) -> Seen<'_> {
        Seen { points, normals }
    }

    /// Seen from above a box may be a cushion; once one of its walls was seen, it is a box with rounded edges on all sides.
    #[test]
    fn the_hidden_edges_of_a_box_are_as_round_as_the_seen_ones() {
        let lattice = Lattice::new(0.013, Point3::origin(), Rotation3::identity());
        let first = surface(|_, n| n.z > 0.1);
        let wall = surface(|_, n| n.x > 0.8 && n.z < 0.1);
        let filled = |later: Seen<'_>| Columns::under(seen(&first), later, &lattice, 0.005);
        let cushion = filled(Seen::NOTHING);
        let box_like = filled(seen(&wall));
        let pitch = 0.013 / f64::from(ALONG);
        // Height of the underside over the middle of a column, where it is rounded.
        let underside = |key: &[i32; 2]| {
            let middle = key.map(|k| (f64::from(k) + 0.5) * pitch);
            let beyond = [0, 1].map(|a| (middle[a].abs() - (HALF[a] - ROUNDING)).max(0.0));
            let beyond = beyond[0].hypot(beyond[1]);
            (beyond > 0.0 && beyond < 0.95 * ROUNDING)
                .then(|| ROUNDING - (ROUNDING * ROUNDING - beyond * beyond).sqrt())
        };
        let error = |columns: &Columns| {
            let rounded = columns.spans().iter();
            let errors: Vec<f64> = rounded
                .filter_map(|(key, s)| underside(key).map(|z| (0.013 * s[0][0] - z).abs()))
                .collect();
            errors.iter().sum::<f64>() / errors.len() as f64
        };
        let sharp = Columns {
            size: 0.013,
            spans: box_like
                .spans()
                .iter()
                .map(|(key, s)| (*key, vec![[0.0, s[0][1]]]))
                .collect(),
        };
        assert!(error(&sharp) > 0.002, "{}", error(&sharp));
        assert!(error(&cushion) > 0.01, "{}", error(&cushion));
        assert!(error(&box_like) < 0.0015, "{}", error(&box_like));
    }
}
