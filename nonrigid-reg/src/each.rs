//! A loop over indices, in parallel with the feature `rayon`.

/// `f` of every index; with the feature `rayon` in parallel, with the same result bit for bit.
pub(crate) fn each<T: Send>(count: usize, f: impl Fn(usize) -> T + Sync + Send) -> Vec<T> {
    #[cfg(feature = "rayon")]
    {
        use rayon::prelude::*;
        (0..count).into_par_iter().map(f).collect()
    }
    #[cfg(not(feature = "rayon"))]
    (0..count).map(f).collect()
}
