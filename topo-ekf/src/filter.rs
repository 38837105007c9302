//! The filter: predict, update, project.

use std::collections::HashSet;

use nalgebra::{Point3, Rotation3};

use crate::contact::{Surface, deepest_gap};
use crate::dual::Row;
use crate::graph::{Graph, check_points, check_vertex};
use crate::marginal::variances;
use crate::memory::{Memory, fit_rotations};
use crate::motion::{Motion, predict};
use crate::observability::Observability;
use crate::observation::{Frame, Seen};
use crate::options::Options;
use crate::project::{Projected, Projection, Status, Warm, deepest, split_planes};
use crate::report::StepReport;
use crate::rotation::clean;
use crate::system::{Factor, System};
use crate::{Error, columns};

/// Live positions of the vertices of a surface graph, with their rotations from rest and the information about them.
///
/// # Guarantees
/// After a step that returned `Ok`, no vertex is lower than rounding (1e-12 m for an object of a metre) below the plane
/// most vertices touch, and with [`Status::Constrained`](crate::Status) every constraint holds within 1e-6 m. A rigid
/// motion of everything given (rest, live, observations, planes) moves the answer by the same motion.
/// After an error the filter is what it was before the call.
///
/// # Limits
/// Shape memory of a surface graph resists stretch and, by the overlap of neighbouring rotations, bending over about two edges. A
/// hollow shell that is unseen on one half keeps that half's bulge only as well as that; edges through the body stiffen it.
pub struct Filter {
    pub(crate) options: Options,
    pub(crate) graph: Graph,
    pub(crate) system: System,
    rest: Vec<Point3<f64>>,
    live: Vec<Point3<f64>>,
    rotations: Vec<Rotation3<f64>>,
    /// Data information of every vertex, 1/m²: what was measured, less what time has taken.
    pub(crate) information: Vec<f64>,
    /// Vertices measured in the last step.
    pub(crate) seen: Vec<bool>,
    warm: Warm,
    surface: Surface,
}

/// Most times the contacts are linearised. Two are the rule; where two sheets are pressed hard onto each other, the triangle
/// under a vertex changes with the push and five have been seen.
const LINEARISATIONS: usize = 6;
/// What a row asks for beyond the separation, m: the triangle turns while it is pushed, and this much of second order is
/// then there to be lost. Without it every contact is linearised once or twice more for the last micrometre.
const SPARE: f64 = 2e-5;
/// Lack of separation that is left standing, m.
const SEPARATED: f64 = 1e-6;

/// Everything a successful step replaces.
struct Posterior {
    live: Vec<Point3<f64>>,
    rotations: Vec<Rotation3<f64>>,
    information: Vec<f64>,
    seen: Vec<bool>,
    warm: Warm,
}

impl Filter {
    /// Filter whose live positions are the rest positions.
    ///
    /// # Errors
    /// No vertices, unusable points, edges out of range or from a vertex to itself, options out of range.
    ///
    /// # Complexity
    /// `O(E)` and one symbolic factorisation, about 1.5 ms at 2,000 vertices.
    pub fn new(rest: &[Point3<f64>], edges: &[[u32; 2]], options: &Options) -> Result<Self, Error> {
        options.check()?;
        let graph = Graph::new(rest, edges)?;
        let system = System::new(rest.len(), edges)?;
        Ok(Self {
            options: *options,
            graph,
            system,
            rest: rest.to_vec(),
            live: rest.to_vec(),
            rotations: vec![Rotation3::identity(); rest.len()],
            information: vec![options.initial_sigma.powi(-2); rest.len()],
            seen: vec![false; rest.len()],
            warm: Warm::default(),
            surface: Surface::default(),
        })
    }

    /// Live positions.
    pub fn live(&self) -> &[Point3<f64>] {
        &self.live
    }

    /// Rest positions.
    pub fn rest(&self) -> &[Point3<f64>] {
        &self.rest
    }

    /// Local rotation from rest to live at every vertex.
    pub fn rotations(&self) -> &[Rotation3<f64>] {
        &self.rotations
    }

    /// Edges of the graph.
    pub fn edges(&self) -> &[[u32; 2]] {
        &self.graph.edges
    }

    /// What is left of what was measured of every vertex, 1/m².
    pub fn information(&self) -> &[f64] {
        &self.information
    }

    /// Settings.
    pub fn options(&self) -> &Options {
        &self.options
    }

    /// Stiffness of every edge relative to `1/edge_sigma²`, in the order of the edges. A new graph starts with 1.
    ///
    /// # Errors
    /// Wrong length, or a stiffness outside `[0, 1e6]`. An edge of stiffness 0 carries no shape.
    pub fn set_stiffness(&mut self, stiffness: &[f64]) -> Result<(), Error> {
        let expected = self.graph.edges.len();
        if stiffness.len() != expected {
            return Err(Error::Length {
                what: "stiffness",
                found: stiffness.len(),
                expected,
            });
        }
        if let Some(index) = stiffness.iter().position(|s| !(0.0..=1e6).contains(s)) {
            let must = "between 0 and 1e6";
            return Err(Error::Value {
                what: "stiffness of edge",
                index,
                value: stiffness[index],
                must,
            });
        }
        self.graph.stiffness.copy_from_slice(stiffness);
        Ok(())
    }

    /// Replaces the graph: vertices added, removed, joined otherwise, or with relaxed rest positions.
    ///
    /// `keep[i]` is the old vertex that new vertex `i` continues; it hands on its information and, unless `rotations` gives
    /// others, its rotation. Vertices without one get [`Options::initial_sigma`] and the rotation that fits their edges.
    ///
    /// # Errors
    /// Lists of different lengths, unusable points or rotations, indices out of range; the filter then keeps its graph.
    ///
    /// # Complexity
    /// As [`Filter::new`].
    pub fn set_graph(
        &mut self,
        rest: &[Point3<f64>],
        live: &[Point3<f64>],
        rotations: Option<&[Rotation3<f64>]>,
        edges: &[[u32; 2]],
        keep: &[Option<u32>],
    ) -> Result<(), Error> {
        let graph = Graph::new(rest, edges)?;
        let expected = rest.len();
        for (what, found) in [
            ("live", live.len()),
            ("keep", keep.len()),
            (
                "rotations",
                rotations.map_or(expected, <[Rotation3<f64>]>::len),
            ),
        ] {
            if found != expected {
                return Err(Error::Length {
                    what,
                    found,
                    expected,
                });
            }
        }
        check_points("live", live)?;
        for (index, old) in keep.iter().enumerate() {
            if let &Some(old) = old {
                check_vertex("keep", index, old, self.rest.len())?;
            }
        }
        let rotations = match rotations {
            Some(given) => checked_rotations(given)?,
            None => self.continued_rotations(&graph, live, keep),
        };
        let system = System::new(rest.len(), edges)?;
        let new = self.options.initial_sigma.powi(-2);
        self.information = keep
            .iter()
            .map(|k| k.map_or(new, |k| self.information[k as usize]))
            .collect();
        self.seen = keep
            .iter()
            .map(|k| k.is_some_and(|k| self.seen[k as usize]))
            .collect();
        // Active sets only warm up the next projection, so dropping them is safe.
        self.warm = Warm::default();
        self.rest = rest.to_vec();
        self.live = live.to_vec();
        self.rotations = rotations;
        self.graph = graph;
        self.system = system;
        Ok(())
    }

    /// Rotations of kept vertices; new ones take the mean of their kept neighbours' as guess and prior of a fit.
    fn continued_rotations(
        &self,
        graph: &Graph,
        live: &[Point3<f64>],
        keep: &[Option<u32>],
    ) -> Vec<Rotation3<f64>> {
        let mut known: Vec<Option<Rotation3<f64>>> = keep
            .iter()
            .map(|k| k.map(|k| self.rotations[k as usize]))
            .collect();
        let weights = vec![1.0; graph.edges.len()];
        // Outward from the kept ones, a ring at a time; what is never reached starts unrotated.
        loop {
            let mut sums = vec![None; live.len()];
            for &[i, j] in &graph.edges {
                for (to, from) in [(i as usize, j as usize), (j as usize, i as usize)] {
                    if let (None, Some(r)) = (known[to], known[from]) {
                        *sums[to].get_or_insert_with(nalgebra::Matrix3::zeros) += r.matrix();
                    }
                }
            }
            let mut spread = false;
            for (k, sum) in known.iter_mut().zip(sums) {
                if let Some(sum) = sum {
                    *k = Some(crate::rotation::nearest_rotation(
                        &sum,
                        &Rotation3::identity(),
                    ));
                    spread = true;
                }
            }
            if !spread {
                break;
            }
        }
        let guess: Vec<_> = known.into_iter().map(Option::unwrap_or_default).collect();
        let fitted = fit_rotations(
            graph,
            &weights,
            live,
            &guess,
            &guess,
            self.options.rotation_memory,
        );
        keep.iter()
            .zip(guess)
            .zip(fitted)
            .map(|((k, g), f)| if k.is_some() { g } else { clean(&f) })
            .collect()
    }

    /// Standard deviation of each coordinate of every vertex, m: the data of all frames, the shape memory and the
    /// anchor together. A constraint does not lower it (a resting vertex is known better along the normal than this says).
    ///
    /// # Errors
    /// As [`Filter::step`], after stiffness or options that leave the information matrix unusable.
    ///
    /// # Complexity
    /// One factorisation and one selected inverse, about 6 ms at 2,000 vertices: ask for it every few frames.
    pub fn marginal_sigmas(&self) -> Result<Vec<f64>, Error> {
        let values = self.values(&self.information, &self.weights());
        let variances = variances(&self.system.pattern, self.system.simplicial()?, &values)?;
        Ok(variances.into_iter().map(f64::sqrt).collect())
    }

    /// What the last step determined, by connection; [`Filter::marginal_sigmas`] says how well.
    pub fn observability(&self) -> Observability {
        Observability::new(&self.seen, &self.graph.component, self.graph.components)
    }

    /// One frame: predict, update, project.
    ///
    /// # Errors
    /// Unusable observations, planes or triangles; information too far apart to be factorised. The filter is left as it was.
    ///
    /// # Complexity
    /// Three numeric factorisations and `rotation_iterations + 2` solves without contact: 6 to 10 ms at 2,000 vertices.
    pub fn step(&mut self, frame: &Frame) -> Result<StepReport, Error> {
        frame.check(self.live.len())?;
        let (posterior, report) = self.posterior(frame)?;
        self.live = posterior.live;
        self.rotations = posterior.rotations;
        self.information = posterior.information;
        self.seen = posterior.seen;
        self.warm = posterior.warm;
        Ok(report)
    }

    fn posterior(&mut self, frame: &Frame) -> Result<(Posterior, StepReport), Error> {
        // Predict.
        let seen = Seen::gather(frame.observations, &self.live);
        let motion = predict(
            &self.graph,
            &mut self.system,
            &self.live,
            &seen,
            &self.options,
        )?;
        let decayed = self.decayed(frame.dt_frames);
        let innovations = innovations(frame, &motion, &decayed);

        // Update.
        let information: Vec<f64> = decayed
            .iter()
            .zip(&seen.information)
            .map(|(d, r)| d + r)
            .collect();
        let weights = self.weights();
        let values = self.values(&information, &weights);
        let factor = self.system.factorise(&values)?;
        let predicted: Vec<_> = motion
            .turns
            .iter()
            .zip(&self.rotations)
            .map(|(turn, r)| turn * r)
            .collect();
        let mut data = vec![0.0; 3 * self.live.len()];
        for i in 0..self.live.len() {
            let pull = (seen.position[i] - motion.positions[i]) * seen.information[i];
            columns::add(&mut data, i, &pull);
        }
        let memory = Memory {
            graph: &self.graph,
            weights: &weights,
            predicted: &predicted,
            origin: &motion.positions,
            data: &data,
        };
        let relaxed = memory.relax(&mut self.system, &factor, &self.options)?;

        // Project.
        let (projected, warm, mut report) =
            self.project(frame, &values, &factor, &relaxed.positions)?;
        let memory = Memory {
            graph: &self.graph,
            weights: &weights,
            predicted: &predicted,
            origin: &motion.positions,
            data: &data,
        };
        let rotations = memory.fit(
            &projected.positions,
            &relaxed.rotations,
            self.options.rotation_memory,
        );
        report.iterations = relaxed.iterations;
        report.last_move = relaxed.last_move;
        report.innovations = innovations;
        let posterior = Posterior {
            live: projected.positions,
            rotations: rotations.iter().map(clean).collect(),
            information,
            seen: seen.information.iter().map(|&r| r > 0.0).collect(),
            warm,
        };
        Ok((posterior, report))
    }

    /// `d/(1 + q d)`: the information of a vertex that walked at random with variance `q`.
    fn decayed(&self, frames: f64) -> Vec<f64> {
        let q = self.options.process_noise.powi(2) * frames;
        self.information.iter().map(|d| d / (1.0 + q * d)).collect()
    }

    pub(crate) fn weights(&self) -> Vec<f64> {
        let unit = self.options.edge_sigma.powi(-2);
        self.graph.stiffness.iter().map(|s| s * unit).collect()
    }

    /// Lower triangle of the information matrix.
    pub(crate) fn values(&self, information: &[f64], weights: &[f64]) -> Vec<f64> {
        let anchor = self.options.anchor_sigma.powi(-2);
        let diagonal: Vec<f64> = information.iter().map(|d| d + anchor).collect();
        self.system
            .pattern
            .assemble(&diagonal, &self.graph.edges, |e| weights[e])
    }

    fn project(
        &mut self,
        frame: &Frame,
        values: &[f64],
        factor: &Factor,
        estimate: &[Point3<f64>],
    ) -> Result<(Projected, Warm, StepReport), Error> {
        let (plane, planes) = split_planes(frame.planes, estimate);
        let surface = std::mem::take(&mut self.surface).renewed(frame.triangles, estimate.len());
        let watch = |now: &[Point3<f64>]| {
            surface.watch(
                &self.live,
                now,
                self.options.separation + SPARE,
                self.options.contact_reach,
            )
        };
        let mut contacts = watch(estimate);
        let before = (deepest_gap(&contacts, estimate) - SPARE).max(0.0);
        let mut warm = self.warm.clone();
        let (mut passes, mut rounds, mut factorisations) = (0, 0, 0);
        let (projected, left, watched) = loop {
            let rows: Vec<_> = planes.iter().chain(&contacts).cloned().collect();
            let projection = Projection {
                values,
                factor,
                estimate,
                plane,
                rows: &rows,
            };
            let projected = projection.solve(&mut self.system, &warm)?;
            warm = Warm::of(&projected, &rows);
            rounds += projected.rounds;
            factorisations += projected.factorisations;
            passes += 1;
            // Normals and feet were those of the estimate; what the projection bent is linearised again where it ended.
            let again = watch(&projected.positions);
            let left = (deepest_gap(&again, &projected.positions) - SPARE).max(0.0);
            if left <= SEPARATED || passes == LINEARISATIONS {
                break (projected, left, contacts.len());
            }
            contacts = merged(contacts, again);
        };
        self.surface = surface;
        if let Some(vertex) = projected
            .positions
            .iter()
            .position(|p| !p.iter().all(|c| c.is_finite()))
        {
            return Err(Error::Overflow { vertex });
        }
        let status = match projected.status {
            Status::Constrained if left > SEPARATED => Status::Unsettled,
            status => status,
        };
        let report = StepReport {
            status,
            iterations: 0,
            last_move: 0.0,
            plane_depth: [
                deepest(frame.planes, estimate),
                deepest(frame.planes, &projected.positions),
            ],
            contact_depth: [before, left],
            resting: projected.resting.clone(),
            pushing: projected.pushing.len(),
            watched,
            rounds,
            factorisations,
            innovations: vec![],
        };
        Ok((projected, warm, report))
    }
}

/// The rows of the newer linearisation, and of the older one for the vertices that the newer does not watch.
fn merged(old: Vec<Row>, new: Vec<Row>) -> Vec<Row> {
    let watched: HashSet<u32> = new.iter().map(|r| r.terms[0].0).collect();
    let mut rows = new;
    rows.extend(old.into_iter().filter(|r| !watched.contains(&r.terms[0].0)));
    rows
}

fn checked_rotations(given: &[Rotation3<f64>]) -> Result<Vec<Rotation3<f64>>, Error> {
    for (index, r) in given.iter().enumerate() {
        let defect = (r.matrix().tr_mul(r.matrix()) - nalgebra::Matrix3::identity()).norm();
        // Written so that NaN is refused too.
        if !(defect < 1e-6 && r.matrix().determinant() > 0.0) {
            return Err(Error::NotARotation { index });
        }
    }
    Ok(given.iter().map(clean).collect())
}

fn innovations(frame: &Frame, motion: &Motion, information: &[f64]) -> Vec<f64> {
    frame
        .observations
        .iter()
        .map(|o| {
            let i = o.vertex as usize;
            let variance = o.sigma * o.sigma + 1.0 / information[i];
            (o.position - motion.positions[i]).norm() / (3.0 * variance).sqrt()
        })
        .collect()
}
