//! Options of the body filter, with the reasons for their defaults.

use crate::Error;
use derive_setters::Setters;

/// Stiffness, weight, friction, numbers of steps. Lengths in metres, weights in 1/m².
///
/// ```
/// use topo_ekf::body::BodyOptions;
/// let options = BodyOptions::default().with_poisson_ratio(0.3);
/// assert_eq!(options.steps, 4);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct BodyOptions {
    /// Elastic energy of unit strain per volume, in units of the data, 1/m³. Default 4.9e7: 200 in a cube of 16 mm, so that a strain of 7 % in
    /// it costs as much as one point with a residual of one standard deviation. With a fifth of it the body is lost, with four times as much the result is
    /// slightly worse.
    pub stiffness: f64,
    /// Poisson's ratio. Default 0.4.
    pub poisson_ratio: f64,
    /// Standard deviation of the expected position of a node, metres per frame.
    pub motion_sigma: f64,
    /// Share of the last frame's motion that is expected to continue. Default 0.8.
    pub momentum: f64,
    /// Standard deviation of a gripped point while the grips pull with no more than [`Self::firm_pull`], metres. Default 0.25 mm: they carry
    /// a body without giving.
    pub grip_sigma: f64,
    /// The same for what they pull beyond that, metres; at least `grip_sigma`. Default 1 mm: a grip that slips does not overrule the data.
    pub slip_sigma: f64,
    /// Pull up to which grips hold firmly, in weights of the body, distributed over all gripped points. The weight is at least half of what
    /// was assumed before anything was lifted. Default 1: the weight of the body; infinite for grips that never slip.
    pub firm_pull: f64,
    /// Standard deviation of a point that touches the table, along the normal of the table, metres.
    pub contact_sigma: f64,
    /// Standard deviation of a point that touches the table, along the table, metres per frame: friction.
    pub stick_sigma: f64,
    /// Coulomb's coefficient of friction: the friction force of a point is at most this times its normal force. Infinite
    /// for friction that always sticks.
    pub friction: f64,
    /// Height below which a point counts as touching the table, metres.
    pub touch: f64,
    /// How the table acts. Default: as a constraint.
    pub table: Table,
    /// Steps with all data in each frame.
    pub steps: usize,
    /// Steps with grips, table and weight alone before the data are used, when something is held.
    pub presteps: usize,
    /// Steps in a frame after a release.
    pub release_steps: usize,
    /// Number of frames after a release in which the body may fall: stiff at first, wide matching, no momentum.
    pub release_frames: usize,
    /// Factor on the stiffness in the first step of such a frame.
    pub release_stiffness: f64,
    /// Steps end when no node has moved farther, metres.
    pub tolerance: f64,
    /// Weight over stiffness `ρ g / E` assumed before anything was lifted, 1/m.
    pub initial_weight: f64,
    /// Standard deviation of that assumption.
    pub initial_weight_sigma: f64,
}

/// How the table acts on points of the body; each variant does less than the one before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Table {
    /// It exerts normal forces with [`BodyOptions::contact_sigma`] and friction, and remaining penetration is removed by projection: no point of the
    /// estimate is more than a micrometre below it.
    Constraint,
    /// It exerts normal forces and friction, without the projection: points that are pressed into it stay there.
    Contact,
    /// There is no table, as in a filter without constraints; a standing body is then supported by its feet alone.
    Absent,
}

impl Default for BodyOptions {
    fn default() -> Self {
        Self {
            stiffness: 4.9e7,
            poisson_ratio: 0.4,
            motion_sigma: 0.02,
            momentum: 0.8,
            grip_sigma: 0.25e-3,
            slip_sigma: 1e-3,
            firm_pull: 1.0,
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

impl BodyOptions {
    /// Rejects invalid options.
    pub(crate) fn check(&self) -> Result<(), Error> {
        for (name, value) in [
            ("stiffness", self.stiffness),
            ("motion_sigma", self.motion_sigma),
            ("grip_sigma", self.grip_sigma),
            ("slip_sigma", self.slip_sigma),
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
            ("friction", self.friction, 0.0, f64::INFINITY, "at least 0"),
            (
                "firm_pull",
                self.firm_pull,
                0.0,
                f64::INFINITY,
                "at least 0",
            ),
            (
                "slip_sigma",
                self.slip_sigma,
                self.grip_sigma,
                f64::INFINITY,
                "at least grip_sigma",
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
