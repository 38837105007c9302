//! Pieces of material that share a cell: nodes are split where the material is separate, and nowhere else.
#![allow(missing_docs, clippy::unwrap_used, reason = "tests")]

#[path = "common/body.rs"]
mod dense;

use dense::{TABLE, UP, block};
use nalgebra::{Point3, Rotation3};
use proptest::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use topo_ekf::Error;
use topo_ekf::body::{
    BodyFilter, BodyFrame, BodyOptions, Embedding, Lattice, Occupancy, PARTS, Piece, Pose,
};

const H: f64 = 0.016;
/// Cells along each of two fingers, which share a row of cells, and of the palm that they grow from.
const LONG: i32 = 4;

/// The parts of a cell in which both fingers lie, apart along the second axis: the first quarter and the last.
fn finger(side: usize) -> Occupancy {
    std::array::from_fn(|k| if k / 4 % 4 == 3 * side { 1.0 } else { 0.0 })
}

/// Two fingers along the first axis on a full palm: `parted` or with common nodes.
fn hand(parted: bool) -> (Lattice, [u32; 2]) {
    let mut lattice = Lattice::new(H, Point3::origin(), Rotation3::identity());
    let mut pieces = vec![Piece {
        place: [0, 0, 0],
        occupancy: [1.0; PARTS],
    }];
    let mut joined = vec![];
    for x in 1..=LONG {
        let place = [x, 0, 0];
        if parted {
            for side in 0..2 {
                let own = pieces.len();
                pieces.push(Piece {
                    place,
                    occupancy: finger(side),
                });
                joined.push([own, if x == 1 { 0 } else { own - 2 }]);
            }
        } else {
            let both = [finger(0), finger(1)];
            joined.push([pieces.len() - 1, pieces.len()]);
            pieces.push(Piece {
                place,
                occupancy: std::array::from_fn(|k| both[0][k] + both[1][k]),
            });
        }
    }
    let cells = lattice.set_pieces(&pieces, &joined).unwrap();
    let last = cells.len() - 1;
    (lattice, [cells[last - usize::from(parted)], cells[last]])
}

/// How far the tip of the second finger follows when the first is lifted by 20 mm and the palm is held.
fn follows(parted: bool) -> f64 {
    let (lattice, [first, second]) = hand(parted);
    let lifted = Embedding::new(first, [1.0, 0.125, 0.5]);
    let tip = Embedding::new(second, [1.0, 0.875, 0.5]);
    let start = lattice.warp(lattice.rest(), &tip);
    let palm: Vec<(Embedding, Point3<f64>)> = (0..8)
        .map(|k| Embedding::new(0, [k & 1, k >> 1 & 1, k >> 2].map(f64::from)))
        .map(|at| (at, lattice.warp(lattice.rest(), &at)))
        .collect();
    let options = BodyOptions::default()
        .with_initial_weight(1e-6)
        .with_initial_weight_sigma(1e-6);
    let mut body = BodyFilter::new(lattice, TABLE, &options).unwrap();
    for frame in 1..=20 {
        let up = UP.into_inner() * (1e-3 * f64::from(frame));
        let mut held = palm.clone();
        let from = body.lattice().warp(body.lattice().rest(), &lifted);
        held.push((lifted, from + up));
        body.step(
            &BodyFrame::new(&held, &[]),
            &mut |_, _, _| vec![],
            &mut |_, _| {},
        )
        .unwrap();
    }
    (body.pose().position(body.lattice(), &tip) - start).z
}

#[test]
fn a_lifted_finger_leaves_the_other_where_it_is() {
    let (together, apart) = (follows(false), follows(true));
    assert!(
        together > 0.012,
        "one cell for both carries the second along: {together}"
    );
    assert!(apart.abs() < 0.003, "pieces of their own do not: {apart}");
}

#[test]
fn fingers_part_after_the_palm_and_rejoin() {
    let (mut lattice, _) = hand(true);
    // 8 nodes of the palm; each finger shares four of them and has four more a cell.
    assert_eq!(lattice.rest().len(), 8 + 2 * 4 * LONG as usize);
    assert!(lattice.is_parted([LONG, 0, 0]));
    assert!(!lattice.is_parted([0, 0, 0]));
    let nodes = lattice.rest().to_vec();
    let pieces: Vec<Piece> = (0..=LONG)
        .map(|x| Piece {
            place: [x, 0, 0],
            occupancy: [1.0; PARTS],
        })
        .collect();
    let joined: Vec<[usize; 2]> = (0..LONG as usize).map(|x| [x, x + 1]).collect();
    lattice.set_pieces(&pieces, &joined).unwrap();
    assert_eq!(
        lattice.rest(),
        &nodes[..],
        "nodes stay where and which they are"
    );
    let used: BTreeSet<u32> = lattice.cells().iter().flat_map(|c| c.nodes).collect();
    assert_eq!(
        used.len(),
        4 * (LONG as usize + 2),
        "one set of nodes again"
    );
    assert!(!lattice.is_parted([LONG, 0, 0]));
}

/// A split node starts at the position of the original node, in every pose.
#[test]
fn parting_does_not_move_a_bent_body() {
    let mut lattice = block([4, 1, 1], H);
    let mut pose = Pose::at_rest(&lattice);
    for p in &mut pose.live {
        p.z += 3.0 * p.x * p.x;
    }
    pose.fit_turns(&lattice);
    let places: Vec<[i32; 3]> = lattice.cells().iter().map(|c| c.place).collect();
    let mut pieces: Vec<Piece> = places
        .iter()
        .map(|p| Piece {
            place: *p,
            occupancy: finger(0),
        })
        .collect();
    pieces.extend(places.iter().map(|p| Piece {
        place: *p,
        occupancy: finger(1),
    }));
    let joined: Vec<[usize; 2]> = (0..3).flat_map(|k| [[k, k + 1], [k + 4, k + 5]]).collect();
    let before: Vec<Point3<f64>> = (0..4)
        .map(|c| pose.position(&lattice, &Embedding::new(c, [0.3, 0.8, 0.2])))
        .collect();
    let cells = lattice.set_pieces(&pieces, &joined).unwrap();
    pose.extend(&lattice);
    for (k, at) in before.iter().enumerate() {
        for cell in [cells[k], cells[k + 4]] {
            let now = pose.position(&lattice, &Embedding::new(cell, [0.3, 0.8, 0.2]));
            assert!((now - at).norm() < 1e-12);
        }
    }
}

#[test]
fn what_cannot_be_is_refused_and_changes_nothing() {
    let mut lattice = block([2, 1, 1], H);
    let before = format!("{lattice:?}");
    let piece = |x| Piece {
        place: [x, 0, 0],
        occupancy: [1.0; PARTS],
    };
    let missing = lattice.set_pieces(&[piece(0)], &[]);
    assert!(matches!(
        missing,
        Err(Error::PlaceWithoutPiece { place: [1, 0, 0] })
    ));
    let all = [piece(0), piece(1), piece(3)];
    for pair in [[0, 2], [0, 3]] {
        let refused = lattice.set_pieces(&all, &[[0, 1], pair]);
        assert!(matches!(refused, Err(Error::NotJoined { index: 1, .. })));
    }
    assert_eq!(format!("{lattice:?}"), before);
}

proptest! {
    /// Random pieces and joins: corners are one node exactly where joins connect them, whatever the lattice was before.
    #[test]
    fn nodes_are_the_classes_of_joined_corners(
        first in prop::collection::vec(1..3usize, 12),
        second in prop::collection::vec(1..3usize, 12),
        picks in prop::collection::vec(any::<bool>(), 400),
    ) {
        let mut lattice = block([3, 2, 2], H);
        for counts in [first, second] {
            let (pieces, joined) = random(&counts, &picks);
            let nodes_before = lattice.rest().to_vec();
            let cells = lattice.set_pieces(&pieces, &joined).unwrap();
            prop_assert!(lattice.rest().starts_with(&nodes_before));
            // The oracle: flood the corners through the joins.
            let corner = |piece: usize, k: i32| {
                let p = pieces[piece].place;
                [p[0] + (k & 1), p[1] + (k >> 1 & 1), p[2] + (k >> 2)]
            };
            let mut label: BTreeMap<(usize, i32), usize> = BTreeMap::new();
            for start in (0..pieces.len()).flat_map(|p| (0..8).map(move |k| (p, k))) {
                if label.contains_key(&start) {
                    continue;
                }
                let name = label.len();
                let mut stack = vec![start];
                while let Some((p, k)) = stack.pop() {
                    if label.insert((p, k), name).is_some() {
                        continue;
                    }
                    let ends = joined.iter().filter(|j| j.contains(&p));
                    for other in ends.map(|j| if j[0] == p { j[1] } else { j[0] }) {
                        let same = (0..8).find(|l| corner(other, *l) == corner(p, k));
                        stack.extend(same.filter(|l| !label.contains_key(&(other, *l))).map(|l| (other, l)));
                    }
                }
            }
            let node = |(p, k): (usize, i32)| lattice.cells()[cells[p] as usize].nodes[k as usize];
            for (a, la) in &label {
                let stands = lattice.rest()[node(*a) as usize];
                let at = corner(a.0, a.1).map(|c| f64::from(c) * H);
                prop_assert!((stands - Point3::from(at)).norm() < 1e-12);
                for (b, lb) in &label {
                    prop_assert_eq!(la == lb, node(*a) == node(*b));
                }
            }
        }
    }
}

/// `counts` pieces in the cells of a block of 3 × 2 × 2, joined at random across faces.
fn random(counts: &[usize], picks: &[bool]) -> (Vec<Piece>, Vec<[usize; 2]>) {
    let mut pieces = vec![];
    for (k, count) in (0_i32..).zip(counts) {
        for side in 0..*count {
            pieces.push(Piece {
                place: [k % 3, k / 3 % 2, k / 6],
                occupancy: finger(side),
            });
        }
    }
    let mut picks = picks.iter();
    let mut joined = vec![];
    for a in 0..pieces.len() {
        for b in a + 1..pieces.len() {
            let steps = (0..3).map(|x| pieces[a].place[x].abs_diff(pieces[b].place[x]));
            if steps.sum::<u32>() == 1 && picks.next().copied().unwrap_or(true) {
                joined.push([a, b]);
            }
        }
    }
    (pieces, joined)
}

#[test]
fn a_hand_weighs_what_its_pieces_weigh() {
    let (lattice, _) = hand(true);
    let cells = 0..lattice.cells().len() as u32;
    let mass: f64 = cells.map(|c| lattice.mass(c)).sum();
    assert!((mass - (1.0 + 0.5 * f64::from(LONG))).abs() < 1e-12);
    assert!(lattice.away(0, &[0.5; 3]) == 0.0);
    let (_, [first, _]) = hand(true);
    assert!((lattice.away(first, &[0.5, 0.75, 0.5]) - 0.5).abs() < 1e-12);
}
