//! Several bodies in one file: the components connected by triangles.

use crate::{Error, Mesh};

impl Mesh {
    /// The vertices of each component, largest first by the number of vertices.
    pub fn bodies(&self) -> Vec<Vec<u32>> {
        let mut parent: Vec<u32> = (0..self.points.len() as u32).collect();
        for [a, b, c] in &self.triangles {
            for other in [b, c] {
                let (x, y) = (root(&mut parent, *a), root(&mut parent, *other));
                parent[x.max(y) as usize] = x.min(y);
            }
        }
        let mut used = vec![false; parent.len()];
        let corners = self.triangles.iter().flatten();
        corners.for_each(|v| used[*v as usize] = true);
        let mut number = vec![None; parent.len()];
        let mut bodies: Vec<Vec<u32>> = Vec::new();
        for v in (0..parent.len() as u32).filter(|v| used[*v as usize]) {
            let root = root(&mut parent, v) as usize;
            let body = *number[root].get_or_insert_with(|| {
                bodies.push(Vec::new());
                bodies.len() - 1
            });
            bodies[body].push(v);
        }
        bodies.sort_by_key(|body| std::cmp::Reverse(body.len()));
        bodies
    }

    /// One of the bodies, counted from 1, the largest first.
    ///
    /// # Errors
    /// [`Error::NoSuchBody`] says how many there are.
    pub fn body(&self, wanted: usize) -> Result<Self, Error> {
        let bodies = self.bodies();
        let body = wanted.checked_sub(1).and_then(|k| bodies.get(k));
        let body = body.ok_or(Error::NoSuchBody {
            wanted,
            found: bodies.len(),
        })?;
        Ok(self.keep(body))
    }
}

fn root(parent: &mut [u32], mut v: u32) -> u32 {
    while parent[v as usize] != v {
        parent[v as usize] = parent[parent[v as usize] as usize];
        v = parent[v as usize];
    }
    v
}
