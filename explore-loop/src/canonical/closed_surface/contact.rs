//! Separates parts that only touch.
//!
//! Two fingers that touch are one surface to the grid: a neck joins them, and with the material between their roots it makes a handle. All around
//! the neck runs a crease ([`super::crease`]). A handle that has grown onto a body sharply has one, too; what tells them apart is what lies within
//! the neck. Where the parts have been seen apart, there are points of the walls that faced each other:
//!
//! ```text
//! p is of a wall  ⇔  |(p − m)·a| < ε,   ‖(p − m) − ((p − m)·a) a‖ < r − ε,   |n·a| > 0.7
//! ```
//! with the middle `m`, the unit vector area `a` and the smallest radius `r` of the loop around the neck. A camera from above hardly sees them; it sees the
//! parts move apart. A pair of points that did so tells as much as a point of a wall, if the line between them crosses the fan of the loop. With enough of both
//! the mesh is cut along the loop, and each side is closed by a cap, which has to have support like any other surface. Without them the handle stays, and the
//! surface does not count as closed.

use super::corners::Corners;
use super::{ClosedSurfaceOptions, crease, handles};
use crate::canonical::genus::Genus;
use nalgebra::{Point3, UnitVector3, Vector3};

/// Longest loop around a contact, in spacings: a fan closes what is about flat.
const LONGEST: f64 = 20.0;

/// Least cosine between the normal of a point of a wall and the axis of the neck.
const ACROSS: f64 = 0.7;

/// Cuts the mesh at contacts whose walls were seen, the most creased first; the loop around each.
pub(super) fn separate(
    mesh: &mut Corners,
    points: &[Point3<f64>],
    normals: &[UnitVector3<f64>],
    options: &ClosedSurfaceOptions,
) -> Vec<Vec<Point3<f64>>> {
    let keep = match options.genus {
        Genus::Any => 0,
        Genus::Exactly(handles) => handles,
    };
    let mut contacts = Vec::new();
    while mesh.handles() > keep {
        let creased = crease::creased_loops(mesh, options.spacing);
        let cut = creased.iter().find_map(|(angle, around)| {
            let places = || around.iter().map(|&c| mesh.place(mesh.from(c)));
            let neck = Neck::new(places().collect())?;
            (*angle > options.contact
                && neck.length() < LONGEST * options.spacing
                && neck.wall_points(points, normals, options.spacing)
                    + neck.parted(&options.parted)
                    >= options.wall_points)
                .then(|| handles::cut_along(mesh, around))?
                .filter(|cut| cut.handles() < mesh.handles())
                .map(|cut| (cut, neck.around))
        });
        let Some((cut, around)) = cut else {
            break;
        };
        contacts.push(around);
        *mesh = cut;
    }
    contacts
}

/// The loop around a contact.
struct Neck {
    around: Vec<Point3<f64>>,
    middle: Point3<f64>,
    axis: UnitVector3<f64>,
}

impl Neck {
    /// `None` for a loop that encloses no area.
    fn new(around: Vec<Point3<f64>>) -> Option<Self> {
        let middle = middle(&around);
        let edges = around.iter().zip(around.iter().cycle().skip(1));
        let area: Vector3<f64> = edges.map(|(p, q)| (p - middle).cross(&(q - middle))).sum();
        Some(Self {
            axis: UnitVector3::try_new(area, 0.0)?,
            middle,
            around,
        })
    }

    fn length(&self) -> f64 {
        let edges = self.around.iter().zip(self.around.iter().cycle().skip(1));
        edges.map(|(p, q)| (q - p).norm()).sum()
    }

    /// How many of the pairs lie on different sides of the neck.
    fn parted(&self, pairs: &[[Point3<f64>; 2]]) -> usize {
        let around: Vec<_> = self.around.iter().map(|p| p.coords).collect();
        let fan = fan(&around);
        let crossed = pairs.iter().filter(|[p, q]| {
            let (start, way) = (p.coords, q - p);
            fan.iter().any(|triangle| crosses(triangle, &start, &way))
        });
        crossed.count()
    }

    fn aside(&self, p: &Point3<f64>) -> f64 {
        (p - self.middle).cross(&self.axis).norm()
    }

    /// How many points lie within the neck and face along its axis.
    fn wall_points(
        &self,
        points: &[Point3<f64>],
        normals: &[UnitVector3<f64>],
        spacing: f64,
    ) -> usize {
        let sides = self.around.iter().map(|p| self.aside(p));
        let radius = sides.fold(f64::INFINITY, f64::min);
        let of_wall = |(p, n): &(&Point3<f64>, &UnitVector3<f64>)| {
            (*p - self.middle).dot(&self.axis).abs() < spacing
                && self.aside(p) < radius - spacing
                && n.dot(&self.axis).abs() > ACROSS
        };
        points.iter().zip(normals).filter(of_wall).count()
    }
}

fn middle(around: &[Point3<f64>]) -> Point3<f64> {
    let sum: Vector3<f64> = around.iter().map(|p| p.coords).sum();
    Point3::from(sum / around.len().max(1) as f64)
}

/// How far a fan extends beyond its loop, relative to the distance from the middle: what crosses the neck on its surface passes just outside of the loop.
const BEYOND: f64 = 1.2;

/// The triangles between the middle of a loop and its edges, a little wider than the loop.
pub(crate) fn fan(around: &[Vector3<f64>]) -> Vec<[Vector3<f64>; 3]> {
    let middle = around.iter().sum::<Vector3<f64>>() / around.len().max(1) as f64;
    let wider = |p: &Vector3<f64>| middle + (p - middle) * BEYOND;
    let next = around.iter().cycle().skip(1);
    let edges = around.iter().zip(next);
    edges.map(|(p, q)| [middle, wider(p), wider(q)]).collect()
}

/// Whether the segment from `start` along `way` meets a triangle.
pub(crate) fn crosses(
    [a, b, c]: &[Vector3<f64>; 3],
    start: &Vector3<f64>,
    way: &Vector3<f64>,
) -> bool {
    let (u, v, offset) = (b - a, c - a, start - a);
    let normal = u.cross(&v);
    let slope = normal.dot(way);
    // Signed volumes; a parallel segment has slope 0 and meets nothing.
    let time = -normal.dot(&offset) / slope;
    let along = way.cross(&offset);
    let (s, t) = (v.dot(&along) / slope, -u.dot(&along) / slope);
    (0.0..1.0).contains(&time) && s >= 0.0 && t >= 0.0 && s + t <= 1.0
}

#[cfg(test)]
mod tests {
    use super::{Vector3, crosses};
    use proptest::prelude::*;

    proptest! {
        /// A segment through a point of a triangle meets it; the same segment beside the triangle, or ending before it, does not.
        #[test]
        fn a_segment_meets_the_triangle_it_was_drawn_through(
            corners in prop::array::uniform9(-1.0..1.0f64), w in prop::array::uniform2(0.05..0.9f64), way in prop::array::uniform3(-1.0..1.0f64), before in 0.05..0.95f64,
        ) {
            let triangle = [0, 3, 6].map(|k| Vector3::new(corners[k], corners[k + 1], corners[k + 2]));
            let [a, b, c] = triangle;
            let normal = (b - a).cross(&(c - a));
            let way = Vector3::from(way);
            prop_assume!(normal.norm() > 0.05 && normal.normalize().dot(&way).abs() > 0.05);
            let (v, w) = (w[0] * (1.0 - w[1]), w[1] * 0.95);
            prop_assume!(v + w < 0.98);
            let inside = a + (b - a) * v + (c - a) * w;
            prop_assert!(crosses(&triangle, &(inside - way * before), &way));
            prop_assert!(!crosses(&triangle, &(inside - way * (before + 1.0)), &way));
            prop_assert!(!crosses(&triangle, &(inside + way * 0.01), &way));
            let beside = a + (b - a) * 1.1 + (c - a) * w;
            prop_assert!(!crosses(&triangle, &(beside - way * before), &way));
        }
    }
}
