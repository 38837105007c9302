//! Points sorted into cubes, to find those within a radius.
//!
//! Unlike a search tree it accepts any number of coincident points, and returns points in a fixed order.

use nalgebra::Point3;
use std::collections::HashMap;

/// Points sorted by the cube they lie in.
pub(super) struct Cells {
    side: f64,
    order: Vec<u32>,
    cubes: HashMap<[i64; 3], (u32, u32)>,
}

impl Cells {
    /// Sorts `points` into cubes of the given side.
    pub(super) fn new(points: &[Point3<f64>], side: f64) -> Self {
        let mut keyed: Vec<([i64; 3], u32)> = (0u32..)
            .zip(points)
            .map(|(i, p)| (key(p, side), i))
            .collect();
        keyed.sort_unstable();
        let mut cubes = HashMap::new();
        let mut start = 0;
        for group in keyed.chunk_by(|a, b| a.0 == b.0) {
            let end = start + group.len() as u32;
            cubes.insert(group[0].0, (start, end));
            start = end;
        }
        Self {
            side,
            order: keyed.into_iter().map(|(_, i)| i).collect(),
            cubes,
        }
    }

    /// Calls `visit` with each point in the cubes that a ball of `radius` around `query` touches: all points within
    /// the radius, and some beyond it.
    pub(super) fn visit(&self, query: &Point3<f64>, radius: f64, mut visit: impl FnMut(usize)) {
        let low = key(&query.map(|x| x - radius), self.side);
        let high = key(&query.map(|x| x + radius), self.side);
        for z in low[2]..=high[2] {
            for y in low[1]..=high[1] {
                for x in low[0]..=high[0] {
                    if let Some(&(start, end)) = self.cubes.get(&[x, y, z]) {
                        for &i in &self.order[start as usize..end as usize] {
                            visit(i as usize);
                        }
                    }
                }
            }
        }
    }
}

fn key(p: &Point3<f64>, side: f64) -> [i64; 3] {
    [p.x, p.y, p.z].map(|x| (x / side).floor() as i64)
}
