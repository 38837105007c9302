//! The warp field: sparse transformation nodes, blended as dual quaternions.
//!
//! ```text
//! q(x) = Σ_i w_i(x) s_i q_i        i over the K nodes nearest to x,  w_i(x) = exp(−‖x − g_i‖² / 2σ²),  s_i = ±1
//! W(x) = q(x) x q(x)⁻¹             q = r + ε d:  W(x) = vec(r x r* + 2 d r*) / ‖r‖²
//! ```
//! `g_i` is the position of node `i` in the canonical frame, the unit dual quaternion `q_i` carries it to the live frame, and `s_i` puts all of them on
//! one side of the double cover (Kavan, Collins, Žára and O'Sullivan 2007, Skinning with dual quaternions). A node moves by a twist about its
//! present position, `q_i ← exp(ω, v) q_i`: to first order a point `y` near it moves to `y + ω × (y − c_i) + v`, `c_i = W_i(g_i)`.
//!
//! Above the nodes that blend are levels of coarser ones, which only regularise: those of level `l` are a subset of level `l − 1` at least `ε βˡ` apart,
//! and every node is joined to the nearest ones of the next level (Newcombe, Fox and Seitz 2015, section 3.3).

use crate::canonical::graph;
use nalgebra::{
    DualQuaternion, Isometry3, Matrix3x6, Point3, Quaternion, Translation3, UnitDualQuaternion,
    UnitQuaternion, Vector3, Vector6,
};

/// Number of nodes that move a point.
pub(super) const BLENDED: usize = 4;
/// Number of nodes of the next level that a node is joined to.
const JOINED: usize = 4;

/// The nodes that move a point, and their weights, which sum to 1; unused entries weigh 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Skin {
    pub nodes: [u32; BLENDED],
    pub weights: [f64; BLENDED],
}

/// The field, and the hierarchy above it.
pub(super) struct Warp {
    /// Distance between nodes, m.
    spacing: f64,
    /// Standard deviation of the weights, m.
    reach: f64,
    coarsening: f64,
    levels: usize,
    /// Number of nodes that blend; those after them only regularise.
    fine: usize,
    rest: Vec<Point3<f64>>,
    pose: Vec<UnitDualQuaternion<f64>>,
    /// Pairs of nodes that the rigidity term joins.
    pub edges: Vec<[u32; 2]>,
    tree: Option<graph::Tree>,
}

impl Warp {
    /// A field without nodes: the identity.
    pub fn new(spacing: f64, reach: f64, levels: usize, coarsening: f64) -> Self {
        Self {
            spacing,
            reach,
            coarsening,
            levels,
            fine: 0,
            rest: Vec::new(),
            pose: Vec::new(),
            edges: Vec::new(),
            tree: None,
        }
    }

    /// Number of nodes of all levels.
    pub fn len(&self) -> usize {
        self.rest.len()
    }

    /// The nodes that blend.
    pub fn nodes(&self) -> &[Point3<f64>] {
        &self.rest[..self.fine]
    }

    /// Position of node `i` in the canonical frame.
    pub fn rest(&self, i: u32) -> Point3<f64> {
        self.rest[i as usize]
    }

    /// `x` moved by the motion of node `i` alone.
    pub fn carried_by(&self, i: u32, x: &Point3<f64>) -> Point3<f64> {
        self.pose[i as usize].transform_point(x)
    }

    /// Distance of `x` to the nearest node that blends, m.
    pub fn distance(&self, x: &Point3<f64>) -> f64 {
        let nearest = self.tree.as_ref().map(|tree| graph::nearest(tree, x).1);
        nearest.unwrap_or(f64::INFINITY)
    }

    /// The nodes that move `x`; `None` while there are none.
    pub fn skin(&self, x: &Point3<f64>) -> Option<Skin> {
        let near = graph::near(self.tree.as_ref()?, x, f64::INFINITY, BLENDED);
        let first = near.first()?.1.powi(2);
        let mut skin = Skin {
            nodes: [near[0].0 as u32; BLENDED],
            weights: [0.0; BLENDED],
        };
        for (k, (node, distance)) in near.iter().enumerate() {
            skin.nodes[k] = *node as u32;
            // A common factor does not change the blend; without removing it every weight would underflow far away.
            skin.weights[k] = (-(distance.powi(2) - first) / (2.0 * self.reach.powi(2))).exp();
        }
        let sum: f64 = skin.weights.iter().sum();
        skin.weights = skin.weights.map(|w| w / sum);
        Some(skin)
    }

    /// The blend of the nodes.
    pub fn blend(&self, skin: &Skin) -> Blend {
        let mut sum =
            DualQuaternion::from_real_and_dual(Quaternion::default(), Quaternion::default());
        for (q, weight) in self.aligned(skin) {
            sum += q * weight;
        }
        Blend::new(sum)
    }

    /// Where the field moves `x`; the identity while there are no nodes.
    pub fn apply(&self, x: &Point3<f64>) -> Point3<f64> {
        self.skin(x).map_or(*x, |skin| self.blend(&skin).apply(x))
    }

    /// The dual quaternions of a skin on the side of the first, with their weights.
    fn aligned(&self, skin: &Skin) -> [(DualQuaternion<f64>, f64); BLENDED] {
        let first = self.pose[skin.nodes[0] as usize].into_inner();
        std::array::from_fn(|k| {
            let q = self.pose[skin.nodes[k] as usize].into_inner();
            let sign = if q.real.dot(&first.real) < 0.0 {
                -1.0
            } else {
                1.0
            };
            (q * sign, skin.weights[k])
        })
    }

    /// `∂W(x)/∂(ω, v)` for the twists of the nodes of its skin, each about the present position of the node.
    ///
    /// With `q_i` changing by `dq = ½ (ω + ε u) q_i`, `u = v − ω × c_i`, and `y = W(x)`:
    /// ```text
    /// dW = w_i vec(dr x r* + r x dr* + 2 dd r* + 2 d dr*) / ‖r‖²  −  2 w_i (r · dr) y / ‖r‖²
    /// ```
    pub fn derivatives(&self, skin: &Skin, x: &Point3<f64>) -> [Matrix3x6<f64>; BLENDED] {
        let blend = self.blend(skin);
        let aligned = self.aligned(skin);
        let y = blend.apply(x).coords;
        let (r, d) = (blend.sum.real, blend.sum.dual);
        let (norm, place) = (r.norm_squared(), Quaternion::from_imag(x.coords));
        let (x_back, back) = (place * r.conjugate(), r.conjugate());
        let forth = r * place;
        std::array::from_fn(|k| {
            let (q, weight) = aligned[k];
            let centre = self
                .carried_by(skin.nodes[k], &self.rest(skin.nodes[k]))
                .coords;
            let mut jacobian = Matrix3x6::zeros();
            for axis in 0..6 {
                let (mut turn, mut shift) = (Vector3::zeros(), Vector3::zeros());
                if axis < 3 {
                    turn[axis] = 0.5;
                    shift = -turn.cross(&centre);
                } else {
                    shift[axis - 3] = 0.5;
                }
                let (turn, shift) = (Quaternion::from_imag(turn), Quaternion::from_imag(shift));
                let real = turn * q.real;
                let dual = turn * q.dual + shift * q.real;
                let moved = real * x_back
                    + forth * real.conjugate()
                    + (dual * back + d * real.conjugate()) * 2.0;
                let column = (moved.imag() - y * (2.0 * r.dot(&real))) * (weight / norm);
                jacobian.set_column(axis, &column);
            }
            jacobian
        })
    }

    /// Moves every node by its twist `(ω, v)` about its present position.
    pub fn step(&mut self, twists: &[Vector6<f64>]) {
        for (i, twist) in twists.iter().enumerate().take(self.len()) {
            let centre = self.pose[i].transform_point(&self.rest[i]);
            let motion = UnitDualQuaternion::from_isometry(&exp(twist, &centre));
            let moved = (motion * self.pose[i]).into_inner().normalize();
            self.pose[i] = UnitDualQuaternion::new_normalize(moved);
        }
    }

    /// Moves every node by the same motion.
    pub fn carry(&mut self, motion: &Isometry3<f64>) {
        let motion = UnitDualQuaternion::from_isometry(motion);
        for pose in &mut self.pose {
            *pose = UnitDualQuaternion::new_normalize((motion * *pose).into_inner());
        }
    }

    /// Adds nodes at those of `places` that no node is within one node distance of, moved as the field moves there, and rebuilds the hierarchy. Returns the
    /// positions of the new nodes.
    pub fn support(&mut self, places: &[Point3<f64>]) -> Vec<Point3<f64>> {
        let mut fresh: Vec<Point3<f64>> = Vec::new();
        for place in places {
            let apart = |q: &Point3<f64>| (q - place).norm() >= self.spacing;
            if self.distance(place) >= self.spacing && fresh.iter().all(apart) {
                fresh.push(*place);
            }
        }
        if fresh.is_empty() {
            return fresh;
        }
        let poses: Vec<UnitDualQuaternion<f64>> = fresh.iter().map(|p| self.pose_at(p)).collect();
        self.rest.truncate(self.fine);
        self.pose.truncate(self.fine);
        self.rest.extend_from_slice(&fresh);
        self.pose.extend(poses);
        self.fine = self.rest.len();
        self.tree = graph::tree(&self.rest);
        self.build_hierarchy();
        fresh
    }

    /// The rigid motion of the field at a point.
    fn pose_at(&self, x: &Point3<f64>) -> UnitDualQuaternion<f64> {
        self.skin(x)
            .map_or_else(UnitDualQuaternion::identity, |skin| {
                UnitDualQuaternion::from_isometry(&self.blend(&skin).isometry())
            })
    }

    /// The coarser levels, and the edges between each and the next.
    fn build_hierarchy(&mut self) {
        self.edges.clear();
        let (mut first, mut apart) = (0, self.spacing);
        for _ in 0..self.levels {
            apart *= self.coarsening;
            let last = self.rest.len();
            let mut coarse: Vec<Point3<f64>> = Vec::new();
            for place in &self.rest[first..last] {
                if coarse.iter().all(|q| (q - place).norm() >= apart) {
                    coarse.push(*place);
                }
            }
            let Some(tree) = graph::tree(&coarse) else {
                return;
            };
            for i in first..last {
                for (j, _) in graph::near(&tree, &self.rest[i], f64::INFINITY, JOINED) {
                    self.edges.push([i as u32, (last + j) as u32]);
                }
            }
            let poses: Vec<UnitDualQuaternion<f64>> =
                coarse.iter().map(|p| self.pose_at(p)).collect();
            first = last;
            self.rest.extend(coarse);
            self.pose.extend(poses);
            if self.rest.len() - first <= 1 {
                return;
            }
        }
    }
}

/// A sum of dual quaternions, used as the nearest rigid motion.
#[derive(Debug, Clone, Copy)]
pub(super) struct Blend {
    sum: DualQuaternion<f64>,
    rotation: UnitQuaternion<f64>,
    translation: Vector3<f64>,
}

impl Blend {
    fn new(sum: DualQuaternion<f64>) -> Self {
        let norm = sum.real.norm_squared().max(f64::MIN_POSITIVE);
        Self {
            sum,
            rotation: UnitQuaternion::new_normalize(sum.real),
            translation: (sum.dual * sum.real.conjugate()).imag() * (2.0 / norm),
        }
    }

    /// Where the motion carries a point.
    pub fn apply(&self, x: &Point3<f64>) -> Point3<f64> {
        self.rotation * x + self.translation
    }

    /// The rotation of the motion.
    pub fn rotation(&self) -> &UnitQuaternion<f64> {
        &self.rotation
    }

    /// The motion as an isometry.
    pub fn isometry(&self) -> Isometry3<f64> {
        Isometry3::from_parts(Translation3::from(self.translation), self.rotation)
    }
}

/// The motion of a twist `(ω, v)` about `centre`: a turn by `ω` there, then a shift by `v`.
pub(super) fn exp(twist: &Vector6<f64>, centre: &Point3<f64>) -> Isometry3<f64> {
    let turn = UnitQuaternion::from_scaled_axis(twist.fixed_rows::<3>(0).into_owned());
    let shift = twist.fixed_rows::<3>(3).into_owned();
    let to_centre = centre.coords - turn * centre.coords;
    Isometry3::from_parts(Translation3::from(to_centre + shift), turn)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
pub(super) mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Nodes on a bent sheet, 20 mm apart or more, all levels.
    pub fn sheet() -> Warp {
        let mut warp = Warp::new(0.02, 0.02, 3, 2.0);
        let places: Vec<Point3<f64>> = (0..400)
            .map(|k| {
                let (x, y) = (0.01 * f64::from(k % 20), 0.01 * f64::from(k / 20));
                Point3::new(x - 0.1, y - 0.1, 0.5 + 3.0 * (x - 0.1) * (x - 0.1))
            })
            .collect();
        assert!(warp.support(&places).len() > 40);
        warp
    }

    pub fn motion() -> impl Strategy<Value = Isometry3<f64>> {
        (
            prop::array::uniform3(-3.0..3.0_f64),
            prop::array::uniform3(-0.5..0.5_f64),
        )
            .prop_map(|(turn, shift)| {
                let turn = UnitQuaternion::from_scaled_axis(Vector3::from(turn));
                Isometry3::from_parts(Translation3::from(Vector3::from(shift)), turn)
            })
    }

    /// Twists of every node, up to 0.5 rad and 50 mm.
    pub fn twists(count: usize) -> impl Strategy<Value = Vec<Vector6<f64>>> {
        prop::collection::vec(prop::array::uniform6(-1.0..1.0_f64), count).prop_map(|all| {
            all.into_iter()
                .map(|t| {
                    Vector6::from(t).component_mul(&Vector6::new(0.5, 0.5, 0.5, 0.05, 0.05, 0.05))
                })
                .collect()
        })
    }

    /// A step of the finite differences: their error is of the order of its square, and of 1e-16 over it.
    pub const STEP: f64 = 1e-5;

    proptest! {
        #[test]
        fn a_rigid_motion_is_reproduced(motion in motion(), x in prop::array::uniform3(-0.1..0.1_f64)) {
            let mut warp = sheet();
            warp.carry(&motion);
            let place = Point3::from(x) + Vector3::z() * 0.5;
            // Rounding: places of 1 m, sums of a dozen terms.
            prop_assert!((warp.apply(&place) - motion * place).norm() < 1e-13);
        }

        #[test]
        fn derivatives_of_the_blend_are_its_finite_differences(
            motion in motion(), twists in twists(200), x in prop::array::uniform3(-0.1..0.1_f64), node in 0..4_usize, axis in 0..6_usize
        ) {
            let mut warp = sheet();
            warp.carry(&motion);
            warp.step(&twists);
            let place = Point3::from(x) + Vector3::z() * 0.5;
            let skin = warp.skin(&place).unwrap();
            let exact = warp.derivatives(&skin, &place)[node].column(axis).into_owned();
            let mut nudged = |step: f64| {
                let mut all = vec![Vector6::zeros(); warp.len()];
                all[skin.nodes[node] as usize][axis] = step;
                warp.step(&all);
                let there = warp.blend(&skin).apply(&place);
                // A step about where the node is now is undone by its opposite there.
                all[skin.nodes[node] as usize][axis] = -step;
                warp.step(&all);
                there
            };
            let difference = (nudged(STEP) - nudged(-STEP)) / (2.0 * STEP);
            prop_assert!((difference - exact).norm() < 1e-7, "{difference} {exact}");
        }
    }
}
