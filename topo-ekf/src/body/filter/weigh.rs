//! The weight of the body in a pose, and the estimate of weight over stiffness from the sag of the held body.
//!
//! ```text
//! sag(γ) = mean over the seen points of  down · (x_γ(e) − x_fitted(e)),     x_γ: the pose by grips, table and weight γ alone
//! sag(γ) ≈ a + s γ                                                        from γ and 0.6 γ;  the estimate moves to the zero of this line
//! ```

use nalgebra::{UnitVector3, Vector3};

use super::{BodyFilter, Setting};
use crate::Error;
use crate::body::elastic::Elastic;
use crate::body::frame::BodyFrame;
use crate::body::lattice::Embedding;
use crate::body::pose::Pose;
use crate::body::row::check_unit;
use crate::body::weight::loads;

/// Steps of the poses that [`BodyFilter::weigh`] compares, and the standard deviation of their nodes, m.
const WEIGH_STEPS: usize = 5;
const WEIGH_SIGMA: f64 = 0.05;
/// The second weight, as a share of the present one.
const LIGHTER: f64 = 0.6;

/// Sag of the seen points as a linear function `constant + slope · γ`.
struct Look {
    constant: f64,
    slope: f64,
    sigma: f64,
}

impl BodyFilter {
    /// Compares the pose with two poses computed from grips, table and weight alone, at the present weight and at 0.6 of it, and moves the estimate
    /// of weight over stiffness to where the mean sag of the seen points vanishes. `seen`: points that the last frame measured, and
    /// their live normals. Does nothing without grips or seen points.
    ///
    /// # Errors
    /// As [`Self::step`]; the estimate is then unchanged.
    ///
    /// # Complexity
    /// Ten factorisations.
    pub fn weigh(
        &mut self,
        frame: &BodyFrame<'_>,
        seen: &[(Embedding, UnitVector3<f64>)],
    ) -> Result<(), Error> {
        self.check(frame)?;
        for (index, (at, normal)) in seen.iter().enumerate() {
            self.lattice.check_embedding("seen point", index, at)?;
            check_unit("length of normal of seen point", index, normal)?;
        }
        if seen.is_empty() || frame.grips.is_empty() {
            return Ok(());
        }
        let (mut elastic, kept) = self.take_elastic()?;
        let looked = self.look_at_sag(&mut elastic, frame, seen);
        self.spent += elastic.take_spent();
        self.give_back(elastic, kept);
        let look = looked?;
        self.weight.weigh(look.constant, look.slope, look.sigma);
        Ok(())
    }

    fn look_at_sag(
        &self,
        elastic: &mut Elastic,
        frame: &BodyFrame<'_>,
        seen: &[(Embedding, UnitVector3<f64>)],
    ) -> Result<Look, Error> {
        let fitted = &self.state.pose;
        let setting = Setting {
            frame,
            before: &fitted.live,
            expected: &fitted.live,
            expected_weight: WEIGH_SIGMA.powi(-2),
        };
        let down = -self.table.normal.into_inner();
        let present = self.weight.value();
        let lighter = LIGHTER * present;
        let share = 1.0 / seen.len() as f64;
        let (mut sag, mut error) = ([0.0; 2], 0.0);
        for (k, weight) in [present, lighter].into_iter().enumerate() {
            let mut pose = fitted.clone();
            let start = fitted.live.iter().zip(&self.state.raised);
            pose.live = start.map(|(p, r)| p - r).collect();
            for _ in 0..WEIGH_STEPS {
                let stiffness = self.options.stiffness;
                let (_, solved) =
                    self.advance_pose(elastic, &setting, &mut pose, vec![], stiffness, weight)?;
                elastic.recycle(solved);
            }
            for (at, normal) in seen {
                let fit = fitted.position(&self.lattice, at);
                let off = pose.position(&self.lattice, at) - fit;
                sag[k] += down.dot(&off) * share;
                if k == 0 {
                    error += normal.dot(&off).abs() * share;
                }
            }
        }
        let slope = (sag[0] - sag[1]) / (present - lighter);
        Ok(Look {
            constant: sag[0] - slope * present,
            slope,
            sigma: (0.002f64.powi(2) + (0.5 * error).powi(2)).sqrt(),
        })
    }

    /// Loads in a pose. During a fall there is no reaction and no weight.
    pub(super) fn loads_of(&self, pose: &Pose, weight: f64) -> Vec<Vector3<f64>> {
        let faded = 1.0 - self.state.falling as f64 / self.options.release_frames.max(1) as f64;
        let full = self.cell_weight(weight);
        let down = -self.table.normal.into_inner();
        loads(
            &self.lattice,
            pose,
            &self.feet,
            full * faded.max(0.0),
            &down,
        )
    }

    /// Weight of a full cell, for a weight over stiffness `gamma`.
    pub(super) fn cell_weight(&self, gamma: f64) -> f64 {
        self.options.stiffness * self.lattice.size().powi(3) * gamma
    }
}
