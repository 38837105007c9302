//! Settings of the body filter, each with the reason for its default.

use crate::Error;
use crate::setters::setters;

/// How stiff, how heavy, how slippery, how many steps. Lengths in metres, weights in 1/m².
///
/// ```
/// use topo_ekf::body::BodyOptions;
/// let options = BodyOptions::default().with_poisson_ratio(0.3);
/// assert_eq!(options.steps, 4);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct BodyOptions {
    /// Elastic energy of unit strain per volume, in units of the data, 1/m³. Default 4.9e7: 200 in a cube of 16 mm, so that a strain of 7 % in
    /// it weighs as much as one point that is off by its standard deviation. A fifth of it loses the body, four times as much is
    /// a little worse.
    pub stiffness: f64,
    /// Poisson's ratio. Default 0.4.
    pub poisson_ratio: f64,
    /// Standard deviation of where a node is expected, metres a frame.
    pub motion_sigma: f64,
    /// Share of the last frame's motion that is expected to go on. Default 0.8.
    pub momentum: f64,
    /// Standard deviation of a gripped point, metres.
    pub grip_sigma: f64,
    /// Standard deviation of a point that touches the table, across the table, metres.
    pub contact_sigma: f64,
    /// Standard deviation of a point that touches the table, along the table, metres a frame: friction.
    pub stick_sigma: f64,
    /// Coulomb's coefficient of friction: no point on the table holds more along it than this times what it bears. Infinite
    /// for friction that always sticks.
    pub friction: f64,
    /// Height below which a point is taken to touch the table, metres.
    pub touch: f64,
    /// What the table does. Default: nothing of the body is ever under it.
    pub table: Table,
    /// Steps with all data in a frame.
    pub steps: usize,
    /// Steps by grips, table and weight alone before the data are looked at, when something is held.
    pub presteps: usize,
    /// Steps in a frame after a release.
    pub release_steps: usize,
    /// Frames after a release in which the body is expected to fall: stiff first, wide matching, no momentum.
    pub release_frames: usize,
    /// How much stiffer the first step of such a frame is.
    pub release_stiffness: f64,
    /// Steps end when no node moved farther, metres.
    pub tolerance: f64,
    /// Weight over stiffness `ρ g / E` that is assumed before anything was lifted, 1/m.
    pub initial_weight: f64,
    /// Standard deviation of that.
    pub initial_weight_sigma: f64,
}

/// What the table does to points of the body, each variant less than the one before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Table {
    /// It pushes back with [`BodyOptions::contact_sigma`] and holds by friction, and what is left below it is projected out: to a micrometre, no point
    /// of the estimate is below.
    Constraint,
    /// It pushes back and holds, without the projection: points that are pressed into it stay in it.
    Contact,
    /// There is none, as in a filter without constraints; the weight of what stands is then borne by its feet alone.
    Absent,
}

impl Default for BodyOptions {
    fn default() -> Self {
        Self {
            stiffness: 4.9e7,
            poisson_ratio: 0.4,
            motion_sigma: 0.02,
            momentum: 0.8,
            grip_sigma: 0.001,
            contact_sigma: 0.5e-3,
            stick_sigma: 0.3e-3,
            friction: 1.0,
            touch: 0.002,
            table: Table::Constraint,
            steps: 4,
            presteps: 2,
            release_steps: 10,
            release_frames: 12,
            release_stiffness: 10.0,
            tolerance: 3e-4,
            initial_weight: 0.7,
            initial_weight_sigma: 0.5,
        }
    }
}

setters! {
    BodyOptions {
        with_stiffness stiffness: f64,
        with_poisson_ratio poisson_ratio: f64,
        with_motion_sigma motion_sigma: f64,
        with_momentum momentum: f64,
        with_grip_sigma grip_sigma: f64,
        with_contact_sigma contact_sigma: f64,
        with_stick_sigma stick_sigma: f64,
        with_friction friction: f64,
        with_touch touch: f64,
        with_table table: Table,
        with_steps steps: usize,
        with_presteps presteps: usize,
        with_release_steps release_steps: usize,
        with_release_frames release_frames: usize,
        with_release_stiffness release_stiffness: f64,
        with_tolerance tolerance: f64,
        with_initial_weight initial_weight: f64,
        with_initial_weight_sigma initial_weight_sigma: f64,
    }
}

impl BodyOptions {
    /// Refuses settings that have no meaning.
    pub(crate) fn check(&self) -> Result<(), Error> {
        for (name, value) in [
            ("stiffness", self.stiffness),
            ("motion_sigma", self.motion_sigma),
            ("grip_sigma", self.grip_sigma),
            ("contact_sigma", self.contact_sigma),
            ("stick_sigma", self.stick_sigma),
            ("release_stiffness", self.release_stiffness),
            ("initial_weight_sigma", self.initial_weight_sigma),
        ] {
            if !(1e-9..=1e12).contains(&value) {
                return Err(Error::Option {
                    name,
                    value,
                    must: "positive and finite",
                });
            }
        }
        for (name, value, least, most, must) in [
            (
                "poisson_ratio",
                self.poisson_ratio,
                0.0,
                0.49,
                "between 0 and 0.49",
            ),
            ("momentum", self.momentum, 0.0, 1.0, "between 0 and 1"),
            (
                "friction",
                self.friction,
                0.0,
                f64::INFINITY,
                "not negative",
            ),
            ("touch", self.touch, 0.0, 1.0, "between 0 and 1"),
            ("tolerance", self.tolerance, 0.0, 1.0, "between 0 and 1"),
            (
                "initial_weight",
                self.initial_weight,
                0.0,
                1e3,
                "between 0 and 1e3",
            ),
        ] {
            if !(least..=most).contains(&value) {
                return Err(Error::Option { name, value, must });
            }
        }
        if self.steps == 0 || self.release_steps == 0 {
            return Err(Error::Option {
                name: "steps",
                value: 0.0,
                must: "at least 1",
            });
        }
        Ok(())
    }
}
