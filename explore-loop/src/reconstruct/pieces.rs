//! Connected pieces of material in each cell, and their connections to neighbouring cells.
//!
//! ```text
//! segment    the part of a column's span that lies in one cell
//! linked     consecutive segments of one span; segments of neighbouring columns that overlap in height, with no wall between them
//! piece      segments of one cell that are linked within it
//! ```
//! Fingers and folds closer to each other than a cell are different pieces of it, with separate nodes. A wall is the fan of a loop around a place where parts
//! touch: their material is not connected through it. A cell with surface but without
//! material is joined to the neighbour with most material, and to other neighbours that are connected with that one.

use super::Material;
use super::fill::{ALONG, Columns, EMPTY, SKIPPED};
use crate::canonical::closed_surface::{crosses, fan};
use nalgebra::{Point3, Vector3};
use std::collections::{BTreeMap, BTreeSet};
use topo_ekf::body::{Lattice, Occupancy, PARTS, Piece};

/// Least overlap in height, in cells, of neighbouring columns that are connected.
const OVERLAP: f64 = 0.02;

/// The pieces in all cells of a lattice, and which of them are connected.
pub(crate) struct Pieces {
    /// Those with material first.
    pub all: Vec<Piece>,
    /// Number of pieces with material.
    pub filled: usize,
    pub joined: Vec<[usize; 2]>,
}

/// The part of a span within a cell.
struct Segment {
    key: [i32; 2],
    /// Index of its span in the column.
    span: usize,
    level: i32,
    low: f64,
    high: f64,
}

impl Segment {
    fn place(&self) -> [i32; 3] {
        let at = self.key.map(|k| k.div_euclid(ALONG));
        [at[0], at[1], self.level]
    }
}

impl Pieces {
    /// From columns, for the cells that have material, those in `surface` and those of `lattice`. Cells without surface get `inner` times
    /// their material.
    pub fn new(
        columns: &Columns,
        lattice: &Lattice,
        surface: &BTreeSet<[i32; 3]>,
        inner: f64,
        material: Material,
        walls: &Walls,
    ) -> Self {
        let segments = segments(columns);
        let links = links(&segments, walls);
        let part_of = match material {
            Material::Connected => within_cells(&segments, &links),
            Material::Whole => by_cell(&segments),
        };
        let mut parts: BTreeMap<usize, Occupancy> = BTreeMap::new();
        for (segment, part) in segments.iter().zip(&part_of) {
            add(segment, parts.entry(*part).or_insert([0.0; PARTS]));
        }
        let known = lattice.cells().iter().map(|c| c.place);
        let needed: BTreeSet<[i32; 3]> = surface.iter().copied().chain(known).collect();
        // Pieces with enough volume, in the order of their first segment.
        let mut pieces = Vec::new();
        let mut index = BTreeMap::new();
        for (part, occupancy) in &parts {
            if occupancy.iter().sum::<f64>() / PARTS as f64 > SKIPPED {
                index.insert(*part, pieces.len());
                let place = segments[*part].place();
                pieces.push(Piece {
                    place,
                    occupancy: *occupancy,
                });
            }
        }
        let mut joins = Joins::of_links(&links, &part_of, &index, pieces.len());
        let filled = pieces.len();
        add_empty(&mut pieces, &mut joins, &needed);
        for piece in &mut pieces {
            let scale = if surface.contains(&piece.place) {
                1.0
            } else {
                inner
            };
            piece.occupancy = piece.occupancy.map(|o| (o * scale).clamp(EMPTY, 1.0));
        }
        let joined = match material {
            Material::Connected => joins.pairs(&pieces),
            Material::Whole => neighbours(&pieces),
        };
        Self {
            all: pieces,
            filled,
            joined,
        }
    }
}

fn segments(columns: &Columns) -> Vec<Segment> {
    let mut segments = Vec::new();
    for (key, spans) in columns.spans() {
        for (number, span) in spans.iter().enumerate() {
            for level in span[0].floor() as i32..=span[1].floor() as i32 {
                let low = span[0].max(f64::from(level));
                let high = span[1].min(f64::from(level) + 1.0);
                if high > low {
                    segments.push(Segment {
                        key: *key,
                        span: number,
                        level,
                        low,
                        high,
                    });
                }
            }
        }
    }
    segments
}

/// Walls between parts that touch: triangles, in columns along the first two axes and cells along the third, as segments are.
#[derive(Default)]
pub(crate) struct Walls(Vec<[Vector3<f64>; 3]>);

impl Walls {
    /// The fans of loops at rest, m.
    pub fn new(contacts: &[Vec<Point3<f64>>], lattice: &Lattice) -> Self {
        let into = |p: &Point3<f64>| {
            let (place, xi) = lattice.locate(p);
            let at = [0, 1, 2].map(|a| f64::from(place[a]) + xi[a]);
            let along = f64::from(ALONG);
            Vector3::new(at[0] * along, at[1] * along, at[2])
        };
        let fans = contacts.iter().flat_map(|contact| {
            let around: Vec<_> = contact.iter().map(into).collect();
            fan(&around)
        });
        Self(fans.collect())
    }

    /// Whether a wall stands between two neighbouring columns at a height.
    fn part(&self, from: [i32; 2], to: [i32; 2], height: f64) -> bool {
        let at = |key: [i32; 2]| {
            let [x, y] = key.map(|k| f64::from(k) + 0.5);
            Vector3::new(x, y, height)
        };
        let (start, way) = (at(from), at(to) - at(from));
        self.0
            .iter()
            .any(|triangle| crosses(triangle, &start, &way))
    }
}

/// Pairs of linked segments, the earlier one first.
fn links(segments: &[Segment], walls: &Walls) -> Vec<[usize; 2]> {
    let mut at: BTreeMap<([i32; 2], i32), Vec<usize>> = BTreeMap::new();
    for (i, s) in segments.iter().enumerate() {
        at.entry((s.key, s.level)).or_default().push(i);
    }
    let mut links = Vec::new();
    for (i, s) in segments.iter().enumerate() {
        let above = segments
            .get(i + 1)
            .filter(|n| (n.key, n.span, n.level) == (s.key, s.span, s.level + 1));
        links.extend(above.map(|_| [i, i + 1]));
        for step in [[1, 0], [0, 1]] {
            let key = [s.key[0] + step[0], s.key[1] + step[1]];
            for &j in at.get(&(key, s.level)).into_iter().flatten() {
                let other = &segments[j];
                let (low, high) = (s.low.max(other.low), s.high.min(other.high));
                if high - low > OVERLAP && !walls.part(s.key, key, low.midpoint(high)) {
                    links.push([i, j]);
                }
            }
        }
    }
    links
}

/// The first segment of the piece of every segment.
fn within_cells(segments: &[Segment], links: &[[usize; 2]]) -> Vec<usize> {
    let mut roots: Vec<usize> = (0..segments.len()).collect();
    let find = |roots: &[usize], mut i: usize| {
        while roots[i] != i {
            i = roots[i];
        }
        i
    };
    for [a, b] in links {
        if segments[*a].place() == segments[*b].place() {
            let (a, b) = (find(&roots, *a), find(&roots, *b));
            roots[a.max(b)] = a.min(b);
        }
    }
    (0..segments.len()).map(|i| find(&roots, i)).collect()
}

/// The first segment of the cell of every segment.
fn by_cell(segments: &[Segment]) -> Vec<usize> {
    let mut first = BTreeMap::new();
    let of = |(i, s): (usize, &Segment)| *first.entry(s.place()).or_insert(i);
    segments.iter().enumerate().map(of).collect()
}

/// Pairs of pieces in adjacent cells, for one piece in every cell.
fn neighbours(pieces: &[Piece]) -> Vec<[usize; 2]> {
    let at: BTreeMap<[i32; 3], usize> = pieces.iter().map(|p| p.place).zip(0..).collect();
    let steps = (0..27).map(|k| [k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1]);
    let mut pairs = Vec::new();
    for (a, piece) in pieces.iter().enumerate() {
        let beside = steps
            .clone()
            .map(|step| [0, 1, 2].map(|k| piece.place[k] + step[k]));
        let there = beside.filter_map(|place| at.get(&place).copied());
        pairs.extend(there.filter(|&b| b > a).map(|b| [a, b]));
    }
    pairs
}

/// Adds a segment to the occupancy of its cell.
fn add(segment: &Segment, occupancy: &mut Occupancy) {
    let [x, y] = segment.key.map(|k| k.rem_euclid(ALONG));
    let part = 1.0 / f64::from(ALONG);
    for z in 0..ALONG {
        let low = f64::from(segment.level) + f64::from(z) * part;
        let filled = (segment.high.min(low + part) - segment.low.max(low)).max(0.0) / part;
        occupancy[(x + ALONG * (y + ALONG * z)) as usize] += filled;
    }
}

/// Which pieces are connected to which.
struct Joins(Vec<BTreeSet<usize>>);

impl Joins {
    /// From links between cells; material too small to be a piece still connects the pieces that it touches.
    fn of_links(
        links: &[[usize; 2]],
        part_of: &[usize],
        index: &BTreeMap<usize, usize>,
        count: usize,
    ) -> Self {
        let mut joins = Self(vec![BTreeSet::new(); count]);
        let mut around_dust: BTreeMap<usize, BTreeSet<usize>> = BTreeMap::new();
        for link in links {
            let [a, b] = link.map(|s| part_of[s]);
            match (index.get(&a), index.get(&b)) {
                (Some(&a), Some(&b)) => joins.join(a, b),
                (Some(&piece), None) => drop(around_dust.entry(b).or_default().insert(piece)),
                (None, Some(&piece)) => drop(around_dust.entry(a).or_default().insert(piece)),
                (None, None) => {}
            }
        }
        for pieces in around_dust.values() {
            let pieces: Vec<usize> = pieces.iter().copied().collect();
            for (k, &a) in pieces.iter().enumerate() {
                pieces[k + 1..].iter().for_each(|&b| joins.join(a, b));
            }
        }
        joins
    }

    fn join(&mut self, a: usize, b: usize) {
        if a != b {
            self.0[a].insert(b);
            self.0[b].insert(a);
        }
    }

    /// Whether two pieces are connected directly or through one other.
    fn near(&self, a: usize, b: usize) -> bool {
        self.0[a].contains(&b) || !self.0[a].is_disjoint(&self.0[b])
    }

    /// Connected pairs whose cells are adjacent.
    fn pairs(&self, pieces: &[Piece]) -> Vec<[usize; 2]> {
        let touch = |a: usize, b: usize| {
            let (a, b) = (pieces[a].place, pieces[b].place);
            (0..3).all(|k| a[k].abs_diff(b[k]) <= 1)
        };
        let mut pairs = Vec::new();
        for (a, with) in self.0.iter().enumerate() {
            pairs.extend(
                with.iter()
                    .filter(|&&b| b > a && touch(a, b))
                    .map(|&b| [a, b]),
            );
        }
        pairs
    }
}

/// Adds cells without material where they are needed.
fn add_empty(pieces: &mut Vec<Piece>, joins: &mut Joins, needed: &BTreeSet<[i32; 3]>) {
    const FACES: [[i32; 3]; 6] = [
        [0, 0, -1],
        [0, 0, 1],
        [-1, 0, 0],
        [1, 0, 0],
        [0, -1, 0],
        [0, 1, 0],
    ];
    let mut at: BTreeMap<[i32; 3], Vec<usize>> = BTreeMap::new();
    for (i, piece) in pieces.iter().enumerate() {
        at.entry(piece.place).or_default().push(i);
    }
    let empty: Vec<[i32; 3]> = needed
        .iter()
        .copied()
        .filter(|p| !at.contains_key(p))
        .collect();
    for place in empty {
        let own = pieces.len();
        let beside: Vec<usize> = FACES
            .iter()
            .filter_map(|f| at.get(&[0, 1, 2].map(|a| place[a] + f[a])))
            .flatten()
            .copied()
            .collect();
        let material = |i: usize| pieces[i].occupancy.iter().sum::<f64>();
        let best = beside
            .iter()
            .copied()
            .max_by(|&a, &b| material(a).total_cmp(&material(b)).then(b.cmp(&a)));
        let mut with: Vec<usize> = best.into_iter().collect();
        loop {
            let around = |&&c: &&usize| {
                !with.contains(&c) && with.iter().any(|&s| s != c && joins.near(s, c))
            };
            let Some(&next) = beside.iter().find(around) else {
                break;
            };
            with.push(next);
        }
        pieces.push(Piece {
            place,
            occupancy: [0.0; PARTS],
        });
        joins.0.push(BTreeSet::new());
        for piece in with {
            joins.join(own, piece);
        }
        at.entry(place).or_default().push(own);
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use crate::canonical::closed_surface::{ClosedSurfaceOptions, closed_surface};
    use nalgebra::{Rotation3, UnitVector3};

    /// Connected groups of pieces with material.
    fn groups(pieces: &Pieces) -> usize {
        let mut group: Vec<usize> = (0..pieces.filled).collect();
        for _ in 0..pieces.filled {
            for [a, b] in &pieces.joined {
                if *a.max(b) < pieces.filled {
                    let least = group[*a].min(group[*b]);
                    (group[*a], group[*b]) = (least, least);
                }
            }
        }
        group.iter().enumerate().filter(|(i, g)| i == *g).count()
    }

    /// A bar of 12 by 4 by 4 cm is one group; a wall across its middle, wherever it lies in a cell and however it is turned, makes two of it, and a wall beside
    /// it leaves it whole.
    #[test]
    fn a_wall_divides_material() {
        let size = Vector3::new(0.06, 0.02, 0.02);
        let (mut points, mut normals) = (Vec::new(), Vec::new());
        for axis in 0..3 {
            let others = [(axis + 1) % 3, (axis + 2) % 3];
            let steps = others.map(|k| (size[k] / 0.005) as i32);
            for (i, j) in
                (-steps[0]..=steps[0]).flat_map(|i| (-steps[1]..=steps[1]).map(move |j| (i, j)))
            {
                for sign in [-1.0, 1.0] {
                    let mut p = Vector3::zeros();
                    (p[axis], p[others[0]], p[others[1]]) = (
                        sign * size[axis],
                        0.005 * f64::from(i),
                        0.005 * f64::from(j),
                    );
                    points.push(Point3::from(p));
                    normals.push(UnitVector3::new_unchecked(Vector3::ith(axis, sign)));
                }
            }
        }
        let weights = vec![1.0; points.len()];
        let surface = closed_surface(
            &points,
            &normals,
            &weights,
            &ClosedSurfaceOptions::new(0.005),
        )
        .unwrap();
        for (place, turn) in [(0.0, 0.0), (0.004, 0.4), (-0.007, 0.8), (0.011, -0.6)] {
            let lattice = Lattice::new(
                0.013,
                Point3::new(place, 0.002, 0.001),
                Rotation3::from_axis_angle(&Vector3::z_axis(), turn),
            );
            let columns = Columns::of_mesh(&surface.vertices, &surface.triangles, &lattice);
            let across = |x: f64| -> Vec<Point3<f64>> {
                let angles = (0..16).map(|k| std::f64::consts::TAU * f64::from(k) / 16.0);
                angles
                    .map(|a| Point3::new(x, 0.03 * a.cos(), 0.03 * a.sin()))
                    .collect()
            };
            let divided = |contacts: &[Vec<Point3<f64>>]| {
                let walls = Walls::new(contacts, &lattice);
                groups(&Pieces::new(
                    &columns,
                    &lattice,
                    &BTreeSet::new(),
                    1.0,
                    Material::Connected,
                    &walls,
                ))
            };
            assert_eq!(divided(&[]), 1, "{place} {turn}");
            assert_eq!(divided(&[across(0.0)]), 2, "{place} {turn}");
            assert_eq!(divided(&[across(-0.02), across(0.02)]), 3, "{place} {turn}");
            assert_eq!(divided(&[across(0.1)]), 1, "{place} {turn}");
        }
    }
}
