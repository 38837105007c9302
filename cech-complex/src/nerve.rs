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
    /// Of the last batch.
    decided: Vec<Option<Meeting>>,
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
        decided: Vec::new(),
    };
    builder.count(vertices.present.iter().filter(|p| **p).count())?;
    let mut skeleton = Skeleton::default();

    let fresh = builder.edges()?;
    let untouched = |edge: usize| vertices.untouched(&old.edges[edge]);
    let layer = old.edge_layer(values.edges.so_far());
    let (edges, origins) = layer.merge(fresh, |vertex| vertex, untouched);
    let (kept, names) = (origins.kept(), origins.names());
    builder.count(kept)?;
    let found_edges = edges.len() - kept;
    let edges = skeleton.set_edges(edges, vertices.cloud.len());
    builder.foresee(&skeleton)?;
    let affected = builder.affected(&skeleton);

    let fresh = builder.triangles(&skeleton, &edges, &affected)?;
    let name = |edge: u32| names[edge as usize];
    let layer = old.triangle_layer(values.triangles.so_far());
    let (triangles, origins) = layer.merge(fresh, name, |_| true);
    let (kept, names) = (origins.kept(), origins.names());
    builder.count(kept)?;
    let found_triangles = triangles.len() - kept;
    let triangles = skeleton.set_triangles(triangles);

    let fresh = builder.tetrahedra(&skeleton, &triangles, &affected)?;
    let name = |triangle: u32| names[triangle as usize];
    let layer = old.tetrahedron_layer(values.tetrahedra.so_far());
    let (tetrahedra, origins) = layer.merge(fresh, name, |_| true);
    let kept = origins.kept();
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
            let mut decided = std::mem::take(&mut self.decided);
            map(pairs, &mut decided, |pair| self.decisions.edge(*pair));
            for (pair, decided) in pairs.iter().zip(&decided) {
                if let Some(meeting) = decided {
                    self.count(1)?;
                    layer.push(*pair, *pair, f64::NAN, Some(meeting.point_or_nan()));
                }
            }
            self.decided = decided;
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
        let mut batch: Vec<Candidate<3>> = Vec::with_capacity(2 * BATCH);
        let to_changed = ToChanged::new(self.vertices, &skeleton.edges, &skeleton.edge_runs);
        // Edge from the current first vertex to a given one.
        let mut edge_to = vec![u32::MAX; self.vertices.cloud.len()];
        for &i in affected {
            let from_i = run(&skeleton.edge_runs, i);
            for e in from_i.clone() {
                edge_to[skeleton.edges[e][1] as usize] = e as u32;
            }
            for ij in from_i.clone() {
                let j = skeleton.edges[ij][1];
                let mut push = |jk: usize| {
                    let k = skeleton.edges[jk][1];
                    let ik = edge_to[k as usize];
                    if ik != u32::MAX {
                        batch.push(Candidate {
                            vertices: [i, j, k],
                            facets: [ij as u32, ik, jk as u32],
                        });
                    }
                };
                if self.vertices.any_changed(&[i, j]) {
                    run(&skeleton.edge_runs, j).for_each(&mut push);
                } else {
                    to_changed.of(j).for_each(&mut push);
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
            let mut decided = std::mem::take(&mut self.decided);
            layer.reserve(batch.len());
            map(batch, &mut decided, |candidate| {
                decide(&self.decisions, candidate)
            });
            for (candidate, decided) in batch.iter().zip(&decided) {
                if let Some(meeting) = decided {
                    self.count(1)?;
                    // Nothing stands on a tetrahedron.
                    let point = (N < 4).then(|| meeting.point_or_nan());
                    layer.push(candidate.vertices, candidate.facets, f64::NAN, point);
                }
            }
            self.decided = decided;
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
        let mut batch: Vec<Candidate<4>> = Vec::with_capacity(2 * BATCH);
        let (of_triangles, triangles) = (&skeleton.triangle_runs, &skeleton.triangles);
        let to_changed = ToChanged::new(self.vertices, triangles, of_triangles);
        for &i in affected {
            for ij in run(&skeleton.edge_runs, i) {
                let leads = to_changed.of(ij as u32).next().is_some();
                if !leads && !self.vertices.any_changed(&skeleton.edges[ij]) {
                    continue;
                }
                for ijk in run(of_triangles, ij as u32) {
                    let facets = skeleton.triangle_edges[ijk];
                    if self.vertices.any_changed(&triangles[ijk]) {
                        let mut with = facets.map(|edge| run(of_triangles, edge));
                        with[0].start = ijk + 1;
                        push_tetrahedra(skeleton, ijk, with, &mut batch);
                    } else {
                        let with = facets.map(|edge| to_changed.of(edge));
                        push_tetrahedra(skeleton, ijk, with, &mut batch);
                    }
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
}

/// Candidates whose first triangle is `ijk`: the fourth vertex closes a triangle with each of its three edges, among those `with` the edges.
fn push_tetrahedra(
    skeleton: &Skeleton,
    ijk: usize,
    with: [impl Iterator<Item = usize>; 3],
    batch: &mut Vec<Candidate<4>>,
) {
    let [i, j, k] = skeleton.triangles[ijk];
    let last = |t: usize| skeleton.triangles[t][2];
    let [with_ij, mut with_ik, mut with_jk] = with;
    let (mut ikl, mut jkl) = (with_ik.next(), with_jk.next());
    for ijl in with_ij.skip_while(|t| *t <= ijk) {
        let l = last(ijl);
        while ikl.is_some_and(|t| last(t) < l) {
            ikl = with_ik.next();
        }
        while jkl.is_some_and(|t| last(t) < l) {
            jkl = with_jk.next();
        }
        let (Some(ikl), Some(jkl)) = (ikl, jkl) else {
            return;
        };
        if last(ikl) == l && last(jkl) == l {
            batch.push(Candidate {
                vertices: [i, j, k, l],
                facets: [ijk as u32, ijl as u32, ikl as u32, jkl as u32],
            });
        }
    }
}

/// Of every run of simplices, those whose last vertex has changed: after a small change few of them.
struct ToChanged {
    starts: Vec<u32>,
    simplices: Vec<u32>,
}

impl ToChanged {
    fn new<const N: usize>(vertices: &Vertices, simplices: &[[u32; N]], runs: &[u32]) -> Self {
        let (mut starts, mut chosen) = (Vec::with_capacity(runs.len()), Vec::new());
        starts.push(0);
        for of in 0..runs.len().saturating_sub(1) {
            let own = run(runs, of as u32);
            let changed = own.filter(|&s| vertices.changed[simplices[s][N - 1] as usize]);
            chosen.extend(changed.map(|s| s as u32));
            starts.push(chosen.len() as u32);
        }
        Self {
            starts,
            simplices: chosen,
        }
    }

    /// Those of run `of`.
    fn of(&self, of: u32) -> impl Iterator<Item = usize> {
        self.simplices[run(&self.starts, of)]
            .iter()
            .map(|&s| s as usize)
    }
}
