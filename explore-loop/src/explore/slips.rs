//! Where grips have slipped: nothing is gripped near such a place again if there are other places.
//!
//! What slipped once slips again: it may be smooth, steep, or next to what is held to the table.

use crate::canonical::CanonicalModel;
use nalgebra::Point3;

/// How near to a place where a grip slipped nothing is gripped, in spacings.
const SLIPPERY: f64 = 10.0;

/// What the jaws hold, and where that went wrong.
#[derive(Debug, Clone, Default, serde::Serialize, serde::Deserialize)]
pub(super) struct Slips {
    /// What the jaws hold: arm, and place at rest.
    gripped: Vec<(usize, Point3<f64>)>,
    /// Places at rest where a grip has slipped.
    slipped: Vec<Point3<f64>>,
}

impl Slips {
    /// Takes in where the jaws were closed.
    pub fn grip(&mut self, gripped: Vec<(usize, Point3<f64>)>) {
        self.gripped = gripped;
    }

    /// Takes in that the grip of an arm has slipped.
    pub fn slip(&mut self, arm: usize) {
        let of = self.gripped.iter().filter(|(held, _)| *held == arm);
        self.slipped.extend(of.map(|(_, place)| *place));
    }

    /// The vertices next to where a grip has slipped.
    pub fn slippery(&self, model: &CanonicalModel, spacing: f64) -> Vec<bool> {
        let near = |p: &Point3<f64>| {
            let mut places = self.slipped.iter();
            places.any(|place| (p - place).norm() < SLIPPERY * spacing)
        };
        model.rest().iter().map(near).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::canonical::NewVertex;
    use nalgebra::Vector3;

    #[test]
    fn nothing_is_gripped_next_to_where_a_grip_has_slipped() {
        let mut model = CanonicalModel::default();
        for k in 0..40 {
            let rest = Point3::new(0.005 * f64::from(k), 0.0, 0.5);
            model.push(NewVertex::new(rest, -Vector3::z_axis()), 0);
        }
        let mut slips = Slips::default();
        slips.grip(vec![(0, model.rest()[0]), (1, model.rest()[39])]);
        assert!(!slips.slippery(&model, 0.005).contains(&true));
        slips.slip(1);
        let slippery = slips.slippery(&model, 0.005);
        assert!((0..40).all(|k| slippery[k] == (k > 29)), "{slippery:?}");
    }
}
