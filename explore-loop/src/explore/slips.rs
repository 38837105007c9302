//! Where grips slipped: places near them are gripped again only if there are no others.
//!
//! A place where a grip slipped is likely to slip again: it may be smooth, steep, or next to a part attached to the table.

use crate::canonical::CanonicalModel;
use nalgebra::Point3;

/// Distance from a slip within which nothing is gripped, in spacings.
const SLIPPERY: f64 = 10.0;

/// What the jaws hold, and where grips slipped.
#[derive(Debug, Clone, Default, serde::Serialize, serde::Deserialize)]
pub(super) struct Slips {
    /// What the jaws hold: arm, and position at rest.
    gripped: Vec<(usize, Point3<f64>)>,
    /// Rest positions at which a grip slipped.
    slipped: Vec<Point3<f64>>,
}

impl Slips {
    /// Records where the jaws were closed.
    pub fn grip(&mut self, gripped: Vec<(usize, Point3<f64>)>) {
        self.gripped = gripped;
    }

    /// Records that the grip of an arm slipped.
    pub fn slip(&mut self, arm: usize) {
        let of = self.gripped.iter().filter(|(held, _)| *held == arm);
        self.slipped.extend(of.map(|(_, place)| *place));
    }

    /// The vertices near slips.
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
