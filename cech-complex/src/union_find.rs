//! Disjoint sets: which vertices are connected.

/// Disjoint sets with path halving; the smaller index is the root, so that components are named by their first vertex.
pub(crate) struct UnionFind {
    parent: Vec<u32>,
}

impl UnionFind {
    pub(crate) fn new(count: usize) -> Self {
        Self {
            parent: (0..count as u32).collect(),
        }
    }

    pub(crate) fn find(&mut self, mut v: u32) -> u32 {
        while self.parent[v as usize] != v {
            let up = self.parent[self.parent[v as usize] as usize];
            self.parent[v as usize] = up;
            v = up;
        }
        v
    }

    /// Joins two sets and returns the root that is no longer one, or `None` if they were one set already.
    pub(crate) fn union(&mut self, a: u32, b: u32) -> Option<u32> {
        let (a, b) = (self.find(a), self.find(b));
        if a == b {
            return None;
        }
        self.parent[a.max(b) as usize] = a.min(b);
        Some(a.max(b))
    }
}
