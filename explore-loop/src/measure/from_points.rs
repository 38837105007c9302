//! A closed surface through the points of a ground truth without triangles.

use super::{MeasureError, TrueSurface};
use crate::canonical::graph;
use nalgebra::Point3;

impl TrueSurface {
    /// A surface through the points of a true surface whose triangles were not recorded: normals by principal components,
    /// oriented consistently over nearest neighbours, starting at the point nearest to the camera; local triangulation; remaining
    /// gaps filled with triangles of least area.
    ///
    /// **Guarantees**: no edge has more than two triangles, and they have the same orientation.
    ///
    /// **Limits**: the points must be dense compared with the curvature of the surface and the distance of its parts. Whether the result
    /// is closed can be seen from [`MeshReport`](super::MeshReport).
    ///
    /// # Errors
    /// Fewer than four points, or points that do not define a surface.
    pub fn from_points(points: &[Point3<f64>]) -> Result<Self, MeasureError> {
        let normals = consistent_normals(points)?;
        let mut triangles =
            crate::canonical::surface::triangulate(points, &normals, 1.6 * median_spacing(points));
        super::gaps::close(points, &mut triangles);
        if triangles.is_empty() {
            return Err(no_surface(points.len(), "no triangle can be formed"));
        }
        Ok(Self {
            vertices: points.to_vec(),
            triangles,
        })
    }
}

/// Median distance to the third nearest neighbour: robust where vertices are paired.
fn median_spacing(points: &[Point3<f64>]) -> f64 {
    let Some(tree) = graph::tree(points) else {
        return 0.0;
    };
    let mut distances: Vec<f64> = points
        .iter()
        .filter_map(|p| {
            graph::near(&tree, p, f64::INFINITY, 4)
                .last()
                .map(|(_, d)| *d)
        })
        .collect();
    distances.sort_by(f64::total_cmp);
    distances.get(distances.len() / 2).copied().unwrap_or(0.0)
}

/// Principal-component normals, oriented outward from the point nearest to the camera along the strongest links first.
fn consistent_normals(
    points: &[Point3<f64>],
) -> Result<Vec<nalgebra::UnitVector3<f64>>, MeasureError> {
    let mut normals = nonrigid_reg::estimate_normals(points, 9, &Point3::origin())
        .map_err(|e| no_surface(points.len(), &e.to_string()))?;
    let tree = graph::tree(points).ok_or_else(|| no_surface(0, "there are no points"))?;
    let root = (0..points.len())
        .min_by(|a, b| points[*a].z.total_cmp(&points[*b].z))
        .unwrap_or(0);
    let mut done = vec![false; points.len()];
    done[root] = true;
    // A link is stronger the more parallel its normals are, so sharp edges are crossed last.
    let mut links = std::collections::BTreeSet::new();
    let leave = |i: usize,
                 done: &[bool],
                 normals: &[nalgebra::UnitVector3<f64>],
                 links: &mut std::collections::BTreeSet<(u64, usize, usize)>| {
        for (j, _) in graph::near(&tree, &points[i], f64::INFINITY, 9) {
            if !done[j] {
                let weakness = 1.0 - normals[i].dot(&normals[j]).abs();
                links.insert(((weakness * 1e9) as u64, i, j));
            }
        }
    };
    leave(root, &done, &normals, &mut links);
    while let Some((_, from, to)) = links.pop_first() {
        if done[to] {
            continue;
        }
        done[to] = true;
        if normals[from].dot(&normals[to]) < 0.0 {
            normals[to] = -normals[to];
        }
        leave(to, &done, &normals, &mut links);
    }
    Ok(normals)
}

fn no_surface(count: usize, reason: &str) -> MeasureError {
    MeasureError::NoSurface {
        count,
        reason: reason.into(),
    }
}
