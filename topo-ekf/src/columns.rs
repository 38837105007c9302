//! Three right-hand sides as one column-major block: entry `(i, axis)` is at index `axis · Q + i`.

use nalgebra::Vector3;

/// Adds `v` to row `i`.
pub(crate) fn add(block: &mut [f64], i: usize, v: &Vector3<f64>) {
    let size = block.len() / 3;
    block[i] += v.x;
    block[size + i] += v.y;
    block[2 * size + i] += v.z;
}

/// Reads the rows as vectors.
pub(crate) fn read(block: &[f64]) -> Vec<Vector3<f64>> {
    let size = block.len() / 3;
    (0..size)
        .map(|i| Vector3::new(block[i], block[size + i], block[2 * size + i]))
        .collect()
}
