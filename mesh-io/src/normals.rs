//! Estimated normals: principal components, oriented consistently.
//!
//! The normal of a point is the direction in which its nearest neighbours are spread least (Hoppe et al., *Surface reconstruction from
//! unorganized points*, SIGGRAPH 1992, section 3.1), with either sign. Signs are then made consistent along the minimum spanning tree of the
//! change of normals (section 3.3): starting from the highest point, whose normal points up, a neighbour's normal is reversed if it opposes. Components without
//! common neighbours each start at their own highest point.
//!
//! *Limits*: the estimate is wrong where a surface bends within the neighbourhood, as at a crease or between two walls. For a mesh the
//! normals of its triangles are better.

use std::collections::BinaryHeap;
use std::num::NonZero;

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use nalgebra::{Matrix3, Point3, SymmetricEigen, UnitVector3, Vector3};

use crate::Mesh;

/// Number of neighbours from which a normal is estimated.
const NEIGHBOURS: usize = 12;

impl Mesh {
    /// Unit normals: those of the file, else of the triangles, else estimated from the neighbours.
    ///
    /// # Errors
    /// [`Error::NoDirection`](crate::Error::NoDirection) if the file has a normal that is zero or not finite.
    pub fn unit_normals_or_estimated(&self) -> Result<Vec<UnitVector3<f64>>, crate::Error> {
        if !self.normals.is_empty() {
            self.unit_normals()
        } else if !self.triangles.is_empty() {
            Ok(self.triangle_normals())
        } else {
            Ok(estimate_normals(&self.points))
        }
    }

    /// Normals of the vertices: the sum of the area vectors of their triangles, normalised; up if the sum is zero.
    pub fn triangle_normals(&self) -> Vec<UnitVector3<f64>> {
        let mut sums = vec![Vector3::zeros(); self.points.len()];
        for t in &self.triangles {
            let [a, b, c] = t.map(|v| self.points[v as usize]);
            let twice = (b - a).cross(&(c - a));
            for v in t {
                sums[*v as usize] += twice;
            }
        }
        let unit = |sum| UnitVector3::try_new(sum, 0.0).unwrap_or(Vector3::z_axis());
        sums.into_iter().map(unit).collect()
    }
}

/// Normals of points of a surface, outward where it is closed. O(n log n).
pub fn estimate_normals(points: &[Point3<f64>]) -> Vec<UnitVector3<f64>> {
    let neighbours = neighbours(points, 1);
    let normals = points.iter().zip(&neighbours);
    let mut normals: Vec<_> = normals.map(|(p, near)| flattest(p, near, points)).collect();
    orient(points, &neighbours, &mut normals);
    normals
}

/// The nearest points of every `step`th point, without itself.
fn neighbours(points: &[Point3<f64>], step: usize) -> Vec<Vec<u32>> {
    // The tree squares distances. Anything measured in metres is nearer.
    const FARTHEST: f64 = 1e60;
    let asked = points.iter().step_by(step);
    if points.iter().any(|p| p.coords.amax() > FARTHEST) {
        return vec![Vec::new(); asked.len()];
    }
    // The search tree cannot split many points at one place, so every place is entered once.
    let mut order: Vec<u32> = (0..points.len() as u32).collect();
    let key = |v: &u32| points[*v as usize].coords.data.0[0];
    order.sort_by(|a, b| {
        key(a)
            .partial_cmp(&key(b))
            .unwrap_or(std::cmp::Ordering::Equal)
    });
    order.dedup_by(|a, b| points[*a as usize] == points[*b as usize]);
    let places: Vec<[f64; 3]> = order.iter().map(key).collect();
    let count = NonZero::new(places.len().min(NEIGHBOURS + 1));
    let (Some(count), Ok(tree)) = (count, ImmutableKdTree::<f64, 3>::new_from_slice(&places))
    else {
        return vec![Vec::new(); asked.len()];
    };
    let near = |p: &Point3<f64>| {
        let at = p.coords.data.0[0];
        let found = tree
            .query(&at)
            .nearest_n::<SquaredEuclidean<f64>>(count)
            .execute();
        let other = found.iter().map(|n| order[n.item as usize]);
        other.filter(|w| points[*w as usize] != *p).collect()
    };
    asked.map(near).collect()
}

/// The direction of smallest spread around a point.
fn flattest(point: &Point3<f64>, near: &[u32], points: &[Point3<f64>]) -> UnitVector3<f64> {
    let offsets: Vec<Vector3<f64>> = near.iter().map(|w| points[*w as usize] - point).collect();
    let longest = offsets.iter().map(Vector3::norm).fold(0.0, f64::max);
    if longest == 0.0 || !longest.is_finite() {
        return Vector3::z_axis();
    }
    // In units of the neighbourhood, so that squares neither under- nor overflow.
    let mean = offsets.iter().sum::<Vector3<f64>>() / (longest * (offsets.len() + 1) as f64);
    let mut spread = mean * mean.transpose();
    for d in &offsets {
        let d = d / longest - mean;
        spread += d * d.transpose();
    }
    let eigen = SymmetricEigen::new(Matrix3::from(spread));
    let least = eigen.eigenvalues.imin();
    UnitVector3::try_new(eigen.eigenvectors.column(least).into_owned(), 0.0)
        .unwrap_or(Vector3::z_axis())
}

/// Two neighbours and how well their normals agree; the heap returns the best first.
struct Step {
    agreement: f64,
    from: u32,
    to: u32,
}

impl PartialEq for Step {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Step {}

impl PartialOrd for Step {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Step {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.agreement
            .total_cmp(&other.agreement)
            .then_with(|| (other.from, other.to).cmp(&(self.from, self.to)))
    }
}

/// Prim's spanning tree of best agreement over neighbours in either direction, from the highest point of each component.
fn orient(points: &[Point3<f64>], neighbours: &[Vec<u32>], normals: &mut [UnitVector3<f64>]) {
    let mut both: Vec<Vec<u32>> = neighbours.to_vec();
    for (v, near) in neighbours.iter().enumerate() {
        for w in near {
            both[*w as usize].push(v as u32);
        }
    }
    let mut highest: Vec<u32> = (0..points.len() as u32).collect();
    highest.sort_by(|a, b| points[*b as usize].z.total_cmp(&points[*a as usize].z));
    let mut done = vec![false; points.len()];
    let mut heap = BinaryHeap::new();
    for start in highest {
        if done[start as usize] {
            continue;
        }
        if normals[start as usize].z < 0.0 {
            normals[start as usize] = -normals[start as usize];
        }
        let mut reached = Some(start);
        while let Some(v) = reached {
            done[v as usize] = true;
            for &to in both[v as usize].iter().filter(|w| !done[**w as usize]) {
                let agreement = normals[v as usize].dot(&normals[to as usize]).abs();
                heap.push(Step {
                    agreement,
                    from: v,
                    to,
                });
            }
            reached = loop {
                match heap.pop() {
                    None => break None,
                    Some(step) if done[step.to as usize] => {}
                    Some(Step { from, to, .. }) => {
                        if normals[from as usize].dot(&normals[to as usize]) < 0.0 {
                            normals[to as usize] = -normals[to as usize];
                        }
                        break Some(to);
                    }
                }
            };
        }
    }
}

/// Share of pairs of near neighbours whose normals oppose; near one half, the signs are arbitrary. For large clouds a sample of points is used.
pub fn opposing_share(points: &[Point3<f64>], normals: &[UnitVector3<f64>]) -> f64 {
    /// Number of neighbours that are compared.
    const NEAR: usize = 6;
    /// Number of points whose neighbours are compared: enough for an accuracy of 0.01.
    const ENOUGH: usize = 2000;
    let step = points.len().div_ceil(ENOUGH).max(1);
    let (mut pairs, mut opposed) = (0usize, 0usize);
    for (k, near) in neighbours(points, step).iter().enumerate() {
        for w in near.iter().take(NEAR) {
            if let (Some(a), Some(b)) = (normals.get(k * step), normals.get(*w as usize)) {
                pairs += 1;
                opposed += usize::from(a.dot(b) < 0.0);
            }
        }
    }
    opposed as f64 / pairs.max(1) as f64
}
