//! The pose of the body: live nodes and the rotation of every cell, forward and inverse map.
//!
//! ```text
//! R_c = argmin_R ‖F_c − R‖             F_c: gradient of the deformation at the centre of the cell (polar factor)
//! x(e) = Σ_k w_k x_{c,k}               forward
//! x(c, ξ) = p  solved for ξ            inverse, by Newton's method in the few cells that may hold p
//! n = F⁻ᵀ n₀ / ‖F⁻ᵀ n₀‖                normals
//! ```

use nalgebra::{Matrix3, Point3, Rotation3, UnitVector3, Vector3};

use super::elastic::{self, Elements};
use super::lattice::{Embedding, Lattice};
use super::options::BodyOptions;
use crate::rotation::nearest_rotation;

/// Newton iterations of the inverse map.
const INVERSE_STEPS: usize = 5;
/// Largest distance of a point outside of a cell for the inverse map, in cells.
const OUTSIDE: f64 = 0.8;
/// Largest distance of a point from the material of a piece that contains it, in cells.
const NEAR: f64 = 0.15;
/// Ratio of volumes below which the map counts as folded: its gradient does not define the normal.
const FOLDED: f64 = 0.05;
/// Number of cells that move a new node.
const CARRIERS: usize = 4;

/// The positions of the nodes of a [`Lattice`] at one moment, and the rotations of its cells.
///
/// Methods panic if the pose has fewer nodes or cells than the given lattice.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Pose {
    /// Live positions of the nodes, m.
    pub live: Vec<Point3<f64>>,
    /// Rotation from rest to live of every cell.
    pub turns: Vec<Rotation3<f64>>,
}

/// A live point mapped to rest.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct AtRest {
    /// Rest position.
    pub position: Point3<f64>,
    /// Gradient of the deformation there, rest to live.
    pub gradient: Matrix3<f64>,
    /// The cell whose map was used.
    pub cell: u32,
    /// Distance of the point outside of that cell, in cells.
    pub outside: f64,
}

impl Pose {
    /// The body at rest.
    pub fn at_rest(lattice: &Lattice) -> Self {
        Self {
            live: lattice.rest().to_vec(),
            turns: vec![Rotation3::identity(); lattice.cells().len()],
        }
    }

    /// Fits the rotation of every cell to its corners: the polar factor of the gradient at its centre.
    ///
    /// # Complexity
    /// Linear in the number of cells.
    ///
    /// ```
    /// use topo_ekf::body::{Lattice, Pose};
    /// use topo_ekf::nalgebra::{Point3, Rotation3, Vector3};
    /// let mut lattice = Lattice::new(0.016, Point3::origin(), Rotation3::identity());
    /// lattice.ensure([0, 0, 0]);
    /// lattice.ensure([1, 0, 0]);
    /// let mut pose = Pose::at_rest(&lattice);
    /// let turn = Rotation3::new(Vector3::new(0.0, 0.5, 1.0));
    /// pose.live = lattice.rest().iter().map(|p| turn * p).collect();
    /// pose.fit_turns(&lattice);
    /// assert!(pose.turns.iter().all(|found| (found.matrix() - turn.matrix()).norm() < 1e-9));
    /// ```
    pub fn fit_turns(&mut self, lattice: &Lattice) {
        self.turns
            .resize(lattice.cells().len(), Rotation3::identity());
        for (cell, turn) in self.turns.iter_mut().enumerate() {
            let gradient = lattice.central_gradient(&self.live, cell as u32);
            *turn = nearest_rotation(&gradient, turn);
        }
    }

    /// Adds the nodes and cells that the lattice has gained: at the position of the node that they were split from, else moved rigidly with the four
    /// nearest cells.
    ///
    /// # Complexity
    /// New nodes times cells.
    pub fn extend(&mut self, lattice: &Lattice) {
        if self.live.len() == lattice.rest().len() && self.turns.len() == lattice.cells().len() {
            return;
        }
        let known = self.live.len();
        let carriers: Vec<u32> = (0..lattice.cells().len() as u32)
            .filter(|&c| {
                let nodes = &lattice.cells()[c as usize].nodes;
                nodes.iter().all(|&n| (n as usize) < known)
            })
            .collect();
        let frames: Vec<(Point3<f64>, Point3<f64>, Rotation3<f64>)> = carriers
            .iter()
            .map(|&c| {
                let gradient = lattice.gradient(&self.live, c, &[0.5; 3]);
                (
                    lattice.rest_centre(c),
                    lattice.centre(&self.live, c),
                    nearest_rotation(&gradient, &Rotation3::identity()),
                )
            })
            .collect();
        for node in known..lattice.rest().len() {
            let parent = lattice.parent(node as u32).map(|p| self.live[p as usize]);
            let place = parent.unwrap_or_else(|| carried(&lattice.rest()[node], &frames));
            self.live.push(place);
        }
        self.fit_turns(lattice);
    }

    /// Elastic energy of the pose with its present rotations, in units of the data ([`BodyOptions::stiffness`]).
    ///
    /// # Complexity
    /// Linear in the number of cells.
    pub fn energy(&self, lattice: &Lattice, options: &BodyOptions) -> f64 {
        let elements = Elements::new(lattice, options.poisson_ratio);
        elastic::energy(&elements, lattice, self, options.stiffness)
    }

    /// Elastic forces on the nodes, in units of the energy per metre: minus the gradient of [`Self::energy`] with fixed rotations. If
    /// the rotations follow the nodes ([`Self::fit_turns`]) the gradient differs by a term of second order in the strain.
    ///
    /// # Complexity
    /// Linear in the number of cells.
    pub fn forces(&self, lattice: &Lattice, options: &BodyOptions) -> Vec<Vector3<f64>> {
        let elements = Elements::new(lattice, options.poisson_ratio);
        elastic::forces(&elements, lattice, self, options.stiffness)
    }

    /// Live position of an embedded point.
    pub fn position(&self, lattice: &Lattice, at: &Embedding) -> Point3<f64> {
        lattice.warp(&self.live, at)
    }

    /// Live normal of an embedded point: `F⁻ᵀ n`, normalised; where the map is folded, `n` rotated with the cell.
    pub fn normal(
        &self,
        lattice: &Lattice,
        at: &Embedding,
        rest_normal: &UnitVector3<f64>,
    ) -> UnitVector3<f64> {
        let gradient = lattice.gradient(&self.live, at.cell, &at.xi);
        let cofactor = gradient
            .try_inverse()
            .filter(|_| gradient.determinant() > FOLDED)
            .map_or(*self.turns[at.cell as usize].matrix(), |i| i.transpose());
        UnitVector3::new_normalize(cofactor * rest_normal.into_inner())
    }

    /// Maps a live point to rest through the best of the candidate cells; `None` if it is more than 0.8 cells outside of all of
    /// them. Where material is divided (`Lattice::set_pieces`), a point must also be within 0.15 cells of the cell's own material.
    ///
    /// ```
    /// use topo_ekf::body::{Lattice, Pose};
    /// use topo_ekf::nalgebra::{Isometry3, Point3, Rotation3, Vector3};
    /// # let mut lattice = Lattice::new(0.016, Point3::origin(), Rotation3::identity());
    /// # lattice.ensure([0, 0, 0]);
    /// # lattice.ensure([1, 0, 0]);
    /// let motion = Isometry3::new(Vector3::new(0.1, 0.0, 0.2), Vector3::new(0.0, 0.5, 1.0));
    /// let mut pose = Pose::at_rest(&lattice);
    /// pose.live = lattice.rest().iter().map(|p| motion * p).collect();
    /// pose.fit_turns(&lattice);
    /// let rest = Point3::new(0.020, 0.004, 0.008); // in the second cell
    /// let found = pose.inverse(&lattice, &(motion * rest), 0..2).ok_or("outside of the body")?;
    /// assert_eq!(found.cell, 1);
    /// assert!((found.position - rest).norm() < 1e-9);
    /// # Ok::<(), &str>(())
    /// ```
    pub fn inverse(
        &self,
        lattice: &Lattice,
        point: &Point3<f64>,
        candidates: impl Iterator<Item = u32>,
    ) -> Option<AtRest> {
        let mut best: Option<(f64, u32, [f64; 3])> = None;
        for cell in candidates {
            let xi = self.invert_in(lattice, cell, point);
            let mut outside = xi
                .iter()
                .map(|v| (-v).max(v - 1.0).max(0.0))
                .fold(0.0, f64::max);
            // Where material is divided, a point may lie in the cells of several pieces: the nearest piece contains it.
            if lattice.parted[cell as usize] {
                outside = outside.max(lattice.away(cell, &xi) - NEAR);
            }
            if best.is_none_or(|b| outside < b.0) {
                best = Some((outside, cell, xi));
            }
            if outside < 1e-6 {
                break;
            }
        }
        let (outside, cell, xi) = best.filter(|b| b.0 <= OUTSIDE)?;
        Some(AtRest {
            position: lattice.rest_at(lattice.cells()[cell as usize].place, xi),
            gradient: lattice.gradient(&self.live, cell, &xi.map(|v| v.clamp(0.0, 1.0))),
            cell,
            outside,
        })
    }

    /// Local coordinates of a live point in a cell, by damped Newton steps.
    fn invert_in(&self, lattice: &Lattice, cell: u32, point: &Point3<f64>) -> [f64; 3] {
        let axes = self.turns[cell as usize] * lattice.axes();
        let offset = point - lattice.centre(&self.live, cell);
        let start = axes.inverse() * offset / lattice.size();
        let mut xi = [0.5 + start.x, 0.5 + start.y, 0.5 + start.z];
        for _ in 0..INVERSE_STEPS {
            let held = xi.map(|v| v.clamp(-OUTSIDE, 1.0 + OUTSIDE));
            let miss = point - lattice.warp(&self.live, &Embedding::new(cell, held));
            let jacobian = lattice.gradient(&self.live, cell, &held)
                * lattice.axes().matrix()
                * lattice.size();
            let Some(inverse) = jacobian.try_inverse() else {
                break;
            };
            let step = inverse * miss;
            xi = [0, 1, 2].map(|a| held[a] + step[a].clamp(-0.6, 0.6));
        }
        xi
    }
}

/// A rest point moved with the nearest of some rigid frames (rest centre, live centre, rotation).
fn carried(
    rest: &Point3<f64>,
    frames: &[(Point3<f64>, Point3<f64>, Rotation3<f64>)],
) -> Point3<f64> {
    let mut near: Vec<(f64, usize)> = frames
        .iter()
        .enumerate()
        .map(|(k, frame)| ((frame.0 - rest).norm_squared(), k))
        .collect();
    if near.is_empty() {
        return *rest;
    }
    let most = CARRIERS.min(near.len());
    near.select_nth_unstable_by(most - 1, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let (mut sum, mut total) = (Vector3::zeros(), 0.0);
    for &(squared, k) in &near[..most] {
        let weight = 1.0 / (squared + 1e-8);
        let (rest_centre, centre, turn) = &frames[k];
        sum += (centre + turn * (rest - rest_centre)).coords * weight;
        total += weight;
    }
    Point3::from(sum / total)
}
