//! A robust fit: least median of squares, then least squares on the inliers.
//!
//! ```text
//! start       model of a small subset with the least residual r₍ₕ₎ at rank h = ⌊(n + p + 1)/2⌋
//! repeat      s = median residual of the m samples kept, r₍ₕ₎ of all the first time
//!             kept = { i : r_i ≤ max(floor, ratio · s · (1 + 5/(m − p))) },  model = least squares on them
//! ```
//! P. J. Rousseeuw, "Least median of squares regression", J. Am. Stat. Assoc. 79 (1984), with his correction for
//! few samples. All subsets of p samples are tried if they are few, else a fixed sequence of them: the same
//! samples give the same bits.

use super::fit::median;

/// Enough for one subset without outliers: with 40 % outliers a subset of four is clean with probability
/// 0.13, and none of 300 is with probability 10⁻¹⁸.
const SUBSETS: usize = 300;
/// The set of inliers converges in two or three rounds, or alternates between two sets.
const ROUNDS: usize = 10;

/// The multiple of the median above which a sample is an outlier, and the floor below which it never is.
pub(super) struct Threshold {
    pub(super) ratio: f64,
    pub(super) floor: f64,
}

/// The model and the outliers. `fit` computes a model from the given samples, `refine` the
/// best one, `residual` the residual of a sample. `None` where `refine` finds no model.
pub(super) fn consensus<M>(
    count: usize,
    subset: usize,
    threshold: &Threshold,
    fit: impl Fn(&[usize]) -> Option<M>,
    refine: impl Fn(&[usize]) -> Option<M>,
    residual: impl Fn(&M, usize) -> f64,
) -> Option<(M, Vec<usize>)> {
    let everything: Vec<usize> = (0..count).collect();
    let residuals =
        |model: &M| -> Vec<f64> { (0..count).map(|index| residual(model, index)).collect() };
    // With one sample more than needed a disagreement cannot be attributed.
    if count <= subset + 1 {
        return refine(&everything).map(|model| (model, Vec::new()));
    }
    let rank = (count + subset).div_ceil(2).min(count) - 1;
    let mut best: Option<(f64, Vec<f64>)> = None;
    for chosen in subsets(count, subset).into_iter().chain([everything]) {
        let Some(model) = fit(&chosen) else { continue };
        let far = residuals(&model);
        let mut sorted = far.clone();
        sorted.sort_by(f64::total_cmp);
        if best.as_ref().is_none_or(|(least, _)| sorted[rank] < *least) {
            best = Some((sorted[rank], far));
        }
    }
    let (_, mut far) = best?;
    let mut scale = {
        let mut sorted = far.clone();
        sorted.sort_by(f64::total_cmp);
        sorted[rank]
    };
    let mut kept: Vec<usize> = Vec::new();
    let mut model = None;
    for _ in 0..ROUNDS {
        let used = if kept.is_empty() { count } else { kept.len() };
        let few = 1.0 + 5.0 / (used.saturating_sub(subset)).max(1) as f64;
        let limit = (threshold.ratio * scale * few).max(threshold.floor);
        let now: Vec<usize> = (0..count).filter(|&index| far[index] <= limit).collect();
        if now == kept {
            break;
        }
        let better = refine(&now)?;
        far = residuals(&better);
        scale = median(&now.iter().map(|&index| far[index]).collect::<Vec<f64>>());
        (kept, model) = (now, Some(better));
    }
    let outliers = (0..count)
        .filter(|index| kept.binary_search(index).is_err())
        .collect();
    Some((model?, outliers))
}

/// All subsets of `size` of `count` samples, or [`SUBSETS`] of them.
fn subsets(count: usize, size: usize) -> Vec<Vec<usize>> {
    let all = (0..size).try_fold(1_usize, |product, k| {
        Some(product.checked_mul(count - k)? / (k + 1))
    });
    if all.is_some_and(|all| all <= SUBSETS) {
        let mut chosen: Vec<usize> = (0..size).collect();
        let mut list = Vec::new();
        loop {
            list.push(chosen.clone());
            // The last position that can still be increased; those after it follow.
            let Some(place) = (0..size).rev().find(|&k| chosen[k] < count - size + k) else {
                return list;
            };
            chosen[place] += 1;
            for k in place + 1..size {
                chosen[k] = chosen[k - 1] + 1;
            }
        }
    }
    let mut state = 0_u64;
    let mut draw = |bound: usize| {
        // SplitMix64 (Steele, Lea, Flood 2014): a fixed pseudo-random sequence.
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) % bound as u64) as usize
    };
    (0..SUBSETS)
        .map(|_| {
            let mut chosen: Vec<usize> = Vec::with_capacity(size);
            while chosen.len() < size {
                let next = draw(count);
                if !chosen.contains(&next) {
                    chosen.push(next);
                }
            }
            chosen
        })
        .collect()
}
