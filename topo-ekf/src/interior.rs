//! The whole projection by clarabel's interior point method, for cases in which the active sets did not converge.
//!
//! ```text
//! min ½ dᵀ (W ⊗ I₃) d + ‖s‖²/(2ς)     s.t.   A d + s ≥ g,   h + d_n ≥ 0        d: displacement, s: residual of infeasible rows
//! ```
//!
//! The same programme as in [`crate::project`], including its softness `ς`: at the optimum `s = ς λ`. It is posed in displacements,
//! because the constant in the other form would dominate the solver's relative gap. It takes seconds at 2,000 vertices, but always terminates.

use clarabel::algebra::CscMatrix;

use crate::Error;
use crate::pattern::Pattern;
use crate::plane_contact::PlaneContact;
use crate::problem::Problem;
use crate::quadratic_program::minimise;
use crate::rows::Stack;
use crate::system::System;

/// Tolerance of feasibility, relative to the deepest violation. What is reached is near rounding; demanded near rounding, a residual
/// that grows from 1e-14 to 1e-10 makes clarabel stop where the cost is still wrong by per cents (seen at 1e-12).
const FEASIBILITY: f64 = 1e-9;

/// Displacement as a block in the frame of the plane, and the forces of the rows. The resting vertices are set in `table`.
pub(crate) fn interior_point(
    problem: &Problem,
    stack: &Stack,
    gaps: &[f64],
    soft: &[f64],
    system: &System,
    table: &mut PlaneContact,
) -> Result<(Vec<f64>, Vec<f64>), Error> {
    let (size, rows) = (problem.estimate.len(), stack.len());
    // In units of the deepest violation and of the largest information, because clarabel's tolerances are absolute.
    let deepest = gaps
        .iter()
        .copied()
        .chain(table.heights().iter().map(|h| -h))
        .fold(f64::MIN_POSITIVE, f64::max);
    let unit = problem.values.iter().copied().fold(0.0, f64::max);
    let slack: Vec<f64> = soft.iter().map(|s| 1.0 / (s * unit)).collect();
    let quadratic = quadratic(&system.pattern, problem.values, unit, &slack);
    let bounds = bounds(stack, size, problem.plane.is_some());
    let right: Vec<f64> = gaps
        .iter()
        .map(|g| -g / deepest)
        .chain(
            table
                .heights()
                .iter()
                .filter(|h| h.is_finite())
                .map(|h| h / deepest),
        )
        .collect();
    let zero = vec![0.0; 3 * size + rows];
    let found = minimise(&quadratic, &zero, &bounds, &right, FEASIBILITY)?;
    if problem.plane.is_some() {
        // Strict complementarity: a vertex rests if its multiplier exceeds its distance.
        let rests = |i: usize| found.z[rows + i] > found.s[rows + i];
        table.set_resting((0..size).map(rests).collect());
    }
    let shift = found.x[..3 * size].iter().map(|d| d * deepest).collect();
    let forces = (0..rows)
        .map(|k| {
            if found.z[k] > found.s[k] {
                found.z[k] * deepest * unit
            } else {
                0.0
            }
        })
        .collect();
    Ok((shift, forces))
}

/// `diag(W, W, W, I/ς)`, upper triangle in compressed columns.
fn quadratic(pattern: &Pattern, values: &[f64], unit: f64, slack: &[f64]) -> CscMatrix<f64> {
    let size = pattern.size();
    let mut columns: Vec<Vec<(usize, f64)>> = vec![vec![]; size];
    for column in 0..size {
        for at in pattern.starts[column]..pattern.starts[column + 1] {
            // The lower triangle by columns is the upper one by rows.
            columns[pattern.rows[at]].push((column, values[at] / unit));
        }
    }
    let whole = 3 * size + slack.len();
    let (mut starts, mut at, mut entries) = (vec![0], vec![], vec![]);
    for axis in 0..3 {
        for column in &columns {
            at.extend(column.iter().map(|(i, _)| axis * size + i));
            entries.extend(column.iter().map(|(_, v)| v));
            starts.push(at.len());
        }
    }
    for (k, &s) in slack.iter().enumerate() {
        at.push(3 * size + k);
        entries.push(s);
        starts.push(at.len());
    }
    CscMatrix::new(whole, whole, starts, at, entries)
}

/// `−A d − s ≤ −g` over `−d_n ≤ h`.
fn bounds(stack: &Stack, size: usize, plane: bool) -> CscMatrix<f64> {
    let rows = stack.len();
    let mut columns: Vec<Vec<(usize, f64)>> = vec![vec![]; 3 * size];
    for k in 0..rows {
        for (v, a) in stack.row(k) {
            for axis in 0..3 {
                let column = &mut columns[axis * size + *v as usize];
                match column.last_mut() {
                    // A vertex that occurs twice in one row.
                    Some((row, value)) if *row == k => *value -= a[axis],
                    _ => column.push((k, -a[axis])),
                }
            }
        }
    }
    if plane {
        for i in 0..size {
            columns[2 * size + i].push((rows + i, -1.0));
        }
    }
    let (mut starts, mut at, mut entries) = (vec![0], vec![], vec![]);
    for column in columns {
        for (row, value) in column {
            at.push(row);
            entries.push(value);
        }
        starts.push(at.len());
    }
    for k in 0..rows {
        at.push(k);
        entries.push(-1.0);
        starts.push(at.len());
    }
    let height = rows + if plane { size } else { 0 };
    CscMatrix::new(height, 3 * size + rows, starts, at, entries)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests")]

    use nalgebra::{Matrix3, Point3, UnitVector3, Vector3};

    use super::*;
    use crate::observation::Plane;
    use crate::rows::{Key, Row};

    /// Uniform in (−1, 1).
    fn draw(state: &mut u64) -> f64 {
        *state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (*state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    /// A chain over a table and rows between its vertices: force and displacement belong to each other, forces push and do so only
    /// where something touches.
    #[test]
    fn the_optimality_conditions_hold() {
        let (size, count, soft) = (40, 6, 1e-9);
        let edges: Vec<_> = (1..size as u32).map(|i| [i - 1, i]).collect();
        let chain: Vec<_> = (0..size)
            .map(|i| Point3::new(5e-3 * i as f64, 0.0, 0.0))
            .collect();
        let mut system = System::new(&chain, &edges).unwrap();
        let normal = UnitVector3::new_unchecked(Vector3::z());
        for seed in 0..50 {
            let mut state = seed;
            let mut next = || draw(&mut state);
            let diagonal: Vec<f64> = (0..size).map(|_| 1e5 * (1.1 + next())).collect();
            let values = system.pattern.assemble(&diagonal, &edges, |_| 1e6);
            let factor = system.factorise(&values).unwrap();
            let estimate: Vec<_> = (0..size)
                .map(|i| Point3::new(5e-3 * i as f64, next() * 1e-3, next() * 3e-3))
                .collect();
            let rows: Vec<_> = (0..count as u32)
                .map(|k| Row {
                    key: Key::Own(k),
                    terms: vec![
                        (5 * k, Vector3::new(next(), next(), 1.0)),
                        (5 * k + 7, -Vector3::new(0.3, next(), 1.0)),
                    ],
                    bound: next() * 2e-3,
                })
                .collect();
            let problem = Problem {
                values: &values,
                factor: &factor,
                estimate: &estimate,
                plane: Some(Plane {
                    normal,
                    offset: 0.0,
                }),
                rows: &rows,
            };
            let stack = Stack::new(&rows, &Matrix3::identity());
            let gaps: Vec<f64> = rows.iter().map(|r| r.gap(&estimate)).collect();
            let heights: Vec<f64> = estimate.iter().map(|p| p.z).collect();
            let mut table = PlaneContact::new(heights, vec![false; size]);
            let softness = vec![soft; count];
            let (shift, forces) =
                interior_point(&problem, &stack, &gaps, &softness, &system, &mut table).unwrap();

            let push = stack.push(&forces, size);
            let largest = push.iter().fold(1.0, |a: f64, f| a.max(f.abs()));
            for axis in 0..3 {
                let pulled = system
                    .pattern
                    .multiply(&values, &shift[axis * size..(axis + 1) * size]);
                for i in 0..size {
                    // Information of 1e6 times 1e-9 m, beside forces of a thousand.
                    let other = pulled[i] - push[axis * size + i];
                    let held = axis == 2 && table.rests(i as u32);
                    assert!(
                        other.abs() < 1e-6 * largest || held && other > 0.0,
                        "{other} {largest}"
                    );
                }
            }
            for (i, p) in estimate.iter().enumerate() {
                let height = p.z + shift[2 * size + i];
                assert!(
                    height > -1e-10 && (height < 1e-8 || !table.rests(i as u32)),
                    "{height}"
                );
            }
            for (k, reached) in stack.reach(&shift).into_iter().enumerate() {
                let left = gaps[k] - reached - soft * forces[k];
                assert!(left < 1e-9 && (left > -1e-8 || forces[k] == 0.0), "{left}");
            }
        }
    }
}
