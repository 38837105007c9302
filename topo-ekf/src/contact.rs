//! Self-contact: which vertex must stay on which side of which triangle.
//!
//! ```text
//! n_T · (x_v − Σ_k b_k x_k) ≥ δ        n_T: unit normal of the triangle, on the side v was on in the last frame
//!                                      b: where v projects into it
//! ```
//!
//! A vertex is watched against triangles that are far along the surface (none of their corners within two rings of it) and near in space.
//! The side is that of the last live positions, which were feasible: this is what tells a vertex that has just passed through a
//! sheet from one that belongs there.

use std::collections::BTreeSet;

use nalgebra::{Point3, Vector3};
use parry3d_f64::bounding_volume::Aabb;
use parry3d_f64::math::Vector as Corner;
use parry3d_f64::partitioning::{Bvh, BvhBuildStrategy};

use crate::dual::Row;

/// How far outside a triangle, in barycentric units, a projection still counts: neighbouring triangles then overlap and
/// a vertex over their common edge is not missed by both.
const OVERLAP: f64 = 0.1;

/// The triangles with, for every vertex, the vertices within two rings.
#[derive(Clone, Debug, Default)]
pub(crate) struct Surface {
    triangles: Vec<[u32; 3]>,
    corners: Vec<u32>,
    starts: Vec<usize>,
    near: Vec<u32>,
}

impl Surface {
    /// The same surface if the triangles are the same, a new one otherwise.
    pub fn renewed(self, triangles: &[[u32; 3]], vertices: usize) -> Self {
        if self.triangles == triangles && self.starts.len() == vertices + 1 {
            self
        } else {
            Self::new(triangles, vertices)
        }
    }

    fn new(triangles: &[[u32; 3]], vertices: usize) -> Self {
        let mut ring: Vec<Vec<u32>> = vec![vec![]; vertices];
        for t in triangles {
            for a in 0..3 {
                ring[t[a] as usize].extend([t[(a + 1) % 3], t[(a + 2) % 3]]);
            }
        }
        for r in &mut ring {
            r.sort_unstable();
            r.dedup();
        }
        let (mut starts, mut near) = (vec![0], vec![]);
        for (v, r) in ring.iter().enumerate() {
            let first = near.len();
            near.push(v as u32);
            near.extend(r);
            near.extend(r.iter().flat_map(|&n| &ring[n as usize]));
            near[first..].sort_unstable();
            // Deduplicated in place: the tail beyond `first` belongs to this vertex alone.
            let mut tail = near.split_off(first);
            tail.dedup();
            near.extend(tail);
            starts.push(near.len());
        }
        let corners = triangles
            .iter()
            .flatten()
            .copied()
            .collect::<BTreeSet<_>>()
            .into_iter()
            .collect();
        Self {
            triangles: triangles.to_vec(),
            corners,
            starts,
            near,
        }
    }

    fn adjoins(&self, vertex: u32, triangle: &[u32; 3]) -> bool {
        let near = &self.near[self.starts[vertex as usize]..self.starts[vertex as usize + 1]];
        triangle.iter().any(|k| near.binary_search(k).is_ok())
    }

    /// Rows for every vertex near a far triangle of `now`, with sides from `before`; at most one row per vertex, that of the
    /// deepest pass.
    pub fn watch(
        &self,
        before: &[Point3<f64>],
        now: &[Point3<f64>],
        separation: f64,
        reach: f64,
    ) -> Vec<Row> {
        let boxes = self.triangles.iter().map(|t| {
            let corner =
                |k: u32| Corner::new(now[k as usize].x, now[k as usize].y, now[k as usize].z);
            Aabb::from_points(t.map(corner))
        });
        let tree = Bvh::from_iter(BvhBuildStrategy::Binned, boxes.enumerate());
        let reach = reach.max(2.0 * separation);
        self.corners
            .iter()
            .filter_map(|&v| {
                let p = &now[v as usize];
                let (low, high) = (p.coords.add_scalar(-reach), p.coords.add_scalar(reach));
                let around = Aabb::new(
                    Corner::new(low.x, low.y, low.z),
                    Corner::new(high.x, high.y, high.z),
                );
                tree.intersect_aabb(&around)
                    .filter_map(|t| {
                        self.pair(
                            v,
                            &self.triangles[t as usize],
                            before,
                            now,
                            separation,
                            reach,
                        )
                    })
                    // Lower triangles first would depend on the tree's order: ties are broken by the row itself.
                    .max_by(|(a, r), (b, s)| {
                        a.total_cmp(b).then_with(|| s.terms[1].0.cmp(&r.terms[1].0))
                    })
                    .map(|(_, row)| row)
            })
            .collect()
    }

    fn pair(
        &self,
        vertex: u32,
        triangle: &[u32; 3],
        before: &[Point3<f64>],
        now: &[Point3<f64>],
        separation: f64,
        reach: f64,
    ) -> Option<(f64, Row)> {
        let (height, normal, weights) = over(triangle, now, &now[vertex as usize])?;
        if height.abs() > reach
            || weights.iter().any(|b| *b < -OVERLAP)
            || self.adjoins(vertex, triangle)
        {
            return None;
        }
        let (was, _, _) = over(triangle, before, &before[vertex as usize])?;
        let side = was.signum();
        let gap = separation - side * height;
        // A distance of one separation in reserve: what is so far away cannot be pushed into contact by the projection.
        (was.abs() > 1e-9 && gap > -separation).then(|| {
            let terms = std::iter::once((vertex, 1.0))
                .chain(triangle.iter().zip(weights).map(|(&k, b)| (k, -b)));
            (
                gap,
                Row {
                    terms: terms.collect(),
                    direction: normal * side,
                    bound: separation,
                },
            )
        })
    }
}

/// Signed height over a triangle's plane, its unit normal and the barycentric weights of the foot.
fn over(
    triangle: &[u32; 3],
    points: &[Point3<f64>],
    p: &Point3<f64>,
) -> Option<(f64, Vector3<f64>, [f64; 3])> {
    let [a, b, c] = triangle.map(|k| points[k as usize]);
    let (u, v, w) = (b - a, c - a, p - a);
    let area = u.cross(&v);
    let square = area.norm_squared();
    // A sliver has no side; its neighbours stand in for it.
    if square <= 1e-12 * u.norm_squared() * v.norm_squared() {
        return None;
    }
    let normal = area / square.sqrt();
    let (second, third) = (
        w.cross(&v).dot(&area) / square,
        u.cross(&w).dot(&area) / square,
    );
    Some((
        normal.dot(&w),
        normal,
        [1.0 - second - third, second, third],
    ))
}

/// Largest lack of separation among the rows, 0 if none.
pub(crate) fn deepest_gap(rows: &[Row], positions: &[Point3<f64>]) -> f64 {
    rows.iter().map(|r| r.gap(positions)).fold(0.0, f64::max)
}
