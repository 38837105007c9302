//! Projections against clarabel on all unknowns at once and the proof by duality, contradictions against least squares.
#![allow(missing_docs, clippy::unwrap_used, reason = "tests")]

mod common;

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettingsBuilder, DefaultSolver, IPSolver, SupportedConeT};
use common::{Noise, dense_information, ellipsoid};
use nalgebra::{DMatrix, DVector, Point3, UnitVector3, Vector3};
use proptest::prelude::*;
use topo_ekf::{Filter, Frame, Inequality, Observation, Options, Plane, Status};

/// `Σ a_v · x_v ≥ b` in metres: the largest coefficient has length 1.
type Row = (Vec<(u32, Vector3<f64>)>, f64);

/// Every plane at every vertex, then the inequalities.
fn rows_of(planes: &[Plane], own: &[Inequality], vertices: usize) -> Vec<Row> {
    let of_plane = |p: &Plane| {
        let (normal, bound) = (p.normal.into_inner(), -p.offset);
        (0..vertices as u32).map(move |v| (vec![(v, normal)], bound))
    };
    let in_metres = |r: &Inequality| {
        let unit = r.terms.iter().map(|(_, a)| a.norm()).fold(0.0, f64::max);
        let terms = r.terms.iter().map(|&(v, a)| (v, a / unit)).collect();
        (terms, r.bound / unit)
    };
    let of_planes = planes.iter().flat_map(of_plane);
    of_planes.chain(own.iter().map(in_metres)).collect()
}

fn gap((terms, bound): &Row, x: &[Point3<f64>]) -> f64 {
    let reached = |(v, a): &(u32, Vector3<f64>)| a.dot(&x[*v as usize].coords);
    bound - terms.iter().map(reached).sum::<f64>()
}

/// `A`, a row each, over the three coordinates one after the other.
fn coefficients(rows: &[Row], vertices: usize) -> DMatrix<f64> {
    let mut a = DMatrix::zeros(rows.len(), 3 * vertices);
    for (k, (terms, _)) in rows.iter().enumerate() {
        for (v, c) in terms {
            for axis in 0..3 {
                a[(k, axis * vertices + *v as usize)] += c[axis];
            }
        }
    }
    a
}

fn sparse(a: &DMatrix<f64>) -> CscMatrix<f64> {
    let rows: Vec<Vec<f64>> = a.row_iter().map(|r| r.iter().copied().collect()).collect();
    CscMatrix::from(rows.as_slice())
}

/// `min ½ xᵀ P x   s.t.   A x ≥ g`: the optimum and the multipliers.
fn clarabel(p: &DMatrix<f64>, a: &DMatrix<f64>, g: &[f64]) -> (Vec<f64>, Vec<f64>) {
    // Residuals are then near 1e-15 all the same; a tolerance near rounding makes it give up at a gap of per cents (going backwards).
    let settings = DefaultSettingsBuilder::default()
        .verbose(false)
        .tol_gap_abs(1e-12)
        .tol_gap_rel(1e-12)
        .tol_feas(1e-9)
        .build()
        .unwrap();
    let cones = [SupportedConeT::NonnegativeConeT(g.len())];
    let bound: Vec<f64> = g.iter().map(|g| -g).collect();
    let (zero, below) = (vec![0.0; a.ncols()], sparse(&-a));
    let upper = sparse(&p.upper_triangle());
    let mut solver = DefaultSolver::new(&upper, &zero, &below, &bound, &cones, settings).unwrap();
    solver.solve();
    (solver.solution.x.clone(), solver.solution.z.clone())
}

/// `S ⊗ I₃`.
fn threefold(s: &DMatrix<f64>) -> DMatrix<f64> {
    let n = s.nrows();
    DMatrix::from_fn(3 * n, 3 * n, |i, j| {
        if i / n == j / n {
            s[(i % n, j % n)]
        } else {
            0.0
        }
    })
}

fn stacked(x: &[Point3<f64>], from: &[Point3<f64>]) -> DVector<f64> {
    let n = x.len();
    DVector::from_fn(3 * n, |k, _| (x[k % n] - from[k % n])[k / n])
}

/// What there is to know about a projection without the code under test.
struct Optimum {
    /// `S ⊗ I₃`, `A` and the gaps of the unconstrained estimate.
    metric: DMatrix<f64>,
    a: DMatrix<f64>,
    gaps: DVector<f64>,
    /// Forces: nonnegative, from clarabel on all 3Q unknowns at once.
    forces: DVector<f64>,
}

impl Optimum {
    fn new(s: &DMatrix<f64>, rows: &[Row], estimate: &[Point3<f64>]) -> Self {
        let (metric, a) = (threefold(s), coefficients(rows, estimate.len()));
        let gaps = DVector::from_iterator(rows.len(), rows.iter().map(|r| gap(r, estimate)));
        // Clarabel's tolerances are absolute: in units of the deepest gap and the largest information.
        let (scale, deepest) = (s.max(), gaps.max());
        let (_, z) = clarabel(&(&metric / scale), &a, (&gaps / deepest).as_slice());
        let forces = DVector::from_vec(z).map(|z| z.max(0.0) * scale * deepest);
        Self {
            metric,
            a,
            gaps,
            forces,
        }
    }

    /// Cost `½ dᵀ S d` of a displacement, how far it may be above the least that the constraints allow, and the part of that which is
    /// not made of gaps.
    ///
    /// Every `λ ≥ 0` proves `½ dᵀ S d ≥ gᵀλ − ½ λᵀ A S⁻¹ Aᵀ λ` for every feasible `d` (weak duality), whoever found it: that clarabel
    /// is exact need not be trusted. What lies between is the residual of the optimality conditions,
    /// `½ ‖S d − Aᵀλ‖²` in the metric `S⁻¹` (no other forces than those of the rows) and `λᵀ (A d − g)` (no force without touch).
    fn excess(&self, d: &DVector<f64>) -> (f64, f64, f64) {
        let cost = 0.5 * d.dot(&(&self.metric * d));
        let push = self.a.tr_mul(&self.forces);
        let moved = self.metric.clone().cholesky().unwrap().solve(&push);
        let excess = cost - (self.gaps.dot(&self.forces) - 0.5 * push.dot(&moved));
        let untouched = self.forces.dot(&(&self.a * d - &self.gaps));
        (cost, excess, excess - untouched)
    }

    /// What forces that are exact to `accuracy`, m, in every row may cost more.
    fn allowance(&self, accuracy: f64) -> f64 {
        self.forces.sum() * accuracy
    }
}

/// Root of the least sum of squares by which the rows from `hard` on are violated where the first `hard` are kept.
fn least_violation(rows: &[Row], hard: usize, estimate: &[Point3<f64>]) -> f64 {
    let (unknowns, soft) = (3 * estimate.len(), rows.len() - hard);
    let gaps: Vec<f64> = rows.iter().map(|r| gap(r, estimate)).collect();
    let deepest = gaps.iter().copied().fold(0.0, f64::max);
    let mut a = DMatrix::zeros(rows.len(), unknowns + soft);
    a.columns_mut(0, unknowns)
        .copy_from(&coefficients(rows, estimate.len()));
    let mut p = DMatrix::zeros(unknowns + soft, unknowns + soft);
    for k in 0..soft {
        a[(hard + k, unknowns + k)] = 1.0;
        p[(unknowns + k, unknowns + k)] = 1.0;
    }
    let g: Vec<f64> = gaps.iter().map(|g| g / deepest).collect();
    let (x, _) = clarabel(&p, &a, &g);
    deepest * x[unknowns..].iter().map(|s| s * s).sum::<f64>().sqrt()
}

/// Relative motion asked of two vertices: along `direction`, `more` metres (of a coefficient of length 1) beyond 1 mm less than now.
#[derive(Clone, Copy, Debug)]
struct Pull {
    from: u32,
    to: u32,
    direction: [f64; 3],
    more: f64,
}

/// A body over one plane or in the corner of two, some of it seen, and pulled at.
#[derive(Clone, Debug)]
struct Case {
    seed: u64,
    tilt: [f64; 2],
    depth: f64,
    second: Option<(f64, f64)>,
    pulls: Vec<Pull>,
}

impl Case {
    fn planes(&self) -> Vec<Plane> {
        let normal = UnitVector3::new_normalize(Vector3::new(self.tilt[0], self.tilt[1], 1.0));
        // The body reaches about 0.02 below its centre: the plane cuts `depth` off it.
        let mut planes = vec![Plane {
            normal,
            offset: 0.02 - self.depth,
        }];
        if let Some((lean, cut)) = self.second {
            let normal = UnitVector3::new_normalize(Vector3::new(1.0, lean, 0.2));
            planes.push(Plane {
                normal,
                offset: 0.03 - cut,
            });
        }
        planes
    }

    fn inequalities(&self, live: &[Point3<f64>]) -> Vec<Inequality> {
        let of = |p: &Pull| {
            let a = Vector3::from(p.direction);
            let now = a.dot(&(live[p.from as usize] - live[p.to as usize]));
            Inequality {
                terms: vec![(p.from, a), (p.to, -a)],
                bound: now + p.more - 1e-3,
            }
        };
        self.pulls
            .iter()
            .filter(|p| p.from != p.to)
            .map(of)
            .collect()
    }

    fn check(&self) -> Result<(), TestCaseError> {
        let (rest, edges) = ellipsoid(60, [0.03, 0.025, 0.02], 5);
        let mut noise = Noise(self.seed);
        let observations: Vec<_> = (0..rest.len())
            .filter(|i| rest[*i].z > -0.005)
            .map(|i| Observation {
                vertex: i as u32,
                position: rest[i] + noise.vector(1e-3),
                sigma: 1e-3,
            })
            .collect();
        let options = Options::default();
        let mut free = Filter::new(&rest, &edges, &options).unwrap();
        free.step(&Frame::new(&observations)).unwrap();
        let (mut planes, own) = (self.planes(), self.inequalities(free.live()));
        let mut held = Filter::new(&rest, &edges, &options).unwrap();
        let frame = Frame::new(&observations)
            .with_planes(&planes)
            .with_inequalities(&own);
        let report = held.step(&frame).unwrap();
        prop_assert_eq!(held.unconstrained(), free.live());
        // The plane that most vertices violate comes first: it holds whatever else is asked.
        planes.sort_by_key(|p| {
            std::cmp::Reverse(free.live().iter().filter(|x| p.height(x) < 0.0).count())
        });
        let rows = rows_of(&planes, &own, rest.len());
        let deepest = rows.iter().map(|r| gap(r, free.live())).fold(0.0, f64::max);
        let left = rows.iter().map(|r| gap(r, held.live()).max(0.0));
        match report.status {
            Status::Free => {
                // Identical, to the bit.
                prop_assert_eq!(held.live(), free.live());
                prop_assert!(deepest <= 1e-8, "{deepest}");
            }
            Status::Constrained => {
                prop_assert!(deepest > 0.0);
                let left = left.fold(0.0, f64::max);
                prop_assert!(left <= 1e-6, "{left}");
                let s = dense_information(held.information(), &edges, &options);
                let optimum = Optimum::new(&s, &rows, free.live());
                let d = stacked(held.live(), free.live());
                let (cost, excess, imbalance) = optimum.excess(&d);
                // Rounding, what rows are left untouched by, and what they may be violated by.
                let (rounding, fine) = (1e-9 * cost, optimum.allowance(2e-8));
                prop_assert!(excess <= fine + rounding, "{excess} {fine} of {cost}");
                prop_assert!(
                    imbalance <= optimum.allowance(1e-6) + rounding,
                    "{imbalance} of {cost}"
                );
            }
            Status::Infeasible => {
                let least = least_violation(&rows, rest.len(), free.live());
                let left = left.map(|l| l * l).sum::<f64>().sqrt();
                prop_assert!(least > 1e-9, "{report:?}");
                prop_assert!(left <= least * 1.001, "{left} {least}");
            }
            _ => prop_assert!(false, "{report:?}"),
        }
        Ok(())
    }
}

fn pulls() -> impl Strategy<Value = Vec<Pull>> {
    // Among few vertices and along few directions, pulls meet: they add up, brace or contradict each other.
    let vertex = || prop_oneof![1 => 0u32..60, 2 => 40u32..43];
    let axis = prop::sample::select(vec![[1.0, 0.0, 0.0], [0.0, 0.6, 0.8], [0.0, 0.0, -0.5]]);
    let direction = prop_oneof![prop::array::uniform3(-1.0..1.0f64), axis];
    let pull = (vertex(), vertex(), direction, 0.0..4e-3f64).prop_filter_map(
        "no direction",
        |(from, to, direction, more)| {
            (Vector3::from(direction).norm() > 1e-3).then_some(Pull {
                from,
                to,
                direction,
                more,
            })
        },
    );
    prop::collection::vec(pull, 0..5)
}

proptest! {
    // What fails is kept as a named case below, not in a file.
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn planes_and_inequalities_are_kept_at_least_cost(
        seed in any::<u64>(),
        tilt in prop::array::uniform2(-0.6..0.6f64),
        depth in -0.004..0.012f64,
        second in prop::option::of((-0.8..0.8f64, 0.0..0.012f64)),
        pulls in pulls(),
    ) {
        Case { seed, tilt, depth, second, pulls }.check()?;
    }
}

#[test]
fn a_pull_of_two_metres_is_kept_as_well() {
    // Once called infeasible: the softness of rows left 0.2 mm of this gap. Nothing contradicts it.
    let along = [0.120_928_260_966_128_71, 0.0, 0.310_916_990_777_573_8];
    let pull = |from, to, direction, more| Pull {
        from,
        to,
        direction,
        more,
    };
    let case = Case {
        seed: 0,
        tilt: [0.0; 2],
        depth: 0.0,
        second: None,
        pulls: vec![
            pull(41, 2, along, 0.003_947_228_190_607_911),
            pull(2, 41, [0.0, 0.0, 1e-3], 0.003_225_118_887_882_721_2),
        ],
    };
    case.check().unwrap();
}

#[test]
fn one_pull_above_a_tilted_plane_costs_no_more_than_it_must() {
    // Once 20 % apart from clarabel, which had been asked for more digits of feasibility than there are and had given up on the way.
    let case = Case {
        seed: 8_930_525_114_985_367_278,
        tilt: [-0.458_292_565_611_713_9, 0.508_425_555_055_777_6],
        depth: -0.001_905_193_004_515_308_4,
        second: None,
        pulls: vec![Pull {
            from: 49,
            to: 4,
            direction: [
                -0.914_589_474_543_131,
                0.740_796_169_453_030_7,
                0.934_240_255_461_213_4,
            ],
            more: 0.003_004_220_640_163_258,
        }],
    };
    case.check().unwrap();
}
