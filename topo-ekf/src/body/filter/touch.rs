//! Contact and friction with the table.
//!
//! ```text
//! table       height(x(e)) = 0                  variance contact_sigma², for points that are below it
//! friction    along the table x(e) = x_before(e)   weight min(w, μ N / ‖slip‖),  N = depth / contact_sigma²: Coulomb's bound
//!             w = 1/stick_sigma² for a foot, a quarter of it for a point of the surface (there are more of them)
//! ```

use nalgebra::{Point3, UnitVector3, Vector3};

use super::{BodyFilter, Setting};
use crate::body::lattice::Embedding;
use crate::body::options::Table;
use crate::body::pose::Pose;
use crate::body::row::Row;

impl BodyFilter {
    /// Contact and friction of the surface and of the feet.
    pub(super) fn touch(&self, setting: &Setting<'_>, pose: &Pose, rows: &mut Vec<Row>) {
        if self.options.table == Table::Absent {
            return;
        }
        let stick = self.options.stick_sigma.powi(-2);
        for at in setting.frame.surface {
            self.touch_one(at, pose, setting.before, 0.25 * stick, rows);
        }
        for foot in &self.feet {
            self.touch_one(&foot.at, pose, setting.before, stick, rows);
        }
    }

    fn touch_one(
        &self,
        at: &Embedding,
        pose: &Pose,
        before: &[Point3<f64>],
        stick: f64,
        rows: &mut Vec<Row>,
    ) {
        let normal = self.table.normal;
        let here = pose.position(&self.lattice, at);
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
}

/// Two unit vectors along the plane.
pub(super) fn tangents(normal: &UnitVector3<f64>) -> [UnitVector3<f64>; 2] {
    let axis = if normal.x.abs() < 0.6 {
        Vector3::x()
    } else {
        Vector3::y()
    };
    let u = UnitVector3::new_normalize(normal.cross(&axis));
    [u, UnitVector3::new_normalize(normal.cross(&u))]
}
