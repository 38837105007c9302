//! With feature `rayon`: the same bits on one thread or many. (`cargo test --workspace --features nonrigid-reg/rayon --test threads`)
#![cfg(feature = "rayon")]
#![allow(missing_docs, clippy::unwrap_used)]

mod shapes;

use nonrigid_reg::{Options, register};
use shapes::{bent, potato, seen};

/// Every bit of the registration of a potato with the same, bent.
fn bits() -> Vec<u64> {
    let source = seen(&potato(1500, 0.0));
    let target = seen(&bent(&potato(1500, 1.7), 0.006));
    let options = Options::default();
    let result = register(&source.cloud(), &target.cloud(), &[], &[], &options).unwrap();
    let moved = result.displacements.iter().flatten().map(|x| x.to_bits());
    let sure = result.confidence.iter().map(|x| x.to_bits());
    moved.chain(sure).collect()
}

#[test]
fn the_number_of_threads_does_not_matter() {
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        pool.build().unwrap().install(bits)
    };
    let one = with(1);
    assert!(one.len() > 1000);
    assert!([2, 5].into_iter().all(|threads| with(threads) == one));
}
