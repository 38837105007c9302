//! A dense oracle for the body filter, written from the definitions: stiffness by quadrature, rotations by singular values, Newton's
//! method with a dense factor. It shares no code with the crate.

#![allow(
    dead_code,
    missing_docs,
    clippy::unwrap_used,
    reason = "each test file uses its own part"
)]

use nalgebra::{DMatrix, DVector, Matrix3, Point3, Rotation3, UnitVector3, Vector3};
use topo_ekf::Plane;
use topo_ekf::body::{Embedding, Lattice};

pub const UP: UnitVector3<f64> = UnitVector3::new_unchecked(Vector3::new(0.0, 0.0, 1.0));
pub const TABLE: Plane = Plane {
    normal: UP,
    offset: 0.0,
};

/// A block of full cells that stands on the table.
pub fn block([nx, ny, nz]: [i32; 3], size: f64) -> Lattice {
    let mut lattice = Lattice::new(size, Point3::origin(), Rotation3::identity());
    for k in 0..nx * ny * nz {
        lattice.ensure([k % nx, k / nx % ny, k / (nx * ny)]);
    }
    lattice
}

/// Middles of all cell faces that bound the lattice, and which face: 2 axis + side.
pub fn skin(lattice: &Lattice) -> Vec<(Embedding, usize)> {
    let mut skin = vec![];
    for (c, cell) in lattice.cells().iter().enumerate() {
        for face in 0..6 {
            let (axis, side) = (face / 2, i32::from(face % 2 == 1));
            let mut beside = cell.place;
            beside[axis] += 2 * side - 1;
            if lattice.cell_at(beside).is_none() {
                let mut xi = [0.5; 3];
                xi[axis] = f64::from(side);
                skin.push((Embedding::new(c as u32, xi), face));
            }
        }
    }
    skin
}

/// Stiffness of the unit cube at Young's modulus 1, 24 × 24: eight corners and Wilson's three quadratic modes, from strain-displacement matrices
/// at 3 × 3 × 3 Gauss points; the quadratic modes are then eliminated.
pub fn cube(nu: f64) -> DMatrix<f64> {
    let c = 1.0 / ((1.0 + nu) * (1.0 - 2.0 * nu));
    let mut d = DMatrix::zeros(6, 6);
    for a in 0..3 {
        for b in 0..3 {
            d[(a, b)] = c * if a == b { 1.0 - nu } else { nu };
        }
        d[(3 + a, 3 + a)] = c * (1.0 - 2.0 * nu) / 2.0;
    }
    let g = 0.6f64.sqrt() / 2.0;
    let points = [
        (0.5 - g, 5.0 / 18.0),
        (0.5, 8.0 / 18.0),
        (0.5 + g, 5.0 / 18.0),
    ];
    let mut k = DMatrix::zeros(33, 33);
    for (x, wx) in points {
        for (y, wy) in points {
            for (z, wz) in points {
                let mut b = DMatrix::zeros(6, 33);
                let p = [x, y, z];
                for mode in 0..3 {
                    let slope = 4.0 * (1.0 - 2.0 * p[mode]);
                    b[(mode, 24 + 3 * mode + mode)] = slope;
                    for (row, (i, j)) in [(0, 1), (1, 2), (0, 2)].into_iter().enumerate() {
                        if mode == j {
                            b[(3 + row, 24 + 3 * mode + i)] = slope;
                        }
                        if mode == i {
                            b[(3 + row, 24 + 3 * mode + j)] = slope;
                        }
                    }
                }
                for corner in 0..8 {
                    let on = |a: usize| corner >> a & 1 == 1;
                    let n = |a: usize| if on(a) { p[a] } else { 1.0 - p[a] };
                    let s = |a: usize| if on(a) { 1.0 } else { -1.0 };
                    let grad = [s(0) * n(1) * n(2), n(0) * s(1) * n(2), n(0) * n(1) * s(2)];
                    for a in 0..3 {
                        b[(a, 3 * corner + a)] = grad[a];
                    }
                    for (row, (i, j)) in [(0, 1), (1, 2), (0, 2)].into_iter().enumerate() {
                        b[(3 + row, 3 * corner + i)] = grad[j];
                        b[(3 + row, 3 * corner + j)] = grad[i];
                    }
                }
                k += b.transpose() * &d * b * (wx * wy * wz);
            }
        }
    }
    let (outer, inner) = (k.view((0, 0), (24, 24)), k.view((24, 24), (9, 9)));
    let across = k.view((24, 0), (9, 24));
    let inverse = inner.clone_owned().try_inverse().unwrap();
    outer - across.transpose() * inverse * across
}

/// Rotation of a cell: polar factor of its mean gradient, by singular values.
pub fn turn(lattice: &Lattice, x: &[Point3<f64>], c: usize) -> Matrix3<f64> {
    let mut f = Matrix3::zeros();
    for (corner, &n) in lattice.cells()[c].nodes.iter().enumerate() {
        let away = Vector3::from_fn(|a, _| if corner >> a & 1 == 1 { 0.25 } else { -0.25 });
        f += x[n as usize].coords * away.transpose();
    }
    let svd = (f * lattice.axes().matrix().transpose() / lattice.size()).svd(true, true);
    let (u, v) = (svd.u.unwrap(), svd.v_t.unwrap());
    assert!((u * v).determinant() > 0.0);
    u * v
}

/// Elastic matrix with the rotations of `x` held, and elastic forces at `x`, dense. `stiffness` is the energy of unit strain per volume.
pub fn elastic(
    lattice: &Lattice,
    x: &[Point3<f64>],
    stiffness: f64,
    nu: f64,
) -> (DMatrix<f64>, DVector<f64>) {
    let unit = cube(nu);
    let size = 3 * x.len();
    let (mut h, mut f) = (DMatrix::zeros(size, size), DVector::zeros(size));
    for (c, cell) in lattice.cells().iter().enumerate() {
        let r = turn(lattice, x, c);
        let axes = r * lattice.axes().matrix();
        let mut q = DMatrix::zeros(24, 24);
        for k in 0..8 {
            q.view_mut((3 * k, 3 * k), (3, 3)).copy_from(&axes);
        }
        let k = &q * &unit * q.transpose() * (stiffness * lattice.size() * cell.stiffness);
        let u = DVector::from_fn(24, |i, _| {
            let n = cell.nodes[i / 3] as usize;
            let rest = lattice.rest()[n] - lattice.rest()[cell.nodes[0] as usize];
            (x[n] - x[cell.nodes[0] as usize] - r * rest)[i % 3]
        });
        let own = &k * u;
        for i in 0..24 {
            let row = 3 * cell.nodes[i / 3] as usize + i % 3;
            f[row] -= own[i];
            for j in 0..24 {
                h[(row, 3 * cell.nodes[j / 3] as usize + j % 3)] += k[(i, j)];
            }
        }
    }
    (h, f)
}

/// Weights of an embedded point over all unknowns, three rows.
pub fn selection(lattice: &Lattice, at: &Embedding) -> DMatrix<f64> {
    let mut w = DMatrix::zeros(3, 3 * lattice.rest().len());
    for (&n, v) in lattice.cells()[at.cell as usize]
        .nodes
        .iter()
        .zip(at.weights)
    {
        for a in 0..3 {
            w[(a, 3 * n as usize + a)] += v;
        }
    }
    w
}
