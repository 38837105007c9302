//! The target cloud with what is known of the neighbourhood of its points. Kept from frame to frame while the cloud stays the same.
//!
//! ```text
//! match      q of the last iteration, distance d = |p − q|
//! search     the neighbours r of q, nearest first, while |q − r| ≤ d + best;  best: distance of the nearest so far
//! ```
//!
//! No point farther from `q` can be nearer to `p`. If the known neighbours of `q` end before that, the search goes on from the best one, or in all boxes.

use gpwrm::Neighbour;
use nalgebra::{Point3, UnitVector3};

use crate::boxes::{Boxes, Lists, Search, TOGETHER, nearest_of, rank};
use crate::cloud::{Cloud, denoised, is_boundary};
use crate::each::each;
use crate::options::Options;
use crate::traits::Probe;

/// Number of neighbours that decide whether a point lies on the boundary.
const BOUNDARY_NEIGHBOURS: usize = 12;
/// Most moves from a match to a better one before all boxes are searched.
const MOVES: usize = 6;
/// Rounding of squared distances, relative.
const ROUNDING: f64 = 1e-12;
/// Largest coordinate, in m: its square is far from overflow.
const LARGEST: f64 = 1e60;

/// What is computed from the neighbourhood of a target point.
#[derive(Clone, Copy)]
pub(crate) struct Place {
    /// The point with reduced noise across the surface.
    pub point: Point3<f64>,
    /// Whether it is a boundary point.
    pub on_boundary: bool,
}

/// What is known of the points of a box; empty before one of them is matched.
#[derive(Clone, Default)]
struct Around {
    places: Vec<Place>,
    /// The neighbours of each, the point itself among them.
    near: Lists,
}

/// A cloud, prepared for the search of nearest points.
pub struct Target {
    points: Vec<Point3<f64>>,
    normals: Vec<UnitVector3<f64>>,
    boxes: Boxes,
    /// By box.
    around: Vec<Around>,
    /// The last match of each source point.
    matched: Vec<Option<u32>>,
    boundary_angle: f64,
    denoise: usize,
}

impl std::fmt::Debug for Target {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Target")
            .field("points", &self.points.len())
            .finish_non_exhaustive()
    }
}

impl Target {
    pub(crate) fn new(cloud: &Cloud, options: &Options) -> Self {
        let boxes = Boxes::new(cloud.points);
        Self {
            points: cloud.points.to_vec(),
            normals: cloud.normals.to_vec(),
            around: vec![Around::default(); boxes.len()],
            boxes,
            matched: Vec::new(),
            boundary_angle: options.boundary_angle,
            denoise: options.denoise,
        }
    }

    /// Whether this was made from the same cloud.
    pub(crate) fn is_of(&self, cloud: &Cloud) -> bool {
        self.points == cloud.points && self.normals == cloud.normals
    }

    /// Positions, in m.
    pub fn points(&self) -> &[Point3<f64>] {
        &self.points
    }

    /// Unit normals, one per point.
    pub fn normals(&self) -> &[UnitVector3<f64>] {
        &self.normals
    }

    /// Index and squared distance (m²) of the point nearest to `p`, of equally near ones always the same; `None` if `p` is not finite. `O(log n)`.
    pub fn nearest(&self, p: &Point3<f64>) -> Option<(usize, f64)> {
        let hit = self.boxes.nearest(p).filter(|_| is_sound(p))?;
        Some((hit.index, hit.squared))
    }

    /// The same for a source point, faster from its second match on, because it starts at the last one.
    pub fn nearest_to(&self, probe: &Probe) -> Option<(usize, f64)> {
        let last = self.matched.get(probe.index).copied().flatten();
        last.and_then(|q| self.near_match(&probe.position, q as usize))
            .or_else(|| self.nearest(&probe.position))
    }

    /// Indices and squared distances (m²) of the `count` nearest, nearest first. `O(log n + count log count)` on surfaces sampled evenly.
    pub fn nearest_n(&self, p: &Point3<f64>, count: usize) -> Vec<(usize, f64)> {
        if !is_sound(p) {
            return Vec::new();
        }
        let hits = self.boxes.nearest_n(p, count.min(self.points.len()));
        hits.iter().map(|hit| (hit.index, hit.squared)).collect()
    }

    /// The nearest point, if the neighbours of `q` and of better matches show that it is.
    fn near_match(&self, p: &Point3<f64>, mut q: usize) -> Option<(usize, f64)> {
        let squared = |i: usize| {
            let d = self.points[i] - p;
            d.x * d.x + d.y * d.y + d.z * d.z
        };
        let order = |i: usize| (squared(i), rank(i as u32), i);
        let mut best = order(q);
        for _ in 0..MOVES {
            let (near, from) = (self.neighbours(q), best.0.sqrt());
            // No neighbour at this distance from `q` or beyond is nearer to `p`.
            let beyond = |least: f64| (from + least.sqrt()).powi(2) * (1.0 + ROUNDING);
            let mut limit = beyond(best.0);
            for n in near {
                if n.squared > limit {
                    return Some((best.2, best.0));
                }
                let candidate = order(n.index);
                if candidate < best {
                    best = candidate;
                    limit = beyond(best.0);
                }
            }
            if best.2 == q || near.is_empty() {
                return None;
            }
            q = best.2;
        }
        None
    }

    /// The neighbours of a point, nearest first, as far as they are known.
    fn neighbours(&self, index: usize) -> &[Neighbour] {
        let (of, slot) = self.boxes.place(index);
        self.around[of].near.get(slot)
    }

    /// Number of neighbours that are looked at, the point itself included.
    fn count(&self) -> usize {
        (BOUNDARY_NEIGHBOURS.max(self.denoise) + 1).min(self.points.len())
    }

    /// Prepares [`Self::place`] of the matches `hits`, one for each source point, and remembers them.
    pub(crate) fn prepare(&mut self, hits: impl Iterator<Item = Option<usize>>) {
        let mut wanted = vec![false; self.boxes.len()];
        for (at, hit) in hits.enumerate() {
            if at == self.matched.len() {
                self.matched.push(None);
            }
            if let Some(q) = hit {
                self.matched[at] = Some(q as u32);
                let of = self.boxes.place(q).0;
                wanted[of] = self.around[of].places.is_empty();
            }
        }
        let wanted: Vec<usize> = (0..wanted.len()).filter(|&of| wanted[of]).collect();
        let groups: Vec<&[usize]> = wanted.chunks(TOGETHER).collect();
        let found = each(groups.len(), |k| {
            let mut search = self.boxes.search();
            let look = |&of: &usize| self.look_around(&mut search, of);
            groups[k].iter().map(look).collect::<Vec<Around>>()
        });
        for (of, around) in wanted.iter().zip(found.into_iter().flatten()) {
            self.around[*of] = around;
        }
    }

    /// The neighbourhood of a matched point; see [`Self::prepare`].
    pub(crate) fn place(&self, index: usize) -> Option<Place> {
        let (of, slot) = self.boxes.place(index);
        self.around[of].places.get(slot).copied()
    }

    fn look_around(&self, search: &mut Search, of: usize) -> Around {
        let cloud = Cloud {
            points: &self.points,
            normals: &self.normals,
        };
        let near = self.boxes.nearest_of_box(search, of, self.count());
        let place = |(slot, &i): (usize, &u32)| {
            let first = |count: usize| nearest_of(near.get(slot), count + 1);
            let i = i as usize;
            Place {
                point: denoised(&cloud, i, first(self.denoise)),
                on_boundary: is_boundary(
                    &cloud,
                    first(BOUNDARY_NEIGHBOURS),
                    i,
                    self.boundary_angle,
                ),
            }
        };
        let own = self.boxes.members(of).iter().enumerate();
        let places = own.map(place).collect();
        Around { places, near }
    }
}

fn is_sound(p: &Point3<f64>) -> bool {
    p.iter().all(|c| c.abs() <= LARGEST)
}
