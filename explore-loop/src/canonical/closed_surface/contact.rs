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
//!
//! ```text
//! glue = { (p, q) :  ‖p − q‖ < reach,   way along the mesh > 2 reach }          among the points around the contact
//! ```
//! are the pairs that a complex of points must not join: near in space and far along the surface.

use super::corners::Corners;
use super::support::nearest_facing;
use super::{ClosedSurface, ClosedSurfaceOptions, crease, handles};
use crate::canonical::genus::Genus;
use nalgebra::{Point3, UnitVector3, Vector3};
use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap};

/// Longest loop around a contact, in spacings: a fan closes what is about flat.
const LONGEST: f64 = 20.0;
/// Least way along the mesh between what only touches, in reaches.
const FAR: f64 = 2.0;

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

pub(super) fn middle(around: &[Point3<f64>]) -> Point3<f64> {
    let sum: Vector3<f64> = around.iter().map(|p| p.coords).sum();
    Point3::from(sum / around.len().max(1) as f64)
}

impl ClosedSurface {
    /// Pairs of points on the surface, by index, that are within `reach` of each other, m, but more than twice as far along it: across a contact.
    pub(crate) fn glue(
        &self,
        points: &[Point3<f64>],
        normals: &[UnitVector3<f64>],
        reach: f64,
    ) -> Vec<[u32; 2]> {
        let mut around: Vec<u32> = Vec::new();
        for contact in &self.contacts {
            let middle = middle(contact);
            let radius = contact
                .iter()
                .map(|p| (p - middle).norm())
                .fold(0.0, f64::max);
            let near = |&i: &u32| (points[i as usize] - middle).norm() < radius + 2.0 * reach;
            around.extend((0..points.len() as u32).filter(near));
        }
        around.sort_unstable();
        around.dedup();
        let places: Vec<_> = around.iter().map(|&i| points[i as usize]).collect();
        let facing: Vec<_> = around.iter().map(|&i| normals[i as usize]).collect();
        let on = nearest_facing(
            &places,
            &facing,
            &self.vertices,
            &self.normals,
            self.spacing,
        );
        let neighbours = self.neighbours();
        let mut glue = Vec::new();
        for (a, place) in places.iter().enumerate() {
            let near: Vec<usize> = (a + 1..places.len())
                .filter(|&b| (places[b] - place).norm() < reach)
                .filter(|&b| on[b].0 != u32::MAX)
                .collect();
            if near.is_empty() || on[a].0 == u32::MAX {
                continue;
            }
            let ways = self.ways(&neighbours, on[a].0, FAR * reach);
            let apart = near.into_iter().filter(|&b| !ways.contains_key(&on[b].0));
            glue.extend(apart.map(|b| [around[a], around[b]]));
        }
        glue
    }

    fn neighbours(&self) -> Vec<Vec<u32>> {
        let mut neighbours = vec![Vec::new(); self.vertices.len()];
        for [a, b, c] in &self.triangles {
            for (from, to) in [(a, b), (b, c), (c, a)] {
                neighbours[*from as usize].push(*to);
            }
        }
        neighbours
    }

    /// Lengths of the shortest ways along the edges from a vertex to those within `limit`.
    fn ways(&self, neighbours: &[Vec<u32>], from: u32, limit: f64) -> BTreeMap<u32, f64> {
        let mut ways = BTreeMap::new();
        // Lengths are not negative: their bits are in order.
        let mut front = BinaryHeap::from([Reverse((0u64, from))]);
        while let Some(Reverse((bits, v))) = front.pop() {
            let Some(beside) = neighbours
                .get(v as usize)
                .filter(|_| !ways.contains_key(&v))
            else {
                continue;
            };
            let way = f64::from_bits(bits);
            ways.insert(v, way);
            for &w in beside {
                let further = way + (self.vertices[w as usize] - self.vertices[v as usize]).norm();
                if further <= limit && !ways.contains_key(&w) {
                    front.push(Reverse((further.to_bits(), w)));
                }
            }
        }
        ways
    }
}
