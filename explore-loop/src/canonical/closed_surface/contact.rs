//! Parts that only touch are parted.
//!
//! Two fingers that touch are one surface to the grid: a neck joins them, and with the material between their roots it makes a handle. A
//! crease runs all around the neck ([`super::crease`]), which a handle of the object does not have. There the mesh is cut, and each side
//! is closed by a cap: the wall that faces the other part. A wall must have been seen like any other surface before the object counts as
//! closed; only one so small that nothing of it lies beyond the reach of the points around it need not.
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

/// Cuts the mesh at contacts, the most creased first; the loop around each.
pub(super) fn part(mesh: &mut Corners, options: &ClosedSurfaceOptions) -> Vec<Vec<Point3<f64>>> {
    let keep = match options.genus {
        Genus::Any => 0,
        Genus::Exactly(handles) => handles,
    };
    let mut contacts = Vec::new();
    while mesh.handles() > keep {
        let creased = crease::most_creased(mesh, options.spacing);
        let Some((_, around)) = creased.filter(|(angle, around)| {
            *angle > options.contact && length(mesh, around) < LONGEST * options.spacing
        }) else {
            break;
        };
        let Some(parted) =
            handles::cut_along(mesh, &around).filter(|m| m.handles() < mesh.handles())
        else {
            break;
        };
        let places = around.iter().map(|&c| mesh.place(mesh.from(c)));
        contacts.push(places.collect());
        *mesh = parted;
    }
    contacts
}

fn length(mesh: &Corners, around: &[u32]) -> f64 {
    around.iter().map(|&c| mesh.length(c)).sum()
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
            let sum: Vector3<f64> = contact.iter().map(|p| p.coords).sum();
            let middle = Point3::from(sum / contact.len().max(1) as f64);
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
            let near = (a + 1..places.len()).filter(|&b| (places[b] - place).norm() < reach);
            let near: Vec<usize> = near.collect();
            if near.is_empty() {
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
