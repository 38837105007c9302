//! Affine motions: exact up to the shrinkage, and the shrinkage vanishes with `ε` at the rate the documentation gives.
#![allow(missing_docs, clippy::unwrap_used)]

use gpwrm::{Field, FieldOptions, Support};
use nalgebra::{Matrix3, Point3, Vector3};
use proptest::prelude::*;

/// A block of nodes with spread in all directions, 10 mm apart, shaken by up to 2 mm.
fn block(jitter: &[f64]) -> Vec<Point3<f64>> {
    (0..125)
        .map(|k| {
            let grid = Vector3::new((k % 5) as f64, (k / 5 % 5) as f64, (k / 25) as f64);
            let shake = Vector3::new(jitter[k % 7], jitter[k % 11], jitter[k % 13]);
            Point3::from(0.01 * grid + 0.002 * shake)
        })
        .collect()
}

/// Largest error, relative to the strain times the way to the nodes in reach, of the affine motion with gradient `g`.
fn error(nodes: &[Point3<f64>], g: &Matrix3<f64>, shrinkage: f64, probes: &[Point3<f64>]) -> f64 {
    let motion: Vec<_> = nodes.iter().map(|x| g * x.coords).collect();
    let options = FieldOptions::default()
        .with_support(Support::Radius(0.025))
        .with_shrinkage(shrinkage);
    let field = Field::new(nodes, &motion, &options).unwrap();
    probes
        .iter()
        .map(|p| (field.displacement(p) - g * p.coords).norm())
        .fold(0.0, f64::max)
}

proptest! {
    /// Within the documented bound `ε/(λ + ε)` times the strain `F − R` times the way to the nodes, which on a weighted mean is no longer
    /// than the support; and ten times less for a tenth of `ε`.
    #[test]
    fn the_shrinkage_vanishes_with_epsilon(
        entries in proptest::collection::vec(-0.4..0.4_f64, 9), jitter in proptest::collection::vec(-1.0..1.0_f64, 13),
        at in proptest::collection::vec(0.0..0.04_f64, 15),
    ) {
        let g = Matrix3::from_row_slice(&entries);
        let f = Matrix3::identity() + g;
        let strain = (f - gpwrm::nearest_rotation(&f).matrix()).norm();
        prop_assume!(strain > 0.05 && f.determinant() > 0.1);
        let nodes = block(&jitter);
        let probes: Vec<_> = at.chunks(3).map(|c| Point3::new(c[0], c[1], c[2])).collect();
        let errors: Vec<f64> = [1e-3, 1e-4, 1e-5].iter().map(|&e| error(&nodes, &g, e, &probes)).collect();
        for (error, epsilon) in errors.iter().zip([1e-3, 1e-4, 1e-5]) {
            // The narrowest neighbourhoods are those of the corners: a twentieth of their spread lies along one axis at least. The support grows by half a diagonal
            // of the grid at most.
            let bound = epsilon / (0.05 + epsilon) * strain * (0.025 + 0.013);
            prop_assert!(*error <= bound, "{error} > {bound}");
        }
        // ε/(λ + ε) is linear in ε to ε/λ, 2 % at 1e-3.
        prop_assert!((errors[0] / errors[1] - 10.0).abs() < 0.5, "{errors:?}");
        prop_assert!((errors[1] / errors[2] - 10.0).abs() < 0.05, "{errors:?}");
        // And nothing is left in the end: rounding of 1e-15 over ε.
        prop_assert!(error(&nodes, &g, 1e-12, &probes) < 1e-11);
    }

    /// On a flat sheet every affine motion is exact within the plane, where the nodes determine it.
    #[test]
    fn a_flat_sheet_is_exact_in_its_plane(entries in proptest::collection::vec(-0.4..0.4_f64, 9), x in 0.0..0.05_f64, y in 0.0..0.05_f64) {
        let g = Matrix3::from_row_slice(&entries);
        let nodes: Vec<_> = (0..36).map(|k| Point3::new(f64::from(k % 6), f64::from(k / 6), 0.0) * 0.01).collect();
        // No 1e-12 here: across the sheet rounding is all there is, and p lies in the plane to rounding only.
        prop_assert!(error(&nodes, &g, 1e-9, &[Point3::new(x, y, 0.0)]) < 1e-9);
    }
}
