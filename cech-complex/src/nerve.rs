//! Construction of the nerve, dimension by dimension, from scratch or around the points that changed.
//!
//! 1. **Edges.** Pairs closer than two circumradii of the cylinder (kd-tree), or the given ones, with admissible orientation.
//! 2. **Triangles.** Triples of mutually joined vertices, **tetrahedra** quadruples whose four triangles exist: by Helly no larger
//!    simplex carries information.
//!
//! Whether the cylinders of such a candidate meet within the largest scale is decided without the value at which they first do (module `decision`): for
//! nearly all by a point. The values of new simplices stay missing until they are asked for (modules `values` and `valuation`).
//!
//! A value depends only on the cylinders of its own simplex, taken in the order of their indices. So after a change the simplices without a
//! changed vertex keep what is known of them, those with one are decided again, and the result is bit for bit that of a new
//! build. A new build is the case in which every vertex has changed.

use crate::cylinder::Cylinder;
use crate::decision::{Decisions, Meeting};
use crate::error::Error;
use crate::filtration::check_cloud;
use crate::options::Options;
use crate::problem::Oriented;
use crate::size;
use crate::skeleton::{Layer, Skeleton, run};
use crate::valuation::{BATCH, Candidate, Valuation, map};
use crate::values::{Attained, Deferred, Values};
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use nalgebra::{Point3, UnitVector3};

/// Number of standard errors at which an estimate is taken for certain.
const CERTAIN: f64 = 4.0;

/// Which vertices there are, and which of them are new or have moved.
pub(crate) struct Vertices<'a> {
    pub(crate) cloud: &'a [Oriented],
    pub(crate) present: &'a [bool],
    pub(crate) changed: &'a [bool],
    /// The only pairs that may be joined, sorted, if they are given.
    pub(crate) pairs: Option<&'a [[u32; 2]]>,
}

impl Vertices<'_> {
    /// Hands all points of a cloud to `work`, each of them new, once they and the options are known to be usable.
    pub(crate) fn of_cloud<T>(
        points: &[Point3<f64>],
        normals: &[UnitVector3<f64>],
        options: &Options,
        work: impl FnOnce(&Vertices) -> T,
    ) -> Result<T, Error> {
        options.check()?;
        let cloud = check_cloud(points, normals)?;
        let all = vec![true; points.len()];
        Ok(work(&Vertices {
            cloud: &cloud,
            present: &all,
            changed: &all,
            pairs: None,
        }))
    }

    /// The error that there are `count` simplices or more; `fitting_scale` is that without a restriction to pairs.
    pub(crate) fn too_many(&self, count: usize, cylinder: Cylinder, options: &Options) -> Error {
        let limit = options.max_simplices;
        let size = size::estimate(self, cylinder, options);
        Error::TooManySimplices {
            count,
            limit,
            max_scale: options.max_scale,
            fitting_scale: size.largest_scale(limit),
        }
    }

    fn any_changed(&self, simplex: &[u32]) -> bool {
        simplex.iter().any(|&v| self.changed[v as usize])
    }

    /// Whether all vertices of a simplex are present and unchanged, so that its earlier value still holds.
    fn untouched(&self, simplex: &[u32]) -> bool {
        simplex
            .iter()
            .all(|&v| self.present[v as usize] && !self.changed[v as usize])
    }
}

/// Data of all stages.
struct Builder<'a> {
    vertices: &'a Vertices<'a>,
    decisions: Decisions<'a>,
    cylinder: Cylinder,
    options: &'a Options,
    total: usize,
}

/// The 3-skeleton of the nerve of the vertices that are present, given an earlier state, with the values that are known from there. Also says
/// how many simplices of dimension 1, 2, 3 contain a changed vertex.
pub(crate) fn build(
    vertices: &Vertices,
    (old, values): (&Skeleton, &mut Values),
    cylinder: Cylinder,
    options: &Options,
) -> Result<(Skeleton, Values, [usize; 3]), Error> {
    let valuation = Valuation {
        cloud: vertices.cloud,
        cylinder,
        options,
    };
    let names = (0..vertices.cloud.len() as u32).collect();
    let mut builder = Builder {
        vertices,
        decisions: Decisions::new(names, valuation),
        cylinder,
        options,
        total: 0,
    };
    builder.count(vertices.present.iter().filter(|p| **p).count())?;
    let mut skeleton = Skeleton::default();

    let fresh = builder.edges()?;
    let untouched = |edge: usize| vertices.untouched(&old.edges[edge]);
    let layer = old.edge_layer(values.edges.so_far());
    let (edges, kept, names) = layer.merge(fresh, |vertex| vertex, untouched);
    builder.count(kept)?;
    let found_edges = edges.len() - kept;
    let edges = skeleton.set_edges(edges, vertices.cloud.len());
    builder.foresee(&skeleton)?;
    let affected = builder.affected(&skeleton);

    let fresh = builder.triangles(&skeleton, &edges, &affected)?;
    let name = |edge: u32| names[edge as usize];
    let layer = old.triangle_layer(values.triangles.so_far());
    let (triangles, kept, names) = layer.merge(fresh, name, |_| true);
    builder.count(kept)?;
    let found_triangles = triangles.len() - kept;
    let triangles = skeleton.set_triangles(triangles);

    let fresh = builder.tetrahedra(&skeleton, &triangles, &affected)?;
    let name = |triangle: u32| names[triangle as usize];
    let layer = old.tetrahedron_layer(values.tetrahedra.so_far());
    let (tetrahedra, kept, _) = layer.merge(fresh, name, |_| true);
    builder.count(kept)?;
    let found_tetrahedra = tetrahedra.len() - kept;
    let tetrahedra = skeleton.set_tetrahedra(tetrahedra);
    let values = Values {
        edges: Deferred::new(edges),
        triangles: Deferred::new(triangles),
        tetrahedra: Deferred::new(tetrahedra),
    };
    let found = [found_edges, found_triangles, found_tetrahedra];
    Ok((skeleton, values, found))
}

impl Builder<'_> {
    /// Adds to the number of simplices; an error above the limit.
    fn count(&mut self, more: usize) -> Result<(), Error> {
        self.total += more;
        let limit = self.options.max_simplices;
        if self.total > limit {
            return Err(self.too_many(self.total));
        }
        Ok(())
    }

    fn too_many(&self, count: usize) -> Error {
        self.vertices.too_many(count, self.cylinder, self.options)
    }

    /// Rejects a complex that will be too large before its triangles and tetrahedra are searched. The test is made only if the degrees of the
    /// vertices admit so many, and rejects only if the excess is certain: four standard errors.
    fn foresee(&self, skeleton: &Skeleton) -> Result<(), Error> {
        if self.vertices.pairs.is_some() {
            // The estimate knows of no pairs, and would be too large.
            return Ok(());
        }
        let mut degrees = vec![0.0; self.vertices.cloud.len()];
        for &vertex in skeleton.edges.iter().flatten() {
            degrees[vertex as usize] += 1.0;
        }
        let most = |d: &f64| d * (d - 1.0) / 6.0 + d * (d - 1.0) * (d - 2.0).max(0.0) / 24.0;
        let limit = self.options.max_simplices as f64;
        if self.total as f64 + degrees.iter().map(most).sum::<f64>() <= limit {
            return Ok(());
        }
        let size = size::estimate(self.vertices, self.cylinder, self.options);
        let least = size.simplices(self.options.max_scale) - CERTAIN * size.standard_error();
        if least > limit {
            return Err(self.too_many(least as usize));
        }
        Ok(())
    }

    /// All edges with a changed end.
    fn edges(&mut self) -> Result<Layer<2>, Error> {
        let mut layer = Layer::default();
        let Vertices {
            cloud,
            present,
            changed,
            pairs,
        } = self.vertices;
        if let Some(pairs) = pairs {
            self.decide_edges(pairs, &mut layer)?;
            return Ok(layer);
        }
        let is_there: Vec<u32> = (0..cloud.len() as u32)
            .filter(|&v| present[v as usize])
            .collect();
        let coordinates: Vec<[f64; 3]> = is_there
            .iter()
            .map(|&v| cloud[v as usize].point.into())
            .collect();
        if coordinates.len() < 2 || !changed.contains(&true) {
            return Ok(layer);
        }
        // The tree fails only on input that was rejected before.
        let tree = ImmutableKdTree::<f64, 3>::new_from_slice(&coordinates)
            .map_err(|_| self.too_many(self.total))?;
        let reach = 2.0 * self.cylinder.circumradius() * self.options.max_scale;
        // A little more than the exact bound, so that rounding in the tree loses no pair.
        let squared = reach * reach * (1.0 + 1e-9);
        let mut pairs = Vec::new();
        for &i in is_there.iter().filter(|&&i| changed[i as usize]) {
            let found = tree
                .query(&cloud[i as usize].point.into())
                .within::<SquaredEuclidean<f64>>(squared)
                .unsorted()
                .execute();
            let others = found.iter().map(|hit| is_there[hit.item as usize]);
            // A pair of two changed vertices is found twice and taken once.
            let taken = others.filter(|&j| j > i || (j < i && !changed[j as usize]));
            let start = pairs.len();
            pairs.extend(taken.map(|j| [i.min(j), i.max(j)]));
            pairs[start..].sort_unstable();
            if pairs.len() >= BATCH {
                self.decide_edges(&pairs, &mut layer)?;
                pairs.clear();
            }
        }
        self.decide_edges(&pairs, &mut layer)?;
        layer.sort();
        Ok(layer)
    }

    fn decide_edges(&mut self, pairs: &[[u32; 2]], layer: &mut Layer<2>) -> Result<(), Error> {
        // In a dense cluster a vertex may have more neighbours than the limit allows edges.
        for pairs in pairs.chunks(BATCH) {
            let decided = map(pairs, |pair| self.decisions.edge(*pair));
            for (pair, decided) in pairs.iter().zip(decided) {
                if let Some(meeting) = decided {
                    self.count(1)?;
                    layer.push(*pair, *pair, f64::NAN, Some(meeting.point_or_nan()));
                }
            }
        }
        Ok(())
    }

    /// Vertices that can be the first of a simplex with a changed vertex: changed themselves, or joined to a later one that is.
    fn affected(&self, skeleton: &Skeleton) -> Vec<u32> {
        let joined_later = |i: u32| {
            let later = &skeleton.edges[run(&skeleton.edge_runs, i)];
            later.iter().any(|edge| self.vertices.any_changed(edge))
        };
        let count = self.vertices.cloud.len() as u32;
        (0..count).filter(|&i| joined_later(i)).collect()
    }

    /// All triangles with a changed vertex, in order.
    fn triangles(
        &mut self,
        skeleton: &Skeleton,
        facets: &Attained,
        affected: &[u32],
    ) -> Result<Layer<3>, Error> {
        let mut layer = Layer::default();
        let decide = |on: &Decisions, candidate: &Candidate<3>| on.coface(candidate, facets);
        let mut batch: Vec<Candidate<3>> = Vec::new();
        // Edge from the current first vertex to a given one.
        let mut edge_to = vec![u32::MAX; self.vertices.cloud.len()];
        for &i in affected {
            let from_i = run(&skeleton.edge_runs, i);
            for e in from_i.clone() {
                edge_to[skeleton.edges[e][1] as usize] = e as u32;
            }
            for ij in from_i.clone() {
                let j = skeleton.edges[ij][1];
                for jk in run(&skeleton.edge_runs, j) {
                    let k = skeleton.edges[jk][1];
                    let ik = edge_to[k as usize];
                    if ik != u32::MAX && self.vertices.any_changed(&[i, j, k]) {
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
            if batch.len() >= BATCH {
                self.decide_simplices(&batch, &mut layer, decide)?;
                batch.clear();
            }
        }
        self.decide_simplices(&batch, &mut layer, decide)?;
        Ok(layer)
    }

    fn decide_simplices<const N: usize>(
        &mut self,
        batch: &[Candidate<N>],
        layer: &mut Layer<N>,
        decide: impl Fn(&Decisions, &Candidate<N>) -> Option<Meeting> + Sync + Send,
    ) -> Result<(), Error> {
        for batch in batch.chunks(BATCH) {
            let decided = map(batch, |candidate| decide(&self.decisions, candidate));
            for (candidate, decided) in batch.iter().zip(decided) {
                if let Some(meeting) = decided {
                    self.count(1)?;
                    // Nothing stands on a tetrahedron.
                    let point = (N < 4).then(|| meeting.point_or_nan());
                    layer.push(candidate.vertices, candidate.facets, f64::NAN, point);
                }
            }
        }
        Ok(())
    }

    /// All tetrahedra with a changed vertex, in order.
    fn tetrahedra(
        &mut self,
        skeleton: &Skeleton,
        facets: &Attained,
        affected: &[u32],
    ) -> Result<Layer<4>, Error> {
        let mut layer = Layer::default();
        let decide = |on: &Decisions, candidate: &Candidate<4>| on.coface(candidate, facets);
        let mut batch: Vec<Candidate<4>> = Vec::new();
        for &i in affected {
            for ij in run(&skeleton.edge_runs, i) {
                for ijk in run(&skeleton.triangle_runs, ij as u32) {
                    self.push_tetrahedra(skeleton, ijk, &mut batch);
                    if batch.len() >= BATCH {
                        self.decide_simplices(&batch, &mut layer, decide)?;
                        batch.clear();
                    }
                }
            }
        }
        self.decide_simplices(&batch, &mut layer, decide)?;
        Ok(layer)
    }

    /// Candidates whose first triangle is `ijk`: the fourth vertex closes a triangle with each of its three edges.
    fn push_tetrahedra(&self, skeleton: &Skeleton, ijk: usize, batch: &mut Vec<Candidate<4>>) {
        let [i, j, k] = skeleton.triangles[ijk];
        let [ij, ik, jk] = skeleton.triangle_edges[ijk];
        let every = self.vertices.any_changed(&[i, j, k]);
        let with_ij = ijk + 1..run(&skeleton.triangle_runs, ij).end;
        let mut with_ik = run(&skeleton.triangle_runs, ik);
        let mut with_jk = run(&skeleton.triangle_runs, jk);
        let last = |t: usize| skeleton.triangles[t][2];
        for ijl in with_ij {
            let l = last(ijl);
            if !every && !self.vertices.any_changed(&[l]) {
                continue;
            }
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
                let [ikl, jkl] = [with_ik.start as u32, with_jk.start as u32];
                batch.push(Candidate {
                    vertices: [i, j, k, l],
                    facets: [ijk as u32, ijl as u32, ikl, jkl],
                });
            }
        }
    }
}
