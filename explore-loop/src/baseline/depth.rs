//! A depth map computed from a point cloud: where the ray through any point meets the surface that the camera saw.
//!
//! Fusion of depth images looks up the image at every pixel, but recordings hold clouds. The points are therefore triangulated in the image
//! plane (Delaunay, over `(x/z, y/z)`), triangles that bridge a gap of the cloud or a step in depth are dropped, and inverse depth is interpolated
//! linearly between the corners, which is exact for a flat triangle.

use crate::Error;
use crate::canonical::graph;
use crate::visibility::facing;
use nalgebra::{Point2, Point3, UnitVector3, Vector3};
use spade::{DelaunayTriangulation, HasPosition, Triangulation};

/// Number of neighbours to which a normal is fitted.
const NORMAL_NEIGHBOURS: usize = 12;
/// Longest edge of a triangle, in median edge lengths.
const LONGEST: f64 = 3.0;
/// Least cosine between the normal of a triangle and the ray: triangles seen at a flatter angle bridge a step in depth.
const LEAST_FACING: f64 = 0.12;
/// Pixels for each median edge length.
const FINE: f64 = 5.0;
/// No triangle.
const NONE: u32 = u32::MAX;
/// Most pixels of the map: a stray point far away must not make a gigapixel image.
const MOST: f64 = 16e6;

/// Where a ray meets the surface.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Hit {
    pub point: Point3<f64>,
    pub normal: UnitVector3<f64>,
}

/// The surface seen in one frame.
pub(crate) struct DepthMap {
    points: Vec<Point3<f64>>,
    normals: Vec<UnitVector3<f64>>,
    triangles: Vec<[u32; 3]>,
    low: Point2<f64>,
    bin: f64,
    size: [usize; 2],
    cover: Vec<u32>,
    tree: graph::Tree,
}

struct Ray {
    at: spade::Point2<f64>,
    point: u32,
}

impl HasPosition for Ray {
    type Scalar = f64;
    fn position(&self) -> spade::Point2<f64> {
        self.at
    }
}

impl DepthMap {
    /// Builds the map of a cloud in the camera frame; `None` when no triangle can be drawn through the points.
    ///
    /// # Errors
    /// Those of the estimation of the normals.
    pub fn new(cloud: &[Point3<f64>]) -> Result<Option<Self>, Error> {
        let usable = |p: &&Point3<f64>| p.coords.iter().all(|x| x.is_finite()) && p.z > 1e-6;
        let points: Vec<Point3<f64>> = cloud.iter().filter(usable).copied().collect();
        let Some(tree) = graph::tree(&points).filter(|_| points.len() >= NORMAL_NEIGHBOURS) else {
            return Ok(None);
        };
        let normals =
            nonrigid_reg::estimate_normals(&points, NORMAL_NEIGHBOURS, &Point3::origin())?;
        let (triangles, edge) = triangulate(&points);
        if triangles.is_empty() {
            return Ok(None);
        }
        let depth = points.iter().map(|p| p.z).sum::<f64>() / points.len() as f64;
        let bin = edge / (FINE * depth);
        let mut map = Self {
            low: points
                .iter()
                .map(ray)
                .fold(ray(&points[0]), |a, b| a.inf(&b)),
            bin,
            size: [0; 2],
            cover: Vec::new(),
            tree,
            points,
            normals,
            triangles,
        };
        let high = map.points.iter().map(ray).fold(map.low, |a, b| a.sup(&b));
        let extent = (high - map.low) / bin;
        if (extent.x + 1.0) * (extent.y + 1.0) > MOST {
            return Ok(None);
        }
        map.size = [extent.x as usize + 1, extent.y as usize + 1];
        map.rasterise();
        Ok(Some(map))
    }

    /// Where the ray through `x` meets the surface, if the camera saw any there.
    pub fn at(&self, x: &Point3<f64>) -> Option<Hit> {
        if x.z <= 1e-6 {
            return None;
        }
        let at = ray(x);
        let pixel = (at - self.low) / self.bin;
        if pixel.x < 0.0 || pixel.y < 0.0 {
            return None;
        }
        let (i, j) = (pixel.x as usize, pixel.y as usize);
        if i >= self.size[0] || j >= self.size[1] {
            return None;
        }
        let triangle = *self
            .triangles
            .get(self.cover[j * self.size[0] + i] as usize)?;
        let parts = barycentric(&triangle.map(|v| ray(&self.points[v as usize])), &at)?;
        let mut inverse = 0.0;
        let mut normal = Vector3::zeros();
        for (v, part) in triangle.iter().zip(parts) {
            inverse += part / self.points[*v as usize].z;
            normal += self.normals[*v as usize].into_inner() * part;
        }
        Some(Hit {
            point: Point3::new(at.x, at.y, 1.0) / inverse,
            normal: UnitVector3::try_new(normal, 1e-9)?,
        })
    }

    /// The point of the cloud nearest to `x`.
    pub fn nearest(&self, x: &Point3<f64>) -> Hit {
        let (k, _) = graph::nearest(&self.tree, x);
        Hit {
            point: self.points[k],
            normal: self.normals[k],
        }
    }

    /// Records for each pixel the triangle that covers its centre.
    fn rasterise(&mut self) {
        self.cover = vec![NONE; self.size[0] * self.size[1]];
        for (t, corners) in self.triangles.iter().enumerate() {
            let corners = corners.map(|v| ray(&self.points[v as usize]));
            let low = corners[0].inf(&corners[1]).inf(&corners[2]) - self.low;
            let high = corners[0].sup(&corners[1]).sup(&corners[2]) - self.low;
            let range = |axis: usize| {
                let last = self.size[axis] - 1;
                let at = |x: f64| ((x / self.bin).max(0.0) as usize).min(last);
                at(low[axis])..=at(high[axis])
            };
            for j in range(1) {
                for i in range(0) {
                    let middle = nalgebra::Vector2::new(i as f64 + 0.5, j as f64 + 0.5);
                    let inside = barycentric(&corners, &(self.low + middle * self.bin))
                        .is_some_and(|parts| parts.iter().all(|p| *p >= 0.0));
                    if inside {
                        self.cover[j * self.size[0] + i] = t as u32;
                    }
                }
            }
        }
    }
}

/// Where the ray through a point crosses the image plane.
fn ray(p: &Point3<f64>) -> Point2<f64> {
    Point2::new(p.x / p.z, p.y / p.z)
}

/// The triangles of a cloud as the camera sees it, and the median length of their edges, m.
fn triangulate(points: &[Point3<f64>]) -> (Vec<[u32; 3]>, f64) {
    let mut plane = DelaunayTriangulation::<Ray>::new();
    let tiny = |x: f64| if x.abs() < 1e-30 { 0.0 } else { x };
    for (i, p) in points.iter().enumerate() {
        let at = ray(p);
        // Of several points on one ray only the last is kept.
        let _ = plane.insert(Ray {
            at: spade::Point2::new(tiny(at.x), tiny(at.y)),
            point: i as u32,
        });
    }
    let all: Vec<[u32; 3]> = plane
        .inner_faces()
        .map(|face| face.vertices().map(|vertex| vertex.data().point))
        .collect();
    let longest = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|v| points[v as usize]);
        (b - a).norm().max((c - b).norm()).max((a - c).norm())
    };
    let mut lengths: Vec<f64> = all.iter().map(longest).collect();
    lengths.sort_by(f64::total_cmp);
    let Some(median) = lengths.get(lengths.len() / 2).copied() else {
        return (Vec::new(), 0.0);
    };
    let faces = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|v| points[v as usize]);
        let normal = UnitVector3::try_new((b - a).cross(&(c - a)), 1e-300);
        normal.is_some_and(|n| facing(&a, &n, &Point3::origin()).abs() > LEAST_FACING)
    };
    let kept = all
        .into_iter()
        .filter(|t| longest(t) <= LONGEST * median && faces(t))
        .collect();
    (kept, median)
}

/// The barycentric coordinates of a place in the image; `None` in a triangle without area.
fn barycentric([a, b, c]: &[Point2<f64>; 3], at: &Point2<f64>) -> Option<[f64; 3]> {
    let (u, v, w) = (b - a, c - a, at - a);
    let area = u.perp(&v);
    if area.abs() < 1e-18 {
        return None;
    }
    let (s, t) = (w.perp(&v) / area, u.perp(&w) / area);
    Some([1.0 - s - t, s, t])
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
pub(super) mod tests {
    use super::*;

    /// What the camera sees of a ball.
    pub fn ball(centre: &Point3<f64>, radius: f64) -> Vec<Point3<f64>> {
        let count = 6000;
        let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
        (0..count)
            .map(|k| {
                let z = 1.0 - 2.0 * (f64::from(k) + 0.5) / f64::from(count);
                let (sin, cos) = (golden * f64::from(k)).sin_cos();
                let r = (1.0 - z * z).sqrt();
                Vector3::new(r * cos, r * sin, z)
            })
            .filter(|n| n.dot(&(centre + n * radius).coords) < 0.0)
            .map(|n| centre + n * radius)
            .collect()
    }

    /// Between its points the depth map of a ball is the ball, to the sagitta of a triangle.
    #[test]
    fn a_depth_map_is_the_surface_along_every_ray() {
        let (centre, radius) = (Point3::new(0.0, 0.0, 0.5), 0.05);
        let depth = DepthMap::new(&ball(&centre, radius)).unwrap().unwrap();
        let mut hits = 0;
        for k in 0..1000 {
            let (x, y) = (
                f64::from(k % 32) / 16.0 - 1.0,
                f64::from(k / 32) / 16.0 - 1.0,
            );
            let behind = Point3::new(0.05 * x, 0.05 * y, 0.6);
            let Some(hit) = depth.at(&behind) else {
                continue;
            };
            hits += 1;
            assert!(((hit.point - centre).norm() - radius).abs() < 1e-4);
            assert!(hit.point.coords.cross(&behind.coords).norm() < 1e-12);
            assert!(hit.normal.dot(&((hit.point - centre) / radius)) > 0.98);
        }
        assert!(hits > 500);
        assert!(depth.at(&Point3::new(0.3, 0.0, 0.5)).is_none());
    }
}
