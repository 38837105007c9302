//! Points in cells: one mean point for each cell, connected parts, and the neighbours of a point.
//!
//! ```text
//! cell of x       = ⌊x / size⌋ per coordinate
//! voxel           = mean of the points in a cell, and of their colours
//! part            = voxels that a chain of steps of at most `gap` connects
//! ```
//! Voxels are in the order of their first points: nothing depends on the order of a hash table.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

use nalgebra::{Point3, Vector3};

type Key = [i64; 3];
type Cells<T> = HashMap<Key, T, BuildHasherDefault<CellHasher>>;

/// Multiplies and rotates. The hash of the standard library resists keys chosen to collide, and is slower
/// therefore; here such keys would only cost time.
#[derive(Default)]
struct CellHasher(u64);

impl Hasher for CellHasher {
    /// A key comes as the bytes of its three numbers.
    fn write(&mut self, bytes: &[u8]) {
        let (words, rest) = bytes.as_chunks::<8>();
        for word in words {
            self.write_u64(u64::from_le_bytes(*word));
        }
        for &byte in rest {
            self.write_u64(u64::from(byte));
        }
    }

    fn write_u64(&mut self, value: u64) {
        self.0 = (self.0.rotate_left(23) ^ value).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    }

    fn write_usize(&mut self, value: usize) {
        self.write_u64(value as u64);
    }

    fn finish(&self) -> u64 {
        self.0 ^ (self.0 >> 32)
    }
}

fn key(point: &Point3<f64>, size: f64) -> Key {
    // Coordinates that are too large saturate: such points share a cell far away.
    (*point / size)
        .coords
        .map(|value| value.floor() as i64)
        .into()
}

/// One cell with its points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Voxel {
    /// Its index, in the order of the first points.
    pub(super) number: usize,
    pub(super) first: Point3<f64>,
    pub(super) point: Point3<f64>,
    pub(super) colour: [u8; 3],
    pub(super) count: usize,
}

/// The mean of the points in each cell of edge `size`, and the voxel index of each point. `colours` has as many
/// entries as `points`, or is `None`.
pub(super) fn voxels(
    points: &[Point3<f64>],
    colours: &[[u8; 3]],
    size: f64,
) -> (Vec<Voxel>, Vec<usize>) {
    #[derive(Clone, Copy, Default)]
    struct Sum {
        count: usize,
        offset: Vector3<f64>,
        colour: [usize; 3],
    }
    let mut indices: Cells<usize> = Cells::default();
    let mut sums: Vec<(Point3<f64>, Sum)> = Vec::new();
    let mut voxel_of = Vec::with_capacity(points.len());
    for (index, point) in points.iter().enumerate() {
        let at = *indices.entry(key(point, size)).or_insert(sums.len());
        if at == sums.len() {
            sums.push((*point, Sum::default()));
        }
        voxel_of.push(at);
        let (first, sum) = &mut sums[at];
        sum.count += 1;
        // Relative to the first point of the cell: exact for one point, and accurate for many.
        sum.offset += *point - *first;
        let colour = colours.get(index).copied().unwrap_or_default();
        for (sum, value) in sum.colour.iter_mut().zip(colour) {
            *sum += usize::from(value);
        }
    }
    let mean = |(number, (first, sum)): (usize, (Point3<f64>, Sum))| Voxel {
        number,
        first,
        point: first + sum.offset / sum.count as f64,
        colour: sum
            .colour
            .map(|value| ((value + sum.count / 2) / sum.count) as u8),
        count: sum.count,
    };
    (sums.into_iter().enumerate().map(mean).collect(), voxel_of)
}

/// Finds the points within a radius.
pub(super) struct Neighbours<'a> {
    points: &'a [Point3<f64>],
    radius: f64,
    cells: Cells<Vec<u32>>,
}

impl<'a> Neighbours<'a> {
    /// O(points).
    pub(super) fn new(points: &'a [Point3<f64>], radius: f64) -> Self {
        let mut cells: Cells<Vec<u32>> = Cells::default();
        for (index, point) in (0..).zip(points) {
            cells.entry(key(point, radius)).or_default().push(index);
        }
        Self {
            points,
            radius,
            cells,
        }
    }

    /// Indices of the points within the radius of `point`, in a fixed order.
    pub(super) fn of(&self, point: &Point3<f64>) -> impl Iterator<Item = usize> {
        let center = key(point, self.radius);
        let cell = move |step: i64| {
            let steps = [step % 3 - 1, step / 3 % 3 - 1, step / 9 - 1];
            let at: Key = std::array::from_fn(|axis| center[axis].saturating_add(steps[axis]));
            self.cells.get(&at).into_iter().flatten()
        };
        let point = *point;
        let near = move |index: &usize| (self.points[*index] - point).norm() <= self.radius;
        (0..27)
            .flat_map(cell)
            .map(|index| *index as usize)
            .filter(near)
    }
}

/// The part of each point, numbered by its first point: steps of at most `gap` connect.
pub(super) fn parts(points: &[Point3<f64>], gap: f64) -> Vec<usize> {
    let neighbours = Neighbours::new(points, gap);
    let mut part = vec![usize::MAX; points.len()];
    let mut open = Vec::new();
    for first in 0..points.len() {
        if part[first] != usize::MAX {
            continue;
        }
        part[first] = first;
        open.push(first);
        while let Some(index) = open.pop() {
            for other in neighbours.of(&points[index]) {
                if part[other] == usize::MAX {
                    part[other] = first;
                    open.push(other);
                }
            }
        }
    }
    part
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `count` points in a cube, crowded enough for several parts.
    fn cloud(seed: u64, count: u64) -> Vec<Point3<f64>> {
        let mut state = seed;
        let mut next = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as f64 / f64::from(1_u32 << 31) - 0.5
        };
        (0..count)
            .map(|_| Point3::new(next(), next(), next()))
            .collect()
    }

    #[test]
    fn parts_are_those_of_all_pairs() {
        for seed in 0..20 {
            let points = cloud(seed, 150);
            let gap = 0.13;
            // Slow: the smaller of two numbers spreads over every short pair until nothing changes.
            let mut slow: Vec<usize> = (0..points.len()).collect();
            let mut changed = true;
            while changed {
                changed = false;
                for i in 0..points.len() {
                    for j in 0..points.len() {
                        if (points[i] - points[j]).norm() <= gap && slow[j] > slow[i] {
                            slow[j] = slow[i];
                            changed = true;
                        }
                    }
                }
            }
            assert_eq!(parts(&points, gap), slow);
            let different = slow.iter().collect::<std::collections::HashSet<_>>().len();
            assert!(different > 3 && different < 140, "{different}");
        }
    }

    #[test]
    fn neighbours_are_those_of_all_points() {
        let points = cloud(7, 300);
        for radius in [0.01, 0.2, 2.0] {
            let neighbours = Neighbours::new(&points, radius);
            for point in &points {
                let mut found: Vec<_> = neighbours.of(point).collect();
                found.sort_unstable();
                let slow: Vec<_> = (0..points.len())
                    .filter(|&i| (points[i] - point).norm() <= radius)
                    .collect();
                assert_eq!(found, slow);
            }
        }
    }

    #[test]
    fn voxels_hold_every_point_once() {
        let points = cloud(3, 1000);
        let colours = vec![[10, 20, 255]; 1000];
        let (found, voxel_of) = voxels(&points, &colours, 0.1);
        assert_eq!(found.iter().map(|voxel| voxel.count).sum::<usize>(), 1000);
        for voxel in &found {
            assert_eq!(voxel.colour, [10, 20, 255]);
            let inside: Vec<_> = points
                .iter()
                .filter(|point| key(point, 0.1) == key(&voxel.point, 0.1))
                .collect();
            assert_eq!(inside.len(), voxel.count);
            assert_eq!(*inside[0], voxel.first);
            let named = (0..1000).filter(|&point| found[voxel_of[point]] == *voxel);
            assert!(named.map(|point| &points[point]).eq(inside.iter().copied()));
            let mean = inside
                .iter()
                .map(|point| point.coords)
                .sum::<Vector3<f64>>()
                / inside.len() as f64;
            assert!((mean - voxel.point.coords).norm() < 1e-15);
        }
    }
}
