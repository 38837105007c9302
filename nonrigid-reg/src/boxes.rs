//! Nearest points within a cloud: the points sorted into small boxes, each searched for all of its points at once.
//!
//! ```text
//! boxes      halves of the cloud along the longest side of its bounding box, until a box has at most 16 points
//! radius     guessed: from the previous point, for the first one from the size of the box; widened if it held too few points
//! search     all points within the radius, of those copied around the box, sorted by distance
//! ```
//!
//! The points of a box have most of their neighbours in common, and a good guess leaves few points to sort. Boxes of 8 points find and copy the surroundings
//! twice as often, boxes of 24 look at more points for each; both are slower. The guess has no effect on the result: of
//! points at the same distance the one with the lower [`rank`] comes first.
//!
//! On the grid of a camera's pixels many points are equally far. If those with the lower index were taken, every neighbourhood would lean to the upper rows
//! of the image, and the normals of a curved surface with it. So all points that are as far as the last neighbour are neighbours too: a neighbourhood
//! of a symmetric cloud is symmetric, and does not depend on the order of the points. The number is limited only because points may coincide.

use gpwrm::Neighbour;
use nalgebra::Point3;

use crate::each::each;

/// Largest number of points in a box.
const LARGEST: usize = 16;

/// Number of boxes that one thread searches in a row.
pub(crate) const TOGETHER: usize = 32;

/// Squared guess of the next radius, relative to the squared radius that was needed for the last point.
const WIDER: f64 = 1.4;
/// Squared distance up to which points are copied, relative to the first guess that needs it: the other points of the box may need a little more.
const REACHES: f64 = 1.2;
/// Largest factor of the squared radius after a guess that held too few points, and number of such guesses before all points are taken.
const WIDENED: f64 = 2.5;
const GUESSES: usize = 8;

/// Most neighbours, relative to the number asked for, if many are as far as the last.
const MOST: usize = 2;

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

    /// The `count` nearest points, nearest first; `count` is at most the number of points.
    pub fn nearest_n(&self, p: &Point3<f64>, count: usize) -> Vec<Neighbour> {
        let Some(first) = self.nearest(p) else {
            return Vec::new();
        };
        let of = self.place(first.index).0;
        let share = count as f64 / self.members(of).len() as f64;
        let around = guess(&self.tree[of + self.len() - 1], share);
        let p = [p.x, p.y, p.z];
        let mut search = Search::new(self);
        search.around([p; 2]);
        search.nearest(&p, count, WIDER * (first.squared + around));
        search.found(count).collect()
    }

    /// A search for [`Self::nearest_of_box`], whose buffers serve one box after the other.
    pub fn search(&self) -> Search<'_> {
        Search::new(self)
    }

    /// The `count` nearest points of every point in a box, itself among them, nearest first, and those as far as the last; in the order of
    /// [`Self::members`]. `count` is at most the number of points.
    pub fn nearest_of_box(&self, search: &mut Search, of: usize, count: usize) -> Lists {
        let (start, end) = (self.starts[of], self.starts[of + 1]);
        let corners = self.tree[of + self.len() - 1];
        search.around(corners);
        let mut squared = search
            .last
            .unwrap_or_else(|| guess(&corners, count as f64 / (end - start).max(1) as f64));
        let mut found = Lists::with_capacity(end - start, count);
        for at in start..end {
            squared = WIDER * search.nearest(&self.coordinates(at), count, squared);
            found.push(search.found(MOST * count), count);
        }
        search.last = Some(squared).filter(|s| *s > 0.0 && s.is_finite());
        found
    }

    /// `f` of every point of the cloud and its `count` nearest, as by [`Self::nearest_of_box`].
    pub fn of_all<T: Copy + Send>(
        &self,
        count: usize,
        f: impl Fn(usize, &[Neighbour]) -> T + Sync + Send,
    ) -> Vec<T> {
        let count = count.min(self.indices.len());
        if count == 0 {
            return Vec::new();
        }
        let found = each(self.len().div_ceil(TOGETHER), |k| {
            let mut search = self.search();
            let mut values = Vec::with_capacity(TOGETHER * LARGEST);
            for of in TOGETHER * k..(TOGETHER * (k + 1)).min(self.len()) {
                let near = self.nearest_of_box(&mut search, of, count);
                let own = self.members(of).iter().enumerate();
                values.extend(own.map(|(slot, &i)| f(i as usize, near.get(slot))));
            }
            values
        });
        let found = found.concat();
        self.places.iter().map(|&at| found[at as usize]).collect()
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

/// Neighbours of a few points, one list after another.
#[derive(Clone, Default)]
pub(crate) struct Lists {
    near: Vec<Neighbour>,
    ends: Vec<usize>,
}

impl Lists {
    fn with_capacity(lists: usize, count: usize) -> Self {
        Self {
            near: Vec::with_capacity(lists * count),
            ends: Vec::with_capacity(lists),
        }
    }

    /// Adds the first `count` of a sorted list and those as far as the last of them.
    fn push(&mut self, sorted: impl Iterator<Item = Neighbour>, count: usize) {
        let from = self.near.len();
        let mut last = f64::INFINITY;
        for n in sorted {
            let taken = self.near.len() - from;
            if taken >= count && n.squared > last {
                break;
            }
            last = n.squared;
            self.near.push(n);
        }
        self.ends.push(self.near.len());
    }

    /// Neighbours of a point by its position in the box; none if they are not known.
    pub fn get(&self, slot: usize) -> &[Neighbour] {
        let Some(&end) = self.ends.get(slot) else {
            return &[];
        };
        let start = if slot == 0 { 0 } else { self.ends[slot - 1] };
        &self.near[start..end]
    }
}

/// The first `count` of neighbours, nearest first, and those as far as the last of them.
pub(crate) fn nearest_of(near: &[Neighbour], count: usize) -> &[Neighbour] {
    let last = count
        .min(near.len())
        .checked_sub(1)
        .map(|at| near[at].squared);
    last.map_or(&[], |last| {
        &near[..near.partition_point(|n| n.squared <= last)]
    })
}

/// The search around a few points.
///
/// The points of the boxes nearby are copied side by side once, so that each search runs through plain arrays. Sorting takes a large part of the time;
/// a key of 64 bits is sorted several times as fast as distance, rank and index together, and where such keys agree the rest decides.
pub(crate) struct Search<'a> {
    boxes: &'a Boxes,
    /// Bounding box of the points, and the squared distance around it up to which points were copied.
    corners: Corners,
    reach: f64,
    near: Vec<usize>,
    /// Coordinates of the copied points, and their places.
    axes: [Vec<f64>; 3],
    at: Vec<u32>,
    /// Squared distance of each from the point of the last search.
    squares: Vec<f64>,
    /// Those within the radius: see [`Self::low_bits`].
    keys: Vec<u64>,
    /// The guess for the next box, which is nearly always beside the last.
    last: Option<f64>,
}

impl<'a> Search<'a> {
    fn new(boxes: &'a Boxes) -> Self {
        Self {
            boxes,
            corners: EMPTY,
            reach: -1.0,
            near: Vec::new(),
            axes: Default::default(),
            at: Vec::new(),
            squares: Vec::new(),
            keys: Vec::new(),
            last: None,
        }
    }

    /// Turns to points within `corners`.
    fn around(&mut self, corners: Corners) {
        self.corners = corners;
        self.reach = -1.0;
    }

    /// Finds the `count` nearest points of `p`, sorted, from a guess of the squared distance of the last; returns the true one.
    fn nearest(&mut self, p: &[f64; 3], count: usize, mut squared: f64) -> f64 {
        let mut guesses = 1;
        loop {
            let found = self.take(p, squared);
            if found >= count || squared == f64::INFINITY {
                break;
            }
            guesses += 1;
            // On a surface the number of points is in proportion to the squared radius.
            squared *= (WIDER * count as f64 / found.max(1) as f64).min(WIDENED);
            if guesses > GUESSES || squared <= 0.0 {
                squared = f64::INFINITY;
            }
        }
        self.sort(MOST * count);
        self.found(count).last().map_or(0.0, |last| last.squared)
    }

    /// Collects the points within a squared distance of `p`; returns their number.
    fn take(&mut self, p: &[f64; 3], squared: f64) -> usize {
        if squared > self.reach {
            self.reach = REACHES * squared;
            self.copy();
        }
        let [x, y, z] = &self.axes;
        let square = |((x, y), z): ((&f64, &f64), &f64)| {
            let (x, y, z) = (x - p[0], y - p[1], z - p[2]);
            x * x + y * y + z * z
        };
        self.squares.clear();
        self.squares.extend(x.iter().zip(y).zip(z).map(square));
        self.keys.resize(self.at.len(), 0);
        let low = self.low_bits();
        let mut count = 0;
        for (slot, d) in self.squares.iter().enumerate() {
            self.keys[count] = d.to_bits() & !low | slot as u64;
            // Without a branch, which would be predicted wrong every other time.
            count += usize::from(*d <= squared);
        }
        self.keys.truncate(count);
        count
    }

    /// Copies the points within reach.
    fn copy(&mut self) {
        let boxes = self.boxes;
        boxes.within(&self.corners, self.reach, &mut self.near);
        self.axes.iter_mut().for_each(Vec::clear);
        self.at.clear();
        for &of in &self.near {
            for at in boxes.starts[of]..boxes.starts[of + 1] {
                let p = boxes.coordinates(at);
                if aside(&self.corners, &p) <= self.reach {
                    for (axis, c) in self.axes.iter_mut().zip(p) {
                        axis.push(c);
                    }
                    self.at.push(at as u32);
                }
            }
        }
    }

    /// The bits of a key that hold the position among the copied points; the others are the leading bits of the squared distance, which have the same order.
    fn low_bits(&self) -> u64 {
        (self.at.len() as u64 + 1).next_power_of_two() - 1
    }

    /// Sorts the points within the radius; of more than twice as many, only the first `most` are kept.
    fn sort(&mut self, most: usize) {
        let low = self.low_bits();
        let (squares, at, boxes) = (&self.squares, &self.at, self.boxes);
        let order = |key: &u64| {
            let slot = (key & low) as usize;
            let at = at[slot] as usize;
            (squares[slot].to_bits(), boxes.ranks[at], boxes.indices[at])
        };
        if self.keys.len() > 2 * most && most > 0 {
            // Many points in one place, perhaps, of which all keys agree.
            self.keys.select_nth_unstable_by_key(most - 1, order);
            self.keys.truncate(most);
        }
        self.keys.sort_unstable();
        for equal in self.keys.chunk_by_mut(|a, b| a & !low == b & !low) {
            if equal.len() > 1 {
                equal.sort_unstable_by_key(order);
            }
        }
    }

    /// The first of the sorted points.
    fn found(&self, count: usize) -> impl Iterator<Item = Neighbour> + '_ {
        let low = self.low_bits();
        self.keys.iter().take(count).map(move |key| {
            let slot = (key & low) as usize;
            Neighbour {
                index: self.boxes.indices[self.at[slot] as usize] as usize,
                squared: self.squares[slot],
            }
        })
    }
}

/// Squared radius of a disc that has `share` times as many points as a box, on a surface or a line through it.
fn guess([low, high]: &Corners, share: f64) -> f64 {
    let mut sides = [high[0] - low[0], high[1] - low[1], high[2] - low[2]];
    sides.sort_by(f64::total_cmp);
    let disc = sides[2] * sides[1] * share;
    let line = 0.5 * sides[2] * share;
    disc.max(0.25 * line * line)
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
