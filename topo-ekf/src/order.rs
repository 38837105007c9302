//! Elimination order: nested dissection of the surface by the rest positions of its vertices (George 1973).
//!
//! ```text
//! set  →  half A,  separator,  half B        cut across the longest extent; separator: vertices of one half with neighbours in the other
//! order:  A,  B,  separator                  A and B recursively
//! ```
//!
//! On a surface of `Q` vertices separators have `√Q` vertices, and the last ones to be eliminated form a few large dense blocks. Minimum
//! degree leaves fewer entries in the factor but in smaller blocks, which take longer.

use nalgebra::Point3;

use crate::pattern::Pattern;

/// Largest size of sets that are not divided further.
const LEAF: usize = 30;

/// The vertices in the order in which to eliminate them.
pub(crate) fn dissect(points: &[Point3<f64>], pattern: &Pattern) -> Vec<usize> {
    let mut order = Vec::with_capacity(points.len());
    let mut side = vec![Side::Out; points.len()];
    cut(
        points,
        pattern,
        (0..points.len()).collect(),
        &mut side,
        &mut order,
    );
    order
}

#[derive(Clone, Copy, PartialEq)]
enum Side {
    Out,
    A,
    B,
}

fn cut(
    points: &[Point3<f64>],
    pattern: &Pattern,
    mut set: Vec<usize>,
    side: &mut [Side],
    order: &mut Vec<usize>,
) {
    if set.len() <= LEAF {
        order.extend(set);
        return;
    }
    let axis = longest(points, &set);
    // Stable sort: vertices with equal coordinates keep their order.
    set.sort_by(|&i, &j| points[i][axis].total_cmp(&points[j][axis]));
    let half = set.len() / 2;
    for (k, &i) in set.iter().enumerate() {
        side[i] = if k < half { Side::A } else { Side::B };
    }
    let touches = |i: usize, other: Side| pattern.neighbours(i).any(|j| side[j] == other);
    let rim = |of: &[usize], other| of.iter().filter(|&&i| touches(i, other)).count();
    let (from, other) = if rim(&set[..half], Side::B) <= rim(&set[half..], Side::A) {
        (Side::A, Side::B)
    } else {
        (Side::B, Side::A)
    };
    let (mut a, mut b, mut separator) = (vec![], vec![], vec![]);
    for &i in &set {
        let part = match side[i] {
            s if s == from && touches(i, other) => &mut separator,
            Side::A => &mut a,
            _ => &mut b,
        };
        part.push(i);
    }
    for &i in &set {
        side[i] = Side::Out;
    }
    cut(points, pattern, a, side, order);
    cut(points, pattern, b, side, order);
    order.extend(separator);
}

/// Coordinate in which the set has the largest extent.
fn longest(points: &[Point3<f64>], set: &[usize]) -> usize {
    let (mut low, mut high) = (points[set[0]], points[set[0]]);
    for &i in set {
        (low, high) = (low.inf(&points[i]), high.sup(&points[i]));
    }
    (high - low).imax()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn complete(order: &[usize]) -> bool {
        let mut sorted = order.to_vec();
        sorted.sort_unstable();
        sorted.into_iter().eq(0..order.len())
    }

    #[test]
    fn a_sheet_is_cut_along_a_line() {
        let side = 40;
        let points: Vec<_> = (0..side * side)
            .map(|k| Point3::new(f64::from(k % side), f64::from(k / side), 0.0))
            .collect();
        let at = |x: i32, y: i32| (y * side + x) as u32;
        let mut edges = vec![];
        for y in 0..side {
            for x in 0..side - 1 {
                edges.extend([[at(x, y), at(x + 1, y)], [at(y, x), at(y, x + 1)]]);
            }
        }
        let order = dissect(&points, &Pattern::new(points.len(), &edges));
        assert!(complete(&order));
        let last = &order[order.len() - 40..];
        let on_line = |axis: usize| {
            let first = points[last[0]][axis];
            last.iter().all(|&i| (points[i][axis] - first).abs() < 0.5)
        };
        assert!(on_line(0) || on_line(1), "{last:?}");
    }

    #[test]
    fn vertices_in_one_place_come_once_each() {
        let points = vec![Point3::origin(); 200];
        let edges: Vec<_> = (1..200).map(|i| [0, i]).collect();
        assert!(complete(&dissect(&points, &Pattern::new(200, &edges))));
    }
}
