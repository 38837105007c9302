//! Estimate of the number of simplices from a sample of vertices.

use crate::cylinder::Cylinder;
use crate::error::Error;
use crate::filtration::{pair_lower_bound, solve};
use crate::nerve::Vertices;
use crate::options::Options;
use crate::problem::Oriented;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use nalgebra::{Point3, UnitVector3};

/// Number of sampled vertices.
const VERTICES: usize = 64;
/// Number of sampled neighbours of a vertex; in a dense cluster there may be a million.
const NEIGHBOURS: usize = 256;
/// Number of sampled triples, and of quadruples, of a vertex.
const TUPLES: usize = 48;
/// Total number of neighbours after which no further vertex is sampled: in a dense cluster few vertices suffice.
const BUDGET: usize = 1 << 21;

/// Estimated number of simplices of all dimensions at any scale up to the `max_scale` of the options it was made for.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct SizeEstimate {
    vertices: usize,
    /// Values of sampled simplices, ascending, with the estimated number of simplices up to each.
    values: Vec<(f64, f64)>,
    standard_error: f64,
}

impl SizeEstimate {
    /// Simplices of dimension 0 to 3 with values up to `scale`.
    pub fn simplices(&self, scale: f64) -> f64 {
        let below = self.values.partition_point(|(value, _)| *value <= scale);
        let more = below.checked_sub(1).map_or(0.0, |last| self.values[last].1);
        self.vertices as f64 + more
    }

    /// Standard error of the number at the largest scale: about 5 % on an even cloud.
    pub fn standard_error(&self) -> f64 {
        self.standard_error
    }

    /// Largest value up to which the complex has about `limit` simplices or fewer; 0 if not even the vertices, or only these, are within the limit.
    pub fn largest_scale(&self, limit: usize) -> f64 {
        let room = limit as f64 - self.vertices as f64;
        if room < 0.0 {
            return 0.0;
        }
        let fitting = self.values.partition_point(|(_, count)| *count <= room);
        fitting
            .checked_sub(1)
            .map_or(0.0, |last| self.values[last].0)
    }
}

/// Estimates how many simplices [`Complex::build`](crate::Complex::build) would find with the same arguments.
///
/// ```text
/// N_k(s) = Σ_v |{σ ∋ v : dim σ = k, f(σ) ≤ s}| / (k + 1)
/// ```
///
/// The sum runs over a few vertices instead of all, and around each of them over a few of the tuples of its neighbours: both
/// estimates are unbiased, and the variance among the vertices gives the standard error. The sampled values give the growth of the number with
/// the scale, and so the scale up to which a complex fits.
///
/// # Errors
/// As `build`, but for [`Error::TooManySimplices`].
///
/// # Complexity
/// A search tree and about 10,000 small convex problems for any size of the cloud: some 10 ms.
///
/// ```
/// use cech_complex::manifolds::Manifold;
/// use cech_complex::{Complex, Cylinder, Options, estimate_size};
///
/// let cloud = Manifold::Torus { major: 1.0, minor: 0.4 }.net(1000, 1);
/// let cylinder = Cylinder::new(1.25 * cloud.spacing, cloud.spacing)?;
/// let options = Options::default().with_max_scale(1.4);
/// let estimate = estimate_size(&cloud.points, &cloud.normals, cylinder, &options)?;
///
/// let complex = Complex::build(&cloud.points, &cloud.normals, cylinder, &options)?;
/// let truth = complex.counts().iter().sum::<usize>() as f64;
/// assert!((estimate.simplices(1.4) / truth - 1.0).abs() < 0.2);
/// assert!((1.1..1.3).contains(&estimate.largest_scale(truth as usize / 2)));
/// # Ok::<(), cech_complex::Error>(())
/// ```
pub fn estimate_size(
    points: &[Point3<f64>],
    normals: &[UnitVector3<f64>],
    cylinder: Cylinder,
    options: &Options,
) -> Result<SizeEstimate, Error> {
    Vertices::of_cloud(points, normals, options, |vertices| {
        estimate(vertices, cylinder, options)
    })
}

/// The estimate for the vertices that are present.
pub(crate) fn estimate(vertices: &Vertices, cylinder: Cylinder, options: &Options) -> SizeEstimate {
    let there = (vertices.cloud.iter().zip(vertices.present)).filter(|(_, present)| **present);
    let cloud: Vec<Oriented> = there.map(|(oriented, _)| *oriented).collect();
    let mut found = Found::default();
    let coordinates: Vec<[f64; 3]> = cloud.iter().map(|o| o.point.into()).collect();
    if let (true, Ok(tree)) = (
        cloud.len() > 1,
        ImmutableKdTree::<f64, 3>::new_from_slice(&coordinates),
    ) {
        let reach = 2.0 * cylinder.circumradius() * options.max_scale;
        let mut budget = BUDGET;
        for v in spread(cloud.len(), VERTICES) {
            let hits = tree
                .query(&coordinates[v])
                .within::<SquaredEuclidean<f64>>(reach * reach)
                .unsorted()
                .execute();
            let mut near: Vec<u32> = hits.iter().map(|hit| hit.item).collect();
            near.retain(|&u| u as usize != v);
            // The tree returns neighbours in any order.
            near.sort_unstable();
            found.around(&cloud, v, &near, cylinder, options);
            budget = budget.saturating_sub(near.len());
            if budget == 0 {
                break;
            }
        }
    }
    found.estimate(cloud.len())
}

/// Simplices around the sampled vertices.
#[derive(Default)]
struct Found {
    /// Value of each sampled simplex, and the number of simplices at its vertex that it represents.
    weighted: Vec<(f64, f64)>,
    /// Estimated number of simplices at each vertex.
    totals: Vec<f64>,
}

impl Found {
    fn around(
        &mut self,
        cloud: &[Oriented],
        v: usize,
        near: &[u32],
        cylinder: Cylinder,
        options: &Options,
    ) {
        let before = self.weighted.len();
        let apart =
            |a: &Oriented, b: &Oriented| options.orientation.separates(&a.normal, &b.normal);
        let at = cloud[v];
        let looked_at = spread(near.len(), NEIGHBOURS);
        let share = near.len() as f64 / looked_at.len().max(1) as f64;
        let mut joined = Vec::new();
        for i in looked_at {
            let other = cloud[near[i] as usize];
            if apart(&at, &other) || pair_lower_bound(&at, &other, cylinder) > options.max_scale {
                continue;
            }
            let value = solve(&[at, other], cylinder, None, options.max_scale).value;
            if value <= options.max_scale {
                self.weighted.push((value, share / 2.0));
                joined.push(other);
            }
        }
        let degree = share * joined.len() as f64;
        let mut pick = Picks::new(joined.len());
        let pairs = degree * (degree - 1.0).max(0.0) / 2.0;
        for _ in 0..if joined.len() < 2 { 0 } else { TUPLES } {
            let [i, j] = pick.distinct();
            let (a, b) = (joined[i], joined[j]);
            if !apart(&a, &b) {
                let value = solve(&[at, a, b], cylinder, None, options.max_scale).value;
                self.keep(value, pairs / TUPLES as f64 / 3.0, options);
            }
        }
        let triples = pairs * (degree - 2.0).max(0.0) / 3.0;
        for _ in 0..if joined.len() < 3 { 0 } else { TUPLES } {
            let [i, j, k] = pick.distinct();
            let (a, b, c) = (joined[i], joined[j], joined[k]);
            if !(apart(&a, &b) || apart(&a, &c) || apart(&b, &c)) {
                let value = solve(&[at, a, b, c], cylinder, None, options.max_scale).value;
                self.keep(value, triples / TUPLES as f64 / 4.0, options);
            }
        }
        self.totals
            .push(self.weighted[before..].iter().map(|(_, n)| n).sum());
    }

    fn keep(&mut self, value: f64, weight: f64, options: &Options) {
        if value <= options.max_scale {
            self.weighted.push((value, weight));
        }
    }

    fn estimate(mut self, vertices: usize) -> SizeEstimate {
        let sample = self.totals.len().max(1) as f64;
        let each = vertices as f64 / sample;
        let mean = self.totals.iter().sum::<f64>() / sample;
        let squares: f64 = self.totals.iter().map(|t| (t - mean).powi(2)).sum();
        self.weighted.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut sum = 0.0;
        for (_, weight) in &mut self.weighted {
            sum += *weight * each;
            *weight = sum;
        }
        SizeEstimate {
            vertices,
            values: self.weighted,
            standard_error: vertices as f64 * (squares / (sample - 1.0).max(1.0) / sample).sqrt(),
        }
    }
}

/// All indices below `count`, or `most` drawn from them.
fn spread(count: usize, most: usize) -> Vec<usize> {
    if count <= most {
        return (0..count).collect();
    }
    let mut picks = Picks::new(count);
    (0..most).map(|_| picks.next()).collect()
}

/// Indices below `count` in pseudo-random order: a multiplicative congruential sequence (Knuth's MMIX constants) with a fixed start.
struct Picks {
    count: usize,
    state: u64,
}

impl Picks {
    fn new(count: usize) -> Self {
        Self { count, state: 1 }
    }

    fn next(&mut self) -> usize {
        self.state = self
            .state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        // The high half is more random; the product fits as counts are below 2³².
        (((self.state >> 32) * self.count as u64) >> 32) as usize
    }

    /// `N` different indices; there must be at least as many.
    fn distinct<const N: usize>(&mut self) -> [usize; N] {
        let mut picked = [usize::MAX; N];
        for n in 0..N {
            let mut next = self.next();
            while picked[..n].contains(&next) {
                next = self.next();
            }
            picked[n] = next;
        }
        picked
    }
}
