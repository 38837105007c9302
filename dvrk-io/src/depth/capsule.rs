//! Capsules: all points within a radius of a segment. Arms are removed as chains of them.
//!
//! ```text
//! distance(x, ab) = ‖x − (a + t (b − a))‖,   t = clamp( (x − a)·(b − a) / ‖b − a‖², 0, 1 )
//! ```

use nalgebra::Point3;

use crate::Error;

/// All points within `radius` of the segment from `start` to `end`.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Capsule {
    /// One end of the axis, camera frame.
    pub start: Point3<f64>,
    /// The other end.
    pub end: Point3<f64>,
    /// Metres.
    pub radius: f64,
}

impl Capsule {
    /// Distance of a point to the surface; negative inside.
    pub fn distance(&self, point: &Point3<f64>) -> f64 {
        let axis = self.end - self.start;
        let square = axis.norm_squared();
        // A capsule with coinciding ends is a ball.
        let t = if square > 0.0 {
            ((point - self.start).dot(&axis) / square).clamp(0.0, 1.0)
        } else {
            0.0
        };
        (point - (self.start + axis * t)).norm() - self.radius
    }

    /// # Errors
    /// Capsule `index` has a coordinate that is not finite or a radius that is negative.
    pub(crate) fn check(&self, index: usize) -> Result<(), Error> {
        for point in [self.start, self.end] {
            if !point.iter().all(|value| value.is_finite()) {
                return Err(Error::NonFinitePoint {
                    index,
                    point: point.into(),
                });
            }
        }
        if self.radius >= 0.0 && self.radius.is_finite() {
            return Ok(());
        }
        let expected = "must be finite and not negative";
        Err(Error::OutOfRange {
            what: "capsule radius",
            value: self.radius,
            expected,
        })
    }
}

/// The capsules along a kinematic chain: link i reaches from `joints[i]` to `joints[i + 1]` and has radius
/// `radii[i]`. Links beyond the shorter of the two slices are left out.
///
/// ```
/// use dvrk_io::depth::chain;
/// use dvrk_io::nalgebra::Point3;
///
/// let joints = [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 1.0]].map(Point3::from);
/// let links = chain(&joints, &[0.125, 0.25]);
/// assert_eq!(links.len(), 2);
/// // Beside the first link, beyond its end, and within the second one.
/// assert_eq!(links[0].distance(&Point3::new(0.5, 0.0, 0.5)), 0.5 - 0.125);
/// assert_eq!(links[0].distance(&Point3::new(0.0, 0.0, -1.0)), 1.0 - 0.125);
/// assert_eq!(links[1].distance(&Point3::new(0.5, 0.0, 1.0)), -0.25);
/// ```
pub fn chain(joints: &[Point3<f64>], radii: &[f64]) -> Vec<Capsule> {
    let capsule = |(ends, &radius): (&[Point3<f64>], &f64)| Capsule {
        start: ends[0],
        end: ends[1],
        radius,
    };
    joints.windows(2).zip(radii).map(capsule).collect()
}
