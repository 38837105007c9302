//! The pinhole camera.
//!
//! ```text
//! u = fx · x/z + cx        v = fy · y/z + cy
//! ```
//! Pixel (0, 0) has its centre at u = v = 0, as in OpenCV and `sensor_msgs/CameraInfo`.

use nalgebra::Point3;

use crate::Error;

/// Size and focal parameters of a rectified camera, in pixels.
///
/// ```
/// use dvrk_io::depth::Intrinsics;
/// use dvrk_io::nalgebra::Point3;
///
/// let camera = Intrinsics::new(640, 480, [500.0, 500.0], [319.5, 239.5])?;
/// // 100 pixels right of the principal point, at 0.5 m: 100/500 · 0.5 m.
/// let point = camera.back_project(419.5, 239.5, 0.5);
/// assert!((point - Point3::new(0.1, 0.0, 0.5)).norm() < 1e-12);
/// let pixel = camera.project(&point).ok_or("behind the camera")?;
/// assert!((pixel[0] - 419.5).abs() < 1e-9 && (pixel[1] - 239.5).abs() < 1e-9);
/// assert_eq!(camera.project(&Point3::new(0.1, 0.0, -0.5)), None);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(try_from = "Parts", into = "Parts")
)]
pub struct Intrinsics {
    width: usize,
    height: usize,
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
}

/// Intrinsics as they are written, and read before they are checked.
#[cfg(feature = "serde")]
#[derive(serde::Serialize, serde::Deserialize)]
struct Parts {
    size: [usize; 2],
    focal: [f64; 2],
    center: [f64; 2],
}

#[cfg(feature = "serde")]
impl From<Intrinsics> for Parts {
    fn from(camera: Intrinsics) -> Self {
        Self {
            size: [camera.width, camera.height],
            focal: camera.focal(),
            center: camera.center(),
        }
    }
}

#[cfg(feature = "serde")]
impl TryFrom<Parts> for Intrinsics {
    type Error = Error;

    fn try_from(read: Parts) -> Result<Self, Error> {
        let [width, height] = read.size;
        Self::new(width, height, read.focal, read.center)
    }
}

impl Intrinsics {
    /// Focal lengths `focal` = (fx, fy) and principal point `center` = (cx, cy), all in pixels.
    ///
    /// # Errors
    /// A focal length that is not positive, or anything not finite.
    pub fn new(
        width: usize,
        height: usize,
        focal: [f64; 2],
        center: [f64; 2],
    ) -> Result<Self, Error> {
        for value in focal {
            if !(value > 0.0 && value.is_finite()) {
                let expected = "must be positive and finite";
                return Err(Error::OutOfRange {
                    what: "focal length",
                    value,
                    expected,
                });
            }
        }
        for value in center {
            if !value.is_finite() {
                return Err(Error::OutOfRange {
                    what: "principal point",
                    value,
                    expected: "must be finite",
                });
            }
        }
        let ([fx, fy], [cx, cy]) = (focal, center);
        Ok(Self {
            width,
            height,
            fx,
            fy,
            cx,
            cy,
        })
    }

    /// From the matrix `k` of a `sensor_msgs/CameraInfo`, row by row.
    ///
    /// # Errors
    /// See [`Intrinsics::new`]; also a skew other than 0, which a rectified camera does not have.
    pub fn from_k(width: usize, height: usize, k: &[f64; 9]) -> Result<Self, Error> {
        let [fx, skew, cx, _, fy, cy, ..] = *k;
        if skew != 0.0 {
            return Err(Error::OutOfRange {
                what: "skew",
                value: skew,
                expected: "must be 0",
            });
        }
        Self::new(width, height, [fx, fy], [cx, cy])
    }

    /// Columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Focal lengths (fx, fy), pixels.
    pub fn focal(&self) -> [f64; 2] {
        [self.fx, self.fy]
    }

    /// Principal point (cx, cy), pixels.
    pub fn center(&self) -> [f64; 2] {
        [self.cx, self.cy]
    }

    /// The point at depth `depth` (metres along the optical axis) on the ray through pixel (u, v).
    pub fn back_project(&self, u: f64, v: f64, depth: f64) -> Point3<f64> {
        Point3::new(
            (u - self.cx) / self.fx * depth,
            (v - self.cy) / self.fy * depth,
            depth,
        )
    }

    /// Where a point appears; `None` behind the camera or in its plane.
    pub fn project(&self, point: &Point3<f64>) -> Option<[f64; 2]> {
        let pixel = [
            self.fx * point.x / point.z + self.cx,
            self.fy * point.y / point.z + self.cy,
        ];
        (point.z > 0.0).then_some(pixel)
    }
}
