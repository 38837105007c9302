//! The set of grips with the largest coverage.
//!
//! Up to three grips every set is scored. Beyond that there are too many sets, and the coverage has diminishing returns
//! (it is nearly a submodular function), for which greedy selection works well:
//!
//! ```text
//! g ← best single, pair or triple;   while |g| < k:  g ← g ∪ argmax_j NSC(g ∪ j)           greedy
//! repeat: (I, J) ← argmax NSC(g ∖ I ∪ J) over I ⊂ g, J ∩ g = ∅, |I| = |J|;  exchange while it grows     refinement
//! ```
//!
//! with one grip at a time as long as that helps, then two; the best result of three starts is used. Every step uses the exact coverage, so no exchange of one or
//! two grips improves the result. Ties go to the candidate
//! that was given first, so the result depends only on the input.

use crate::Coverage;

/// An exchange must improve the score by more than rounding, or two equal sets could be exchanged for ever.
const BETTER: f64 = 1e-12;

impl Coverage {
    /// The triple of candidates with the largest score; ties go to the first in candidate order.
    pub fn best_triple(&self) -> Option<([u32; 3], f64)> {
        let (set, score) = self.best_set(3)?;
        Some(([set[0], set[1], set[2]], score))
    }

    /// The set of `count` candidates with the largest score, in candidate order, and its score. `None` if there are fewer candidates.
    ///
    /// *Guarantees.* Up to three it is the best of all sets. Beyond, no exchange of one or two grips for other
    /// candidates improves it (on random bodies with 4 to 6 of 12 candidates it is within 2 % of the best of all; `tests/select.rs`).
    ///
    /// # Complexity
    /// `m` candidates: `O(m³)` scores for the triples, `O(k² m²)` for each exchange beyond; a score costs `O(k³)`.
    pub fn best_set(&self, count: usize) -> Option<(Vec<u32>, f64)> {
        if self.candidates.len() < count {
            return None;
        }
        let best = if count <= 3 {
            self.best_small(count)
        } else {
            // The best pair and the best triple often lead to different local optima.
            let grown = (1..=3).filter_map(|start| self.grown(self.best_small(start), count));
            let better = |a: (Vec<usize>, f64), b: (Vec<usize>, f64)| if b.1 > a.1 { b } else { a };
            grown.reduce(better)?.0
        };
        let score = self.score_columns(&best, &mut Vec::new());
        Some((best.iter().map(|&c| self.candidates[c]).collect(), score))
    }

    /// A set grown greedily and refined, in candidate order.
    fn grown(&self, mut set: Vec<usize>, count: usize) -> Option<(Vec<usize>, f64)> {
        while set.len() < count {
            set.push(self.best_addition(&set)?.0);
        }
        self.refine(&mut set);
        set.sort_unstable();
        let score = self.score_columns(&set, &mut Vec::new());
        Some((set, score))
    }

    /// Scores every set of up to three columns.
    fn best_small(&self, count: usize) -> Vec<usize> {
        let all = self.candidates.len();
        let mut scratch = Vec::new();
        let mut best: (f64, Vec<usize>) = (f64::NEG_INFINITY, Vec::new());
        let mut try_set = |set: &[usize]| {
            let score = self.score_columns(set, &mut scratch);
            if score > best.0 {
                best = (score, set.to_vec());
            }
        };
        match count {
            0 => {}
            1 => (0..all).for_each(|i| try_set(&[i])),
            2 => (0..all).for_each(|i| (i + 1..all).for_each(|j| try_set(&[i, j]))),
            _ => {
                for i in 0..all {
                    for j in i + 1..all {
                        for k in j + 1..all {
                            try_set(&[i, j, k]);
                        }
                    }
                }
            }
        }
        best.1
    }

    /// The column that adds most to `set`, and the resulting score.
    fn best_addition(&self, set: &[usize]) -> Option<(usize, f64)> {
        let mut scratch = Vec::new();
        let mut with = set.to_vec();
        with.push(0);
        let mut best: Option<(usize, f64)> = None;
        for c in (0..self.candidates.len()).filter(|c| !set.contains(c)) {
            with[set.len()] = c;
            let score = self.score_columns(&with, &mut scratch);
            if best.is_none_or(|(_, most)| score > most) {
                best = Some((c, score));
            }
        }
        best
    }

    /// Exchanges one grip at a time, then two, the best exchange first, while the score grows.
    fn refine(&self, set: &mut [usize]) {
        let mut score = self.score_columns(set, &mut Vec::new());
        loop {
            let one = self.best_exchange(set, 1);
            let better = |e: &(Vec<usize>, f64)| e.1 > score + BETTER;
            let exchange = one
                .filter(better)
                .or_else(|| self.best_exchange(set, 2).filter(better));
            let Some((exchanged, with)) = exchange else {
                return;
            };
            set.copy_from_slice(&exchanged);
            score = with;
        }
    }

    /// The best set that differs from `set` in `count` (1 or 2) grips.
    fn best_exchange(&self, set: &[usize], count: usize) -> Option<(Vec<usize>, f64)> {
        let others: Vec<usize> = (0..self.candidates.len())
            .filter(|c| !set.contains(c))
            .collect();
        let mut scratch = Vec::new();
        let mut best: Option<(Vec<usize>, f64)> = None;
        for places in combinations(set.len(), count) {
            for picks in combinations(others.len(), count) {
                let mut exchanged = set.to_vec();
                for (&place, &pick) in places.iter().zip(&picks) {
                    exchanged[place] = others[pick];
                }
                let score = self.score_columns(&exchanged, &mut scratch);
                if best.as_ref().is_none_or(|(_, most)| score > *most) {
                    best = Some((exchanged, score));
                }
            }
        }
        best
    }
}

/// All sets of one or two of the numbers below `of`, in order.
fn combinations(of: usize, count: usize) -> Vec<Vec<usize>> {
    match count {
        1 => (0..of).map(|i| vec![i]).collect(),
        _ => (0..of)
            .flat_map(|i| (i + 1..of).map(move |j| vec![i, j]))
            .collect(),
    }
}
