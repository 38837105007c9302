//! The unit cube as a finite element: trilinear shape functions and its stiffness.
//!
//! ```text
//! N_k(ξ) = Π_a (ξ_a or 1 − ξ_a)                      corner k, local coordinates ξ in [0, 1]³
//! K̂_ij = ∫ λ ∇N_i ∇N_jᵀ + μ ∇N_j ∇N_iᵀ + μ (∇N_i·∇N_j) I        Young's modulus 1, Poisson's ratio ν
//! ```
//! The integral runs over the material in the cube. A cube of edge `h` and modulus `E` has the stiffness `E h K̂`.

use nalgebra::{Matrix3, SMatrix, Vector3};

/// Corners of a cube in local coordinates, the first coordinate fastest.
pub(crate) const CORNERS: [[i32; 3]; 8] = [
    [0, 0, 0],
    [1, 0, 0],
    [0, 1, 0],
    [1, 1, 0],
    [0, 0, 1],
    [1, 0, 1],
    [0, 1, 1],
    [1, 1, 1],
];

/// Values of the eight shape functions.
pub(crate) fn shape(xi: &[f64; 3]) -> [f64; 8] {
    CORNERS.map(|corner| (0..3).map(|a| side(corner[a], xi[a])).product())
}

/// Derivatives of the eight shape functions by the local coordinates.
pub(crate) fn shape_gradients(xi: &[f64; 3]) -> [Vector3<f64>; 8] {
    CORNERS.map(|corner| {
        Vector3::from_fn(|a, _| {
            let sign = if corner[a] == 1 { 1.0 } else { -1.0 };
            let others = (0..3).filter(|b| *b != a);
            sign * others.map(|b| side(corner[b], xi[b])).product::<f64>()
        })
    })
}

fn side(corner: i32, xi: f64) -> f64 {
    if corner == 1 { xi } else { 1.0 - xi }
}

/// Stiffness of the unit cube, as blocks between corners.
pub(crate) type Stiffness = [[Matrix3<f64>; 8]; 8];

/// Number of parts of a cube along each edge.
const ALONG: usize = 4;
/// Number of parts of a cube.
pub const PARTS: usize = ALONG * ALONG * ALONG;

/// Which parts of a cube hold material: the share of each of 4 × 4 × 4 parts, the first coordinate fastest.
pub type Occupancy = [f64; PARTS];

/// Integration points, one for each part, moved outwards from the centres so that the second moments of a full cube are exact.
fn point(part: usize) -> [f64; 3] {
    const OUT: f64 = 1.032_795_558_988_644_5; // √(16/15)
    let index = [part % ALONG, part / ALONG % ALONG, part / (ALONG * ALONG)];
    index.map(|k| 0.5 + OUT * ((k as f64 + 0.5) / ALONG as f64 - 0.5))
}

/// Modes of displacement within a cube: eight corners and three bubbles `4 ξ_a (1 − ξ_a)`.
const MODES: usize = 11;

/// The stiffness of a cube of which only some parts hold material, at Young's modulus 1 and Poisson's ratio `nu`.
///
/// The bubbles represent the shear that bending would otherwise cause in eight corners, and are eliminated (Wilson's incompatible modes;
/// their mean gradient over the material is subtracted, so that uniform strain needs none of them: Taylor, Beresford and Wilson 1976). The
/// integral is taken over the material only, so a thin layer in a large cube bends as a thin layer does.
pub(crate) fn stiffness(occupancy: &Occupancy, nu: f64) -> Stiffness {
    let (lambda, mu) = lame(nu);
    let share = 1.0 / PARTS as f64;
    let total: f64 = occupancy.iter().sum::<f64>() * share;
    let mut mean = [0.0; 3];
    for (part, filled) in occupancy.iter().enumerate() {
        let xi = point(part);
        for a in 0..3 {
            mean[a] += filled * share * 4.0 * (1.0 - 2.0 * xi[a]) / total.max(1e-12);
        }
    }
    let mut blocks = [[Matrix3::zeros(); MODES]; MODES];
    for (part, filled) in occupancy.iter().enumerate().filter(|(_, f)| **f > 0.0) {
        let xi = point(part);
        let mut d = [Vector3::zeros(); MODES];
        d[..8].copy_from_slice(&shape_gradients(&xi));
        for a in 0..3 {
            d[8 + a][a] = 4.0 * (1.0 - 2.0 * xi[a]) - mean[a];
        }
        let weight = filled * share;
        for i in 0..MODES {
            for j in i..MODES {
                let spread = d[i] * d[j].transpose() * lambda + d[j] * d[i].transpose() * mu;
                let own = spread + Matrix3::identity() * (mu * d[i].dot(&d[j]));
                blocks[i][j] += own * weight;
            }
        }
    }
    for i in 0..MODES {
        for j in 0..i {
            blocks[i][j] = blocks[j][i].transpose();
        }
    }
    condensed(&blocks, total)
}

/// Eliminates the bubbles.
fn condensed(blocks: &[[Matrix3<f64>; MODES]; MODES], total: f64) -> Stiffness {
    let entry = |i: usize, j: usize| blocks[i / 3][j / 3][(i % 3, j % 3)];
    let mut inner = SMatrix::<f64, 9, 9>::from_fn(|i, j| entry(24 + i, 24 + j));
    // A mode without any resistance must not make the matrix singular.
    for i in 0..9 {
        inner[(i, i)] += 1e-9 * total.max(1e-6);
    }
    let across = SMatrix::<f64, 9, 24>::from_fn(|i, j| entry(24 + i, j));
    let taken = inner
        .cholesky()
        .map_or_else(SMatrix::<f64, 24, 24>::zeros, |c| {
            across.transpose() * c.solve(&across)
        });
    let mut out = [[Matrix3::zeros(); 8]; 8];
    for (i, row) in out.iter_mut().enumerate() {
        for (j, block) in row.iter_mut().enumerate() {
            *block = blocks[i][j] - taken.fixed_view::<3, 3>(3 * i, 3 * j);
        }
    }
    out
}

/// How the mass of the material is divided among the corners; the sum is its share of the cube.
pub(crate) fn mass_shares(occupancy: &Occupancy) -> [f64; 8] {
    let mut shares = [0.0; 8];
    for (part, filled) in occupancy.iter().enumerate() {
        for (own, n) in shares.iter_mut().zip(shape(&point(part))) {
            *own += filled * n / PARTS as f64;
        }
    }
    shares
}

/// Lamé's constants at Young's modulus 1.
fn lame(nu: f64) -> (f64, f64) {
    (nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), 0.5 / (1.0 + nu))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Patch test: under a uniform strain the element's forces balance and its energy is that of the continuum.
    #[test]
    fn uniform_strain_has_the_energy_of_the_continuum() {
        let nu = 0.3;
        let mut half = [1.0; PARTS];
        half[17..40].fill(0.25);
        let share = half.iter().sum::<f64>() / PARTS as f64;
        uniform_strain(&stiffness(&[1.0; PARTS], nu), nu, 1.0);
        uniform_strain(&stiffness(&half, nu), nu, share);
    }

    /// A cube bent to a constant curvature `c` about one axis costs `E c² / 24` when it is free to widen at `ν = 0`.
    #[test]
    fn bending_is_not_stiffened_by_shear() {
        let k = stiffness(&[1.0; PARTS], 0.0);
        let c = 0.01;
        let u = CORNERS.map(|p| {
            let [x, _, z] = p.map(|v| f64::from(v) - 0.5);
            Vector3::new(c * x * z, 0.0, 0.0)
        });
        let energy = energy(&k, &u);
        assert!((energy / (c * c / 24.0) - 1.0).abs() < 1e-3, "{energy}");
    }

    fn energy(k: &Stiffness, u: &[Vector3<f64>; 8]) -> f64 {
        (0..8)
            .map(|i| {
                (0..8)
                    .map(|j| 0.5 * u[i].dot(&(k[i][j] * u[j])))
                    .sum::<f64>()
            })
            .sum()
    }

    fn uniform_strain(k: &Stiffness, nu: f64, share: f64) {
        let (lambda, mu) = lame(nu);
        let strain = Matrix3::new(0.02, 0.01, -0.03, 0.01, -0.01, 0.005, -0.03, 0.005, 0.04);
        let u = CORNERS.map(|c| strain * Vector3::from(c.map(f64::from)));
        let mut energy = 0.0;
        let mut total = Vector3::zeros();
        for i in 0..8 {
            let force: Vector3<f64> = (0..8).map(|j| k[i][j] * u[j]).sum();
            energy += 0.5 * u[i].dot(&force);
            total += force;
        }
        let exact = share * (0.5 * lambda * strain.trace().powi(2) + mu * strain.norm_squared());
        assert!((energy - exact).abs() < 1e-12, "{energy} {exact}");
        assert!(total.norm() < 1e-12);
    }

    #[test]
    fn shape_functions_interpolate_linear_fields() {
        let xi = [0.2, 0.7, 0.4];
        let at =
            |c: [i32; 3]| 3.0 + f64::from(c[0]) - 2.0 * f64::from(c[1]) + 0.5 * f64::from(c[2]);
        let value: f64 = shape(&xi).iter().zip(CORNERS).map(|(n, c)| n * at(c)).sum();
        assert!((value - (3.0 + 0.2 - 1.4 + 0.2)).abs() < 1e-14);
        let slope: Vector3<f64> = shape_gradients(&xi)
            .iter()
            .zip(CORNERS)
            .map(|(g, c)| g * at(c))
            .sum();
        assert!((slope - Vector3::new(1.0, -2.0, 0.5)).norm() < 1e-14);
    }
}
