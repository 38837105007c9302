//! The target cloud with its search tree. Kept from frame to frame while the cloud stays the same.

use gpwrm::Tree;
use nalgebra::{Point3, UnitVector3};

use crate::cloud::{Cloud, denoised, is_boundary};
use crate::error::Error;
use crate::options::Options;

/// Number of neighbours that decide whether a point lies on the boundary.
const BOUNDARY_NEIGHBOURS: usize = 12;

/// What is computed from the neighbourhood of a target point.
#[derive(Clone, Copy)]
pub(crate) struct Place {
    /// The point with reduced noise across the surface.
    pub point: Point3<f64>,
    /// Whether it is a boundary point.
    pub on_boundary: bool,
}

/// A cloud and its search tree.
pub struct Target {
    points: Vec<Point3<f64>>,
    normals: Vec<UnitVector3<f64>>,
    tree: Tree,
    places: Vec<Option<Place>>,
    boundary_angle: f64,
    denoise: usize,
}

impl std::fmt::Debug for Target {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Target")
            .field("points", &self.points.len())
            .finish_non_exhaustive()
    }
}

impl Target {
    pub(crate) fn new(cloud: &Cloud, options: &Options) -> Result<Self, Error> {
        Ok(Self {
            points: cloud.points.to_vec(),
            normals: cloud.normals.to_vec(),
            tree: Tree::new(cloud.points).map_err(|_| Error::EmptyCloud { cloud: "target" })?,
            places: vec![None; cloud.points.len()],
            boundary_angle: options.boundary_angle,
            denoise: options.denoise,
        })
    }

    /// Whether this was made from the same cloud.
    pub(crate) fn is_of(&self, cloud: &Cloud) -> bool {
        self.points == cloud.points && self.normals == cloud.normals
    }

    /// Positions, in m.
    pub fn points(&self) -> &[Point3<f64>] {
        &self.points
    }

    /// Unit normals, one per point.
    pub fn normals(&self) -> &[UnitVector3<f64>] {
        &self.normals
    }

    /// Index and squared distance (m²) of the point nearest to `p`; `None` if `p` is not finite. `O(log n)`.
    pub fn nearest(&self, p: &Point3<f64>) -> Option<(usize, f64)> {
        self.tree.nearest(p).map(|hit| (hit.index, hit.squared))
    }

    /// Indices and squared distances (m²) of the `count` nearest, nearest first. `O(log n + count)`.
    pub fn nearest_n(&self, p: &Point3<f64>, count: usize) -> Vec<(usize, f64)> {
        let hits = self.tree.nearest_n(p, count.min(self.points.len()));
        hits.iter().map(|hit| (hit.index, hit.squared)).collect()
    }

    /// Computed once per point, and only for points that are matched.
    pub(crate) fn place(&mut self, index: usize) -> Place {
        if let Some(known) = self.places[index] {
            return known;
        }
        let cloud = Cloud {
            points: &self.points,
            normals: &self.normals,
        };
        let wanted = BOUNDARY_NEIGHBOURS.max(self.denoise) + 1;
        let near = self
            .tree
            .nearest_n(&self.points[index], wanted.min(self.points.len()));
        let around = &near[..near.len().min(BOUNDARY_NEIGHBOURS + 1)];
        let place = Place {
            point: denoised(&cloud, index, &near[..near.len().min(self.denoise + 1)]),
            on_boundary: is_boundary(&cloud, around, index, self.boundary_angle),
        };
        self.places[index] = Some(place);
        place
    }
}
