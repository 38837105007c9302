//! The same bits on every machine, with and without feature `rayon`, on one thread or many.
#![allow(missing_docs, clippy::unwrap_used, reason = "a test may panic")]

use cech_complex::nalgebra::{Point3, UnitVector3, Vector3};
use cech_complex::{Complex, Cylinder, Options};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// A wavy sheet: nothing but sums, products and square roots, which IEEE 754 rounds alike everywhere.
fn sheet() -> Complex {
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    let sample = |_| {
        let [x, y]: [f64; 2] = std::array::from_fn(|_| rng.random_range(-1.0..1.0));
        let point = Point3::new(x, y, 0.3 * x * y * y);
        let normal = UnitVector3::new_normalize(Vector3::new(-0.3 * y * y, -0.6 * x * y, 1.0));
        (point, normal)
    };
    let (points, normals): (Vec<_>, Vec<_>) = (0..900).map(sample).unzip();
    let cylinder = Cylinder::new(0.1, 0.08).unwrap();
    Complex::build(&points, &normals, cylinder, &Options::default()).unwrap()
}

/// FNV-1a over all simplices and the bits of their values.
fn digest(complex: &Complex) -> u64 {
    let names = complex
        .edges()
        .iter()
        .flatten()
        .chain(complex.triangles().iter().flatten())
        .chain(complex.tetrahedra().iter().flatten())
        .map(|&v| u64::from(v));
    let values = complex
        .edge_values()
        .iter()
        .chain(complex.triangle_values())
        .chain(complex.tetrahedron_values())
        .map(|value| value.to_bits());
    names
        .chain(values)
        .fold(0xcbf2_9ce4_8422_2325, |hash, word| {
            (hash ^ word).wrapping_mul(0x0100_0000_01b3)
        })
}

/// Recorded once; a change means that some value has changed.
const DIGEST: u64 = 0x55c1_8acd_52d6_0738;

#[test]
fn every_build_of_the_crate_gives_these_bits() {
    let complex = sheet();
    assert_eq!(complex.counts(), [900, 11_784, 61_350, 191_594]);
    assert_eq!(digest(&complex), DIGEST);
}

#[cfg(feature = "rayon")]
#[test]
fn the_number_of_threads_does_not_matter() {
    for threads in [1, 2, 5] {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        assert_eq!(pool.install(|| digest(&sheet())), DIGEST);
    }
}

/// A task that computes values may take up another one, which asks for the same.
#[cfg(feature = "rayon")]
#[test]
fn tasks_of_one_pool_may_ask_for_the_same_values() {
    use rayon::prelude::*;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(3)
        .build()
        .unwrap();
    for round in 0..5 {
        let complex = sheet();
        let ask = |task: usize| match (task + round) % 3 {
            0 => complex.barcode().bars().len(),
            1 => complex.tetrahedron_values().len(),
            _ => complex.edge_values().len(),
        };
        let answers: Vec<usize> = pool.install(|| (0..30).into_par_iter().map(ask).collect());
        assert!(answers.iter().all(|count| *count > 0));
        assert_eq!(digest(&complex), DIGEST);
    }
}
