//! The nearest points of all points of a box at once.
//!
//! ```text
//! radius     guessed: from the previous point, for the first one from the size of the box; widened if it held too few points
//! search     all points within the radius, of those copied around the box, sorted by distance
//! ```
//!
//! The points of a box have most of their neighbours in common, and a good guess leaves few points to sort. Small boxes find and copy their
//! surroundings more often, large ones look at more points for each. The guess has no effect on the result.
//!
//! On the grid of a camera's pixels many points are equally far. If those with the lower index were taken, every neighbourhood would lean to the upper rows
//! of the image, and the normals of a curved surface with it. So all points that are as far as the last neighbour are neighbours too: a neighbourhood
//! of a symmetric cloud is symmetric, and does not depend on the order of the points. The number is limited only because points may coincide.

use gpwrm::Neighbour;
use nalgebra::Point3;

use super::{Boxes, Corners, EMPTY, LARGEST, aside};
use crate::each::each;

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

impl Boxes {
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
/// The points of the boxes nearby are copied side by side once, so that each search runs through plain arrays. Sorting takes a large part of the time:
/// a key of 64 bits is sorted faster than distance, rank and index together; where such keys agree the rest decides.
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
