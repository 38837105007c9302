//! Construction of the nerve, one dimension after the other.
//!
//! 1. **Edges.** Pairs closer than two circumradii of the cylinder (kd-tree), orientation allowed; a closed-form lower bound rejects nearly
//!    all of those that will not be edges, the solver values the rest.
//! 2. **Triangles.** Triples of mutually joined vertices, **tetrahedra** quadruples whose four triangles exist: by Helly no larger
//!    simplex carries information.
//! 3. **Facet shortcut.** If the cylinder opposite the latest facet contains the minimiser of that facet, the simplex has exactly the
//!    value of the facet: nothing to solve. This settles more than nine tetrahedra in ten and half of the triangles.
//!
//! A value below that of a facet can only be rounding, so the larger of the two is taken, and the value of the facet whenever the
//! certified bracket contains it: monotone to the last bit, and equal to the last bit where the truth is a tie.

use crate::complex::{Options, Orientation};
use crate::cylinder::{Cylinder, gauge};
use crate::error::Error;
use crate::filtration::{pair_lower_bound, solve};
use crate::problem::Oriented;
use crate::skeleton::{Skeleton, run};
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use nalgebra::Vector3;

/// Candidates valued at a time: enough to share among threads, little enough to stop soon after the limit.
const BATCH: usize = 1 << 14;

/// A value and a point where it is attained.
type Valued = (f64, Vector3<f64>);

/// What all stages share.
struct Builder<'a> {
    cloud: &'a [Oriented],
    cylinder: Cylinder,
    options: &'a Options,
    total: usize,
}

/// Candidate of dimension `N − 1` with the indices of its facets.
struct Candidate<const N: usize> {
    vertices: [u32; N],
    facets: [u32; N],
}

/// Builds the filtered 3-skeleton of the nerve.
pub(crate) fn build(
    cloud: &[Oriented],
    cylinder: Cylinder,
    options: &Options,
) -> Result<Skeleton, Error> {
    let mut builder = Builder {
        cloud,
        cylinder,
        options,
        total: 0,
    };
    builder.count(cloud.len())?;
    let mut skeleton = Skeleton::default();
    let edge_points = builder.edges(&mut skeleton)?;
    let triangle_points = builder.triangles(&mut skeleton, &edge_points)?;
    builder.tetrahedra(&mut skeleton, &triangle_points)?;
    Ok(skeleton)
}

impl Builder<'_> {
    /// Adds to the number of simplices, or refuses.
    fn count(&mut self, more: usize) -> Result<(), Error> {
        self.total += more;
        let limit = self.options.max_simplices;
        if self.total > limit {
            return Err(Error::TooManySimplices {
                count: self.total,
                limit,
            });
        }
        Ok(())
    }

    fn edges(&mut self, skeleton: &mut Skeleton) -> Result<Vec<Vector3<f64>>, Error> {
        let mut minimisers = Vec::new();
        if self.cloud.len() > 1 {
            let coordinates: Vec<[f64; 3]> = self.cloud.iter().map(|o| o.point.into()).collect();
            // The tree refuses only what the checks at the door have refused already.
            let tree = ImmutableKdTree::<f64, 3>::new_from_slice(&coordinates).map_err(|_| {
                Error::TooManySimplices {
                    count: self.total,
                    limit: u32::MAX as usize,
                }
            })?;
            let reach = 2.0 * self.cylinder.circumradius() * self.options.max_scale;
            // A little more than the exact bound, so that rounding in the tree loses no pair.
            let squared = reach * reach * (1.0 + 1e-9);
            let mut pairs = Vec::new();
            let mut later: Vec<u32> = Vec::new();
            for (i, centre) in coordinates.iter().enumerate() {
                let found = tree
                    .query(centre)
                    .within::<SquaredEuclidean<f64>>(squared)
                    .unsorted()
                    .execute();
                later.clear();
                later.extend(found.iter().map(|hit| hit.item).filter(|&j| j as usize > i));
                later.sort_unstable();
                pairs.extend(later.iter().map(|&j| [i as u32, j]));
                if pairs.len() >= BATCH || i + 1 == coordinates.len() {
                    self.value_edges(&pairs, skeleton, &mut minimisers)?;
                    pairs.clear();
                }
            }
        }
        skeleton.index_edges(self.cloud.len());
        Ok(minimisers)
    }

    fn value_edges(
        &mut self,
        pairs: &[[u32; 2]],
        skeleton: &mut Skeleton,
        minimisers: &mut Vec<Vector3<f64>>,
    ) -> Result<(), Error> {
        for (pair, valued) in pairs.iter().zip(map(pairs, |pair| self.value_edge(*pair))) {
            if let Some((value, minimiser)) = valued {
                self.count(1)?;
                skeleton.edges.push(*pair);
                skeleton.edge_values.push(value);
                minimisers.push(minimiser);
            }
        }
        Ok(())
    }

    fn value_edge(&self, [i, j]: [u32; 2]) -> Option<Valued> {
        let (a, b) = (self.cloud[i as usize], self.cloud[j as usize]);
        if let Orientation::Separate { min_cosine } = self.options.orientation
            && a.normal.dot(&b.normal) < min_cosine
        {
            return None;
        }
        let cutoff = self.options.max_scale;
        if pair_lower_bound(&a, &b, self.cylinder) > cutoff {
            return None;
        }
        let solved = solve(&[a, b], self.cylinder, None, cutoff);
        (solved.value <= cutoff).then_some((solved.value, solved.minimiser.coords))
    }

    fn triangles(
        &mut self,
        skeleton: &mut Skeleton,
        edge_points: &[Vector3<f64>],
    ) -> Result<Vec<Vector3<f64>>, Error> {
        let mut minimisers = Vec::new();
        let mut batch: Vec<Candidate<3>> = Vec::new();
        // Edge from the current first vertex to a given one.
        let mut edge_to = vec![u32::MAX; self.cloud.len()];
        for i in 0..self.cloud.len() as u32 {
            let from_i = run(&skeleton.edge_runs, i);
            for e in from_i.clone() {
                edge_to[skeleton.edges[e][1] as usize] = e as u32;
            }
            for ij in from_i.clone() {
                let j = skeleton.edges[ij][1];
                for jk in run(&skeleton.edge_runs, j) {
                    let k = skeleton.edges[jk][1];
                    let ik = edge_to[k as usize];
                    if ik != u32::MAX {
                        batch.push(Candidate {
                            vertices: [i, j, k],
                            facets: [ij as u32, ik, jk as u32],
                        });
                    }
                }
            }
            for e in from_i {
                edge_to[skeleton.edges[e][1] as usize] = u32::MAX;
            }
            if batch.len() >= BATCH || i as usize + 1 == self.cloud.len() {
                let valued = map(&batch, |c| {
                    self.value(c, &skeleton.edge_values, edge_points)
                });
                for (candidate, valued) in batch.iter().zip(valued) {
                    if let Some((value, minimiser)) = valued {
                        self.count(1)?;
                        skeleton.triangles.push(candidate.vertices);
                        skeleton.triangle_edges.push(candidate.facets);
                        skeleton.triangle_values.push(value);
                        minimisers.push(minimiser);
                    }
                }
                batch.clear();
            }
        }
        skeleton.index_triangles();
        Ok(minimisers)
    }

    fn tetrahedra(
        &mut self,
        skeleton: &mut Skeleton,
        triangle_points: &[Vector3<f64>],
    ) -> Result<(), Error> {
        let mut batch: Vec<Candidate<4>> = Vec::new();
        for ijk in 0..skeleton.triangles.len() {
            push_tetrahedra(skeleton, ijk, &mut batch);
            if batch.len() >= BATCH || ijk + 1 == skeleton.triangles.len() {
                let valued = map(&batch, |c| {
                    self.value(c, &skeleton.triangle_values, triangle_points)
                });
                for (candidate, valued) in batch.iter().zip(valued) {
                    if let Some((value, _)) = valued {
                        self.count(1)?;
                        skeleton.tetrahedra.push(candidate.vertices);
                        skeleton.tetrahedron_triangles.push(candidate.facets);
                        skeleton.tetrahedron_values.push(value);
                    }
                }
                batch.clear();
            }
        }
        skeleton.index_tetrahedra();
        Ok(())
    }

    /// Value of a triangle or tetrahedron from the values and minimisers of its facets.
    fn value<const N: usize>(
        &self,
        candidate: &Candidate<N>,
        facet_values: &[f64],
        facet_points: &[Vector3<f64>],
    ) -> Option<Valued> {
        let mut latest = 0;
        for f in 1..N {
            if facet_values[candidate.facets[f] as usize]
                > facet_values[candidate.facets[latest] as usize]
            {
                latest = f;
            }
        }
        let facet = candidate.facets[latest] as usize;
        let (floor, minimiser) = (facet_values[facet], facet_points[facet]);
        // Facet `f` leaves out the vertex `N − 1 − f`.
        let opposite = &self.cloud[candidate.vertices[N - 1 - latest] as usize];
        let (half, radius) = (self.cylinder.half_height(), self.cylinder.radius());
        let inside = gauge(
            &(minimiser - opposite.point),
            &opposite.normal,
            half,
            radius,
        ) <= floor;
        if inside {
            return Some((floor, minimiser));
        }
        let cutoff = self.options.max_scale;
        let simplex = candidate.vertices.map(|v| self.cloud[v as usize]);
        let solved = solve(&simplex, self.cylinder, Some(&minimiser), cutoff);
        let value = if solved.lower <= floor {
            floor
        } else {
            solved.value
        };
        (value <= cutoff).then_some((value, solved.minimiser.coords))
    }
}

/// Tetrahedra whose first triangle is `ijk`: the fourth vertex closes a triangle with each of its three edges.
fn push_tetrahedra(skeleton: &Skeleton, ijk: usize, batch: &mut Vec<Candidate<4>>) {
    let [i, j, k] = skeleton.triangles[ijk];
    let [ij, ik, jk] = skeleton.triangle_edges[ijk];
    let with_ij = ijk + 1..run(&skeleton.triangle_runs, ij).end;
    let mut with_ik = run(&skeleton.triangle_runs, ik);
    let mut with_jk = run(&skeleton.triangle_runs, jk);
    let last = |t: usize| skeleton.triangles[t][2];
    for ijl in with_ij {
        let l = last(ijl);
        while with_ik.start < with_ik.end && last(with_ik.start) < l {
            with_ik.start += 1;
        }
        while with_jk.start < with_jk.end && last(with_jk.start) < l {
            with_jk.start += 1;
        }
        if with_ik.is_empty() || with_jk.is_empty() {
            return;
        }
        if last(with_ik.start) == l && last(with_jk.start) == l {
            batch.push(Candidate {
                vertices: [i, j, k, l],
                facets: [
                    ijk as u32,
                    ijl as u32,
                    with_ik.start as u32,
                    with_jk.start as u32,
                ],
            });
        }
    }
}

/// Applies `f` to every item, on all threads with feature `rayon`; the answer is the same either way.
#[cfg(not(feature = "rayon"))]
fn map<T, R>(items: &[T], f: impl Fn(&T) -> R) -> Vec<R> {
    items.iter().map(f).collect()
}

/// Applies `f` to every item, on all threads with feature `rayon`; the answer is the same either way.
#[cfg(feature = "rayon")]
fn map<T: Sync, R: Send>(items: &[T], f: impl Fn(&T) -> R + Sync + Send) -> Vec<R> {
    use rayon::prelude::*;
    items.par_iter().map(f).collect()
}
