//! A cloud sorted into small boxes, for the nearest points within it.
//!
//! ```text
//! boxes      halves of the cloud along the longest side of its bounding box, until a box has at most 16 points
//! nearest    the boxes of a complete binary tree, nearer half first, until no box left is nearer than the best point
//! ```
//! Many nearest points, of all points of a box at once, are in [`search`]. Of points at the same distance the one with the lower [`rank`] comes first.

use gpwrm::Neighbour;
use nalgebra::Point3;

mod search;

pub(crate) use search::{Lists, Search, TOGETHER, nearest_of};

/// Largest number of points in a box.
const LARGEST: usize = 16;

/// Order of points at the same distance: the index, scrambled one to one (the last steps of MurmurHash3, A. Appleby).
pub(crate) fn rank(index: u32) -> u32 {
    let mut h = index;
    h = (h ^ (h >> 16)).wrapping_mul(0x85eb_ca6b);
    h = (h ^ (h >> 13)).wrapping_mul(0xc2b2_ae35);
    h ^ (h >> 16)
}

/// A bounding box: lower and upper corner.
type Corners = [[f64; 3]; 2];

const EMPTY: Corners = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];

/// The points of a cloud, box by box.
pub(crate) struct Boxes {
    /// Coordinates in the order of the boxes, one array for each axis.
    axes: [Vec<f64>; 3],
    /// Index of each of these points in the cloud, and its rank.
    indices: Vec<u32>,
    ranks: Vec<u32>,
    /// Place of each point of the cloud in the order of the boxes.
    places: Vec<u32>,
    /// Bounding boxes as a complete binary tree: the halves of box `j` are `2j + 1` and `2j + 2`, the last level are the boxes themselves.
    tree: Vec<Corners>,
    /// First place of each box, and one past the last.
    starts: Vec<usize>,
}

impl Boxes {
    pub fn new(points: &[Point3<f64>]) -> Self {
        let mut count = 1;
        while points.len() > LARGEST * count {
            count *= 2;
        }
        let mut boxes = Self {
            axes: Default::default(),
            indices: (0..points.len() as u32).collect(),
            ranks: vec![],
            places: vec![0; points.len()],
            tree: vec![EMPTY; 2 * count - 1],
            starts: (0..=count).map(|b| points.len() * b / count).collect(),
        };
        let mut indices = std::mem::take(&mut boxes.indices);
        boxes.split(points, &mut indices, 0, 0..count);
        boxes.ranks = indices.iter().map(|&i| rank(i)).collect();
        boxes.indices = indices;
        for (place, &i) in boxes.indices.iter().enumerate() {
            boxes.places[i as usize] = place as u32;
        }
        boxes.axes = [0, 1, 2].map(|axis| {
            let at = boxes.indices.iter().map(|&i| points[i as usize][axis]);
            at.collect()
        });
        boxes
    }

    /// Distributes points over a range of boxes, those of node `j` of the tree.
    fn split(
        &mut self,
        points: &[Point3<f64>],
        indices: &mut [u32],
        j: usize,
        range: std::ops::Range<usize>,
    ) {
        let [mut low, mut high] = EMPTY;
        for &i in &*indices {
            let p = &points[i as usize];
            for axis in 0..3 {
                low[axis] = low[axis].min(p[axis]);
                high[axis] = high[axis].max(p[axis]);
            }
        }
        self.tree[j] = [low, high];
        if range.len() == 1 {
            return;
        }
        let sides = [0, 1, 2].map(|axis| high[axis] - low[axis]);
        let longest = (1..3).fold(0, |a, b| if sides[b] > sides[a] { b } else { a });
        let middle = range.start + range.len() / 2;
        let half = self.starts[middle] - self.starts[range.start];
        if half < indices.len() {
            let at = |i: &u32| points[*i as usize][longest];
            indices.select_nth_unstable_by(half, |a, b| at(a).total_cmp(&at(b)).then(a.cmp(b)));
        }
        let (first, second) = indices.split_at_mut(half);
        self.split(points, first, 2 * j + 1, range.start..middle);
        self.split(points, second, 2 * j + 2, middle..range.end);
    }

    /// Number of boxes.
    pub fn len(&self) -> usize {
        self.starts.len() - 1
    }

    /// Indices of the points in a box.
    pub fn members(&self, of: usize) -> &[u32] {
        &self.indices[self.starts[of]..self.starts[of + 1]]
    }

    /// The box of a point, and the position of the point in it.
    pub fn place(&self, index: usize) -> (usize, usize) {
        let place = self.places[index] as usize;
        // The last box that starts at or before the place, by the formula of the starts.
        let of = ((place + 1) * self.len() - 1) / self.places.len();
        (of, place - self.starts[of])
    }

    /// The nearest point and its squared distance; `None` only without points, or if no distance is finite.
    pub fn nearest(&self, p: &Point3<f64>) -> Option<Neighbour> {
        let p = [p.x, p.y, p.z];
        let mut best = (f64::INFINITY, u32::MAX, u32::MAX);
        // A complete tree over fewer than 2³² points: at most one node of each level waits.
        let mut waiting = [(0_usize, 0.0_f64); 40];
        let mut count = 1;
        while count > 0 {
            count -= 1;
            let (mut j, beyond) = waiting[count];
            if beyond > best.0 {
                continue;
            }
            while 2 * j + 1 < self.tree.len() {
                let a = (2 * j + 1, aside(&self.tree[2 * j + 1], &p));
                let b = (2 * j + 2, aside(&self.tree[2 * j + 2], &p));
                let (near, far) = if b.1 < a.1 { (b, a) } else { (a, b) };
                waiting[count] = far;
                count += 1;
                j = near.0;
            }
            let of = j + 1 - self.len();
            for at in self.starts[of]..self.starts[of + 1] {
                let candidate = (self.squared(at, &p), self.ranks[at], self.indices[at]);
                if candidate < best {
                    best = candidate;
                }
            }
        }
        best.0.is_finite().then(|| neighbour(best))
    }

    /// Collects the boxes within a squared distance of `corners`.
    fn within(&self, corners: &Corners, squared: f64, found: &mut Vec<usize>) {
        found.clear();
        let mut waiting = vec![0];
        while let Some(j) = waiting.pop() {
            if apart(&self.tree[j], corners) > squared {
                continue;
            }
            if 2 * j + 1 < self.tree.len() {
                waiting.extend([2 * j + 2, 2 * j + 1]);
            } else {
                found.push(j + 1 - self.len());
            }
        }
    }

    fn coordinates(&self, at: usize) -> [f64; 3] {
        [self.axes[0][at], self.axes[1][at], self.axes[2][at]]
    }

    fn squared(&self, at: usize, p: &[f64; 3]) -> f64 {
        let (x, y, z) = (
            self.axes[0][at] - p[0],
            self.axes[1][at] - p[1],
            self.axes[2][at] - p[2],
        );
        x * x + y * y + z * z
    }
}

fn neighbour((squared, _, index): (f64, u32, u32)) -> Neighbour {
    Neighbour {
        index: index as usize,
        squared,
    }
}

/// Squared distance of a point from a bounding box.
fn aside(corners: &Corners, p: &[f64; 3]) -> f64 {
    apart(corners, &[*p; 2])
}

/// Squared distance of two bounding boxes.
fn apart(a: &Corners, b: &Corners) -> f64 {
    let gap = |axis: usize| {
        larger(
            larger(a[0][axis] - b[1][axis], b[0][axis] - a[1][axis]),
            0.0,
        )
    };
    let (x, y, z) = (gap(0), gap(1), gap(2));
    x * x + y * y + z * z
}

/// Without the case of NaN, which there is not: one instruction.
fn larger(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn by_looking_at_all(points: &[Point3<f64>], p: &Point3<f64>, count: usize) -> Vec<usize> {
        let squared = |i: &usize| {
            let d = points[*i] - p;
            d.x * d.x + d.y * d.y + d.z * d.z
        };
        let mut all: Vec<usize> = (0..points.len()).collect();
        let order = |i: &usize| rank(*i as u32);
        all.sort_by(|a, b| {
            squared(a)
                .total_cmp(&squared(b))
                .then(order(a).cmp(&order(b)))
        });
        all.truncate(count);
        all
    }

    /// Also those as far as the last, up to twice as many.
    fn with_equally_far(points: &[Point3<f64>], p: &Point3<f64>, count: usize) -> Vec<usize> {
        let mut all = by_looking_at_all(points, p, 2 * count);
        let squared = |i: usize| (points[i] - p).norm_squared();
        let last = squared(all[count - 1]);
        all.retain(|&i| squared(i) <= last);
        all
    }

    proptest! {
        /// Coordinates of few values, so that many points coincide and many distances are equal.
        #[test]
        fn as_by_looking_at_all_points(
            raw in prop::collection::vec(prop::array::uniform3(0..12_i32), 1..300),
            coarse in 1..12_i32, asked in 1..20_usize, from in prop::array::uniform3(-3.0..15.0),
        ) {
            let points: Vec<Point3<f64>> = raw.iter().map(|p| p.map(|c| f64::from(c / coarse)).into()).collect();
            let (boxes, count) = (Boxes::new(&points), asked.min(points.len()));
            let mut seen = 0;
            let mut search = boxes.search();
            for of in 0..boxes.len() {
                let found = boxes.nearest_of_box(&mut search, of, count);
                for (slot, &i) in boxes.members(of).iter().enumerate() {
                    prop_assert_eq!(boxes.place(i as usize), (of, slot));
                    let near: Vec<usize> = found.get(slot).iter().map(|n| n.index).collect();
                    prop_assert_eq!(near, with_equally_far(&points, &points[i as usize], count));
                    seen += 1;
                }
            }
            prop_assert_eq!(seen, points.len());
            let from = Point3::from(from);
            let near: Vec<usize> = boxes.nearest_n(&from, count).iter().map(|n| n.index).collect();
            prop_assert_eq!(near, by_looking_at_all(&points, &from, count));
            prop_assert_eq!(boxes.nearest(&from).map(|n| n.index), by_looking_at_all(&points, &from, 1).first().copied());
        }
    }
}
