//! Triangulation of polygons by ear clipping (Meisters, *Polygons have ears*, 1975).
//!
//! A face with more than three corners may be concave: a fan from its first corner would fill its notches. The polygon is projected to the
//! plane across its vector area `½ Σ pᵢ × pᵢ₊₁` (Newell), and ears are cut off: corners whose triangle turns left and contains no other
//! corner. The roundest ear is cut first, so that corners in the middle of an edge (T-joints) give no triangles of zero area, as long
//! as there are others. Only corners of the polygon are used: neighbours that share its edges stay joined.
//!
//! *Guarantees*: `n − 2` triangles that use every edge of the polygon once. *Limits*: the result for a polygon that crosses itself is
//! arbitrary. O(n²) for `n` corners, O(n³) if it crosses itself.

use nalgebra::{Point2, Point3, Vector3};

/// Adds the triangles of a polygon; repeated successive corners count once.
pub fn triangulate(points: &[Point3<f64>], polygon: &[u32], triangles: &mut Vec<[u32; 3]>) {
    let mut corners = polygon.to_vec();
    corners.dedup();
    if corners.len() > 1 && corners.first() == corners.last() {
        corners.pop();
    }
    match corners[..] {
        [a, b, c] => keep(triangles, [a, b, c]),
        [a, b, c, d] if is_convex(points, [a, b, c, d]) => {
            keep(triangles, [a, b, c]);
            keep(triangles, [a, c, d]);
        }
        [_, _, _, ..] => Ears::new(points, corners).cut(triangles),
        _ => {}
    }
}

fn keep(triangles: &mut Vec<[u32; 3]>, t: [u32; 3]) {
    if t[0] != t[1] && t[1] != t[2] && t[2] != t[0] {
        triangles.push(t);
    }
}

/// Whether all corners of a quadrilateral turn the same way, so that either diagonal lies inside.
fn is_convex(points: &[Point3<f64>], corners: [u32; 4]) -> bool {
    let p = corners.map(|v| points[v as usize]);
    let along = (p[2] - p[0]).cross(&(p[3] - p[1]));
    (0..4).all(|k| {
        let (before, at, after) = (p[(k + 3) % 4], p[k], p[(k + 1) % 4]);
        (at - before).cross(&(after - at)).dot(&along) > 0.0
    })
}

/// The remaining corners in their plane.
struct Ears {
    corners: Vec<u32>,
    flat: Vec<Point2<f64>>,
    /// Roundness of the ear at each corner; −1 if it is not an ear.
    roundness: Vec<f64>,
}

impl Ears {
    fn new(points: &[Point3<f64>], corners: Vec<u32>) -> Self {
        let at = |k: usize| points[corners[k % corners.len()] as usize];
        let origin = at(0);
        let area: Vector3<f64> = (1..corners.len())
            .map(|k| (at(k) - origin).cross(&(at(k + 1) - origin)))
            .sum();
        // A polygon of zero area has no plane: any will do.
        let normal = area
            .try_normalize(0.0)
            .filter(|n| n.iter().all(|c| c.is_finite()));
        let normal = normal.unwrap_or(Vector3::z());
        let across = Vector3::ith(normal.iamin(), 1.0);
        let u = normal.cross(&across).normalize();
        let v = normal.cross(&u);
        let flat = (0..corners.len()).map(|k| at(k) - origin);
        let flat = flat.map(|d| Point2::new(d.dot(&u), d.dot(&v))).collect();
        let mut ears = Self {
            roundness: vec![0.0; corners.len()],
            corners,
            flat,
        };
        ears.look_again();
        ears
    }

    fn cut(mut self, triangles: &mut Vec<[u32; 3]>) {
        while self.corners.len() > 3 {
            let mut ear = self.roundest();
            if self.roundness[ear] < 0.0 {
                // Cutting may have made new ears; if not, the polygon crosses itself and any corner will do.
                self.look_again();
                ear = self.roundest();
            }
            let n = self.corners.len();
            let [before, after] = [(ear + n - 1) % n, (ear + 1) % n];
            keep(triangles, [before, ear, after].map(|k| self.corners[k]));
            self.corners.remove(ear);
            self.flat.remove(ear);
            self.roundness.remove(ear);
            let n = n - 1;
            for k in [(ear + n - 1) % n, ear % n] {
                self.roundness[k] = self.ear(k);
            }
        }
        keep(triangles, [0, 1, 2].map(|k| self.corners[k]));
    }

    fn roundest(&self) -> usize {
        let best = (0..self.roundness.len())
            .max_by(|&a, &b| self.roundness[a].total_cmp(&self.roundness[b]));
        best.unwrap_or(0)
    }

    fn look_again(&mut self) {
        self.roundness = (0..self.corners.len()).map(|k| self.ear(k)).collect();
    }

    /// Area over the square of the longest side, if the triangle at corner `k` turns left and holds no other corner.
    fn ear(&self, k: usize) -> f64 {
        let n = self.flat.len();
        let [a, b, c] = [(k + n - 1) % n, k, (k + 1) % n].map(|k| self.flat[k]);
        let area = turn(a, b, c);
        let longest = (b - a)
            .norm_squared()
            .max((c - b).norm_squared())
            .max((a - c).norm_squared());
        let inside = |p: &Point2<f64>| {
            // Another corner at the same place, as where a seam leads to a hole, does not block the ear.
            let elsewhere = *p != a && *p != b && *p != c;
            elsewhere && turn(a, b, *p) >= 0.0 && turn(b, c, *p) >= 0.0 && turn(c, a, *p) >= 0.0
        };
        if area < 0.0 || self.flat.iter().any(inside) {
            -1.0
        } else if longest > 0.0 {
            area / longest
        } else {
            0.0
        }
    }
}

/// Twice the signed area of a triangle.
fn turn(a: Point2<f64>, b: Point2<f64>, c: Point2<f64>) -> f64 {
    (b - a).perp(&(c - a))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn area(points: &[Point3<f64>], triangles: &[[u32; 3]]) -> f64 {
        let one = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|v| points[v as usize]);
            0.5 * (b - a).cross(&(c - a)).norm()
        };
        triangles.iter().map(one).sum()
    }

    fn cut(points: &[Point3<f64>]) -> Vec<[u32; 3]> {
        let mut triangles = Vec::new();
        let all: Vec<u32> = (0..points.len() as u32).collect();
        triangulate(points, &all, &mut triangles);
        triangles
    }

    #[test]
    fn a_notch_stays_open_from_either_side() {
        let u = [
            (0., 0.),
            (10., 0.),
            (10., 8.),
            (7., 8.),
            (7., 2.),
            (3., 2.),
            (3., 8.),
            (0., 8.),
        ];
        let mut points: Vec<_> = u.iter().map(|(x, y)| Point3::new(*x, *y, 1.0)).collect();
        for _ in 0..2 {
            let triangles = cut(&points);
            assert_eq!(triangles.len(), 6);
            assert!((area(&points, &triangles) - 56.0).abs() < 1e-9);
            points.reverse();
        }
    }

    #[test]
    fn corners_within_an_edge_make_no_flat_triangle() {
        let square = [(0., 0.), (1., 0.), (2., 0.), (3., 0.), (3., 3.), (0., 3.)];
        let points: Vec<_> = square
            .iter()
            .map(|(x, y)| Point3::new(*x, 0.0, *y))
            .collect();
        for t in cut(&points) {
            assert!(area(&points, &[t]) > 0.1, "{t:?}");
        }
    }

    #[test]
    fn two_corners_are_no_polygon() {
        let mut triangles = Vec::new();
        for polygon in [&[][..], &[1], &[1, 2], &[1, 2, 1], &[1, 1, 2, 2]] {
            triangulate(&[Point3::origin(); 3], polygon, &mut triangles);
        }
        assert!(triangles.is_empty());
    }

    proptest! {
        // A star around the origin: its area is the sum of its sectors, for any shape.
        #[test]
        fn stars_keep_their_area_and_their_edges(
            radii in prop::collection::vec(0.2..1.0f64, 4..40), tilt in prop::array::uniform3(-1.0..1.0f64),
        ) {
            let n = radii.len();
            let turn = nalgebra::Rotation3::new(tilt.into());
            let spoke = |k: usize| {
                let a = std::f64::consts::TAU * k as f64 / n as f64;
                turn * Point3::new(radii[k % n] * a.cos(), radii[k % n] * a.sin(), 0.3)
            };
            let points: Vec<_> = (0..n).map(spoke).collect();
            let triangles = cut(&points);
            prop_assert_eq!(triangles.len(), n - 2);
            let sector = 0.5 * (std::f64::consts::TAU / n as f64).sin();
            let expected: f64 = (0..n).map(|k| sector * radii[k] * radii[(k + 1) % n]).sum();
            prop_assert!((area(&points, &triangles) - expected).abs() < 1e-9);
            let edges: Vec<_> = triangles.iter().flat_map(|t| [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])]).collect();
            for k in 0..n as u32 {
                prop_assert_eq!(edges.iter().filter(|e| **e == (k, (k + 1) % n as u32)).count(), 1);
            }
        }

        // All corners are used up, wherever they are.
        #[test]
        fn any_polygon_ends(points in prop::collection::vec(prop::array::uniform3(-1i8..2), 3..12)) {
            let points: Vec<_> = points.iter().map(|p| Point3::from(p.map(f64::from))).collect();
            prop_assert_eq!(cut(&points).len(), points.len() - 2);
        }
    }
}
