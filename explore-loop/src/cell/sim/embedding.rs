//! A fine surface carried by coarse tetrahedra.
//!
//! Every surface vertex is written as `x = Σ wₖ Xₖ`, `Σ wₖ = 1`, over the nodes of one tetrahedron, and moves with them by the
//! same weights. Inside its tetrahedron all weights are in `[0, 1]`. A vertex slightly outside all of them (flat faces cut off a
//! curved surface) uses the tetrahedron whose smallest weight is largest: negative weights amplify the deformation of a tetrahedron,
//! so a large one a little farther away is better than a sliver next to the vertex.

use nalgebra::{Matrix3, Point3, Vector3};

use super::lattice::TetMesh;

/// Carrier tetrahedron and weights of each surface vertex.
#[derive(Debug, Clone)]
pub(super) struct Embedding {
    pub carriers: Vec<([usize; 4], [f64; 4])>,
    /// Largest distance of a vertex from the tetrahedra, metres.
    pub gap: f64,
}

impl Embedding {
    /// Binds `vertices` to `mesh`, whose tetrahedra are about `cell` long.
    pub fn new(vertices: &[Point3<f64>], mesh: &TetMesh, cell: f64) -> Self {
        let frames: Vec<Frame> = (0..mesh.tets.len()).map(|t| Frame::new(mesh, t)).collect();
        let bins = Bins::new(mesh, cell);
        let mut gap = 0.0_f64;
        let carriers = vertices
            .iter()
            .map(|p| {
                let near = bins.at(p);
                // A vertex far from all tetrahedra is bound too, so that the reported gap is right.
                let all: Vec<usize>;
                let candidates = if near.is_empty() {
                    all = (0..frames.len()).collect();
                    &all
                } else {
                    near
                };
                let nearest = candidates.iter().map(|&t| frames[t].outside(p));
                gap = gap.max(nearest.fold(f64::INFINITY, f64::min));
                let bound = candidates.iter().map(|&t| (t, frames[t].weights(p)));
                let best = bound.max_by(|a, b| smallest(&a.1).total_cmp(&smallest(&b.1)));
                let (t, weights) = best.unwrap_or((0, [0.25; 4]));
                (mesh.tets[t], weights)
            })
            .collect();
        Self { carriers, gap }
    }

    /// Positions of the vertices for these node positions.
    pub fn place(&self, nodes: &[Point3<f64>]) -> Vec<Point3<f64>> {
        self.carriers
            .iter()
            .map(|(t, w)| {
                Point3::from((0..4).fold(Vector3::zeros(), |x, k| x + nodes[t[k]].coords * w[k]))
            })
            .collect()
    }
}

fn smallest(weights: &[f64; 4]) -> f64 {
    weights.iter().copied().fold(f64::INFINITY, f64::min)
}

struct Frame {
    apex: Point3<f64>,
    inverse: Matrix3<f64>,
    heights: [f64; 4],
}

impl Frame {
    fn new(mesh: &TetMesh, t: usize) -> Self {
        let [a, b, c, d] = mesh.tets[t].map(|v| mesh.nodes[v]);
        let inverse = Matrix3::from_columns(&[b - a, c - a, d - a])
            .try_inverse()
            .unwrap_or_else(Matrix3::zeros);
        // The gradient of a weight is 1 over the height above the opposite face.
        let rows = [0, 1, 2].map(|k| inverse.row(k).transpose());
        let of = |g: Vector3<f64>| 1.0 / g.norm().max(1e-9);
        let heights = [
            of(-(rows[0] + rows[1] + rows[2])),
            of(rows[0]),
            of(rows[1]),
            of(rows[2]),
        ];
        Self {
            apex: a,
            inverse,
            heights,
        }
    }

    fn weights(&self, p: &Point3<f64>) -> [f64; 4] {
        let w = self.inverse * (p - self.apex);
        [1.0 - w.sum(), w.x, w.y, w.z]
    }

    /// Distance of `p` beyond its farthest face plane, metres; 0 inside.
    fn outside(&self, p: &Point3<f64>) -> f64 {
        let w = self.weights(p);
        (0..4).map(|k| -w[k] * self.heights[k]).fold(0.0, f64::max)
    }
}

/// Tetrahedra by cubes of a grid: a vertex tests those whose bounding box, grown by half a cell, covers its cube.
struct Bins {
    origin: Point3<f64>,
    cell: f64,
    size: [usize; 3],
    tets: Vec<Vec<usize>>,
}

impl Bins {
    fn new(mesh: &TetMesh, cell: f64) -> Self {
        let mut low = Point3::from(Vector3::repeat(f64::INFINITY));
        let mut high = Point3::from(Vector3::repeat(f64::NEG_INFINITY));
        for p in &mesh.nodes {
            low = low.inf(p);
            high = high.sup(p);
        }
        let origin = low - Vector3::repeat(cell);
        let size = [0, 1, 2]
            .map(|k| (((high[k] - low[k]).max(0.0) / cell).ceil() as usize).saturating_add(3));
        let mut bins = Self {
            origin,
            cell,
            size,
            tets: vec![Vec::new(); size.iter().product()],
        };
        for (t, tet) in mesh.tets.iter().enumerate() {
            let corners = tet.map(|v| mesh.nodes[v]);
            let low =
                corners.iter().fold(corners[0], |m, p| m.inf(p)) - Vector3::repeat(0.5 * cell);
            let high =
                corners.iter().fold(corners[0], |m, p| m.sup(p)) + Vector3::repeat(0.5 * cell);
            let (low, high) = (bins.cube(&low), bins.cube(&high));
            for k in low[2]..=high[2] {
                for j in low[1]..=high[1] {
                    for i in low[0]..=high[0] {
                        let at = bins.index([i, j, k]);
                        bins.tets[at].push(t);
                    }
                }
            }
        }
        bins
    }

    fn cube(&self, p: &Point3<f64>) -> [usize; 3] {
        [0, 1, 2].map(|k| {
            (((p[k] - self.origin[k]) / self.cell).max(0.0) as usize).min(self.size[k] - 1)
        })
    }

    fn index(&self, [i, j, k]: [usize; 3]) -> usize {
        (k * self.size[1] + j) * self.size[0] + i
    }

    fn at(&self, p: &Point3<f64>) -> &[usize] {
        &self.tets[self.index(self.cube(p))]
    }
}
