//! Cells that are removed: what is left is the same body in the same pose, and goes on as if they had never been.
#![allow(missing_docs, clippy::unwrap_used, reason = "tests")]

#[path = "common/body.rs"]
mod dense;

use dense::{TABLE, block};
use nalgebra::{Point3, Rotation3, Vector3};
use proptest::prelude::*;
use topo_ekf::Error;
use topo_ekf::body::{
    BodyFilter, BodyFrame, BodyOptions, Embedding, Foot, Lattice, PARTS, Piece, Pose,
};

const H: f64 = 0.016;
/// Cells of a block, and places away from it.
const BLOCK: usize = 12;
const APART: [[i32; 3]; 3] = [[8, 0, 3], [8, 5, 3], [-6, 0, 3]];

fn body(lattice: Lattice) -> BodyFilter {
    // How firmly grips hold must not depend on the weight of cells that are removed later.
    let options = BodyOptions::default().with_firm_pull(f64::INFINITY);
    let mut body = BodyFilter::new(lattice, TABLE, &options).unwrap();
    let foot = |cell| Foot {
        at: Embedding::new(cell, [0.5, 0.5, 0.0]),
        load: 2.0,
    };
    let stands = (0..body.lattice().cells().len() as u32).filter(|&c| {
        let [x, y, z] = body.lattice().cells()[c as usize].place;
        (0..3).contains(&x) && (0..2).contains(&y) && z == 0
    });
    let feet = stands.map(foot).collect();
    body.set_feet(feet);
    body
}

/// Lifts the corner of a body by `frames` steps from `from`.
fn lift(body: &mut BodyFilter, corner: u32, from: usize, frames: usize) {
    let grip = Embedding::new(corner, [0.0, 0.5, 1.0]);
    for frame in from + 1..=from + frames {
        let up = 0.002 * frame as f64;
        let held = [(grip, Point3::new(0.0, 0.5 * H, 2.0 * H + up))];
        let surface = [Embedding::new(corner, [0.5, 0.5, 1.0])];
        let frame = BodyFrame::new(&held, &surface);
        body.step(&frame, &mut |_, _, _| vec![], &mut |_, _| {})
            .unwrap();
    }
}

/// Two bodies, one of them with cells apart from its block in the middle of its list, and which of its cells belong to the block.
fn with_and_without() -> (BodyFilter, BodyFilter, Vec<bool>) {
    let plain = block([3, 2, 2], H);
    let mut mixed = Lattice::new(H, Point3::origin(), Rotation3::identity());
    let mut keep = vec![];
    for (k, cell) in plain.cells().iter().enumerate() {
        if k % 4 == 1 {
            mixed.ensure(APART[k / 4]);
            keep.push(false);
        }
        mixed.ensure(cell.place);
        keep.push(true);
    }
    (body(mixed), body(plain), keep)
}

#[test]
fn the_rest_goes_on_as_if_the_cells_had_never_been() {
    let (mut mixed, mut plain, keep) = with_and_without();
    let corner = |body: &BodyFilter| body.lattice().cell_at([0, 0, 1]).unwrap();
    let (a, b) = (corner(&mixed), corner(&plain));
    lift(&mut mixed, a, 0, 5);
    lift(&mut plain, b, 0, 5);
    let renumbered = mixed.retain_cells(&keep).unwrap();
    assert_eq!(renumbered.cell(a), Some(b));
    assert_eq!(mixed.lattice().cells(), plain.lattice().cells());
    assert_eq!(mixed.lattice().rest(), plain.lattice().rest());
    assert_eq!(mixed.weight().to_bits(), plain.weight().to_bits());
    lift(&mut mixed, b, 5, 10);
    lift(&mut plain, b, 5, 10);
    let now = mixed.pose().live.iter().zip(&plain.pose().live);
    let off = now.map(|(p, q)| (p - q).norm()).fold(0.0, f64::max);
    let risen = plain.pose().live.iter().map(|p| p.z).fold(0.0, f64::max) - 2.0 * H;
    assert!(risen > 0.02 && off < 1e-6, "risen {risen}, off {off:e}");
}

#[test]
fn what_cannot_be_is_refused_and_changes_nothing() {
    let (mut mixed, _, keep) = with_and_without();
    let before = format!("{:?} {:?}", mixed.lattice(), mixed.pose());
    let short = mixed.retain_cells(&keep[1..]);
    assert!(matches!(
        short,
        Err(Error::CellOutOfRange { .. } | Error::Length { .. })
    ));
    let mut without_foot = keep.clone();
    without_foot[0] = false;
    assert!(matches!(
        mixed.retain_cells(&without_foot),
        Err(Error::CellOutOfRange {
            what: "foot",
            index: 0,
            ..
        })
    ));
    mixed.set_feet(vec![]);
    assert!(matches!(
        mixed.retain_cells(&keep[1..]),
        Err(Error::Length {
            found: 14,
            expected: 15,
            ..
        })
    ));
    assert_eq!(
        mixed.retain_cells(&vec![false; keep.len()]),
        Err(Error::NoVertices)
    );
    assert_eq!(format!("{:?} {:?}", mixed.lattice(), mixed.pose()), before);
}

/// The block as one piece a cell, some of them in two halves that are not joined.
fn divided(halves: &[bool]) -> Lattice {
    let mut lattice = block([3, 2, 2], H);
    let mut pieces = vec![];
    for (cell, halves) in lattice.cells().iter().zip(halves) {
        let half = |side: usize| -> [f64; PARTS] {
            std::array::from_fn(|k| f64::from(u8::from(!halves || k / 4 % 4 / 2 == side)))
        };
        for side in 0..=usize::from(*halves) {
            pieces.push(Piece {
                place: cell.place,
                occupancy: half(side),
            });
        }
    }
    let joined: Vec<[usize; 2]> = (1..pieces.len()).map(|k| [k - 1, k]).collect();
    let touch = |[a, b]: &[usize; 2]| {
        let (a, b) = (pieces[*a].place, pieces[*b].place);
        a != b && (0..3).all(|k| a[k].abs_diff(b[k]) <= 1)
    };
    let joined: Vec<[usize; 2]> = joined.into_iter().filter(touch).collect();
    lattice.set_pieces(&pieces, &joined).unwrap();
    lattice
}

proptest! {
    /// Any cells of any divided block: those kept have the same places, corners and neighbours, and no node is left over.
    #[test]
    fn kept_cells_stay_the_same(
        halves in prop::collection::vec(any::<bool>(), BLOCK),
        marks in prop::collection::vec(any::<bool>(), 2 * BLOCK),
        seed in any::<u16>(),
    ) {
        let lattice = divided(&halves);
        let mut body = BodyFilter::new(lattice.clone(), TABLE, &BodyOptions::default()).unwrap();
        body.set_feet(vec![]);
        let mut keep = marks[..lattice.cells().len()].to_vec();
        keep[usize::from(seed) % lattice.cells().len()] = true;
        let before = body.pose().clone();
        let renumbered = body.retain_cells(&keep).unwrap();
        let now = body.lattice();
        prop_assert_eq!(now.cells().len(), keep.iter().filter(|k| **k).count());
        prop_assert_eq!(now.rest().len(), body.pose().live.len());
        prop_assert_eq!(body.pose(), &renumbered.pose(&before));
        for (c, cell) in lattice.cells().iter().enumerate() {
            let old = Embedding::new(c as u32, [0.2, 0.7, 1.1]);
            let Some(at) = renumbered.embedding(&old) else {
                prop_assert!(!keep[c]);
                continue;
            };
            let new = &now.cells()[at.cell as usize];
            prop_assert_eq!((new.place, &new.occupancy), (cell.place, &cell.occupancy));
            prop_assert_eq!(new.nodes.map(Some), cell.nodes.map(|n| renumbered.node(n)));
            prop_assert_eq!(now.warp(now.rest(), &at), lattice.warp(lattice.rest(), &old));
            prop_assert!(now.copies(cell.place).contains(&at.cell));
        }
        let mut used: Vec<u32> = now.cells().iter().flat_map(|c| c.nodes).collect();
        used.sort_unstable();
        used.dedup();
        prop_assert_eq!(used, (0..now.rest().len() as u32).collect::<Vec<u32>>());
        for place in lattice.cells().iter().map(|c| c.place) {
            let kept: Vec<u32> = lattice.copies(place).iter().filter_map(|&c| renumbered.cell(c)).collect();
            prop_assert_eq!(now.copies(place), &kept[..]);
        }
        // A pose from before the block was divided, extended to it, is one of what is left.
        let shift = Vector3::new(0.01, 0.0, 0.02);
        let mut early = Pose::at_rest(&block([3, 2, 2], H));
        early.live.iter_mut().for_each(|p| *p += shift);
        early.extend(&lattice);
        let early = renumbered.pose(&early);
        prop_assert_eq!((early.live.len(), early.turns.len()), (now.rest().len(), now.cells().len()));
        for (p, q) in early.live.iter().zip(now.rest()) {
            prop_assert!((p - q - shift).norm() < 1e-9);
        }
        // It still takes frames.
        let grip = Embedding::new(0, [0.5; 3]);
        let held = [(grip, now.warp(now.rest(), &grip))];
        body.step(&BodyFrame::new(&held, &[]), &mut |_, _, _| vec![], &mut |_, _| {}).unwrap();
    }
}
