//! Separates parts that only touch.
//!
//! Two fingers that touch are one surface to the grid: a neck joins them, and with the material between their roots it makes a handle. All around
//! the neck runs a crease ([`super::crease`]). A handle that has grown onto a body sharply has one, too; what tells them apart is what lies within
//! the neck. Where the parts have been seen apart, there are points of the walls that faced each other:
//!
//! ```text
//! p is of a wall  ⇔  |(p − m)·a| < ε,   ‖(p − m) − ((p − m)·a) a‖ < r − ε,   |n·a| > 0.7
//! ```
//! with the middle `m`, the unit vector area `a` and the smallest radius `r` of the loop around the neck. With two such points the mesh is cut
//! along the loop, and each side is closed by a cap, which has to have support like any other surface. Without them the handle stays, and the
//! surface does not count as closed.

use super::corners::Corners;
use super::{ClosedSurfaceOptions, crease, handles};
use crate::canonical::genus::Genus;
use nalgebra::{Point3, UnitVector3, Vector3};

/// Longest loop around a contact, in spacings: a fan closes what is about flat.
const LONGEST: f64 = 20.0;

/// Least cosine between the normal of a point of a wall and the axis of the neck.
const ACROSS: f64 = 0.7;
/// Fewest points of walls that show that two parts were apart: one may be a stray.
const WALL_POINTS: usize = 2;

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
                && neck.wall_points(points, normals, options.spacing) >= WALL_POINTS)
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
