//! A list that stays short: every 2^k-th of what was given to it.
//!
//! When it is full every second entry goes, and from then on only half as many are taken. What remains depends on how many were given and on
//! their sizes, on nothing else.

use serde::{Deserialize, Serialize};

/// At most so many entries of at most so many bytes together, evenly spread over all that were given.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Thinned<T> {
    kept: Vec<T>,
    every: u64,
    given: u64,
    most: usize,
}

impl<T> Thinned<T> {
    /// Keeps at most `most` entries, and two at least.
    pub fn new(most: usize) -> Self {
        Self {
            kept: Vec::new(),
            every: 1,
            given: 0,
            most: most.max(2),
        }
    }

    /// Whether the next entry would be kept: one that is costly to make need not be made otherwise. Counts it as given.
    pub fn takes_next(&mut self) -> bool {
        let takes = self.given.is_multiple_of(self.every);
        self.given += 1;
        takes
    }

    /// Keeps an entry that [`Self::takes_next`] asked for.
    pub fn keep(&mut self, entry: T) {
        self.kept.push(entry);
        if self.kept.len() > self.most {
            self.halve();
        }
    }

    /// Takes an entry if it is its turn.
    pub fn push(&mut self, entry: T) {
        if self.takes_next() {
            self.keep(entry);
        }
    }

    /// Leaves out every second entry; the first stays.
    pub fn halve(&mut self) {
        let mut at = 0;
        self.kept.retain(|_| {
            at += 1;
            at % 2 == 1
        });
        self.every = self.every.saturating_mul(2);
    }

    /// What was kept.
    pub fn kept(&self) -> &[T] {
        &self.kept
    }

    /// The same, to be changed.
    pub fn kept_mut(&mut self) -> &mut [T] {
        &mut self.kept
    }

    /// How many entries there were.
    pub fn given(&self) -> u64 {
        self.given
    }

    /// Every how many-th entry is kept.
    pub fn every(&self) -> u64 {
        self.every
    }
}

#[cfg(test)]
mod tests {
    use super::Thinned;

    /// However many are given, what is kept is every 2^k-th from the first on, and few.
    #[test]
    fn every_so_many_th_is_kept() {
        for count in [0, 1, 2, 9, 10, 11, 100, 1_000, 12_345] {
            let mut list = Thinned::new(10);
            for i in 0..count {
                list.push(i);
            }
            assert!(list.every().is_power_of_two());
            let expected: Vec<u64> = (0..count).step_by(list.every() as usize).collect();
            assert_eq!(list.kept(), expected);
            assert!(list.kept().len() <= 10 && (count < 10 || list.kept().len() >= 5));
        }
    }
}
