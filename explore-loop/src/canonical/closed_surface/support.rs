//! Which parts of the surface were seen, and the mesh and a sample of those parts.

use super::ClosedSurface;
use super::cells::Cells;
use nalgebra::{Point3, UnitVector3, Vector3};
use std::collections::BTreeMap;

/// A patch without support is a random gap between samples if none of it is farther than this from them, in spacings; otherwise it was not seen.
const CHANCE: f64 = 1.75;
/// Largest total share of the area of random gaps.
const SCATTERED: f64 = 0.003;
/// Pieces of a trimmed mesh below this share of its area are dropped.
const SMALL_PIECE: f64 = 0.05;

/// A connected patch without support.
pub(super) struct Gap {
    /// m².
    pub area: f64,
    /// Greatest distance of its corners from the nearest point that faces the same way, m.
    pub farthest: f64,
    pub triangles: Vec<usize>,
}

/// The nearest point that does not face away, and its distance, for each vertex.
pub(super) fn nearest_facing(
    places: &[Point3<f64>],
    facing: &[UnitVector3<f64>],
    points: &[Point3<f64>],
    normals: &[UnitVector3<f64>],
    spacing: f64,
) -> Vec<(u32, f64)> {
    let cells = Cells::new(points, spacing);
    let squared = |v: usize, i: usize| (points[i] - places[v]).norm_squared();
    let matches = |v: usize, i: usize| facing[v].dot(&normals[i]) > 0.0;
    (0..places.len())
        .map(|v| {
            let mut best = (f64::INFINITY, u32::MAX);
            let mut radius = 1.5 * spacing;
            // The search radius grows, and in the end all points are tried: distant ones are rare.
            while best.0 > radius * radius && radius < 7.0 * spacing {
                cells.visit(&places[v], radius, |i| {
                    if matches(v, i) {
                        best = least(best, (squared(v, i), i as u32));
                    }
                });
                radius *= 2.0;
            }
            if best.1 == u32::MAX {
                best = (0..points.len())
                    .filter(|&i| matches(v, i))
                    .map(|i| (squared(v, i), i as u32))
                    .fold(best, least);
            }
            (best.1, best.0.sqrt())
        })
        .collect()
}

fn least(a: (f64, u32), b: (f64, u32)) -> (f64, u32) {
    if b.0.total_cmp(&a.0).then(b.1.cmp(&a.1)).is_lt() {
        b
    } else {
        a
    }
}

impl ClosedSurface {
    /// Whether a point that faces the same way lies within reach of a vertex.
    pub fn is_supported(&self, vertex: usize) -> bool {
        self.distance[vertex] <= self.reach
    }

    /// Whether the unsupported area consists only of random gaps between points: none of it farther from them than 1.75 spacings, and in total less
    /// than three thousandths of the area.
    ///
    /// The share alone cannot tell one hole from scattered gaps, and would weigh the same hole less on a larger body.
    pub fn is_wholly_seen(&self) -> bool {
        self.bare <= SCATTERED && self.farthest <= CHANCE * self.spacing
    }

    /// Computes the unsupported share, and the distance of that part from any point.
    pub(super) fn measure_gaps(&mut self) {
        let all: Vec<usize> = (0..self.triangles.len()).collect();
        let total = self.area(&all).max(f64::MIN_POSITIVE);
        let gaps = self.gaps();
        // An empty sum of floats is −0.
        self.bare = (gaps.iter().map(|gap| gap.area).sum::<f64>() + 0.0) / total;
        self.farthest = gaps.iter().map(|gap| gap.farthest).fold(0.0, f64::max);
    }

    /// Which triangles have no support: two of their corners are beyond the reach of any point, or one is farther than a random gap allows.
    pub(crate) fn bare_triangles(&self) -> Vec<bool> {
        let far = self.reach.max(CHANCE * self.spacing);
        let beyond = |t: &[u32; 3], limit: f64| {
            let corners = t.iter().map(|v| self.distance[*v as usize]);
            corners.filter(|distance| *distance > limit).count()
        };
        let lacks = |t: &[u32; 3]| beyond(t, self.reach) >= 2 || beyond(t, far) >= 1;
        self.triangles.iter().map(lacks).collect()
    }

    /// Patches of triangles without support, the smallest first.
    fn gaps(&self) -> Vec<Gap> {
        let pieces = self.pieces(&self.bare_triangles()).into_iter();
        let mut gaps: Vec<Gap> = pieces
            .map(|triangles| Gap {
                area: self.area(&triangles),
                farthest: (triangles.iter().flat_map(|t| self.triangles[*t]))
                    .map(|v| self.distance[v as usize])
                    .fold(0.0, f64::max),
                triangles,
            })
            .collect();
        gaps.sort_by(|a, b| {
            a.area
                .total_cmp(&b.area)
                .then(a.triangles.cmp(&b.triangles))
        });
        gaps
    }

    /// The patches without support that are not random gaps, the smallest first.
    pub(super) fn places_not_seen(&self) -> Vec<Gap> {
        let all: Vec<usize> = (0..self.triangles.len()).collect();
        let (mut so_far, most) = (0.0, SCATTERED * self.area(&all));
        let mut gaps = self.gaps();
        gaps.retain(|gap| {
            so_far += gap.area;
            gap.farthest > CHANCE * self.spacing || so_far > most
        });
        gaps
    }

    /// The mesh of the seen part: triangles without support are removed, and the mesh is open there.
    ///
    /// A triangle has support if two of its corners have and the third is not far away. Patches without support that are nowhere farther than
    /// 1.75 spacings from a point are random gaps and are kept, so that a body seen from all sides stays watertight; the smallest first, as long
    /// as their total is less than three thousandths of the area. Pieces of less than a twentieth of the area are dropped.
    /// The result is a 2-manifold with boundary: a vertex where two parts touch is doubled.
    #[must_use]
    pub fn trimmed(&self) -> ClosedSurface {
        let mut keep = vec![true; self.triangles.len()];
        for t in self.places_not_seen().into_iter().flat_map(|g| g.triangles) {
            keep[t] = false;
        }
        let pieces = self.pieces(&keep);
        let total: f64 = pieces.iter().map(|p| self.area(p)).sum();
        for piece in pieces {
            if self.area(&piece) < SMALL_PIECE * total {
                for t in piece {
                    keep[t] = false;
                }
            }
        }
        self.only(&keep)
    }

    /// Supported vertices at least `spacing` apart, with their normals: an even sample of the seen part. Sheets that face away from each other are
    /// sampled separately.
    ///
    /// Besides the vertices, points inside triangles are candidates, so that no gap wider than `spacing` is left.
    pub fn resample(&self, spacing: f64) -> (Vec<Point3<f64>>, Vec<UnitVector3<f64>>) {
        let mut places: Vec<Point3<f64>> = Vec::new();
        let mut normals: Vec<UnitVector3<f64>> = Vec::new();
        if !(spacing > 0.0 && spacing.is_finite()) {
            return (places, normals);
        }
        let mut cubes: BTreeMap<[i64; 3], Vec<u32>> = BTreeMap::new();
        for (place, normal) in self.candidates() {
            let key = [0, 1, 2].map(|a| (place[a] / spacing).floor() as i64);
            let crowded = (0..27).any(|n: i64| {
                let near = [
                    key[0] + n % 3 - 1,
                    key[1] + n / 3 % 3 - 1,
                    key[2] + n / 9 - 1,
                ];
                cubes.get(&near).is_some_and(|cube| {
                    cube.iter().any(|&i| {
                        (places[i as usize] - place).norm() < spacing
                            && normals[i as usize].dot(&normal) > 0.2
                    })
                })
            });
            if !crowded {
                cubes.entry(key).or_default().push(places.len() as u32);
                places.push(place);
                normals.push(normal);
            }
        }
        (places, normals)
    }

    /// Supported vertices, then points within triangles whose corners are all supported.
    fn candidates(&self) -> Vec<(Point3<f64>, UnitVector3<f64>)> {
        const PARTS: [[f64; 3]; 4] = [
            [1.0, 1.0, 1.0],
            [1.0, 1.0, 0.0],
            [0.0, 1.0, 1.0],
            [1.0, 0.0, 1.0],
        ];
        let mut found: Vec<_> = (0..self.vertices.len())
            .filter(|&v| self.is_supported(v))
            .map(|v| (self.vertices[v], self.normals[v]))
            .collect();
        for t in &self.triangles {
            if !t.iter().all(|v| self.is_supported(*v as usize)) {
                continue;
            }
            for part in PARTS {
                let (mut place, mut normal) = (Vector3::zeros(), Vector3::zeros());
                for (v, w) in t.iter().zip(part) {
                    place += self.vertices[*v as usize].coords * w;
                    normal += self.normals[*v as usize].into_inner() * w;
                }
                let place = Point3::from(place / part.iter().sum::<f64>());
                if let Some(normal) = UnitVector3::try_new(normal, 1e-9) {
                    found.push((place, normal));
                }
            }
        }
        found
    }

    pub(super) fn area(&self, triangles: &[usize]) -> f64 {
        triangles
            .iter()
            .map(|&t| {
                let [a, b, c] = self.triangles[t].map(|v| self.vertices[v as usize]);
                (b - a).cross(&(c - a)).norm() / 2.0
            })
            .sum()
    }

    /// Connected components, over edges, of the triangles with `chosen[t]`.
    fn pieces(&self, chosen: &[bool]) -> Vec<Vec<usize>> {
        let mut across: BTreeMap<[u32; 2], usize> = BTreeMap::new();
        for (t, [a, b, c]) in self.triangles.iter().enumerate() {
            across.extend([([*a, *b], t), ([*b, *c], t), ([*c, *a], t)]);
        }
        let mut seen = vec![false; chosen.len()];
        let mut pieces = Vec::new();
        for seed in 0..chosen.len() {
            if !chosen[seed] || seen[seed] {
                continue;
            }
            seen[seed] = true;
            let (mut piece, mut front) = (Vec::new(), vec![seed]);
            while let Some(t) = front.pop() {
                piece.push(t);
                let [a, b, c] = self.triangles[t];
                for edge in [[b, a], [c, b], [a, c]] {
                    if let Some(&u) = across.get(&edge)
                        && chosen[u]
                        && !seen[u]
                    {
                        seen[u] = true;
                        front.push(u);
                    }
                }
            }
            pieces.push(piece);
        }
        pieces
    }

    /// The mesh of the triangles with `keep[t]`; a vertex gets a copy for every fan of triangles at it.
    fn only(&self, keep: &[bool]) -> ClosedSurface {
        let kept: Vec<[u32; 3]> = (0..keep.len())
            .filter(|&t| keep[t])
            .map(|t| self.triangles[t])
            .collect();
        // Maps each vertex and its outgoing edge to the triangle, to walk the fans.
        let mut fan_of: BTreeMap<(u32, usize), u32> = BTreeMap::new();
        let mut across: BTreeMap<[u32; 2], usize> = BTreeMap::new();
        for (t, [a, b, c]) in kept.iter().enumerate() {
            across.extend([([*a, *b], t), ([*b, *c], t), ([*c, *a], t)]);
        }
        let mut source: Vec<u32> = Vec::new();
        for t in 0..kept.len() {
            for v in kept[t] {
                if fan_of.contains_key(&(v, t)) {
                    continue;
                }
                let copy = source.len() as u32;
                source.push(v);
                let mut front = vec![t];
                while let Some(u) = front.pop() {
                    if fan_of.insert((v, u), copy).is_some() {
                        continue;
                    }
                    for w in kept[u].into_iter().filter(|w| *w != v) {
                        front.extend(across.get(&[v, w]));
                        front.extend(across.get(&[w, v]));
                    }
                }
            }
        }
        let triangles = (0..kept.len())
            .map(|t| kept[t].map(|v| fan_of.get(&(v, t)).copied().unwrap_or(0)))
            .collect();
        self.with_mesh(&source, triangles)
    }
}
