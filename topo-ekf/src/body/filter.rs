//! The body filter: predict, relinearise from rest, update, project.
//!
//! ```text
//! predict     y = x + momentum · d                        expected positions of the nodes, σ = motion_sigma
//! prestep     grips, table, weight and elasticity alone   → innovation: distance of the data from this prediction
//! update      repeat: rows = observe(pose);  one Gauss–Newton step of elasticity + rows + grips + table + friction + weight
//! project     x ← nearest to x in the metric of the information with no point under the table, inequalities kept
//! keep        x, d = x − x_before
//! ```
//! It is an iterated extended Kalman filter whose prior is the energy of the whole deformation from rest, so that the rest shape is never
//! lost: sliding of the surface along itself must strain the body, which resists it.
//!
//! Contact with the table is in `touch`, the force of grips in `grip`, constraints of the pose in `constrain`, weight and its estimate in `weigh`, uncertainties in
//! `certainty`, the limits of a plausible frame in `plausible`, a body that was found elsewhere in `relocate`, changes of the material in `edit`, data
//! kept from one step to the next in `equations`.
//!
//! The projection removes the depth to which points are pressed into the table, and with it the reaction of the table. The next frame therefore
//! starts its steps (not its prior) at the estimate before the projection.

use nalgebra::{Point3, Vector3};

use super::elastic::{Acting, Elastic, Solved};
use super::frame::{BodyFrame, BodyReport, Progress};
use super::lattice::Lattice;
use super::options::BodyOptions;
use super::pose::Pose;
use super::row::{Row, check_unit};
use super::spent::Spent;
use super::weight::{Foot, WeightEstimate};
use crate::observation::Plane;
use crate::{Error, Status};

mod certainty;
mod constrain;
mod edit;
mod equations;
mod grip;
mod plausible;
mod relocate;
mod touch;
mod weigh;

/// Mean motion of a frame, m, below which the body counts as idle: the next frame makes one step.
const IDLE: f64 = 3e-4;
/// Depth to which points on the table at rest are assumed to be pressed into it, m: at exactly zero height rounding would decide whether they touch,
/// and the first step would let them sink.
const TOUCHING: f64 = 1e-9;
/// Factor on the standard deviation of the motion after a release.
const RELEASED: f64 = 3.0;

/// Tracks the volume of a soft body: an elastic lattice deformed from rest by observations, grips and contacts.
///
/// See the [module](crate::body) for an example.
///
/// # Guarantees
/// A call that returns an error leaves the body as it was. After a step no point of the surface and no foot is more than 1e-6 m below the
/// table and every inequality holds to 1e-6 m, unless the report says `Infeasible`. The same calls give the same bits.
///
/// # Limits
/// Cells are removed only on request ([`Self::retain_cells`]); sheets closer than a cell are joined unless they are declared as separate pieces ([`Lattice::set_pieces`]); and the covariances treat the
/// rotations of cells as known.
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct BodyFilter {
    options: BodyOptions,
    lattice: Lattice,
    table: Plane,
    feet: Vec<Foot>,
    weight: WeightEstimate,
    state: State,
    #[cfg_attr(feature = "serde", serde(skip))]
    last: Option<(Elastic, Solved)>,
    #[cfg_attr(feature = "serde", serde(skip))]
    spent: Spent,
}

impl std::fmt::Debug for BodyFilter {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("BodyFilter")
            .field("options", &self.options)
            .field("cells", &self.lattice.cells().len())
            .field("weight", &self.weight.value())
            .finish_non_exhaustive()
    }
}

/// The state that a frame changes.
#[derive(Clone)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
struct State {
    pose: Pose,
    /// Displacement of every node in the last frame, m.
    displacement: Vec<Vector3<f64>>,
    /// Displacement of every node by the last projection.
    raised: Vec<Vector3<f64>>,
    /// Remaining frames of the fall after a release, down to 0.
    falling: usize,
    held: bool,
    idle: bool,
}

impl BodyFilter {
    /// A body at rest on a table.
    ///
    /// # Errors
    /// Options out of range; a lattice that is empty, has an invalid size or negative fill; a plane whose normal is not a unit vector.
    pub fn new(lattice: Lattice, table: Plane, options: &BodyOptions) -> Result<Self, Error> {
        options.check()?;
        lattice.check()?;
        let sound = check_unit("normal", 0, &table.normal).is_ok() && table.offset.abs() <= 1e9;
        if !sound {
            return Err(Error::Plane {
                index: 0,
                normal: table.normal.into_inner().into(),
                offset: table.offset,
            });
        }
        Ok(Self {
            state: State {
                pose: Pose::at_rest(&lattice),
                displacement: vec![Vector3::zeros(); lattice.rest().len()],
                raised: vec![table.normal.into_inner() * TOUCHING; lattice.rest().len()],
                falling: 0,
                held: false,
                idle: true,
            },
            feet: Foot::under_columns(&lattice),
            weight: WeightEstimate::new(options.initial_weight, options.initial_weight_sigma),
            options: *options,
            lattice,
            table,
            last: None,
            spent: Spent::default(),
        })
    }

    /// Checks a deserialised body for consistency.
    ///
    /// # Errors
    /// Options out of range, an invalid lattice, nodes or feet that do not belong to the lattice.
    #[cfg(feature = "serde")]
    pub fn check_read(&self) -> Result<(), Error> {
        self.options.check()?;
        self.lattice.check()?;
        self.lattice.check_read()?;
        let (nodes, cells) = (self.lattice.rest().len(), self.lattice.cells().len());
        let state = &self.state;
        for (what, found, expected) in [
            ("nodes of the pose", state.pose.live.len(), nodes),
            ("rotations of the pose", state.pose.turns.len(), cells),
            ("displacements", state.displacement.len(), nodes),
            ("raised nodes", state.raised.len(), nodes),
        ] {
            if found != expected {
                return Err(Error::Length {
                    what,
                    found,
                    expected,
                });
            }
        }
        let mut feet = self.feet.iter().enumerate();
        feet.try_for_each(|(index, foot)| foot.check(index, &self.lattice))
    }

    /// The cells.
    pub fn lattice(&self) -> &Lattice {
        &self.lattice
    }

    /// The present pose.
    pub fn pose(&self) -> &Pose {
        &self.state.pose
    }

    /// Settings.
    pub fn options(&self) -> &BodyOptions {
        &self.options
    }

    /// Weight over stiffness `ρ g / E`, 1/m, estimated from the sag of the held body.
    pub fn weight_over_stiffness(&self) -> f64 {
        self.weight.value()
    }

    /// Standard deviation of [`Self::weight_over_stiffness`].
    pub fn weight_over_stiffness_sigma(&self) -> f64 {
        self.weight.sigma()
    }

    /// Estimated weight of the whole body, in units of the energy per metre: `stiffness · h³ · γ` times the mass of the cells.
    pub fn weight(&self) -> f64 {
        self.weight_at(self.weight.value())
    }

    /// Weight of the whole body if its weight over stiffness is `gamma`.
    fn weight_at(&self, gamma: f64) -> f64 {
        let cells = 0..self.lattice.cells().len() as u32;
        let mass: f64 = cells.map(|c| self.lattice.mass(c)).sum();
        self.cell_weight(gamma) * mass
    }

    /// The force of the grips of a frame in weights of the body: one upwards when they carry all of it. Of a stiff body, which does not sag and
    /// so seems to weigh nothing, small errors of its shape are forces of many weights.
    pub fn grip_force_in_weights(&self, report: &BodyReport) -> Vector3<f64> {
        report.grip_force / self.weight().max(f64::MIN_POSITIVE)
    }

    /// Elastic energy of the present pose, in units of the data: a row whose residual is its standard deviation costs 1/2.
    ///
    /// # Complexity
    /// Linear in the number of cells.
    pub fn energy(&self) -> f64 {
        self.state.pose.energy(&self.lattice, &self.options)
    }

    /// Forces of weight on the nodes in the present pose, in units of the energy per metre (see [`Foot`] for the reaction at rest). They are faded in over
    /// the frames after a release.
    pub fn loads(&self) -> Vec<Vector3<f64>> {
        self.loads_of(&self.state.pose, self.weight.value())
    }

    /// Time spent on the normal equations since the filter was created, including failed steps.
    pub fn spent(&self) -> Spent {
        self.spent
    }

    /// Whether the body was released a few frames ago.
    pub fn is_falling(&self) -> bool {
        self.state.falling > 0
    }

    /// Processes one frame. `observe` is called before every step for the rows of the data at the present pose; `innovation` is called once with
    /// the pose predicted by grips, table and weight alone, when something is held.
    ///
    /// # Errors
    /// Grips, points, rows, inequalities or feet in cells that do not exist, coordinates or weights that are not finite or negative,
    /// rows so heavy that the matrix cannot be factorised; a frame beyond its [limits](super::Limits). The body is then unchanged.
    ///
    /// # Complexity
    /// Each step is one sparse factorisation with three unknowns for each node (see the README for times); the projection takes one more solve for every
    /// round of its active set.
    pub fn step(
        &mut self,
        frame: &BodyFrame<'_>,
        observe: &mut dyn FnMut(&Lattice, &Pose, Progress) -> Vec<Row>,
        innovation: &mut dyn FnMut(&Lattice, &Pose),
    ) -> Result<BodyReport, Error> {
        self.check(frame)?;
        self.all_or_nothing(|body, elastic| body.try_step(elastic, frame, observe, innovation))
    }

    /// Fits an earlier pose to its frame again, after the rest shape has improved; the body itself is unchanged.
    ///
    /// # Errors
    /// As [`Self::step`]; a pose of another lattice.
    pub fn refit(
        &mut self,
        pose: &Pose,
        frame: &BodyFrame<'_>,
        observe: &mut dyn FnMut(&Lattice, &Pose, Progress) -> Vec<Row>,
    ) -> Result<Pose, Error> {
        let mut earlier = pose.clone();
        earlier.extend(&self.lattice);
        let nodes = self.lattice.rest().len();
        if earlier.live.len() != nodes {
            return Err(Error::Length {
                what: "nodes of the pose",
                found: earlier.live.len(),
                expected: nodes,
            });
        }
        let kept = self.state.clone();
        self.state = State {
            pose: earlier,
            displacement: vec![Vector3::zeros(); nodes],
            raised: vec![Vector3::zeros(); nodes],
            falling: 0,
            held: false,
            idle: false,
        };
        let outcome = self.step(frame, observe, &mut |_, _| {});
        let fitted = std::mem::replace(&mut self.state, kept);
        outcome.map(|_| fitted.pose)
    }

    fn check(&self, frame: &BodyFrame<'_>) -> Result<(), Error> {
        for (index, foot) in self.feet.iter().enumerate() {
            foot.check(index, &self.lattice)?;
        }
        frame.check(&self.lattice)
    }

    fn try_step(
        &mut self,
        elastic: &mut Elastic,
        frame: &BodyFrame<'_>,
        observe: &mut dyn FnMut(&Lattice, &Pose, Progress) -> Vec<Row>,
        innovation: &mut dyn FnMut(&Lattice, &Pose),
    ) -> Result<(BodyReport, Solved), Error> {
        let holding = !frame.grips.is_empty();
        self.hold(holding);
        let released = self.state.falling > 0 || frame.fell;
        let before = self.state.pose.live.clone();
        let expected = self.expected(released);
        let sigma = self.options.motion_sigma * if released { RELEASED } else { 1.0 };
        let setting = Setting {
            frame,
            before: &before,
            expected: &expected,
            expected_weight: sigma.powi(-2),
        };
        // The steps start with the same depth below the table with which they ended last time.
        let start = expected.iter().zip(&self.state.raised);
        self.state.pose.live = start.map(|(p, r)| p - r).collect();
        self.state.pose.fit_turns(&self.lattice);
        let mut report = BodyReport {
            status: if holding {
                Status::Free
            } else {
                Status::Unobserved
            },
            ..BodyReport::default()
        };
        if holding {
            for _ in 0..self.options.presteps {
                let (_, solved) = self.advance(elastic, &setting, Vec::new(), 1.0)?;
                elastic.recycle(solved);
                report.solves += 1;
            }
            innovation(&self.lattice, &self.state.pose);
        }
        let solved = self.update(elastic, &setting, observe, released, &mut report)?;
        self.constrain(elastic, &solved, frame, &mut report)?;
        self.check_plausible(&before, released, frame, &report)?;
        self.finish(&before, released, &mut report);
        Ok((report, solved))
    }

    /// Updates the state of grips that close and open.
    fn hold(&mut self, holding: bool) {
        self.state.falling = match (holding, self.state.held) {
            (true, _) => 0,
            (false, true) => self.options.release_frames,
            (false, false) => self.state.falling.saturating_sub(1),
        };
        self.state.held = holding;
    }

    /// Expected positions of the nodes.
    fn expected(&self, released: bool) -> Vec<Point3<f64>> {
        let momentum = if released { 0.0 } else { self.options.momentum };
        let moving = self.state.pose.live.iter().zip(&self.state.displacement);
        moving.map(|(p, d)| p + d * momentum).collect()
    }

    /// The steps with all data; returns the normal equations of the last.
    fn update(
        &mut self,
        elastic: &mut Elastic,
        setting: &Setting<'_>,
        observe: &mut dyn FnMut(&Lattice, &Pose, Progress) -> Vec<Row>,
        released: bool,
        report: &mut BodyReport,
    ) -> Result<Solved, Error> {
        let steps = match (released, self.state.held, self.state.idle) {
            (true, ..) => self.options.release_steps,
            (false, false, true) => 1,
            _ => self.options.steps,
        };
        let mut step = 0;
        loop {
            let share = if steps > 1 {
                step as f64 / (steps - 1) as f64
            } else {
                1.0
            };
            let stiffer = if released {
                self.options.release_stiffness.powf(1.0 - share)
            } else {
                1.0
            };
            let progress = Progress { share, released };
            let rows = observe(&self.lattice, &self.state.pose, progress);
            for (index, row) in rows.iter().enumerate() {
                row.check(index, &self.lattice)?;
                if row.weight > 0.0 {
                    report.status = Status::Free;
                }
            }
            let (longest, solved) = self.advance(elastic, setting, rows, stiffer)?;
            report.last_step = longest;
            report.solves += 1;
            let settled = step >= 2 && longest < self.options.tolerance && !released;
            step += 1;
            if settled || step >= steps {
                return Ok(solved);
            }
            elastic.recycle(solved);
        }
    }

    fn finish(&mut self, before: &[Point3<f64>], released: bool, report: &mut BodyReport) {
        let moved = self.state.pose.live.iter().zip(before);
        self.state.displacement = moved.map(|(now, then)| now - then).collect();
        let sum: f64 = self.state.displacement.iter().map(Vector3::norm).sum();
        report.moved = sum / self.state.displacement.len() as f64;
        self.state.idle = report.moved < IDLE && !released;
    }

    /// One step with the given observations.
    fn advance(
        &mut self,
        elastic: &mut Elastic,
        setting: &Setting<'_>,
        observed: Vec<Row>,
        stiffer: f64,
    ) -> Result<(f64, Solved), Error> {
        let mut pose = std::mem::take(&mut self.state.pose);
        let stiffness = self.options.stiffness * stiffer;
        let weight = self.weight.value();
        let answer = self.advance_pose(elastic, setting, &mut pose, observed, stiffness, weight);
        self.state.pose = pose;
        answer
    }

    /// One step of a pose under the given rows, grips, table, friction and loads.
    fn advance_pose(
        &self,
        elastic: &mut Elastic,
        setting: &Setting<'_>,
        pose: &mut Pose,
        observed: Vec<Row>,
        stiffness: f64,
        weight: f64,
    ) -> Result<(f64, Solved), Error> {
        let mut rows = observed;
        rows.extend(self.grip_rows(setting.frame.grips, pose));
        self.touch(setting, pose, &mut rows);
        let acting = Acting {
            stiffness,
            rows: &rows,
            expected: setting.expected,
            expected_weight: setting.expected_weight,
            forces: &self.loads_of(pose, weight),
        };
        elastic.step(&self.lattice, pose, &acting)
    }
}

/// Data that stay the same over the steps of a frame.
struct Setting<'a> {
    frame: &'a BodyFrame<'a>,
    before: &'a [Point3<f64>],
    expected: &'a [Point3<f64>],
    expected_weight: f64,
}
