//! From the image to the surface: the 3-D position of a corner.
//!
//! ```text
//! x = Σ_k w_k X_k        bilinear over the four points of the scan around the pixel
//! ```
//! Only where the scan shows a single surface: all points around the pixel measured, all on the object, none much deeper than another, no arm nearby.

use nalgebra::Point3;

use super::brief::Descriptor;
use super::options::FeatureOptions;
use super::{GreyImage, Keypoint};
use crate::Error;
use crate::depth::{Capsule, Scan};

/// A corner with its 3-D position.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Feature {
    /// Its position, camera frame, metres.
    pub point: Point3<f64>,
    /// Its descriptor.
    pub descriptor: Descriptor,
}

/// The surface measured together with the colours.
#[derive(Debug, Clone, Copy)]
pub struct Surface<'a> {
    /// Points of a depth camera with the same rays as the colour camera, row by row; the colour image has one pixel for each point, or
    /// k × k.
    pub scan: &'a Scan,
    /// Which points of the scan are the object, if that is known.
    pub object: Option<&'a [bool]>,
    /// Arms in view.
    pub arms: &'a [Capsule],
}

/// Lifts corners to the surface; those that cannot be lifted, or are outside of the image, are skipped.
///
/// # Errors
/// A scan without rows; an image whose size is not an integer multiple of that of the scan, the same along rows and columns; `object` with another
/// length than the scan; a capsule that is not finite.
///
/// ```
/// use dvrk_io::depth::{Capsule, DepthImage, Intrinsics, Scan};
/// use dvrk_io::features::{Descriptor, FeatureOptions, GreyImage, Keypoint, Surface, lift};
///
/// // A wall half a metre away, and an arm in front of one of two corners.
/// let camera = Intrinsics::new(64, 48, [80.0, 80.0], [31.5, 23.5])?;
/// let scan = Scan::from_image(&DepthImage::from_metres(64, 48, &[0.5; 64 * 48])?, &camera)?;
/// let at = |column, row| Keypoint { column, row, score: 1, descriptor: Descriptor::default() };
/// let tip = camera.back_project(50.0, 30.0, 0.49);
/// let arms = [Capsule { start: tip, end: tip, radius: 0.005 }];
/// let surface = Surface { scan: &scan, object: None, arms: &arms };
/// let image = GreyImage::new(64, 48, vec![0; 64 * 48])?;
/// let features = lift(&[at(20, 30), at(50, 30)], &image, &surface, &FeatureOptions::default())?;
/// assert_eq!(features.len(), 1);
/// assert!((features[0].point - camera.back_project(20.0, 30.0, 0.5)).norm() < 1e-9);
/// # Ok::<(), dvrk_io::Error>(())
/// ```
pub fn lift(
    keypoints: &[Keypoint],
    image: &GreyImage,
    surface: &Surface<'_>,
    options: &FeatureOptions,
) -> Result<Vec<Feature>, Error> {
    let grid = Grid::new(image, surface)?;
    let mut features = Vec::with_capacity(keypoints.len());
    for keypoint in keypoints {
        let Some(point) = grid.point([keypoint.column, keypoint.row], options.edge) else {
            continue;
        };
        let near = |arm: &Capsule| arm.distance(&point) < options.clearance;
        if !surface.arms.iter().any(near) {
            features.push(Feature {
                point,
                descriptor: keypoint.descriptor,
            });
        }
    }
    Ok(features)
}

/// The points of a scan as the pixels of an image.
struct Grid<'a> {
    points: &'a [Point3<f64>],
    object: Option<&'a [bool]>,
    columns: usize,
    rows: usize,
    /// Pixels of the image for each one of the scan, in each direction.
    scale: usize,
}

impl<'a> Grid<'a> {
    fn new(image: &GreyImage, surface: &Surface<'a>) -> Result<Self, Error> {
        let points = surface.scan.points();
        let bad = |reason: String| Error::BadImage { reason };
        let Some(columns) = surface.scan.columns() else {
            return Err(bad(
                "the scan has no rows, so pixels have no points".to_owned()
            ));
        };
        let rows = points.len() / columns;
        let scale = image.width() / columns;
        if scale == 0 || [image.width(), image.height()] != [columns * scale, rows * scale] {
            return Err(bad(format!(
                "the image has {} × {} pixels, which does not fit the scan of {columns} × {rows}",
                image.width(),
                image.height()
            )));
        }
        if let Some(marks) = surface.object.filter(|marks| marks.len() != points.len()) {
            return Err(Error::ImageSize {
                width: columns,
                height: rows,
                length: marks.len(),
            });
        }
        let mut arms = surface.arms.iter().enumerate();
        arms.try_for_each(|(index, arm)| arm.check(index))?;
        Ok(Self {
            points,
            object: surface.object,
            columns,
            rows,
            scale,
        })
    }

    /// The point of the surface at a pixel of the image, if there is a single surface around it.
    fn point(&self, pixel: [usize; 2], edge: f64) -> Option<Point3<f64>> {
        // Centres of pixels are integers in both images.
        let of_scan = |p: usize| (p as f64 + 0.5) / self.scale as f64 - 0.5;
        let [u, v] = pixel.map(of_scan);
        // One ring of points beyond the four that are interpolated.
        let first = |x: f64| (x.floor() >= 1.0).then(|| x.floor() as usize - 1);
        let (left, top) = (first(u)?, first(v)?);
        if left.saturating_add(4) > self.columns || top.saturating_add(4) > self.rows {
            return None;
        }
        let around = (top..top + 4).flat_map(|r| (left..left + 4).map(move |c| (c, r)));
        let (mut nearest, mut farthest) = (f64::INFINITY, f64::NEG_INFINITY);
        for (column, row) in around {
            let at = row * self.columns + column;
            let depth = self.points[at].z;
            if !depth.is_finite() || self.object.is_some_and(|object| !object[at]) {
                return None;
            }
            (nearest, farthest) = (nearest.min(depth), farthest.max(depth));
        }
        if farthest - nearest > edge {
            return None;
        }
        let (s, t) = (u - u.floor(), v - v.floor());
        let corner = |c: usize, r: usize, weight: f64| {
            self.points[(top + 1 + r) * self.columns + left + 1 + c].coords * weight
        };
        let sum = corner(0, 0, (1.0 - s) * (1.0 - t))
            + corner(1, 0, s * (1.0 - t))
            + corner(0, 1, (1.0 - s) * t)
            + corner(1, 1, s * t);
        Some(Point3::from(sum))
    }
}
