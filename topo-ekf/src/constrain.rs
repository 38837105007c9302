//! The constraints of a frame: planes, inequalities and contacts; the latter are linearised repeatedly until they converge.

use std::collections::HashSet;

use nalgebra::Point3;

use crate::Error;
use crate::contact::Surface;
use crate::filter::{Filter, Update};
use crate::observation::{Frame, Plane};
use crate::options::Projection;
use crate::problem::{Problem, Warm};
use crate::project::{Projected, Status, deepest, split_planes};
use crate::report::StepReport;
use crate::rows::{FEASIBLE, Key, Row, SPARE, deepest_gap};
use crate::system::Factor;

/// Most linearisations of the contacts. Usually two suffice; where two sheets are pressed hard onto each other, the triangle
/// below a vertex changes during the projection and five have been observed.
const LINEARISATIONS: usize = 8;
/// A constrained estimate, and the start of the next frame's projection.
pub(crate) struct Constrained {
    pub positions: Vec<Point3<f64>>,
    pub warm: Warm,
    pub surface: Surface,
    pub report: StepReport,
}

/// The metric of the projection.
enum Metric<'a> {
    Information(&'a Update),
    Euclidean(Vec<f64>, Factor),
}

impl Metric<'_> {
    fn parts(&self) -> (&[f64], &Factor) {
        match self {
            Self::Information(update) => (&update.values, &update.factor),
            Self::Euclidean(values, factor) => (values, factor),
        }
    }
}

impl Filter {
    /// Projects the estimate onto the constraints.
    pub(crate) fn constrain(
        &mut self,
        frame: &Frame,
        update: &Update,
    ) -> Result<Constrained, Error> {
        let estimate = &update.relaxed.positions;
        let (plane, planes) = split_planes(frame.planes, estimate);
        let own = frame.inequalities.iter().enumerate();
        let fixed: Vec<Row> = planes
            .into_iter()
            .chain(own.map(|(k, row)| Row::of(row, k)))
            .collect();
        // Lost after an error, it is only made again.
        let mut surface = std::mem::take(&mut self.surface).renewed(
            frame.triangles,
            &self.rest,
            self.options.separation,
        );
        let before = lack(&self.watch(&mut surface, estimate), estimate);
        let metric = self.metric(update)?;
        let Settled {
            projected,
            left,
            watched,
            work,
        } = self.linearise(&metric, estimate, plane, &fixed, &mut surface)?;
        if let Some(vertex) = first_infinite(&projected.positions) {
            return Err(Error::Overflow { vertex });
        }
        let depths = |positions: &[Point3<f64>]| {
            [
                deepest(frame.planes, positions),
                deepest_gap(&fixed, positions),
            ]
        };
        let (was, is) = (depths(estimate), depths(&projected.positions));
        let report = StepReport {
            status: match projected.status {
                Status::Constrained if left > FEASIBLE => Status::Unsettled,
                status => status,
            },
            iterations: 0,
            last_move: 0.0,
            plane_depth: [was[0], is[0]],
            contact_depth: [before, left],
            inequality_depth: [was[1], is[1]],
            resting: projected.warm.resting.clone(),
            pushing: projected.pushing,
            watched,
            rounds: work.rounds,
            solves: work.solves,
            factorisations: work.factorisations,
        };
        Ok(Constrained {
            positions: projected.positions,
            warm: projected.warm,
            surface,
            report,
        })
    }

    /// Projects, linearises the contacts at the result, and projects again until they hold.
    fn linearise(
        &mut self,
        metric: &Metric,
        estimate: &[Point3<f64>],
        plane: Option<Plane>,
        fixed: &[Row],
        surface: &mut Surface,
    ) -> Result<Settled, Error> {
        let (values, factor) = metric.parts();
        let mut contacts = self.watch(surface, &self.expected(estimate));
        let mut warm = self.warm.clone();
        // Only its memory is used again; lost after an error, it is made again.
        let mut influence = std::mem::take(&mut self.influence).emptied(estimate.len());
        let mut work = Work::default();
        loop {
            let rows: Vec<_> = fixed.iter().chain(&contacts).cloned().collect();
            let problem = Problem {
                values,
                factor,
                estimate,
                plane,
                rows: &rows,
            };
            let projected = problem.solve(&mut self.system, &warm, &mut influence)?;
            work.add(&projected);
            // Normals and feet were predicted ones; contacts are linearised again at the projected positions.
            let again = self.watch(surface, &projected.positions);
            let left = lack(&again, &projected.positions);
            if left <= FEASIBLE || work.linearisations == LINEARISATIONS {
                self.influence = influence;
                return Ok(Settled {
                    projected,
                    left,
                    watched: contacts.len(),
                    work,
                });
            }
            warm = projected.warm;
            contacts = merged(contacts, again);
        }
    }

    fn metric<'a>(&mut self, update: &'a Update) -> Result<Metric<'a>, Error> {
        Ok(match self.options.projection {
            Projection::Estimate => Metric::Information(update),
            Projection::Gain => {
                let values = self.system.pattern.assemble(
                    &vec![1.0; self.rest.len()],
                    &self.graph.edges,
                    |_| 0.0,
                );
                let factor = self.system.factorise(&values)?;
                Metric::Euclidean(values, factor)
            }
        })
    }

    /// The constrained estimate if the constraints act as in the last frame: the contacts are first linearised there.
    fn expected(&self, estimate: &[Point3<f64>]) -> Vec<Point3<f64>> {
        let pushed = self.live.iter().zip(&self.estimate).map(|(x, e)| x - e);
        estimate.iter().zip(pushed).map(|(p, d)| p + d).collect()
    }

    fn watch(&self, surface: &mut Surface, now: &[Point3<f64>]) -> Vec<Row> {
        let separation = self.options.separation + SPARE;
        let (asked, reach) = (|_, _: &_, _| Some(separation), self.options.contact_reach);
        surface.watch(&self.live, now, &asked, separation, reach)
    }
}

/// The result of the linearisations.
struct Settled {
    projected: Projected,
    left: f64,
    watched: usize,
    work: Work,
}

#[derive(Default)]
struct Work {
    linearisations: usize,
    rounds: usize,
    solves: usize,
    factorisations: usize,
}

impl Work {
    fn add(&mut self, projected: &Projected) {
        self.linearisations += 1;
        self.rounds += projected.rounds;
        self.solves += projected.solves;
        self.factorisations += projected.factorisations;
    }
}

/// Missing separation beyond the reserve.
fn lack(contacts: &[Row], positions: &[Point3<f64>]) -> f64 {
    (deepest_gap(contacts, positions) - SPARE).max(0.0)
}

/// The rows of the newer linearisation, and those of the older one for vertices that the newer does not contain.
fn merged(old: Vec<Row>, new: Vec<Row>) -> Vec<Row> {
    let watched: HashSet<Key> = new.iter().map(|r| r.key).collect();
    let mut rows = new;
    rows.extend(old.into_iter().filter(|r| !watched.contains(&r.key)));
    rows
}

fn first_infinite(positions: &[Point3<f64>]) -> Option<usize> {
    positions
        .iter()
        .position(|p| !p.iter().all(|c| c.is_finite()))
}
