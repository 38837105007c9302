//! Tables of the 3-skeleton: simplices in lexicographic order, their values, and who is a face of whom.
//!
//! Vertices of a simplex ascend, and so do the simplices of a dimension, so the edges that start at a vertex are contiguous, as
//! are the triangles that start with an edge and the tetrahedra that start with a triangle. Three offset tables turn this
//! into constant-time look-up downward; facets are stored by index.

/// Offsets of runs: `runs[i]..runs[i + 1]` are the items whose (ascending) key is `i`.
pub(crate) fn runs(keys: impl Iterator<Item = u32>, count: usize) -> Vec<u32> {
    let mut offsets = vec![0u32; count + 1];
    for key in keys {
        offsets[key as usize + 1] += 1;
    }
    for i in 0..count {
        offsets[i + 1] += offsets[i];
    }
    offsets
}

/// The run of `i` as a range of indices.
pub(crate) fn run(offsets: &[u32], i: u32) -> std::ops::Range<usize> {
    offsets[i as usize] as usize..offsets[i as usize + 1] as usize
}

/// Simplices of dimension 1 to 3 with values, facets and offsets.
#[derive(Debug, Clone, Default)]
pub(crate) struct Skeleton {
    pub(crate) edges: Vec<[u32; 2]>,
    pub(crate) edge_values: Vec<f64>,
    pub(crate) edge_runs: Vec<u32>,
    pub(crate) triangles: Vec<[u32; 3]>,
    /// Edges `01`, `02`, `12` of a triangle.
    pub(crate) triangle_edges: Vec<[u32; 3]>,
    pub(crate) triangle_values: Vec<f64>,
    pub(crate) triangle_runs: Vec<u32>,
    pub(crate) tetrahedra: Vec<[u32; 4]>,
    /// Triangles `012`, `013`, `023`, `123` of a tetrahedron.
    pub(crate) tetrahedron_triangles: Vec<[u32; 4]>,
    pub(crate) tetrahedron_values: Vec<f64>,
    pub(crate) tetrahedron_runs: Vec<u32>,
}

impl Skeleton {
    pub(crate) fn index_edges(&mut self, vertices: usize) {
        self.edge_runs = runs(self.edges.iter().map(|e| e[0]), vertices);
    }

    pub(crate) fn index_triangles(&mut self) {
        self.triangle_runs = runs(self.triangle_edges.iter().map(|t| t[0]), self.edges.len());
    }

    pub(crate) fn index_tetrahedra(&mut self) {
        self.tetrahedron_runs = runs(
            self.tetrahedron_triangles.iter().map(|t| t[0]),
            self.triangles.len(),
        );
    }

    /// Index of the edge `[a, b]`, in either order.
    pub(crate) fn find_edge(&self, a: u32, b: u32) -> Option<u32> {
        let (a, b) = (a.min(b), a.max(b));
        let range = run(&self.edge_runs, a);
        let offset = self.edges[range.clone()].binary_search(&[a, b]).ok()?;
        Some((range.start + offset) as u32)
    }

    /// The part that survives when the marked edges go with all their cofaces; order is kept.
    pub(crate) fn without(&self, edge_cut: &[bool], vertices: usize) -> Self {
        let keep_edge: Vec<bool> = edge_cut.iter().map(|cut| !cut).collect();
        let keep_triangle = survivors(&self.triangle_edges, &keep_edge);
        let keep_tetrahedron = survivors(&self.tetrahedron_triangles, &keep_triangle);
        let (edge_names, triangle_names) = (renumber(&keep_edge), renumber(&keep_triangle));
        let mut rest = Self {
            edges: kept(&self.edges, &keep_edge),
            edge_values: kept(&self.edge_values, &keep_edge),
            triangles: kept(&self.triangles, &keep_triangle),
            triangle_edges: renamed(&self.triangle_edges, &keep_triangle, &edge_names),
            triangle_values: kept(&self.triangle_values, &keep_triangle),
            tetrahedra: kept(&self.tetrahedra, &keep_tetrahedron),
            tetrahedron_triangles: renamed(
                &self.tetrahedron_triangles,
                &keep_tetrahedron,
                &triangle_names,
            ),
            tetrahedron_values: kept(&self.tetrahedron_values, &keep_tetrahedron),
            ..Self::default()
        };
        rest.index_edges(vertices);
        rest.index_triangles();
        rest.index_tetrahedra();
        rest
    }
}

/// A simplex survives if all its facets do.
fn survivors<const N: usize>(facets: &[[u32; N]], kept: &[bool]) -> Vec<bool> {
    facets
        .iter()
        .map(|f| f.iter().all(|&i| kept[i as usize]))
        .collect()
}

fn kept<T: Copy>(items: &[T], keep: &[bool]) -> Vec<T> {
    items
        .iter()
        .zip(keep)
        .filter(|(_, keep)| **keep)
        .map(|(item, _)| *item)
        .collect()
}

/// New index of every kept item.
fn renumber(keep: &[bool]) -> Vec<u32> {
    let mut next = 0;
    let name = |keep: &bool| {
        let name = next;
        next += u32::from(*keep);
        name
    };
    keep.iter().map(name).collect()
}

fn renamed<const N: usize>(facets: &[[u32; N]], keep: &[bool], names: &[u32]) -> Vec<[u32; N]> {
    kept(facets, keep)
        .into_iter()
        .map(|f| f.map(|i| names[i as usize]))
        .collect()
}
