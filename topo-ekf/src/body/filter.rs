//! The body filter: predict, relinearise from rest, update.
//!
//! ```text
//! predict     y = x + momentum · v                        where the nodes are expected, σ = motion_sigma
//! prestep     grips, table, weight and elasticity alone   → innovation: how far the data are from it
//! update      repeat: rows = observe(pose);  one Gauss–Newton step of elasticity + rows + grips + table + friction + weight
//! keep        x, v = x − x_before
//! ```
//! It is an iterated extended Kalman filter whose prior is the energy of the whole deformation from rest, so that it never forgets the
//! rest shape: what drags surface along itself must strain the body between.

use nalgebra::{Point3, UnitVector3, Vector3};

use super::elastic::{Acting, Elastic, Row};
use super::lattice::{Embedding, Lattice};
use super::options::BodyOptions;
use super::pose::Pose;
use super::weight::{Foot, WeightEstimate, loads};
use crate::Error;
use crate::observation::Plane;

/// How far along the steps of a frame are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Progress {
    /// 0 at the first step, 1 at the last.
    pub share: f64,
    /// Whether the body was let go a few frames ago: it may have moved far.
    pub released: bool,
}

/// What one frame did.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BodyReport {
    /// Steps made, each one factorisation.
    pub solves: usize,
    /// Mean move of the nodes since the last frame, m.
    pub moved: f64,
    /// Longest move of a node in the last step, m.
    pub last_step: f64,
}

/// What a frame brings besides observations.
#[derive(Clone, Copy, Debug)]
pub struct BodyFrame<'a> {
    /// Points held by grippers and where those are now.
    pub grips: &'a [(Embedding, Point3<f64>)],
    /// The estimated surface, for contact with the table.
    pub surface: &'a [Embedding],
}

/// The live body.
pub struct BodyFilter {
    options: BodyOptions,
    lattice: Lattice,
    pose: Pose,
    velocity: Vec<Vector3<f64>>,
    table: Plane,
    feet: Vec<Foot>,
    elastic: Option<Elastic>,
    weight: WeightEstimate,
    /// Frames since the last release, down to 0.
    falling: usize,
    held: bool,
    idle: bool,
}

impl BodyFilter {
    /// A body at rest on a table.
    ///
    /// # Errors
    /// Options out of range, a lattice without cells, a plane whose normal is not finite.
    pub fn new(lattice: Lattice, table: Plane, options: &BodyOptions) -> Result<Self, Error> {
        options.check()?;
        if lattice.cells().is_empty() {
            return Err(Error::NoVertices);
        }
        let feet = Foot::under_columns(&lattice);
        Ok(Self {
            pose: Pose::at_rest(&lattice),
            velocity: vec![Vector3::zeros(); lattice.rest().len()],
            weight: WeightEstimate::new(options.initial_weight, options.initial_weight_sigma),
            options: *options,
            lattice,
            table,
            feet,
            elastic: None,
            falling: 0,
            held: false,
            idle: true,
        })
    }

    /// The cells.
    pub fn lattice(&self) -> &Lattice {
        &self.lattice
    }

    /// Where the nodes are.
    pub fn pose(&self) -> &Pose {
        &self.pose
    }

    /// Settings.
    pub fn options(&self) -> &BodyOptions {
        &self.options
    }

    /// Weight over stiffness `ρ g / E`, 1/m, as estimated from how the held body sags.
    pub fn weight_over_stiffness(&self) -> f64 {
        self.weight.value()
    }

    /// Standard deviation of [`Self::weight_over_stiffness`].
    pub fn weight_over_stiffness_sigma(&self) -> f64 {
        self.weight.sigma()
    }

    /// Whether the body was let go a few frames ago.
    pub fn is_falling(&self) -> bool {
        self.falling > 0
    }

    /// The cell at a place, made if there is none with the given fill: surface was seen in it.
    pub fn ensure(&mut self, place: [i32; 3], fill: f64) -> u32 {
        let known = self.lattice.cell_at(place);
        let mut cell = known.unwrap_or_default();
        if known.is_none() {
            self.edit(|lattice| {
                cell = lattice.ensure(place);
                lattice.set_fill(cell, fill, fill);
            });
        }
        cell
    }

    /// Says where the body stands on the table at rest; until then the middle of every cell at the table does.
    pub fn set_feet(&mut self, feet: Vec<Foot>) {
        self.feet = feet;
    }

    /// Where the body stands on the table at rest.
    pub fn feet(&self) -> &[Foot] {
        &self.feet
    }

    /// Changes the lattice: cells may be added and refilled, none taken away. New nodes are carried along.
    pub fn edit(&mut self, change: impl FnOnce(&mut Lattice)) {
        change(&mut self.lattice);
        self.elastic = None;
        self.pose.extend(&self.lattice);
        self.velocity
            .resize(self.lattice.rest().len(), Vector3::zeros());
    }

    /// One frame. `observe` is asked before every step for the rows that the data make of the present pose; `innovation` is called once on
    /// the pose that grips, table and weight alone predict.
    ///
    /// # Errors
    /// Rows that are not finite or so heavy that the matrix cannot be factorised; the body is then as before.
    pub fn step(
        &mut self,
        frame: &BodyFrame<'_>,
        observe: &mut dyn FnMut(&Lattice, &Pose, Progress) -> Vec<Row>,
        innovation: &mut dyn FnMut(&Lattice, &Pose),
    ) -> Result<BodyReport, Error> {
        let before = (self.pose.clone(), self.falling, self.held);
        let answer = self.try_step(frame, observe, innovation);
        if answer.is_err() {
            (self.pose, self.falling, self.held) = before;
        }
        answer
    }

    fn try_step(
        &mut self,
        frame: &BodyFrame<'_>,
        observe: &mut dyn FnMut(&Lattice, &Pose, Progress) -> Vec<Row>,
        innovation: &mut dyn FnMut(&Lattice, &Pose),
    ) -> Result<BodyReport, Error> {
        let holding = !frame.grips.is_empty();
        self.falling = match (holding, self.held) {
            (true, _) => 0,
            (false, true) => self.options.release_frames,
            (false, false) => self.falling.saturating_sub(1),
        };
        self.held = holding;
        let released = self.falling > 0;
        let before = self.pose.live.clone();
        let momentum = if released { 0.0 } else { self.options.momentum };
        let expected: Vec<Point3<f64>> = before
            .iter()
            .zip(&self.velocity)
            .map(|(p, v)| p + v * momentum)
            .collect();
        let sigma = self.options.motion_sigma * if released { 3.0 } else { 1.0 };
        let mut elastic = self.prepared()?;
        self.pose.live.clone_from(&expected);
        self.pose.fit_turns(&self.lattice);
        let mut report = BodyReport::default();
        let setting = Setting {
            frame,
            before: &before,
            expected: &expected,
            expected_weight: sigma.powi(-2),
        };
        let steps = match (released, holding, self.idle) {
            (true, ..) => self.options.release_steps,
            (false, false, true) => 1,
            _ => self.options.steps,
        };
        if holding {
            for _ in 0..self.options.presteps {
                self.advance(&mut elastic, &setting, &[], 1.0)?;
                report.solves += 1;
            }
            innovation(&self.lattice, &self.pose);
        }
        for step in 0..steps {
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
            let rows = observe(&self.lattice, &self.pose, Progress { share, released });
            report.last_step = self.advance(&mut elastic, &setting, &rows, stiffer)?;
            report.solves += 1;
            if step >= 2 && report.last_step < self.options.tolerance && !released {
                break;
            }
        }
        self.elastic = Some(elastic);
        self.velocity = self
            .pose
            .live
            .iter()
            .zip(&before)
            .map(|(now, then)| now - then)
            .collect();
        report.moved = self.velocity.iter().map(Vector3::norm).sum::<f64>()
            / self.velocity.len() as f64;
        self.idle = report.moved < 3e-4 && !released;
        Ok(report)
    }

    /// The normal equations of the lattice as it is.
    fn prepared(&mut self) -> Result<Elastic, Error> {
        match self.elastic.take() {
            Some(elastic) if elastic.fits(&self.lattice) => Ok(elastic),
            _ => Elastic::new(&self.lattice, self.options.poisson_ratio),
        }
    }

    /// One step with the given observations.
    fn advance(
        &mut self,
        elastic: &mut Elastic,
        setting: &Setting<'_>,
        observed: &[Row],
        stiffer: f64,
    ) -> Result<f64, Error> {
        let weight = self.weight.value();
        let (rows, forces) = self.acting(setting, observed, weight);
        let acting = Acting {
            stiffness: self.options.stiffness * stiffer,
            rows: &rows,
            expected: setting.expected,
            expected_weight: setting.expected_weight,
            forces: &forces,
        };
        elastic.step(&self.lattice, &mut self.pose, &acting)
    }

    /// Everything that acts on the present pose: the given rows, grips, table, friction; and the loads.
    fn acting(
        &self,
        setting: &Setting<'_>,
        observed: &[Row],
        weight: f64,
    ) -> (Vec<Row>, Vec<Vector3<f64>>) {
        let mut rows = observed.to_vec();
        let grip = self.options.grip_sigma.powi(-2);
        rows.extend(
            setting
                .frame
                .grips
                .iter()
                .map(|(at, target)| Row::point(*at, *target, grip)),
        );
        self.touch(setting, &mut rows);
        // In the fall nothing bears and nothing weighs yet.
        let faded = 1.0 - self.falling as f64 / self.options.release_frames.max(1) as f64;
        let cell_weight =
            self.options.stiffness * self.lattice.size().powi(3) * weight * faded.max(0.0);
        let down = -self.table.normal.into_inner();
        let forces = loads(&self.lattice, &self.pose, &self.feet, cell_weight, &down);
        (rows, forces)
    }

    /// Contact and friction of the surface and of the feet.
    fn touch(&self, setting: &Setting<'_>, rows: &mut Vec<Row>) {
        let stick = self.options.stick_sigma.powi(-2);
        for at in setting.frame.surface {
            self.touch_one(at, setting.before, 0.25 * stick, rows);
        }
        for foot in &self.feet {
            self.touch_one(&foot.at, setting.before, stick, rows);
        }
    }

    fn touch_one(&self, at: &Embedding, before: &[Point3<f64>], stick: f64, rows: &mut Vec<Row>) {
        let normal = self.table.normal;
        let here = self.pose.position(&self.lattice, at);
        let height = self.table.height(&here);
        let contact = self.options.contact_sigma.powi(-2);
        if height < 0.0 {
            let target = here - normal.into_inner() * height;
            rows.push(Row::along(*at, target, normal, contact));
        }
        let was = self.lattice.warp(before, at);
        if self.table.height(&was) < self.options.touch {
            let slip = here - was;
            let along = slip - normal.into_inner() * normal.dot(&slip);
            let bound = self.options.friction * contact * (-height).max(0.0);
            let weight = if bound.is_finite() {
                stick.min(bound / along.norm().max(1e-5))
            } else {
                stick
            };
            if weight > 0.0 {
                for direction in tangents(&normal) {
                    rows.push(Row::along(*at, was, direction, weight));
                }
            }
        }
    }

    /// Compares the pose with two that grips, table and weight alone produce, at the present weight and at 0.6 of it, and moves the
    /// estimate of the weight to where the mean sag of the seen points vanishes.
    ///
    /// # Errors
    /// As [`Self::step`].
    pub fn weigh(&mut self, frame: &BodyFrame<'_>, seen: &[(Embedding, UnitVector3<f64>)]) -> Result<(), Error> {
        if seen.is_empty() || frame.grips.is_empty() {
            return Ok(());
        }
        let fitted = self.pose.clone();
        let at_fit: Vec<Point3<f64>> = seen.iter().map(|(at, _)| fitted.position(&self.lattice, at)).collect();
        let mut elastic = self.prepared()?;
        let present = self.weight.value();
        let pair = [present, 0.6 * present];
        let mut sag = [0.0; 2];
        let mut error = 0.0;
        let outcome = (|| {
            for (k, weight) in pair.into_iter().enumerate() {
                self.pose = fitted.clone();
                let setting = Setting {
                    frame,
                    before: &fitted.live,
                    expected: &fitted.live,
                    expected_weight: 0.05f64.powi(-2),
                };
                for _ in 0..5 {
                    let (rows, forces) = self.acting(&setting, &[], weight);
                    let acting = Acting {
                        stiffness: self.options.stiffness,
                        rows: &rows,
                        expected: setting.expected,
                        expected_weight: setting.expected_weight,
                        forces: &forces,
                    };
                    elastic.step(&self.lattice, &mut self.pose, &acting)?;
                }
                let down = -self.table.normal.into_inner();
                for ((at, normal), fit) in seen.iter().zip(&at_fit) {
                    let off = self.pose.position(&self.lattice, at) - fit;
                    sag[k] += down.dot(&off) / seen.len() as f64;
                    if k == 0 {
                        error += normal.dot(&off).abs() / seen.len() as f64;
                    }
                }
            }
            Ok(())
        })();
        self.pose = fitted;
        self.elastic = Some(elastic);
        outcome?;
        let slope = (sag[0] - sag[1]) / (pair[0] - pair[1]);
        let sigma = (0.002f64.powi(2) + (0.5 * error).powi(2)).sqrt();
        self.weight.weigh(sag[0] - slope * present, slope, sigma);
        Ok(())
    }
}

/// What stays the same over the steps of a frame.
struct Setting<'a> {
    frame: &'a BodyFrame<'a>,
    before: &'a [Point3<f64>],
    expected: &'a [Point3<f64>],
    expected_weight: f64,
}

/// Two unit vectors along the plane.
fn tangents(normal: &UnitVector3<f64>) -> [UnitVector3<f64>; 2] {
    let axis = if normal.x.abs() < 0.6 {
        Vector3::x()
    } else {
        Vector3::y()
    };
    let u = UnitVector3::new_normalize(normal.cross(&axis));
    [u, UnitVector3::new_normalize(normal.cross(&u))]
}
