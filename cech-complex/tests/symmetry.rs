//! Laws that need no oracle: the complex does not depend on the frame, the unit, the order of the points, or (if asked) the signs of normals.
#![allow(missing_docs, clippy::unwrap_used, reason = "a test may panic")]

use cech_complex::manifolds::{Manifold, OrientedCloud};
use cech_complex::nalgebra::{Isometry3, Point3, Vector3};
use cech_complex::{Complex, Cylinder, Options, Orientation};
use proptest::prelude::*;

fn build(cloud: &OrientedCloud, cylinder: Cylinder) -> Complex {
    let options = Options::default()
        .with_max_scale(1.1)
        .with_orientation(Orientation::Free);
    Complex::build(&cloud.points, &cloud.normals, cylinder, &options).unwrap()
}

fn noisy_torus(seed: u64) -> OrientedCloud {
    let cloud = Manifold::Torus {
        major: 1.0,
        minor: 0.45,
    }
    .net(90, seed);
    cloud.with_noise(0.02, 0.1, seed)
}

/// Values sorted, so that complexes with renamed vertices compare.
fn sorted(values: &[f64]) -> Vec<f64> {
    let mut values = values.to_vec();
    values.sort_by(f64::total_cmp);
    values
}

/// Rounding moves a value by about the certificate's tolerance, so a simplex at the cut-off may come or go: compare well below it.
fn same(a: &[f64], b: &[f64]) -> bool {
    let (a, b) = (sorted(a), sorted(b));
    let below = |values: &[f64]| values.iter().filter(|v| **v < 1.05).count();
    below(&a).abs_diff(below(&b)) <= 1
        && a.iter()
            .zip(&b)
            .take_while(|(a, _)| **a < 1.05)
            .all(|(a, b)| (a - b).abs() < 1e-10)
}

fn same_complex(a: &Complex, b: &Complex) -> bool {
    same(a.edge_values(), b.edge_values())
        && same(a.triangle_values(), b.triangle_values())
        && same(a.tetrahedron_values(), b.tetrahedron_values())
}

fn cylinder(unit: f64) -> Cylinder {
    Cylinder::new(0.5 * unit, 0.4 * unit).unwrap()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: ProptestConfig::default().cases / 8, ..ProptestConfig::default() })]

    #[test]
    fn frame_and_unit_do_not_matter(
        seed in 0u64..1000, axis in prop::array::uniform3(-3.0..3.0f64),
        shift in prop::array::uniform3(-9.0..9.0f64), power in -8i32..8,
    ) {
        let cloud = noisy_torus(seed);
        let (motion, unit) = (Isometry3::new(Vector3::from(shift), Vector3::from(axis)), 2f64.powi(power));
        let moved = OrientedCloud {
            points: cloud.points.iter().map(|p| Point3::from((motion * p).coords * unit)).collect(),
            normals: cloud.normals.iter().map(|n| motion.rotation * n).collect(),
            spacing: cloud.spacing * unit,
        };
        let (here, there) = (build(&cloud, cylinder(1.0)), build(&moved, cylinder(unit)));
        prop_assert!(same_complex(&here, &there));
        prop_assert_eq!(here.betti(0.97), there.betti(0.97));
    }

    #[test]
    fn order_and_signs_do_not_matter(seed in 0u64..1000, start in 0usize..90) {
        let cloud = noisy_torus(seed);
        // Steps of 7, which is prime to 90, visit every point once.
        let order: Vec<usize> = (0..90).map(|i| (start + 7 * i) % 90).collect();
        let shuffled = OrientedCloud {
            points: order.iter().map(|&i| cloud.points[i]).collect(),
            normals: order.iter().map(|&i| if i % 3 == 0 { -cloud.normals[i] } else { cloud.normals[i] }).collect(),
            spacing: cloud.spacing,
        };
        let (here, there) = (build(&cloud, cylinder(1.0)), build(&shuffled, cylinder(1.0)));
        prop_assert!(same_complex(&here, &there));
        prop_assert_eq!(here.betti(0.97), there.betti(0.97));
    }

    #[test]
    fn bars_add_up_to_the_euler_characteristic(seed in 0u64..1000, scale in 0.3..0.8f64) {
        let complex = build(&noisy_torus(seed), cylinder(1.0));
        let [b0, b1, b2] = complex.betti(scale).map(|b| i64::try_from(b).unwrap());
        // β₃ of the 3-skeleton is what is left, and cannot be negative.
        prop_assert!(b0 - b1 + b2 - complex.euler_characteristic(scale) >= 0);
        for bar in complex.barcode().bars() {
            prop_assert!(bar.birth < bar.death && bar.persistence() > 0.0);
        }
    }
}
