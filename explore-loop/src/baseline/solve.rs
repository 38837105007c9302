//! The warp that aligns the canonical surface with a frame.
//!
//! ```text
//! E(W) = Σ_u ψ_Tukey( n̂_u · (v̂_u − d_u) )  +  λ Σ_{(i,j)} ψ_Huber( ‖T_i g_j − T_j g_j‖ )
//! ```
//! `v̂_u` and `n̂_u` are a warped point of the canonical surface and its normal; `d_u` is where the ray through `v̂_u` meets the observed surface
//! (projective association). The second term penalises, for every edge of the node hierarchy, that its two nodes disagree about where a position
//! goes: it is zero for any rigid motion (Newcombe, Fox and Seitz 2015, section 3.3).
//!
//! First one motion is found for all nodes (rigid ICP), then Gauss–Newton iterates over the twists of every node; weights and associations are
//! renewed each time (iteratively reweighted least squares).

use super::depth::{DepthMap, Hit};
use super::equations::{Equations, Structure};
use super::warp::{BLENDED, Skin, Warp, exp};
use super::{Association, DynamicFusionOptions};
use crate::visibility::{DepthGrid, Sight, facing};
use nalgebra::{
    Isometry3, Matrix3, Matrix3x6, Matrix6, Point3, RowVector6, UnitVector3, Vector3, Vector6,
};

/// A point of the canonical surface, and the nodes that move it.
#[derive(Debug, Clone, Copy)]
pub(super) struct SurfacePoint {
    pub rest: Point3<f64>,
    pub normal: UnitVector3<f64>,
    pub skin: Skin,
}

/// A point held by an arm: it moves with the jaw.
#[derive(Debug, Clone, Copy)]
pub(super) struct Held {
    pub rest: Point3<f64>,
    pub skin: Skin,
    pub target: Point3<f64>,
}

/// A point of the surface and the observation that it is matched with.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pair {
    pub point: usize,
    /// Warped normal.
    pub normal: UnitVector3<f64>,
    /// Warped position minus observed position.
    pub offset: Vector3<f64>,
}

impl Pair {
    /// Distance along the normal, m.
    pub fn residual(&self) -> f64 {
        self.normal.dot(&self.offset)
    }
}

/// Least cosine between a warped normal and the view direction, and between it and the observed normal.
const FACING: f64 = 0.15;
const ALIKE: f64 = 0.4;
/// Step below which the iterations end, m and rad.
const SETTLED: f64 = 2e-5;
/// Damping of Gauss–Newton, as a share of the diagonal.
const DAMPING: f64 = 1e-4;
/// Weight of a held point over that of a point of the surface.
const HELD: f64 = 20.0;

/// What one frame provides.
pub(super) struct Frame<'a> {
    pub depth: &'a DepthMap,
    pub held: &'a [Held],
    pub options: &'a DynamicFusionOptions,
}

impl Frame<'_> {
    /// Aligns `warp` with the frame.
    pub fn solve(&self, warp: &mut Warp, surface: &[SurfacePoint]) {
        for round in 0..self.options.rigid_iterations {
            let gate = self.gate(round, self.options.rigid_iterations);
            let pairs = self.associate(warp, surface, gate);
            let step = self.step_rigid(warp, surface, &pairs);
            if step.is_none_or(|step| step < SETTLED) {
                break;
            }
        }
        let Some(structure) = structure(warp, surface, self.held) else {
            return;
        };
        for round in 0..self.options.iterations {
            let gate = self.gate(round, self.options.iterations);
            let pairs = self.associate(warp, surface, gate);
            if pairs.is_empty() {
                return;
            }
            let mut equations = Equations::new(&structure);
            add_data(&mut equations, warp, surface, &pairs, gate);
            self.add_held(&mut equations, warp);
            add_rigidity(&mut equations, warp, self.options);
            let Some(twists) = equations.solve(DAMPING) else {
                return;
            };
            warp.step(&twists);
            if twists.iter().all(|t| t.amax() < SETTLED) {
                return;
            }
        }
    }

    /// The scale of the robust weights in an iteration: wide at first, so that fast motion is followed, narrow at the end.
    fn gate(&self, round: usize, rounds: usize) -> f64 {
        let share = round as f64 / (rounds.max(2) - 1) as f64;
        let [first, last] = self.options.tukey;
        first * (last / first).powf(share)
    }

    /// Which points of the surface are visible, and where they were observed: they face the camera, no other part of the warped surface hides them,
    /// and the observed surface on their ray faces the same way and lies within `gate`.
    pub fn associate(&self, warp: &Warp, surface: &[SurfacePoint], gate: f64) -> Vec<Pair> {
        let warped: Vec<(Point3<f64>, UnitVector3<f64>)> = surface
            .iter()
            .map(|s| {
                let blend = warp.blend(&s.skin);
                (blend.apply(&s.rest), blend.rotation() * s.normal)
            })
            .collect();
        let front: Vec<Point3<f64>> = warped
            .iter()
            .filter(|(v, n)| facing(v, n, &Point3::origin()) > 0.0)
            .map(|(v, _)| *v)
            .collect();
        let rendered = DepthGrid::new(&front, 1.5 * self.options.voxel, &Isometry3::identity());
        let back = 2.0 * self.options.truncation;
        let hidden = |v: &Point3<f64>| {
            let sight = rendered.as_ref().map(|r| r.sight(v, f64::INFINITY, back));
            matches!(sight, Some(Sight::Occluded))
        };
        (0..surface.len())
            .filter_map(|point| {
                let (v, normal) = warped[point];
                if facing(&v, &normal, &Point3::origin()) < FACING || hidden(&v) {
                    return None;
                }
                let hit = self.meet(&v)?;
                let offset = v - hit.point;
                let near = offset.norm() < gate && hit.normal.dot(&normal) > ALIKE;
                near.then_some(Pair {
                    point,
                    normal,
                    offset,
                })
            })
            .collect()
    }

    /// The observed point that a warped point is matched with.
    fn meet(&self, v: &Point3<f64>) -> Option<Hit> {
        match self.options.association {
            Association::Projective => self.depth.at(v),
            Association::Nearest => Some(self.depth.nearest(v)),
        }
    }

    /// One step of rigid ICP; returns its length.
    fn step_rigid(&self, warp: &mut Warp, surface: &[SurfacePoint], pairs: &[Pair]) -> Option<f64> {
        let centre = surface
            .first()
            .map(|s| warp.blend(&s.skin).apply(&s.rest))?;
        let (mut left, mut right) = (Matrix6::zeros(), Vector6::zeros());
        // The scale stays wide: distant pairs are no longer matched by then, and the others should count alike.
        let scale = self.options.tukey[0];
        for pair in pairs {
            let s = &surface[pair.point];
            let arm = warp.blend(&s.skin).apply(&s.rest) - centre;
            let row = row(&pair.normal, &point_rows(&arm));
            let weight = tukey(pair.residual(), scale);
            left += row.transpose() * row * weight;
            right -= row.transpose() * (weight * pair.residual());
        }
        let twist = left.cholesky()?.solve(&right);
        warp.carry(&exp(&twist, &centre));
        Some(twist.amax())
    }

    /// The points that the arms hold.
    fn add_held(&self, equations: &mut Equations<'_>, warp: &Warp) {
        for held in self.held {
            let offset = warp.blend(&held.skin).apply(&held.rest) - held.target;
            let jacobians = warp.derivatives(&held.skin, &held.rest);
            for (i, a) in held.skin.nodes.iter().zip(&jacobians) {
                equations.add_right(*i, &(a.transpose() * offset * -HELD));
                for (j, b) in held.skin.nodes.iter().zip(&jacobians) {
                    equations.add(*i, *j, &(a.transpose() * b * HELD));
                }
            }
        }
    }
}

/// The data term.
fn add_data(
    equations: &mut Equations<'_>,
    warp: &Warp,
    surface: &[SurfacePoint],
    pairs: &[Pair],
    gate: f64,
) {
    for pair in pairs {
        let s = &surface[pair.point];
        let rows: [RowVector6<f64>; BLENDED] = warp
            .derivatives(&s.skin, &s.rest)
            .map(|jacobian| row(&pair.normal, &jacobian));
        let weight = tukey(pair.residual(), gate);
        for (i, a) in s.skin.nodes.iter().zip(&rows) {
            equations.add_right(*i, &(a.transpose() * (-weight * pair.residual())));
            for (j, b) in s.skin.nodes.iter().zip(&rows) {
                equations.add(*i, *j, &(a.transpose() * b * weight));
            }
        }
    }
}

/// As-rigid-as-possible: the two nodes of an edge must agree on where the coarser and the finer of them go.
fn add_rigidity(equations: &mut Equations<'_>, warp: &Warp, options: &DynamicFusionOptions) {
    for &[i, j] in &warp.edges {
        for (i, j) in [(i, j), (j, i)] {
            let (difference, [a, b]) = rigidity(warp, i, j);
            let weight = options.rigidity * huber(difference.norm(), options.huber);
            for (k, jacobian) in [(i, &a), (j, &b)] {
                equations.add_right(k, &(jacobian.transpose() * difference * -weight));
                equations.add(k, k, &(jacobian.transpose() * jacobian * weight));
            }
            let block = a.transpose() * b * weight;
            equations.add(i, j, &block);
            equations.add(j, i, &block.transpose());
        }
    }
}

/// `T_i g_j − T_j g_j`, and its derivatives for the twists of both nodes.
fn rigidity(warp: &Warp, i: u32, j: u32) -> (Vector3<f64>, [Matrix3x6<f64>; 2]) {
    let place = warp.rest(j);
    let (by_other, by_own) = (warp.carried_by(i, &place), warp.carried_by(j, &place));
    let centre = warp.carried_by(i, &warp.rest(i));
    let own = -point_rows(&Vector3::zeros());
    (by_other - by_own, [point_rows(&(by_other - centre)), own])
}

/// Which pairs of nodes share a residual.
fn structure(warp: &Warp, surface: &[SurfacePoint], held: &[Held]) -> Option<Structure> {
    let skins = surface
        .iter()
        .map(|s| &s.skin)
        .chain(held.iter().map(|h| &h.skin));
    let mut together: Vec<[u32; BLENDED]> = skins
        .map(|skin| {
            let mut nodes = skin.nodes;
            nodes.sort_unstable();
            nodes
        })
        .collect();
    together.sort_unstable();
    together.dedup();
    let pairs = together
        .iter()
        .flat_map(|nodes| nodes.iter().flat_map(|i| nodes.iter().map(|j| [*i, *j])));
    Structure::new(warp.len(), pairs.chain(warp.edges.iter().copied()))
}

/// How a point at `arm` from the centre of a twist moves: `ω × arm + v`.
fn point_rows(arm: &Vector3<f64>) -> Matrix3x6<f64> {
    let mut rows = Matrix3x6::zeros();
    rows.fixed_columns_mut::<3>(0)
        .copy_from(&-arm.cross_matrix());
    rows.fixed_columns_mut::<3>(3)
        .copy_from(&Matrix3::identity());
    rows
}

/// The component of a motion along a normal.
fn row(normal: &UnitVector3<f64>, jacobian: &Matrix3x6<f64>) -> RowVector6<f64> {
    normal.transpose() * jacobian
}

/// Weight of Tukey's biweight.
fn tukey(residual: f64, scale: f64) -> f64 {
    let share = (residual / scale).abs().min(1.0);
    (1.0 - share * share).powi(2)
}

/// Weight of Huber's penalty.
fn huber(length: f64, scale: f64) -> f64 {
    if length <= scale { 1.0 } else { scale / length }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::super::warp::tests::{STEP, motion, sheet, twists};
    use super::*;
    use proptest::prelude::*;

    /// The value of the as-rigid-as-possible term, without its weight, m².
    fn rigidity_energy(warp: &Warp) -> f64 {
        let both = |[i, j]: &[u32; 2]| {
            rigidity(warp, *i, *j).0.norm_squared() + rigidity(warp, *j, *i).0.norm_squared()
        };
        warp.edges.iter().map(both).sum()
    }

    proptest! {
        #[test]
        fn a_rigid_motion_costs_nothing(motion in motion()) {
            let mut warp = sheet();
            warp.carry(&motion);
            // Rounding: places of 1 m, sums of a dozen terms.
            prop_assert!(rigidity_energy(&warp) < 1e-24 * warp.edges.len() as f64);
        }

        #[test]
        fn a_motion_that_is_not_rigid_costs(twists in twists(60)) {
            let mut warp = sheet();
            warp.step(&twists);
            prop_assert!(rigidity_energy(&warp) > 1e-6);
        }

        #[test]
        fn derivatives_of_rigidity_are_its_finite_differences(motion in motion(), twists in twists(200), edge in 0..1000_usize, end in 0..2_usize, axis in 0..6_usize) {
            let mut warp = sheet();
            warp.carry(&motion);
            warp.step(&twists);
            let [i, j] = warp.edges[edge % warp.edges.len()];
            let exact = rigidity(&warp, i, j).1[end].column(axis).into_owned();
            let mut nudged = |step: f64| {
                let mut all = vec![Vector6::zeros(); warp.len()];
                all[[i, j][end] as usize][axis] = step;
                warp.step(&all);
                let there = rigidity(&warp, i, j).0;
                all[[i, j][end] as usize][axis] = -step;
                warp.step(&all);
                there
            };
            let difference = (nudged(STEP) - nudged(-STEP)) / (2.0 * STEP);
            prop_assert!((difference - exact).norm() < 1e-7);
        }
    }
}
