//! What lies under the seen surface: material down to the table, as far as anyone can tell.
//!
//! ```text
//! column     top: the seen surface;  bottom: the table, rounded up toward the outline
//! outline    at height z the surface turns under; the hidden side is taken to mirror the seen one there, and not to be blunter than a circle:
//!            bottom(d) = min( 2 z − top,  z − √(z² − (z − d)²) ) ≥ 0     at distance d < z inside of it,    0 farther in
//! cell       fill = share of its volume that lies in columns
//! feet       columns whose bottom is on the table, each bearing its own weight
//! ```
//! It is the paper's assumption of a solid object, for as long as nobody has seen the other side; once the surface is closed, the columns
//! come from it ([`Columns::of_mesh`]).

use super::view::FrameView;
use crate::canonical::graph;
use nalgebra::{Point3, UnitVector3};
use std::collections::BTreeMap;
use topo_ekf::body::{Embedding, Foot, Lattice, Occupancy};

/// Columns along the edge of a cell.
const ALONG: i32 = 4;
/// A column is under the seen surface when a point of the cloud lies this close beside it, in spacings.
const BESIDE: f64 = 0.85;
/// Steepest slope that a point of the cloud continues with: rise over run.
const STEEPEST: f64 = 1.5;
/// Columns whose bottom is lower than this stand on the table, metres.
const STANDS: f64 = 0.0012;
/// Fill of a cell of which nothing is known but that surface is in it.
pub(crate) const LEAST: f64 = 0.12;
/// Share that every part of a cell holds at least: the nodes of an empty cell must stay where something holds them.
const EMPTY: f64 = 0.05;
/// Cells with less material than this, and no surface, are left out.
const SKIPPED: f64 = 0.02;

/// Share of a cell that is filled.
pub(crate) fn share(occupancy: &Occupancy) -> f64 {
    occupancy.iter().sum::<f64>() / occupancy.len() as f64
}

/// Spans of material above places on the table, in cells.
pub(crate) struct Columns {
    /// Size of a cell, metres.
    size: f64,
    spans: BTreeMap<[i32; 2], Vec<[f64; 2]>>,
}

impl Columns {
    /// Under the first view, in the frame of an (empty) lattice.
    pub fn under(view: &FrameView, lattice: &Lattice, spacing: f64) -> Self {
        let size = lattice.size();
        let into = |p: &Point3<f64>| {
            let (place, xi) = lattice.locate(p);
            [0, 1, 2].map(|a| (f64::from(place[a]) + xi[a]) * size)
        };
        let local: Vec<[f64; 3]> = view.points.iter().map(into).collect();
        let normals: Vec<UnitVector3<f64>> = view
            .normals
            .iter()
            .map(|n| lattice.axes().inverse() * n)
            .collect();
        let flat: Vec<Point3<f64>> = local.iter().map(|p| Point3::new(p[0], p[1], 0.0)).collect();
        let Some(tree) = graph::tree(&flat) else {
            return Self {
                size,
                spans: BTreeMap::new(),
            };
        };
        let tops = tops(&local, &normals, &tree, size, spacing);
        let rim = rim(&tops);
        let pitch = size / f64::from(ALONG);
        let spans = tops
            .iter()
            .map(|(key, top)| {
                let bottom = rounded(*key, *top, &rim, pitch);
                (*key, vec![[bottom.min(*top) / size, top / size]])
            })
            .collect();
        Self { size, spans }
    }

    /// Inside a closed mesh: every column is cut by the triangles over it.
    pub fn of_mesh(vertices: &[Point3<f64>], triangles: &[[u32; 3]], lattice: &Lattice) -> Self {
        let size = lattice.size();
        let along = f64::from(ALONG);
        let into = |p: &Point3<f64>| {
            let (place, xi) = lattice.locate(p);
            // Off the grid of columns by an irrational share, so that no column meets an edge exactly.
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

    /// Which parts of the cell at `place` are filled.
    pub fn occupancy(&self, place: [i32; 3]) -> Occupancy {
        let part = 1.0 / f64::from(ALONG);
        std::array::from_fn(|k| {
            // One of 64 parts.
            #[allow(clippy::cast_possible_wrap)]
            let k = k as i32;
            let key = [
                place[0] * ALONG + k % ALONG,
                place[1] * ALONG + k / ALONG % ALONG,
            ];
            let low = f64::from(place[2]) + f64::from(k / (ALONG * ALONG)) * part;
            let spans = self.spans.get(&key).into_iter().flatten();
            let filled: f64 = spans
                .map(|span| (span[1].min(low + part) - span[0].max(low)).max(0.0))
                .sum();
            filled / part
        })
    }

    /// Volume of the material, in cells.
    pub fn volume(&self) -> f64 {
        let heights = self.spans.values().flatten().map(|s| s[1] - s[0]);
        heights.sum::<f64>() / f64::from(ALONG * ALONG)
    }

    /// Places of all cells that have material in them.
    pub fn places(&self) -> std::collections::BTreeSet<[i32; 3]> {
        let mut places = std::collections::BTreeSet::new();
        for (key, spans) in &self.spans {
            for span in spans {
                let [low, high] = [span[0].floor() as i32, span[1].floor() as i32];
                for k in low..=high {
                    places.insert([key[0].div_euclid(ALONG), key[1].div_euclid(ALONG), k]);
                }
            }
        }
        places
    }

    /// Makes the cells that have material or are named, and fills all cells of the lattice: those in `surface` with what is in them, the others with
    /// `inner` times that.
    pub fn fill(
        &self,
        lattice: &mut Lattice,
        surface: &std::collections::BTreeSet<[i32; 3]>,
        inner: f64,
    ) {
        for place in self.places().union(surface) {
            if surface.contains(place) || share(&self.occupancy(*place)) > SKIPPED {
                lattice.ensure(*place);
            }
        }
        for cell in 0..lattice.cells().len() as u32 {
            let place = lattice.cells()[cell as usize].place;
            let scale = if surface.contains(&place) { 1.0 } else { inner };
            let occupancy = self.occupancy(place).map(|o| (o * scale).max(EMPTY));
            lattice.set_fill(cell, 1.0, 1.0);
            let full = occupancy.iter().all(|o| *o >= 1.0 - 1e-9);
            lattice.set_occupancy(cell, (!full).then_some(occupancy));
        }
    }

    /// Where the body stands on the table: the bottoms of the columns that reach it; the lowest when none does.
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
            let Some(cell) = lattice.cell_at(place) else {
                continue;
            };
            let xi = [
                at[0] - f64::from(place[0]),
                at[1] - f64::from(place[1]),
                bottom - f64::from(place[2]),
            ];
            let load: f64 = spans.iter().map(|s| s[1] - s[0]).sum();
            feet.push(Foot {
                at: Embedding::new(cell, xi),
                load,
            });
        }
        Foot::bearing_all(feet, lattice)
    }
}

/// Heights of the seen surface over the columns, metres.
fn tops(
    local: &[[f64; 3]],
    normals: &[UnitVector3<f64>],
    tree: &kiddo::ImmutableKdTree<f64, 3>,
    size: f64,
    spacing: f64,
) -> BTreeMap<[i32; 2], f64> {
    let pitch = size / f64::from(ALONG);
    let reach = BESIDE * spacing;
    let mut near = std::collections::BTreeSet::new();
    let cells = (reach / pitch).ceil() as i32;
    for p in local {
        let key = [(p[0] / pitch).floor() as i32, (p[1] / pitch).floor() as i32];
        for x in -cells..=cells {
            for y in -cells..=cells {
                near.insert([key[0] + x, key[1] + y]);
            }
        }
    }
    let mut tops = BTreeMap::new();
    for key in near {
        let middle = key.map(|k| (f64::from(k) + 0.5) * pitch);
        let at = Point3::new(middle[0], middle[1], 0.0);
        let (mut sum, mut total) = (0.0, 0.0);
        for (i, distance) in graph::near(tree, &at, reach, 4) {
            let n = &normals[i];
            let run = [middle[0] - local[i][0], middle[1] - local[i][1]];
            let rise = -(n.x * run[0] + n.y * run[1]) / n.z.max(0.1);
            let rise = rise.clamp(-STEEPEST * distance, STEEPEST * distance);
            let weight = 1.0 / (distance + 0.1 * pitch);
            sum += (local[i][2] + rise) * weight;
            total += weight;
        }
        if total > 0.0 && sum > 0.0 {
            tops.insert(key, sum / total);
        }
    }
    tops
}

/// Columns at the outline, and the height of the surface there, metres.
fn rim(tops: &BTreeMap<[i32; 2], f64>) -> Vec<([i32; 2], f64)> {
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
    let smooth = |(key, _): &([i32; 2], f64)| {
        let beside: Vec<f64> = outline
            .iter()
            .filter(|(k, _)| (k[0] - key[0]).abs() <= 2 && (k[1] - key[1]).abs() <= 2)
            .map(|(_, top)| *top)
            .collect();
        (
            *key,
            beside.iter().sum::<f64>() / beside.len().max(1) as f64,
        )
    };
    outline.iter().map(smooth).collect()
}

/// Height of the bottom of a column, metres.
fn rounded(key: [i32; 2], top: f64, rim: &[([i32; 2], f64)], pitch: f64) -> f64 {
    let nearest = rim
        .iter()
        .map(|(k, height)| ((k[0] - key[0]).pow(2) + (k[1] - key[1]).pow(2), height))
        .min_by_key(|(squared, _)| *squared);
    let Some((squared, height)) = nearest else {
        return 0.0;
    };
    let inside = f64::from(squared).sqrt() * pitch;
    let left = (height - inside).max(0.0);
    let round = height - (height * height - left * left).max(0.0).sqrt();
    let mirrored = (2.0 * height - top).max(0.0);
    round.min(mirrored)
}
