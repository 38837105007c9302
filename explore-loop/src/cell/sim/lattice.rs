//! Tetrahedra that fill a solid and end on its surface: isosurface stuffing (Labelle and Shewchuk 2007).
//!
//! Space is filled with a body-centred cubic lattice: cube corners and cube centres; two neighbouring centres and an edge
//! of the face between them span a tetrahedron, and all tetrahedra are alike and nearly regular. With `φ` the depth below
//! the surface at each lattice point (negative outside):
//!
//! 1. every lattice edge with `φ` of both signs gets a cut point where the surface crosses it;
//! 2. a lattice point with a cut point close by moves onto it (`φ = 0`): without that, slivers would be cut off;
//! 3. of every tetrahedron the part with `φ ≥ 0` is kept: a tetrahedron, a pyramid or a prism, halved into tetrahedra.
//!
//! Where that paper chooses the diagonals of pyramids and prisms by parity, this code takes on every quadrilateral the diagonal
//! from the smallest index (Dompierre et al. 1999): neighbours then always agree, at the price of a looser bound on
//! the angles.

use std::collections::{BTreeMap, HashMap};

use nalgebra::{Point3, Vector3};

use super::mesh::root;

/// Distance of a cut point, in edge lengths, below which the lattice point moves onto it: the paper's values
/// for its bound on the dihedral angles (10.7°), for edges along the axes and along the diagonals.
const WARP_LONG: f64 = 0.249_99;
const WARP_SHORT: f64 = 0.411_89;

/// Two lattice points, the lower index first.
type Edge = (usize, usize);

/// Nodes and tetrahedra.
#[derive(Debug, Clone, Default)]
pub(super) struct TetMesh {
    pub nodes: Vec<Point3<f64>>,
    /// Positively oriented: `(b−a)·((c−a)×(d−a)) > 0`.
    pub tets: Vec<[usize; 4]>,
}

impl TetMesh {
    /// Volume of tetrahedron `t`.
    pub fn volume_of(&self, t: usize) -> f64 {
        signed_volume(self.tets[t].map(|v| self.nodes[v]))
    }

    /// Volume of all of them.
    pub fn volume(&self) -> f64 {
        (0..self.tets.len()).map(|t| self.volume_of(t)).sum()
    }
}

/// Volume of a tetrahedron, positive when `a`, `b`, `c` are counter-clockwise seen from `d`.
pub(super) fn signed_volume([a, b, c, d]: [Point3<f64>; 4]) -> f64 {
    (b - a).dot(&(c - a).cross(&(d - a))) / 6.0
}

/// Fills `depth > 0` inside the box `bounds` with a lattice of cubes of side `cell`; only the largest connected component is kept.
pub(super) fn fill(
    depth: &dyn Fn(&Point3<f64>) -> f64,
    bounds: (Point3<f64>, Point3<f64>),
    cell: f64,
) -> TetMesh {
    let lattice = Lattice::new(bounds, cell);
    let mut stuffing = Stuffing {
        points: lattice.points(),
        phi: Vec::new(),
        cuts: BTreeMap::new(),
    };
    stuffing.phi = stuffing.points.iter().map(depth).collect();
    stuffing.cut_edges(&lattice, depth);
    stuffing.warp(&lattice);
    let mut mesh = TetMesh::default();
    for tet in lattice.tets() {
        stuffing.keep_inside(tet, &mut mesh.tets);
    }
    mesh.nodes = stuffing.points;
    largest_piece(&mesh)
}

/// The body-centred cubic lattice over a box.
struct Lattice {
    origin: Point3<f64>,
    cell: f64,
    size: [usize; 3],
}

impl Lattice {
    fn new((low, high): (Point3<f64>, Point3<f64>), cell: f64) -> Self {
        // A margin of one cube, and the box centred in the lattice, so that a symmetric solid gets symmetric tetrahedra.
        let size = [0, 1, 2].map(|k| ((high[k] - low[k]) / cell).ceil() as usize + 3);
        let centre = nalgebra::center(&low, &high);
        let origin = centre - Vector3::from(size.map(|n| 0.5 * (n - 1) as f64)) * cell;
        Self { origin, cell, size }
    }

    fn corner(&self, [i, j, k]: [usize; 3]) -> usize {
        (k * self.size[1] + j) * self.size[0] + i
    }

    /// Index of the centre of the cube whose lowest corner is `at`.
    fn centre(&self, at: [usize; 3]) -> usize {
        self.size.iter().product::<usize>() + self.corner(at)
    }

    fn grid(&self) -> impl Iterator<Item = [usize; 3]> + use<> {
        let [nx, ny, nz] = self.size;
        (0..nz).flat_map(move |k| (0..ny).flat_map(move |j| (0..nx).map(move |i| [i, j, k])))
    }

    fn points(&self) -> Vec<Point3<f64>> {
        let place = |at: [usize; 3], shift: f64| {
            self.origin + Vector3::from(at.map(|c| c as f64 + shift)) * self.cell
        };
        self.grid()
            .map(|at| place(at, 0.0))
            .chain(self.grid().map(|at| place(at, 0.5)))
            .collect()
    }

    /// Four tetrahedra around each segment between neighbouring centres.
    fn tets(&self) -> Vec<[usize; 4]> {
        let mut tets = Vec::new();
        for at in self.grid() {
            for axis in 0..3 {
                let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
                let mut next = at;
                next[axis] += 1;
                if next[axis] + 1 >= self.size[axis]
                    || at[u] + 1 >= self.size[u]
                    || at[v] + 1 >= self.size[v]
                {
                    continue;
                }
                let ring = [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(du, dv)| {
                    let mut corner = next;
                    corner[u] += du;
                    corner[v] += dv;
                    self.corner(corner)
                });
                for k in 0..4 {
                    tets.push([
                        self.centre(at),
                        ring[k],
                        ring[(k + 1) % 4],
                        self.centre(next),
                    ]);
                }
            }
        }
        tets
    }

    /// Every edge once, lower index first, with whether it runs along an axis.
    fn edges(&self) -> BTreeMap<Edge, bool> {
        let half = self.size.iter().product::<usize>();
        let mut edges = BTreeMap::new();
        for tet in self.tets() {
            for a in 0..4 {
                for b in a + 1..4 {
                    let key = (tet[a].min(tet[b]), tet[a].max(tet[b]));
                    // Corner-corner and centre-centre edges are the long ones.
                    edges.insert(key, (key.0 < half) == (key.1 < half));
                }
            }
        }
        edges
    }
}

struct Stuffing {
    points: Vec<Point3<f64>>,
    phi: Vec<f64>,
    /// Cut point of each cut edge (lower index first), as an index into `points`.
    cuts: BTreeMap<Edge, usize>,
}

impl Stuffing {
    fn cut_edges(&mut self, lattice: &Lattice, depth: &dyn Fn(&Point3<f64>) -> f64) {
        for &(a, b) in lattice.edges().keys() {
            if self.phi[a] * self.phi[b] < 0.0 {
                let cut = crossing(self.points[a], self.points[b], self.phi[a] > 0.0, depth);
                self.cuts.insert((a, b), self.points.len());
                self.points.push(cut);
                self.phi.push(0.0);
            }
        }
    }

    /// Moves lattice points onto cut points that are too near, and removes the cut points of edges that are no longer cut.
    fn warp(&mut self, lattice: &Lattice) {
        let mut around: HashMap<usize, Vec<(Edge, f64)>> = HashMap::new();
        for (key, long) in lattice
            .edges()
            .into_iter()
            .filter(|(key, _)| self.cuts.contains_key(key))
        {
            let limit = if long { WARP_LONG } else { WARP_SHORT };
            let length = (self.points[key.0] - self.points[key.1]).norm();
            for end in [key.0, key.1] {
                around.entry(end).or_default().push((key, limit * length));
            }
        }
        let lattice_points = 2 * lattice.size.iter().product::<usize>();
        for v in 0..lattice_points {
            let Some(edges) = around.get(&v) else {
                continue;
            };
            let distance = |key: &Edge| {
                self.cuts
                    .get(key)
                    .map(|&c| (self.points[c] - self.points[v]).norm())
            };
            let nearest = edges
                .iter()
                .filter_map(|(key, limit)| distance(key).filter(|d| d < limit).map(|d| (key, d)))
                .min_by(|x, y| x.1.total_cmp(&y.1));
            if let Some((key, _)) = nearest {
                self.points[v] = self.points[self.cuts[key]];
                self.phi[v] = 0.0;
                for (key, _) in edges {
                    self.cuts.remove(key);
                }
            }
        }
    }

    fn cut(&self, inside: usize, outside: usize) -> usize {
        self.cuts[&(inside.min(outside), inside.max(outside))]
    }

    /// Appends the tetrahedra of the part of `tet` with `φ ≥ 0`.
    fn keep_inside(&self, tet: [usize; 4], out: &mut Vec<[usize; 4]>) {
        let of_sign = |sign: f64| -> Vec<usize> {
            tet.iter()
                .copied()
                .filter(|&v| {
                    if sign == 0.0 {
                        self.phi[v] == 0.0
                    } else {
                        self.phi[v] * sign > 0.0
                    }
                })
                .collect()
        };
        let (plus, zero, minus) = (of_sign(1.0), of_sign(0.0), of_sign(-1.0));
        let mut add = |t: [usize; 4]| out.push(self.oriented(t));
        match (plus.as_slice(), zero.as_slice(), minus.as_slice()) {
            ([], ..) => {}
            (_, _, []) => add(tet),
            (&[p], zero, minus) => {
                let mut corners = vec![p];
                corners.extend(zero);
                corners.extend(minus.iter().map(|&m| self.cut(p, m)));
                add([corners[0], corners[1], corners[2], corners[3]]);
            }
            (&[p, q], &[z], &[m]) => pyramid([p, q, self.cut(q, m), self.cut(p, m)], z)
                .into_iter()
                .for_each(add),
            (&[p, q], _, &[m, n]) => {
                prism(
                    [p, self.cut(p, m), self.cut(p, n)],
                    [q, self.cut(q, m), self.cut(q, n)],
                )
                .into_iter()
                .for_each(add);
            }
            (&[p, q, r], _, &[m]) => {
                prism([p, q, r], [self.cut(p, m), self.cut(q, m), self.cut(r, m)])
                    .into_iter()
                    .for_each(add);
            }
            _ => {}
        }
    }

    fn oriented(&self, t: [usize; 4]) -> [usize; 4] {
        if signed_volume(t.map(|v| self.points[v])) < 0.0 {
            [t[0], t[2], t[1], t[3]]
        } else {
            t
        }
    }
}

/// Where the surface crosses the segment. Bisection needs only the sign, which is reliable where a distance is not.
fn crossing(
    a: Point3<f64>,
    b: Point3<f64>,
    a_inside: bool,
    depth: &dyn Fn(&Point3<f64>) -> f64,
) -> Point3<f64> {
    let (mut low, mut high) = (0.0, 1.0);
    // 2⁻¹⁰ of an edge is 15 µm.
    for _ in 0..10 {
        let middle = 0.5 * (low + high);
        if (depth(&a.lerp(&b, middle)) > 0.0) == a_inside {
            low = middle;
        } else {
            high = middle;
        }
    }
    a.lerp(&b, 0.5 * (low + high))
}

/// Two tetrahedra of the pyramid over the quadrilateral `base` (in order around it).
fn pyramid(base: [usize; 4], apex: usize) -> [[usize; 4]; 2] {
    let first = (0..4).min_by_key(|&k| base[k]).unwrap_or(0);
    let [a, b, c, d] = [0, 1, 2, 3].map(|k| base[(first + k) % 4]);
    [[a, b, c, apex], [a, c, d, apex]]
}

/// Three tetrahedra of the prism with ends `bottom` and `top` (`bottom[k]` below `top[k]`).
fn prism(bottom: [usize; 3], top: [usize; 3]) -> [[usize; 4]; 3] {
    // From the corner of smallest index both adjacent quadrilaterals are cut; the rest is a tetrahedron over the far end and a
    // pyramid over the far quadrilateral.
    let all = [bottom[0], bottom[1], bottom[2], top[0], top[1], top[2]];
    let smallest = (0..6).min_by_key(|&k| all[k]).unwrap_or(0);
    let (near, far) = if smallest < 3 {
        (bottom, top)
    } else {
        (top, bottom)
    };
    let k = smallest % 3;
    let (i, j) = ((k + 1) % 3, (k + 2) % 3);
    let [first, second] = pyramid([near[i], near[j], far[j], far[i]], near[k]);
    [[near[k], far[0], far[1], far[2]], first, second]
}

/// Keeps the nodes and tetrahedra of the largest connected component.
fn largest_piece(mesh: &TetMesh) -> TetMesh {
    let mut parent: Vec<usize> = (0..mesh.nodes.len()).collect();
    for t in &mesh.tets {
        for k in 1..4 {
            let (a, b) = (root(&mut parent, t[0]), root(&mut parent, t[k]));
            parent[a.max(b)] = a.min(b);
        }
    }
    let mut sizes: BTreeMap<usize, usize> = BTreeMap::new();
    for t in &mesh.tets {
        *sizes.entry(root(&mut parent, t[0])).or_default() += 1;
    }
    let Some(largest) = sizes.iter().max_by_key(|&(_, size)| size).map(|(&r, _)| r) else {
        return TetMesh::default();
    };
    let mut new_index = HashMap::new();
    let mut kept = TetMesh::default();
    for t in &mesh.tets {
        if root(&mut parent, t[0]) != largest {
            continue;
        }
        kept.tets.push(t.map(|v| {
            *new_index.entry(v).or_insert_with(|| {
                kept.nodes.push(mesh.nodes[v]);
                kept.nodes.len() - 1
            })
        }));
    }
    kept
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn ball(cell: f64) -> TetMesh {
        let radius = 0.05;
        let corner = Point3::new(radius, radius, radius);
        fill(
            &|p: &Point3<f64>| radius - p.coords.norm(),
            (-corner, corner),
            cell,
        )
    }

    /// Dihedral angles of a tetrahedron, degrees.
    fn dihedrals(mesh: &TetMesh, t: usize) -> Vec<f64> {
        let x = mesh.tets[t].map(|v| mesh.nodes[v]);
        let inward: Vec<Vector3<f64>> = (0..4)
            .map(|k| {
                let (a, b, c) = (x[(k + 1) % 4], x[(k + 2) % 4], x[(k + 3) % 4]);
                let n = (b - a).cross(&(c - a)).normalize();
                n * (x[k] - a).dot(&n).signum()
            })
            .collect();
        (0..4)
            .flat_map(|a| (a + 1..4).map(move |b| (a, b)))
            .map(|(a, b)| 180.0 - inward[a].angle(&inward[b]).to_degrees())
            .collect()
    }

    #[test]
    fn neighbours_share_whole_faces_and_the_boundary_is_closed() {
        for cell in [0.02, 0.013, 0.009] {
            let mesh = ball(cell);
            let mut faces: HashMap<[usize; 3], i32> = HashMap::new();
            for (t, tet) in mesh.tets.iter().enumerate() {
                assert!(
                    mesh.volume_of(t) > 1e-4 * cell.powi(3),
                    "tetrahedron {t} is flat: {}",
                    mesh.volume_of(t)
                );
                for [i, j, k] in [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]] {
                    let mut face = [tet[i], tet[j], tet[k]];
                    face.sort_unstable();
                    *faces.entry(face).or_default() += 1;
                }
            }
            assert!(faces.values().all(|&count| count <= 2));
            let mut edges: HashMap<[usize; 2], i32> = HashMap::new();
            for face in faces
                .iter()
                .filter(|&(_, &count)| count == 1)
                .map(|(face, _)| face)
            {
                for [a, b] in [[0, 1], [1, 2], [0, 2]] {
                    *edges.entry([face[a], face[b]]).or_default() += 1;
                }
                for &v in face {
                    let off = mesh.nodes[v].coords.norm() - 0.05;
                    // Cut points are found to 2⁻¹⁰ of an edge.
                    assert!(
                        off.abs() < cell * 2e-3,
                        "a boundary node {off} m off the sphere"
                    );
                }
            }
            assert!(
                edges.values().all(|&count| count == 2),
                "the boundary is not closed"
            );
        }
    }

    #[test]
    fn no_slivers() {
        let mesh = ball(0.011);
        let angles: Vec<f64> = (0..mesh.tets.len())
            .flat_map(|t| dihedrals(&mesh, t))
            .collect();
        let (low, high) = (
            angles.iter().copied().fold(180.0, f64::min),
            angles.iter().copied().fold(0.0, f64::max),
        );
        assert!(
            low > 5.0 && high < 170.0,
            "dihedral angles {low} to {high} degrees"
        );
    }

    #[test]
    fn the_volume_converges_to_that_of_the_ball() {
        let exact = 4.0 / 3.0 * std::f64::consts::PI * 0.05_f64.powi(3);
        let error = |cell: f64| {
            let mesh = ball(cell);
            1.0 - mesh.volume() / exact
        };
        let (coarse, fine) = (error(0.016), error(0.008));
        // Flat faces on a sphere: second order.
        assert!(
            coarse > 0.0 && fine > 0.0 && fine < coarse / 3.0,
            "{coarse} {fine}"
        );
    }
}
