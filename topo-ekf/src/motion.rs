//! Prediction: the motion since the last frame, estimated from the seen vertices and spread to the hidden ones.
//!
//! ```text
//! whole component   z_i ≈ C(x_i)                        C rigid, weighted least squares (Kabsch)
//! local rotations   min Σ_i λ_i ‖ω_i − ω̂_i‖² + Σ_e ‖ω_i − ω_j‖²/σ_b²
//!                   ω̂_i rotates the seen edges of i, λ_i is the information they give
//! positions         min Σ_i ‖x⁻_i − z_i‖²/σ_i² + Σ_e ‖x⁻_i − x⁻_j − ½(ΔR_i + ΔR_j)(x_i − x_j)‖²/σ_m²
//!                   ΔR_i = exp[ω_i] R_C
//! ```
//!
//! As-rigid-as-possible alternations move information one edge at a time: from a bad start the far side of a half-seen
//! body needs hundreds of them. Two linear solves provide a start that is exact for any rigid motion, extrapolates bending
//! smoothly to the far side, and averages the noise of the seen side over many vertices.

use nalgebra::{Matrix3, Point3, Rotation3, Vector3};

use crate::graph::Graph;
use crate::observation::Seen;
use crate::options::{Options, Unseen};
use crate::rotation::{nearest_rotation, solve_positive};
use crate::system::System;
use crate::{Error, columns};

/// Prior on the rotation of a whole component within a frame, as information on an angle (1/0.2² rad⁻²). It determines the axis
/// that one, two or collinear observations leave open; a well observed body outweighs it ten-thousandfold.
const TURN_INFORMATION: f64 = 25.0;

/// Rigid motion of a component: `x ↦ R (x − from) + to`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rigid {
    pub rotation: Rotation3<f64>,
    from: Vector3<f64>,
    to: Vector3<f64>,
}

impl Rigid {
    const STILL: fn() -> Self = || Self {
        rotation: Rotation3::identity(),
        from: Vector3::zeros(),
        to: Vector3::zeros(),
    };

    fn apply(&self, p: &Point3<f64>) -> Point3<f64> {
        Point3::from(self.rotation * (p.coords - self.from) + self.to)
    }
}

/// Predicted rotation and position of every vertex.
pub(crate) struct Moved {
    pub turns: Vec<Rotation3<f64>>,
    pub positions: Vec<Point3<f64>>,
}

impl Moved {
    /// The prediction without motion.
    pub fn still(live: &[Point3<f64>]) -> Self {
        Self {
            turns: vec![Rotation3::identity(); live.len()],
            positions: live.to_vec(),
        }
    }
}

/// Predicts from the last frame's positions and this frame's observations.
pub(crate) fn predict(
    graph: &Graph,
    system: &mut System,
    live: &[Point3<f64>],
    seen: &Seen,
    options: &Options,
) -> Result<Moved, Error> {
    let rigid = rigid_motions(graph, live, seen, options);
    let carried: Vec<_> = live
        .iter()
        .zip(&graph.component)
        .map(|(p, &c)| rigid[c as usize].apply(p))
        .collect();
    let turns = spread_turns(graph, system, &carried, seen, options)?
        .iter()
        .zip(&graph.component)
        .map(|(w, &c)| Rotation3::new(*w) * rigid[c as usize].rotation)
        .collect::<Vec<_>>();
    let positions = place(graph, system, live, &carried, &turns, seen, options)?;
    Ok(Moved { turns, positions })
}

/// One weighted Kabsch fit per component that is seen.
fn rigid_motions(
    graph: &Graph,
    live: &[Point3<f64>],
    seen: &Seen,
    options: &Options,
) -> Vec<Rigid> {
    let fit = |of: Option<u32>| {
        let chosen = || {
            (0..live.len()).filter(move |&i| {
                seen.information[i] > 0.0 && of.is_none_or(|c| graph.component[i] == c)
            })
        };
        let total: f64 = chosen().map(|i| seen.information[i]).sum();
        if total <= 0.0 {
            return None;
        }
        let mean = |points: &[Point3<f64>]| {
            chosen()
                .map(|i| points[i].coords * seen.information[i])
                .sum::<Vector3<f64>>()
                / total
        };
        let (from, to) = (mean(live), mean(&seen.position));
        let moment = chosen()
            .map(|i| {
                (seen.position[i].coords - to)
                    * (live[i].coords - from).transpose()
                    * seen.information[i]
            })
            .sum::<Matrix3<f64>>();
        let identity = Rotation3::identity();
        let rotation = nearest_rotation(
            &(moment + Matrix3::identity() * TURN_INFORMATION),
            &identity,
        );
        Some(Rigid { rotation, from, to })
    };
    let unseen = match options.unseen {
        Unseen::Hold => None,
        Unseen::Follow => fit(None),
    };
    // There are few components in practice; with many, one pass for each seen component would be quadratic.
    let mut motions = vec![unseen.unwrap_or_else(Rigid::STILL); graph.components];
    let mut done = vec![false; graph.components];
    for i in 0..live.len() {
        let c = graph.component[i];
        if seen.information[i] > 0.0 && !done[c as usize] {
            done[c as usize] = true;
            if let Some(rigid) = fit(Some(c)) {
                motions[c as usize] = rigid;
            }
        }
    }
    motions
}

/// Rotations relative to the component's own: measured on edges with two seen ends, harmonic elsewhere.
fn spread_turns(
    graph: &Graph,
    system: &mut System,
    carried: &[Point3<f64>],
    seen: &Seen,
    options: &Options,
) -> Result<Vec<Vector3<f64>>, Error> {
    let size = carried.len();
    let mut normal = vec![Matrix3::zeros(); size];
    let mut moment = vec![Vector3::zeros(); size];
    for &[i, j] in &graph.edges {
        let (i, j) = (i as usize, j as usize);
        let (ri, rj) = (seen.information[i], seen.information[j]);
        if ri > 0.0 && rj > 0.0 {
            let weight = ri * rj / (ri + rj);
            let before = carried[i] - carried[j];
            let after = seen.position[i] - seen.position[j];
            let inertia = (Matrix3::identity() * before.norm_squared()
                - before * before.transpose())
                * weight;
            let turn = before.cross(&after) * weight;
            for k in [i, j] {
                normal[k] += inertia;
                moment[k] += turn;
            }
        }
    }
    let mut information = vec![0.0; size];
    let mut rhs = vec![0.0; 3 * size];
    for i in 0..size {
        let trace = normal[i].trace();
        if trace > 0.0 {
            information[i] = trace / 3.0;
            // A thousandth of the trace keeps collinear edges solvable: no rotation about their line is then assumed.
            let held = normal[i] + Matrix3::identity() * (1e-3 * trace);
            let turn = solve_positive(&held, &moment[i]).unwrap_or_else(Vector3::zeros);
            columns::add(&mut rhs, i, &(turn * information[i]));
        }
    }
    // A weight of one (1 rad) on zero rotation keeps components without a seen edge solvable.
    let diagonal: Vec<f64> = information.iter().map(|w| w + 1.0).collect();
    let stiff = 1.0 / options.bend_sigma.powi(2);
    let values = system.pattern.assemble(&diagonal, &graph.edges, |_| stiff);
    let factor = system.factorise(&values)?;
    system.solve(&factor, &mut rhs);
    system.recycle(factor);
    Ok(columns::read(&rhs))
}

/// Positions whose edges are the rotated edges of the last frame, and that are near the observations.
fn place(
    graph: &Graph,
    system: &mut System,
    live: &[Point3<f64>],
    carried: &[Point3<f64>],
    turns: &[Rotation3<f64>],
    seen: &Seen,
    options: &Options,
) -> Result<Vec<Point3<f64>>, Error> {
    let size = live.len();
    let anchor = 1.0 / options.anchor_sigma.powi(2);
    let stiff = 1.0 / options.motion_sigma.powi(2);
    // Solved for the displacement from the rigidly moved position, so that rigid motion costs no precision.
    let mut rhs = vec![0.0; 3 * size];
    for i in 0..size {
        columns::add(
            &mut rhs,
            i,
            &((seen.position[i] - carried[i]) * seen.information[i]),
        );
    }
    for &[i, j] in &graph.edges {
        let (i, j) = (i as usize, j as usize);
        let edge = live[i] - live[j];
        let turned = (turns[i] * edge + turns[j] * edge) * 0.5;
        let pull = (turned - (carried[i] - carried[j])) * stiff;
        columns::add(&mut rhs, i, &pull);
        columns::add(&mut rhs, j, &-pull);
    }
    let diagonal: Vec<f64> = seen.information.iter().map(|r| r + anchor).collect();
    let values = system.pattern.assemble(&diagonal, &graph.edges, |_| stiff);
    let factor = system.factorise(&values)?;
    system.solve(&factor, &mut rhs);
    system.recycle(factor);
    Ok(carried
        .iter()
        .zip(columns::read(&rhs))
        .map(|(p, d)| p + d)
        .collect())
}
