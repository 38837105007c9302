//! A fine, even triangle mesh of an implicit surface.
//!
//! Surface nets (Gibson 1998): space is divided into cubes; every cube that the surface passes through gets one vertex, the mean
//! of the points where the surface cuts its edges; every cut edge joins the vertices of its four cubes to a quad. Each edge of a quad
//! belongs to exactly two quads as long as no feature is thinner than a cube, so the mesh is closed. To make the triangles even, vertices
//! move along the surface toward the mean of their neighbours and are projected back onto `f = 0` by Newton steps
//! `p ← p − f ∇f/‖∇f‖²`; the quads are halved along their shorter diagonal.

use std::collections::HashMap;

use nalgebra::{Point3, Vector3};

use super::implicit::Implicit;
use super::mesh::TriangleMesh;

/// Rounds of smoothing: after ten the triangles hardly change any more.
const SLIDES: usize = 10;

/// Mesh of `solid` with cubes of side `cell`.
pub(super) fn triangulate(solid: &dyn Implicit, cell: f64) -> TriangleMesh {
    let grid = Grid::new(solid, cell);
    let (mut vertices, vertex_of_cube) = grid.vertices();
    let quads = grid.quads(&vertex_of_cube);
    relax(solid, &mut vertices, &quads, cell);
    let triangles = quads.iter().flat_map(|q| halves(q, &vertices)).collect();
    TriangleMesh {
        vertices,
        triangles,
    }
}

struct Grid {
    origin: Point3<f64>,
    cell: f64,
    size: [usize; 3],
    values: Vec<f64>,
}

impl Grid {
    fn new(solid: &dyn Implicit, cell: f64) -> Self {
        let (low, high) = solid.bounds();
        // A margin of two cubes, so that every cut edge has four cubes.
        let origin = low - Vector3::repeat(2.0 * cell);
        let size = [0, 1, 2].map(|k| ((high[k] - low[k]) / cell).ceil() as usize + 5);
        let mut grid = Self {
            origin,
            cell,
            size,
            values: Vec::with_capacity(size[0] * size[1] * size[2]),
        };
        for k in 0..size[2] {
            for j in 0..size[1] {
                for i in 0..size[0] {
                    grid.values.push(solid.value(&grid.point([i, j, k])));
                }
            }
        }
        grid
    }

    fn index(&self, [i, j, k]: [usize; 3]) -> usize {
        (k * self.size[1] + j) * self.size[0] + i
    }

    fn point(&self, at: [usize; 3]) -> Point3<f64> {
        self.origin + Vector3::from(at.map(|c| c as f64)) * self.cell
    }

    fn inside(&self, at: [usize; 3]) -> bool {
        self.values[self.index(at)] < 0.0
    }

    fn cubes(&self) -> impl Iterator<Item = [usize; 3]> + use<> {
        let [nx, ny, nz] = self.size;
        (0..nz - 1)
            .flat_map(move |k| (0..ny - 1).flat_map(move |j| (0..nx - 1).map(move |i| [i, j, k])))
    }

    /// One vertex for each cube that the surface passes through.
    fn vertices(&self) -> (Vec<Point3<f64>>, HashMap<usize, usize>) {
        let mut vertices = Vec::new();
        let mut vertex_of_cube = HashMap::new();
        for cube in self.cubes() {
            let (mut sum, mut count) = (Vector3::zeros(), 0.0);
            for (a, b) in cube_edges(cube) {
                if self.inside(a) != self.inside(b) {
                    let (fa, fb) = (self.values[self.index(a)], self.values[self.index(b)]);
                    sum += self
                        .point(a)
                        .coords
                        .lerp(&self.point(b).coords, fa / (fa - fb));
                    count += 1.0;
                }
            }
            if count > 0.0 {
                vertex_of_cube.insert(self.index(cube), vertices.len());
                vertices.push(Point3::from(sum / count));
            }
        }
        (vertices, vertex_of_cube)
    }

    /// One quad for each cut grid edge, seen counter-clockwise from outside.
    fn quads(&self, vertex_of_cube: &HashMap<usize, usize>) -> Vec<[usize; 4]> {
        let mut quads = Vec::new();
        for at in self.cubes().filter(|at| at.iter().all(|&c| c > 0)) {
            for axis in 0..3 {
                let mut end = at;
                end[axis] += 1;
                if self.inside(at) == self.inside(end) {
                    continue;
                }
                let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
                let around = [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(du, dv)| {
                    let mut cube = at;
                    cube[u] -= du;
                    cube[v] -= dv;
                    vertex_of_cube[&self.index(cube)]
                });
                let [a, b, c, d] = around;
                quads.push(if self.inside(at) {
                    [a, b, c, d]
                } else {
                    [d, c, b, a]
                });
            }
        }
        quads
    }
}

fn cube_edges(at: [usize; 3]) -> impl Iterator<Item = ([usize; 3], [usize; 3])> {
    (0..3).flat_map(move |axis| {
        [(0, 0), (1, 0), (0, 1), (1, 1)].map(move |(du, dv)| {
            let mut a = at;
            a[(axis + 1) % 3] += du;
            a[(axis + 2) % 3] += dv;
            let mut b = a;
            b[axis] += 1;
            (a, b)
        })
    })
}

fn relax(solid: &dyn Implicit, vertices: &mut [Point3<f64>], quads: &[[usize; 4]], cell: f64) {
    for _ in 0..SLIDES {
        let mut mean = vec![(Vector3::zeros(), 0.0); vertices.len()];
        for q in quads {
            for k in 0..4 {
                let entry = &mut mean[q[k]];
                entry.0 += vertices[q[(k + 1) % 4]].coords;
                entry.1 += 1.0;
            }
        }
        for (p, (sum, count)) in vertices.iter_mut().zip(&mean) {
            let towards = (sum / *count - p.coords) * 0.5;
            *p = onto_surface(solid, *p + towards, cell);
        }
    }
}

/// Newton steps along the gradient, bounded because `f` is a distance only near the surface.
fn onto_surface(solid: &dyn Implicit, mut p: Point3<f64>, cell: f64) -> Point3<f64> {
    for _ in 0..3 {
        let h = 1e-3 * cell;
        let slope =
            |e: Vector3<f64>| (solid.value(&(p + e * h)) - solid.value(&(p - e * h))) / (2.0 * h);
        let gradient = Vector3::new(
            slope(Vector3::x()),
            slope(Vector3::y()),
            slope(Vector3::z()),
        );
        let step = gradient * (solid.value(&p) / gradient.norm_squared().max(1e-12));
        p -= step.cap_magnitude(0.5 * cell);
    }
    p
}

fn halves(&[a, b, c, d]: &[usize; 4], vertices: &[Point3<f64>]) -> [[usize; 3]; 2] {
    if (vertices[a] - vertices[c]).norm() <= (vertices[b] - vertices[d]).norm() {
        [[a, b, c], [a, c, d]]
    } else {
        [[a, b, d], [b, c, d]]
    }
}
