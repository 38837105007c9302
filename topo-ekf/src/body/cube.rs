//! The unit cube as a finite element: trilinear shape functions and its stiffness.
//!
//! ```text
//! N_k(ξ) = Π_a (ξ_a or 1 − ξ_a)                      corner k, local coordinates ξ in [0, 1]³
//! K̂_ij = ∫ λ ∇N_i ∇N_jᵀ + μ ∇N_j ∇N_iᵀ + μ (∇N_i·∇N_j) I        Young's modulus 1, Poisson's ratio ν
//! ```
//! The integral is taken with two Gauss points a direction, which is exact for a cube. A cube of edge `h` and modulus `E` has
//! the stiffness `E h K̂`.

use nalgebra::{Matrix3, Vector3};

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

/// The stiffness at Young's modulus 1 and Poisson's ratio `nu`.
pub(crate) fn unit_stiffness(nu: f64) -> Stiffness {
    let (lambda, mu) = (nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), 0.5 / (1.0 + nu));
    let offset = 0.5 / 3f64.sqrt();
    let mut stiffness = [[Matrix3::zeros(); 8]; 8];
    for gauss in CORNERS {
        let xi = gauss.map(|c| if c == 1 { 0.5 + offset } else { 0.5 - offset });
        let d = shape_gradients(&xi);
        for i in 0..8 {
            for j in 0..8 {
                let spread = lambda * d[i] * d[j].transpose() + mu * d[j] * d[i].transpose();
                stiffness[i][j] += (spread + Matrix3::identity() * (mu * d[i].dot(&d[j]))) / 8.0;
            }
        }
    }
    stiffness
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Patch test: under a uniform strain the element's forces balance and its energy is that of the continuum.
    #[test]
    fn uniform_strain_has_the_energy_of_the_continuum() {
        let nu = 0.3;
        let k = unit_stiffness(nu);
        let (lambda, mu) = (nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), 0.5 / (1.0 + nu));
        let strain = Matrix3::new(0.02, 0.01, -0.03, 0.01, -0.01, 0.005, -0.03, 0.005, 0.04);
        let u = CORNERS.map(|c| strain * Vector3::from(c.map(f64::from)));
        let mut energy = 0.0;
        let mut total = Vector3::zeros();
        for i in 0..8 {
            let force: Vector3<f64> = (0..8).map(|j| k[i][j] * u[j]).sum();
            energy += 0.5 * u[i].dot(&force);
            total += force;
        }
        let exact = 0.5 * lambda * strain.trace().powi(2) + mu * strain.norm_squared();
        assert!((energy - exact).abs() < 1e-15, "{energy} {exact}");
        assert!(total.norm() < 1e-15);
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
