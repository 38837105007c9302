//! Memory of a complex, from the first allocation of the build to the barcode, and of Betti numbers without it. One test, since the counter sees the whole process.
#![allow(missing_docs, clippy::unwrap_used, reason = "a test may panic")]

use cech_complex::manifolds::Manifold;
use cech_complex::{Complex, Cylinder, Options, betti_numbers};
use peak_alloc::PeakAlloc;

#[global_allocator]
static HEAP: PeakAlloc = PeakAlloc;

#[test]
fn a_simplex_takes_at_most_a_hundred_bytes_at_the_peak() {
    let torus = Manifold::Torus {
        major: 1.0,
        minor: 0.4,
    };
    for (count, flatness) in [(500, 0.5), (2000, 0.5), (2000, 1.0), (5000, 0.7)] {
        let cloud = torus.net(count, 1);
        let radius = 1.25 * cloud.spacing;
        let cylinder = Cylinder::new(radius, flatness * radius).unwrap();
        let before = HEAP.current_usage();
        HEAP.reset_peak_usage();
        let complex =
            Complex::build(&cloud.points, &cloud.normals, cylinder, &Options::default()).unwrap();
        let build = HEAP.peak_usage() - before;
        assert_eq!(complex.betti(1.0), [1, 2, 1]);
        assert_eq!(complex.barcode().rank(1.0, 1.0), [1, 2, 1]);
        let all = HEAP.peak_usage() - before;
        let simplices: usize = complex.counts().iter().sum();
        assert!(
            all <= 100 * simplices,
            "{simplices} simplices: {build} bytes to build, {all} with the barcode"
        );
        drop(complex);

        let before = HEAP.current_usage();
        HEAP.reset_peak_usage();
        let options = Options::default();
        let betti = betti_numbers(&cloud.points, &cloud.normals, cylinder, &options);
        assert_eq!(betti, Ok([1, 2, 1]));
        let all = HEAP.peak_usage() - before;
        assert!(
            all <= 10 * simplices,
            "{simplices} simplices: {all} bytes for Betti numbers alone"
        );
    }
}
