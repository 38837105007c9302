//! Edges that join parts that only touched are cut, and no others.
#![allow(missing_docs, clippy::unwrap_used)]

mod common;

use common::{SPACING, at_rest, rotation};
use explore_loop::canonical::CanonicalModel;
use explore_loop::canonical::cut::distorted;
use nalgebra::{Point3, Rotation3, Vector3};
use proptest::prelude::*;

/// Two sheets that touch along x = 0, 20 by 12 vertices at 5 mm, in one plane: the graph joins them.
fn touching() -> CanonicalModel {
    let points: Vec<_> = (0..20)
        .flat_map(|i| (0..12).map(move |j| (f64::from(i) - 9.5, f64::from(j))))
        .map(|(x, y)| Point3::new(x * SPACING, y * SPACING, 0.4))
        .collect();
    let normals = vec![-Vector3::z_axis(); points.len()];
    let mut model = at_rest(&points, &normals);
    model.join(SPACING);
    model
}

fn glue(model: &CanonicalModel) -> Vec<[u32; 2]> {
    let right = |i: u32| model.rest()[i as usize].x > 0.0;
    let crosses = |e: &&[u32; 2]| right(e[0]) != right(e[1]);
    model.edges().iter().filter(crosses).copied().collect()
}

/// Opens the sheets by `gap` and moves everything rigidly.
fn open(model: &mut CanonicalModel, gap: f64, turn: &Rotation3<f64>, shift: Vector3<f64>) {
    for i in 0..model.len() {
        let mut p = model.rest()[i];
        p.x += if p.x > 0.0 { gap } else { 0.0 };
        model.live_mut()[i] = turn * p + shift;
        model.rotations_mut()[i] = *turn.matrix();
    }
}

proptest! {
    /// However everything turns, edges that did not open are not cut.
    #[test]
    fn a_rigid_turn_cuts_nothing(turn in rotation(), shift in [-1.0..1.0, -1.0..1.0, -1.0..1.0f64]) {
        let mut model = touching();
        prop_assert!(!glue(&model).is_empty());
        open(&mut model, 0.0, &turn, shift.into());
        let seen = vec![true; model.len()];
        prop_assert_eq!(distorted(&model, &seen, SPACING), Vec::<[u32; 2]>::new());
    }

    /// The glue opens beyond three spacings: it is cut, all of it and nothing else; below that nothing is.
    #[test]
    fn only_what_glued_the_sheets_is_cut(turn in rotation(), gap in 0.0..6.0f64) {
        prop_assume!((gap - 3.0).abs() > 1e-6);
        let mut model = touching();
        open(&mut model, gap * SPACING, &turn, Vector3::new(0.1, 0.0, 0.2));
        let seen = vec![true; model.len()];
        let expected = if gap > 3.0 { glue(&model) } else { Vec::new() };
        prop_assert_eq!(distorted(&model, &seen, SPACING), expected);
    }
}

/// Unseen parts may be predicted wrongly: they do not count as opened.
#[test]
fn unseen_ends_are_not_cut() {
    let mut model = touching();
    open(
        &mut model,
        4.0 * SPACING,
        &Rotation3::identity(),
        Vector3::zeros(),
    );
    let left: Vec<bool> = model.rest().iter().map(|p| p.x < 0.0).collect();
    assert!(distorted(&model, &left, SPACING).is_empty());
}

/// One end whose rotation went wrong does not cut its edges.
#[test]
fn one_wrong_rotation_cuts_nothing() {
    let mut model = touching();
    let turned = Rotation3::from_axis_angle(&Vector3::z_axis(), std::f64::consts::PI);
    model.rotations_mut()[100] = *turned.matrix();
    let seen = vec![true; model.len()];
    assert!(distorted(&model, &seen, SPACING).is_empty());
}

/// A cut is permanent: one round removes all such edges, and the graph does not join the ends again, nor others across the cut, also
/// after other vertices are gone.
#[test]
fn a_cut_is_for_good() {
    let mut model = touching();
    open(
        &mut model,
        4.0 * SPACING,
        &Rotation3::identity(),
        Vector3::zeros(),
    );
    let seen = vec![true; model.len()];
    let found = distorted(&model, &seen, SPACING);
    assert!(!found.is_empty());
    assert_eq!(model.cut(&found), found.len());
    assert_eq!(model.cut(&found), 0);
    model.join(SPACING);
    assert!(glue(&model).is_empty());
    let keep: Vec<bool> = (0..model.len()).map(|i| i % 7 != 3).collect();
    let stays = model.retain(&keep);
    model.join(SPACING);
    assert!(model.edges().iter().all(|e| !model.is_cut(*e)));
    let left = found.iter().filter(|e| e.iter().all(|i| keep[*i as usize]));
    let mut renumbered: Vec<[u32; 2]> = left
        .map(|e| e.map(|i| stays.binary_search(&i).unwrap() as u32))
        .collect();
    let mut cuts = model.cut_edges();
    renumbered.sort_unstable();
    cuts.sort_unstable();
    assert_eq!(cuts, renumbered);
    assert!(
        cuts.iter()
            .all(|e| model.is_cut(*e) && model.is_cut([e[1], e[0]]))
    );
}
