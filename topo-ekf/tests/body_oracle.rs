//! The body filter against dense algebra: one step, covariances, the projection; and rejected input.
#![allow(missing_docs, clippy::unwrap_used, reason = "tests")]

mod common;
#[path = "common/body.rs"]
mod dense;

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettingsBuilder, DefaultSolver, IPSolver, SupportedConeT};
use common::Noise;
use dense::{TABLE, UP, block, elastic, selection, skin};
use nalgebra::{DMatrix, DVector, Matrix3, Point3, Rotation3, UnitVector3, Vector3};
use topo_ekf::body::{
    BodyFilter, BodyFrame, BodyInequality, BodyOptions, BodyReport, Embedding, Foot, Lattice, Row,
};
use topo_ekf::{Error, Plane, Status};

const H: f64 = 0.016;

fn options() -> BodyOptions {
    BodyOptions::default().with_steps(1).with_presteps(0)
}

fn some_rows(lattice: &Lattice, seed: u64) -> Vec<Row> {
    let mut noise = Noise(seed);
    let skin = skin(lattice);
    let rows = skin.iter().filter(|s| s.1 > 3).map(|(at, _)| {
        let target = lattice.warp(lattice.rest(), at) + noise.vector(1e-3);
        let across = UnitVector3::new_normalize(Vector3::z() + noise.vector(0.3));
        Row::along(*at, target, across, 1e6)
    });
    let mut rows: Vec<Row> = rows.collect();
    let at = Embedding::new(0, [0.3, 0.2, 0.9]);
    let target = lattice.warp(lattice.rest(), &at) + Vector3::new(0.0, 1e-3, 2e-3);
    rows.push(Row::point(at, target, 1e6));
    rows
}

/// `H` and `−∇E` at rest: elasticity, rows, where nodes are expected.
fn normal_equations(
    lattice: &Lattice,
    rows: &[Row],
    o: &BodyOptions,
) -> (DMatrix<f64>, DVector<f64>) {
    let (mut h, mut f) = elastic(lattice, lattice.rest(), o.stiffness, o.poisson_ratio);
    for i in 0..f.len() {
        h[(i, i)] += o.motion_sigma.powi(-2);
    }
    for row in rows {
        let w = selection(lattice, &row.at);
        let square = row
            .direction
            .map_or(Matrix3::identity(), |d| d.into_inner() * d.transpose());
        let miss = row.target - lattice.warp(lattice.rest(), &row.at);
        h += w.transpose() * square * &w * row.weight;
        f += w.transpose() * (square * miss) * row.weight;
    }
    (h, f)
}

/// Hung high over the table, and without weight: nothing but rows acts.
fn floating(lattice: &Lattice) -> BodyFilter {
    let table = Plane {
        normal: UP,
        offset: 1.0,
    };
    let mut body = BodyFilter::new(lattice.clone(), table, &options()).unwrap();
    body.set_feet(vec![]);
    body
}

fn step(body: &mut BodyFilter, frame: &BodyFrame<'_>, rows: &[Row]) -> Result<BodyReport, Error> {
    body.step(frame, &mut |_, _, _| rows.to_vec(), &mut |_, _| {})
}

#[test]
fn one_step_is_dense_algebra() {
    let turn = Rotation3::new(Vector3::new(0.2, -0.1, 0.4));
    let mut lattice = Lattice::new(H, Point3::new(0.1, 0.0, 0.2), turn);
    for k in 0..8 {
        let cell = lattice.ensure([k % 4, k / 4, 0]);
        lattice.set_fill(cell, 1.0 - 0.1 * f64::from(k), 1.0);
    }
    let rows = some_rows(&lattice, 5);
    let mut body = floating(&lattice);
    let report = step(&mut body, &BodyFrame::new(&[], &[]), &rows).unwrap();
    assert_eq!(report.status, Status::Free);
    let (h, f) = normal_equations(&lattice, &rows, &options());
    let moves = h.clone().cholesky().unwrap().solve(&f);
    for (i, (live, rest)) in body.pose().live.iter().zip(lattice.rest()).enumerate() {
        let error = live - rest - Vector3::from_column_slice(&moves.as_slice()[3 * i..3 * i + 3]);
        // Rounding of 1e-16 in a matrix of condition 1e4, moves of millimetres.
        assert!(error.norm() < 1e-12, "{i}: {error}");
    }

    // The same matrix gives the covariances, in one look and in several.
    let points: Vec<Embedding> = skin(&lattice).iter().map(|s| s.0).collect();
    let inverse = h.try_inverse().unwrap();
    let found = body.covariances(&points).unwrap();
    let sigmas = body.marginal_sigmas(&points).unwrap();
    for ((at, c), sigma) in points.iter().zip(&found).zip(&sigmas) {
        let w = selection(&lattice, at);
        let exact = &w * &inverse * w.transpose();
        assert!((c - &exact).norm() < 1e-9 * exact.norm());
        assert!((sigma - (exact.trace() / 3.0).sqrt()).abs() < 1e-9 * sigma);
        let alone = body.covariances(&[*at]).unwrap()[0];
        assert!((alone - c).norm() < 1e-12 * c.norm());
    }
    let threshold = 0.5 * (sigmas.iter().copied().fold(0.0, f64::max) + sigmas[0]);
    let observed = body.observability(&points, threshold).unwrap();
    assert!(observed.determined.contains(&true) && observed.determined.contains(&false));
}

/// min ½ dᵀ H d s.t. D d ≥ g, all of it, by clarabel.
fn whole_problem(h: &DMatrix<f64>, d: &DMatrix<f64>, g: &DVector<f64>) -> DVector<f64> {
    // In millimetres and in units of the largest information.
    let unit = h.amax();
    let settings = DefaultSettingsBuilder::default()
        .verbose(false)
        .tol_gap_abs(1e-12)
        .tol_gap_rel(1e-12)
        .tol_feas(1e-11)
        .build()
        .unwrap();
    let csc = |m: &DMatrix<f64>| {
        let (mut starts, mut at, mut values) = (vec![0], vec![], vec![]);
        for column in m.column_iter() {
            for (i, v) in column.iter().enumerate().filter(|(_, v)| **v != 0.0) {
                at.push(i);
                values.push(*v);
            }
            starts.push(at.len());
        }
        CscMatrix::new(m.nrows(), m.ncols(), starts, at, values)
    };
    let (p, a) = (csc(&(h.upper_triangle() / unit)), csc(&-d));
    let b: Vec<f64> = g.iter().map(|g| -g * 1e3).collect();
    let cone = [SupportedConeT::NonnegativeConeT(b.len())];
    let zero = vec![0.0; h.nrows()];
    let mut solver = DefaultSolver::new(&p, &zero, &a, &b, &cone, settings).unwrap();
    solver.solve();
    DVector::from_iterator(h.nrows(), solver.solution.x.iter().map(|x| x * 1e-3))
}

#[test]
fn the_projection_is_that_of_the_whole_problem() {
    for (seed, sink) in [(1, 0.5e-3), (2, 2e-3), (3, 8e-3)] {
        let lattice = block([4, 3, 1], H);
        let surface: Vec<Embedding> = skin(&lattice)
            .iter()
            .filter(|s| s.1 != 5)
            .map(|s| s.0)
            .collect();
        let mut noise = Noise(seed);
        // Rows that draw the top down and askew.
        let rows: Vec<Row> = skin(&lattice)
            .iter()
            .filter(|s| s.1 == 5)
            .map(|(at, _)| {
                let target = lattice.warp(lattice.rest(), at) - Vector3::z() * sink
                    + noise.vector(0.5 * sink);
                Row::point(*at, target, 1e6)
            })
            .collect();
        let apart = [
            BodyInequality {
                terms: vec![
                    (Embedding::new(0, [0.0, 0.5, 0.5]), -Vector3::x()),
                    (Embedding::new(3, [1.0, 0.5, 0.5]), Vector3::x() * 0.7),
                    (Embedding::new(3, [1.0, 0.5, 0.5]), Vector3::x() * 0.3),
                ],
                bound: 4.0 * H + sink,
            },
            BodyInequality {
                terms: vec![(Embedding::new(5, [0.5; 3]), Vector3::new(0.0, -0.2, 1.0))],
                bound: -0.1,
            },
        ];
        // The table is far below in the steps and where it is in the projection: the first body tells the estimate without constraints, and
        // contact rows would make another matrix.
        let mut free = floating(&lattice);
        step(&mut free, &BodyFrame::new(&[], &[]), &rows).unwrap();
        let low = free.pose().live.clone();
        let (h, _) = normal_equations(&lattice, &rows, &options());
        // Inequalities alone stand for the table.
        let mut inequalities: Vec<BodyInequality> = surface
            .iter()
            .map(|at| BodyInequality {
                terms: vec![(*at, Vector3::z())],
                bound: 0.0,
            })
            .collect();
        inequalities.extend(apart);
        let mut body = floating(&lattice);
        let frame = BodyFrame::new(&[], &[]).with_inequalities(&inequalities);
        let report = step(&mut body, &frame, &rows).unwrap();
        assert_eq!(report.status, Status::Constrained);
        assert!(report.pushing > 3 && report.violation[0] > 0.1 * sink);

        let size = 3 * low.len();
        let mut d = DMatrix::zeros(inequalities.len(), size);
        let mut g = DVector::zeros(inequalities.len());
        for (k, row) in inequalities.iter().enumerate() {
            g[k] = row.bound;
            for (at, a) in &row.terms {
                let w = a.transpose() * selection(&lattice, at);
                d.row_mut(k)
                    .iter_mut()
                    .zip(w.iter())
                    .for_each(|(d, w)| *d += w);
                g[k] -= a.dot(&lattice.warp(&low, at).coords);
            }
        }
        let exact = whole_problem(&h, &d, &g);
        for (i, (p, l)) in body.pose().live.iter().zip(&low).enumerate() {
            let error = p - l - Vector3::from_column_slice(&exact.as_slice()[3 * i..3 * i + 3]);
            // Violations of a tenth of a micrometre are left standing.
            assert!(error.norm() < 5e-7, "{seed} {i}: {error}");
        }
    }
}

#[test]
fn no_point_stays_under_the_table() {
    let lattice = block([5, 4, 2], H);
    let surface: Vec<Embedding> = skin(&lattice).iter().map(|s| s.0).collect();
    let mut body = BodyFilter::new(lattice, TABLE, &BodyOptions::default()).unwrap();
    for k in 0..12 {
        let mut noise = Noise(k);
        let rows: Vec<Row> = surface
            .iter()
            .map(|at| {
                let rest = body.lattice().warp(body.lattice().rest(), at);
                Row::point(*at, rest - Vector3::z() * 3e-3 + noise.vector(2e-3), 1e6)
            })
            .collect();
        let report = step(&mut body, &BodyFrame::new(&[], &surface), &rows).unwrap();
        assert_eq!(report.status, Status::Constrained);
        let points = surface.iter().chain(body.feet().iter().map(|f| &f.at));
        for at in points {
            assert!(body.pose().position(body.lattice(), at).z > -1e-6);
        }
    }
}

#[test]
fn contradictions_are_reported_and_shared() {
    let lattice = block([2, 1, 1], H);
    let at = Embedding::new(0, [0.5; 3]);
    let mut body = floating(&lattice);
    let start = body.pose().position(&lattice, &at).z;
    let contradictory =
        [(1.0, start + 1e-3), (-1.0, -start + 1e-3)].map(|(s, bound)| BodyInequality {
            terms: vec![(at, Vector3::z() * s)],
            bound,
        });
    let frame = BodyFrame::new(&[], &[]).with_inequalities(&contradictory);
    let report = step(&mut body, &frame, &[]).unwrap();
    assert_eq!(report.status, Status::Infeasible);
    // Both lack a millimetre in the middle.
    assert!((body.pose().position(&lattice, &at).z - start).abs() < 1e-5);
    // A row that cancels to nothing cannot be kept either.
    let nothing = [BodyInequality {
        terms: vec![(at, Vector3::z()), (at, -Vector3::z())],
        bound: 1e-3,
    }];
    let frame = BodyFrame::new(&[], &[]).with_inequalities(&nothing);
    assert_eq!(
        step(&mut body, &frame, &[]).unwrap().status,
        Status::Infeasible
    );
}

#[test]
#[allow(clippy::too_many_lines, reason = "one list of refusals")]
fn refusals_leave_the_body_as_it_was() {
    let lattice = block([3, 2, 1], H);
    let good = Embedding::new(0, [0.5; 3]);
    let nowhere = Embedding::new(99, [0.5; 3]);
    let mut broken = good;
    broken.weights[3] = f64::NAN;
    let here = Point3::new(0.5 * H, 0.5 * H, 0.5 * H);
    let void = Point3::new(0.0, f64::INFINITY, 0.0);
    let mut body = BodyFilter::new(lattice, TABLE, &BodyOptions::default()).unwrap();
    let held = [(good, here + Vector3::z() * 2e-3)];
    step(&mut body, &BodyFrame::new(&held, &[good]), &[]).unwrap();

    let row = Row::point(good, here, 1e6);
    let bad_rows = [
        Row { at: nowhere, ..row },
        Row { at: broken, ..row },
        Row {
            target: void,
            ..row
        },
        Row {
            weight: f64::NAN,
            ..row
        },
        Row {
            weight: -1.0,
            ..row
        },
        Row {
            weight: 1e30,
            ..row
        },
        Row {
            direction: Some(UnitVector3::new_unchecked(Vector3::new(f64::NAN, 0.0, 0.0))),
            ..row
        },
    ];
    let none = [].as_slice();
    let bad_grips = [[(nowhere, here)], [(broken, here)], [(good, void)]];
    let inequality = |at, a: f64, bound| {
        [BodyInequality {
            terms: vec![(at, Vector3::z() * a)],
            bound,
        }]
    };
    let bad_inequalities = [
        inequality(nowhere, 1.0, 0.0),
        inequality(good, f64::NAN, 0.0),
        inequality(good, 0.0, 0.0),
        inequality(good, 1.0, f64::NAN),
    ];
    let held_frame = BodyFrame::new(&held, none);
    let mut frames: Vec<(BodyFrame<'_>, Vec<Row>)> = bad_rows
        .iter()
        .map(|r| (held_frame, vec![row, *r]))
        .collect();
    frames.extend(
        bad_rows
            .iter()
            .map(|r| (BodyFrame::new(&[], none), vec![*r])),
    );
    frames.extend(bad_grips.iter().map(|g| (BodyFrame::new(g, none), vec![])));
    let bad_points = [nowhere, broken];
    frames.push((BodyFrame::new(&held, &bad_points), vec![]));
    frames.extend(
        bad_inequalities
            .iter()
            .map(|i| (held_frame.with_inequalities(i), vec![])),
    );

    let state = |body: &BodyFilter| {
        (
            body.pose().clone(),
            body.is_falling(),
            body.weight_over_stiffness(),
            body.marginal_sigmas(&[good]).unwrap(),
        )
    };
    let before = state(&body);
    for (frame, rows) in &frames {
        assert!(step(&mut body, frame, rows).is_err());
        assert_eq!(state(&body), before);
        if rows.is_empty() {
            assert!(body.weigh(frame, &[(good, UP)]).is_err());
            assert_eq!(state(&body), before);
        }
    }
    // What comes after is the same, to the bit, as in a twin that was never asked anything wrong.
    let mut twin = BodyFilter::new(block([3, 2, 1], H), TABLE, &BodyOptions::default()).unwrap();
    step(&mut twin, &BodyFrame::new(&held, &[good]), &[]).unwrap();
    for body in [&mut body, &mut twin] {
        step(body, &BodyFrame::new(&[], &[good]), &[row]).unwrap();
        step(body, &held_frame, &[row]).unwrap();
    }
    assert_eq!(body.pose(), twin.pose());
    let now = state(&body);
    for (frame, rows) in &frames {
        assert!(step(&mut body, frame, rows).is_err());
        assert_eq!(state(&body), now);
    }
    for seen in [
        (nowhere, UP),
        (good, UnitVector3::new_unchecked(Vector3::zeros())),
    ] {
        assert!(body.weigh(&held_frame, &[seen]).is_err());
        assert_eq!(state(&body), now);
    }
    // Feet.
    let feet = body.feet().to_vec();
    for foot in [
        Foot {
            at: nowhere,
            load: 1.0,
        },
        Foot {
            at: good,
            load: f64::NAN,
        },
    ] {
        body.set_feet(vec![foot]);
        assert!(step(&mut body, &held_frame, &[]).is_err());
        assert_eq!(state(&body), now);
    }
    body.set_feet(feet);
    // The lattice.
    assert!(matches!(
        body.try_edit(|l| *l = block([1, 1, 1], H)),
        Err(Error::CellsLost { cell: 1 })
    ));
    assert!(matches!(
        body.try_edit(|l| {
            l.set_fill(2, -1.0, 1.0);
        }),
        Err(Error::Value { index: 2, .. })
    ));
    assert!(body.lattice().clone().set_fill(99, 1.0, 1.0).is_none());
    body.edit(|l| *l = Lattice::new(f64::NAN, Point3::origin(), Rotation3::identity()));
    assert_eq!(state(&body), now);
    assert!(body.marginal_sigmas(&[nowhere]).is_err());
    assert!(body.observability(&[good], f64::NAN).is_err());
    // Growth: a new cell has no variance before the next step, and the old ones keep theirs.
    let cell = body.ensure([3, 0, 0], f64::NAN);
    assert!(matches!(
        body.marginal_sigmas(&[Embedding::new(cell, [0.5; 3])]),
        Err(Error::CellOutOfRange {
            cell: 6,
            cells: 6,
            ..
        })
    ));
    assert_eq!(body.marginal_sigmas(&[good]).unwrap(), now.3);
    assert!(step(&mut body, &held_frame, &[bad_rows[0]]).is_err());
    assert_eq!(body.marginal_sigmas(&[good]).unwrap(), now.3);
    step(&mut body, &held_frame, &[]).unwrap();
    assert!(
        body.marginal_sigmas(&[Embedding::new(cell, [0.5; 3])])
            .is_ok()
    );
    body.ensure([i32::MAX, i32::MIN, 0], -4.0);
    step(&mut body, &held_frame, &[]).unwrap();
}

#[test]
fn no_body_without_sense() {
    let make = |lattice, table| BodyFilter::new(lattice, table, &BodyOptions::default()).err();
    let empty = Lattice::new(H, Point3::origin(), Rotation3::identity());
    assert_eq!(make(empty, TABLE), Some(Error::NoVertices));
    let tilted = Plane {
        normal: UnitVector3::new_unchecked(Vector3::new(f64::NAN, 0.0, 1.0)),
        offset: 0.0,
    };
    assert!(matches!(
        make(block([1, 1, 1], H), tilted),
        Some(Error::Plane { .. })
    ));
    let mut negative = block([1, 1, 1], H);
    negative.set_fill(0, 1.0, -0.1);
    assert!(matches!(make(negative, TABLE), Some(Error::Value { .. })));
    assert!(matches!(
        make(block([1, 1, 1], -1.0), TABLE),
        Some(Error::Value { .. })
    ));
    let skewed = Rotation3::from_matrix_unchecked(Matrix3::identity() * 2.0);
    let mut skewed = Lattice::new(H, Point3::origin(), skewed);
    skewed.ensure([0; 3]);
    assert!(matches!(
        make(skewed, TABLE),
        Some(Error::NotARotation { .. })
    ));
    let stiff = BodyOptions::default().with_stiffness(f64::NAN);
    assert!(BodyFilter::new(block([1, 1, 1], H), TABLE, &stiff).is_err());
}
