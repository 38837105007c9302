//! The normal equations `H u = f` of all node displacements: dense lower triangle, Cholesky by faer.
//!
//! A node meets every node within two reaches, on a seen surface of 150 nodes that is a third of all: dense and blocked
//! beats sparse up to some hundreds of nodes.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt;
use faer::{MatMut, Par, Spec};
use nalgebra::{Matrix3, Vector3};

/// Storage kept from frame to frame.
#[derive(Default)]
pub(crate) struct System {
    count: usize,
    /// Column-major `3N × 3N`; only the lower triangle is meaningful.
    matrix: Vec<f64>,
    right: Vec<f64>,
}

impl System {
    /// `count` nodes, all zero.
    pub fn reset(&mut self, count: usize) {
        self.count = count;
        self.matrix.clear();
        self.matrix.resize(9 * count * count, 0.0);
        self.right.clear();
        self.right.resize(3 * count, 0.0);
    }

    /// Takes over the content of `other`.
    pub fn copy_from(&mut self, other: &Self) {
        self.count = other.count;
        self.matrix.clone_from(&other.matrix);
        self.right.clone_from(&other.right);
    }

    /// `H_kl += block`, for `k ≥ l`. The block of a pair `k > l` stands for both halves.
    pub fn add_block(&mut self, k: usize, l: usize, block: &Matrix3<f64>) {
        let rows = 3 * self.count;
        for b in 0..3 {
            let start = (3 * l + b) * rows + 3 * k;
            for (a, entry) in self.matrix[start..start + 3].iter_mut().enumerate() {
                *entry += block[(a, b)];
            }
        }
    }

    /// `H_kl += weight · I`, either order.
    pub fn add_scalar(&mut self, k: usize, l: usize, weight: f64) {
        let rows = 3 * self.count;
        let (k, l) = (k.max(l), k.min(l));
        for a in 0..3 {
            self.matrix[(3 * l + a) * rows + 3 * k + a] += weight;
        }
    }

    /// `f_k += force`.
    pub fn add_right(&mut self, k: usize, force: &Vector3<f64>) {
        for a in 0..3 {
            self.right[3 * k + a] += force[a];
        }
    }

    /// Factorises in place and solves; `None` if `H` is not positive definite.
    pub fn solve(&mut self) -> Option<Vec<Vector3<f64>>> {
        let rows = 3 * self.count;
        let mut h = MatMut::from_column_major_slice_mut(&mut self.matrix, rows, rows);
        let params = Spec::<llt::factor::LltParams, f64>::default();
        let scratch = llt::factor::cholesky_in_place_scratch::<f64>(rows, Par::Seq, params);
        let mut buffer = MemBuffer::new(scratch);
        llt::factor::cholesky_in_place(
            h.as_mut(),
            llt::factor::LltRegularization::default(),
            Par::Seq,
            MemStack::new(&mut buffer),
            params,
        )
        .ok()?;
        let mut f = MatMut::from_column_major_slice_mut(&mut self.right, rows, 1);
        llt::solve::solve_in_place(
            h.as_ref(),
            f.as_mut(),
            Par::Seq,
            MemStack::new(&mut MemBuffer::new(faer::dyn_stack::StackReq::EMPTY)),
        );
        let solution: Vec<Vector3<f64>> = self
            .right
            .chunks_exact(3)
            .map(Vector3::from_column_slice)
            .collect();
        solution
            .iter()
            .all(|u| u.iter().all(|c| c.is_finite()))
            .then_some(solution)
    }
}
