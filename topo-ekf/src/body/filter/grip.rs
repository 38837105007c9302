//! The force with which a grip holds a point of the material.
//!
//! ```text
//! force on a point at distance d from its place in the jaw
//!     d / σ²                        up to F = firm_pull · W / n     σ = grip_sigma, W weight of the body, n number of gripped points
//!     F + (d − F σ²) / σ_slip²      beyond                          σ_slip = slip_sigma > σ
//! ```
//! Grips that carry a body must not give: if they hold it with a standard deviation of a millimetre, the model of a liver hangs a millimetre lower in
//! the jaws than the liver does, and what is seen for the first time then is placed wrongly by as much. Grips that slip or tear must not overrule the
//! camera: beyond the weight of the body they are soft. A step uses force over distance at the present pose as the weight of a row, and a few steps find the
//! equilibrium.

use nalgebra::Point3;

use super::BodyFilter;
use crate::body::lattice::Embedding;
use crate::body::pose::Pose;
use crate::body::row::Row;

/// The force as a function of the distance.
#[derive(Clone, Copy)]
struct GripLaw {
    /// `1/σ²` and `1/σ_slip²`, 1/m².
    firm: f64,
    soft: f64,
    /// `F`, in units of the energy per metre.
    pull: f64,
}

impl GripLaw {
    /// Force over distance, 1/m².
    fn weight(&self, distance: f64) -> f64 {
        let knee = self.pull / self.firm;
        if distance <= knee {
            self.firm
        } else {
            (self.pull + self.soft * (distance - knee)) / distance
        }
    }
}

impl BodyFilter {
    /// The rows that hold gripped points at their places, in a pose.
    pub(super) fn grip_rows(
        &self,
        grips: &[(Embedding, Point3<f64>)],
        pose: &Pose,
    ) -> impl Iterator<Item = Row> {
        let law = self.grip_law(grips.len());
        grips.iter().map(move |(at, place)| {
            let distance = (place - pose.position(&self.lattice, at)).norm();
            Row::point(*at, *place, law.weight(distance))
        })
    }

    /// The law for a frame with this many gripped points.
    fn grip_law(&self, points: usize) -> GripLaw {
        GripLaw {
            firm: self.options.grip_sigma.powi(-2),
            soft: self.options.slip_sigma.powi(-2),
            // Not a number if a body without mass is held infinitely firmly; 0 then.
            pull: (self.options.firm_pull * self.assumed_weight() / points.max(1) as f64).max(0.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::GripLaw;

    const LAW: GripLaw = GripLaw {
        firm: 1.6e7,
        soft: 1e6,
        pull: 2000.0,
    };

    /// The force is continuous, grows with the distance, and has the two slopes.
    #[test]
    fn the_force_of_a_grip_is_firm_up_to_its_share_of_the_weight_and_soft_beyond() {
        let force = |d: f64| LAW.weight(d) * d;
        let knee = LAW.pull / LAW.firm;
        assert!((force(0.5 * knee) - 0.5 * LAW.pull).abs() < 1e-9);
        assert!((force(knee * (1.0 + 1e-9)) - LAW.pull).abs() < 1e-3);
        assert!((force(knee + 1e-3) - LAW.pull - 1000.0).abs() < 1e-6);
        let forces: Vec<f64> = (0..1000).map(|k| force(1e-6 * f64::from(k))).collect();
        assert!(forces.windows(2).all(|f| f[0] < f[1]));
    }
}
