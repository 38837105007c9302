//! A list of bounded length: every 2^k-th of the entries offered to it.
//!
//! When it is full every second entry is dropped, and from then on only half as many are stored. The result depends only on the number of
//! offered entries and their sizes.

use serde::{Deserialize, Serialize};

/// A bounded number of entries, evenly spread over all that were offered.
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

    /// Whether the next entry will be stored, so that a costly one need not be computed otherwise. Counts it as offered.
    pub fn takes_next(&mut self) -> bool {
        let takes = self.given.is_multiple_of(self.every);
        self.given += 1;
        takes
    }

    /// Stores an entry after [`Self::takes_next`] has returned true.
    pub fn keep(&mut self, entry: T) {
        self.kept.push(entry);
        if self.kept.len() > self.most {
            self.halve();
        }
    }

    /// Stores an entry if it is due.
    pub fn push(&mut self, entry: T) {
        if self.takes_next() {
            self.keep(entry);
        }
    }

    /// Drops every second entry; the first stays.
    pub fn halve(&mut self) {
        let mut at = 0;
        self.kept.retain(|_| {
            at += 1;
            at % 2 == 1
        });
        self.every = self.every.saturating_mul(2);
    }

    /// The stored entries.
    pub fn kept(&self) -> &[T] {
        &self.kept
    }

    /// The stored entries, mutable.
    pub fn kept_mut(&mut self) -> &mut [T] {
        &mut self.kept
    }

    /// How many entries were offered.
    pub fn given(&self) -> u64 {
        self.given
    }

    /// The stride: every n-th entry is stored.
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
