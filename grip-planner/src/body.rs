//! The body as an obstacle: a ball about every vertex, in a bounding volume hierarchy.
//!
//! ```text
//! hit(a, b) = argmin_i { dist(p_i, segment ab) : dist < ρ }
//! ```
//! A part of a tool is a segment; its thickness, half a jaw, is added to the vertices. Surfaces sampled
//! more finely than that have no gaps. The hierarchy (parry) makes a query logarithmic where nothing is near, which is the usual case; a plan
//! makes a few thousand queries.

use nalgebra::{Isometry3, Point3};
use parry3d_f64::bounding_volume::Aabb;
use parry3d_f64::math::Vector;
use parry3d_f64::partitioning::{Bvh, BvhBuildStrategy};
use parry3d_f64::query::{PointQuery, Ray, RayCast};
use parry3d_f64::shape::Segment;

/// The vertices of a model, at rest.
pub(crate) struct Body {
    tree: Bvh,
    points: Vec<Vector>,
    radius: f64,
}

impl Body {
    /// `radius` is the least distance of a tool, metres.
    pub(crate) fn new(points: &[Point3<f64>], radius: f64) -> Self {
        let points: Vec<Vector> = points.iter().map(|p| p.coords.into()).collect();
        let leaves: Vec<Aabb> = points
            .iter()
            .map(|&p| Aabb::from_half_extents(p, Vector::splat(radius)))
            .collect();
        Self {
            tree: Bvh::from_leaves(BvhBuildStrategy::Binned, &leaves),
            points,
            radius,
        }
    }

    /// The vertex nearest to the segment and its distance, if it is too near; the first of equal ones.
    pub(crate) fn hit(&self, [a, b]: [Point3<f64>; 2]) -> Option<(u32, f64)> {
        let (a, b): (Vector, Vector) = (a.coords.into(), b.coords.into());
        let ray = Ray::new(a, b - a);
        let segment = Segment::new(a, b);
        self.tree
            .leaves(|node| node.aabb().cast_local_ray(&ray, 1.0, true).is_some())
            .map(|v| {
                let gap = segment.distance_to_local_point(self.points[v as usize], true);
                (v, gap)
            })
            .filter(|(_, gap)| *gap < self.radius)
            .min_by(|(v, p), (w, q)| p.total_cmp(q).then(v.cmp(w)))
    }
}

/// A tool: two segments, from the tip back along its straight part to the wrist and from there to the base of its arm.
#[derive(Clone, Copy)]
pub(crate) struct Tool {
    pub(crate) tip: Point3<f64>,
    pub(crate) wrist: Point3<f64>,
    base: Point3<f64>,
}

impl Tool {
    pub(crate) fn new(
        camera_from_tip: &Isometry3<f64>,
        base: &Point3<f64>,
        shaft_length: f64,
    ) -> Self {
        Self {
            tip: Point3::from(camera_from_tip.translation.vector),
            wrist: camera_from_tip * Point3::new(0.0, 0.0, -shaft_length),
            base: *base,
        }
    }

    /// The same tool in another frame.
    pub(crate) fn seen_from(&self, frame_from_camera: &Isometry3<f64>) -> Self {
        Self {
            tip: frame_from_camera * self.tip,
            wrist: frame_from_camera * self.wrist,
            base: frame_from_camera * self.base,
        }
    }

    /// The straight part behind the first `jaws` metres; `None` if it is not longer.
    pub(crate) fn shaft(&self, jaws: f64) -> Option<[Point3<f64>; 2]> {
        let length = (self.wrist - self.tip).norm();
        (length > jaws).then(|| {
            [
                self.tip + (self.wrist - self.tip) * (jaws / length),
                self.wrist,
            ]
        })
    }

    /// From the wrist to the base.
    pub(crate) fn link(&self) -> [Point3<f64>; 2] {
        [self.wrist, self.base]
    }

    /// Distance between the centre lines of two tools.
    pub(crate) fn distance(&self, other: &Self) -> f64 {
        use parry3d_f64::query::details::closest_points_segment_segment_with_locations_nD as closest;
        let parts = |t: &Self| -> [[Vector; 2]; 2] {
            [[t.tip, t.wrist], t.link()].map(|s| s.map(|p| p.coords.into()))
        };
        let mut least = f64::INFINITY;
        for a in parts(self) {
            for b in parts(other) {
                let (at, bt) = closest((&a[0], &a[1]), (&b[0], &b[1]));
                let gap =
                    Segment::new(a[0], a[1]).point_at(&at) - Segment::new(b[0], b[1]).point_at(&bt);
                least = least.min(gap.length());
            }
        }
        least
    }
}
