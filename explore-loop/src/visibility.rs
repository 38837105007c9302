//! Visibility of the model from the camera.
//!
//! In its own frame the camera is at the origin and looks along +z, so a point is seen along the ray `(x/z, y/z)`. The cloud of a
//! frame, binned by ray, is a depth image that does not need the camera's intrinsics:
//!
//! ```text
//! depth(x)  > cloud + behind   → occluded by something
//! depth(x)  < cloud − front    → contradicted: the camera sees through it
//! otherwise                    → supported, when its normal faces the camera
//! ```

use crate::canonical::CanonicalModel;
use crate::cell::Observation;
use nalgebra::{Isometry3, Point3, UnitVector3};

/// A depth image computed from a cloud: the nearest depth in each bin of rays.
///
/// ```
/// use explore_loop::nalgebra::{Isometry3, Point3};
/// use explore_loop::visibility::{DepthGrid, Sight};
///
/// // A wall of 10 cm, half a metre from the camera, with a point every 2 mm.
/// let place = |k: i32| 0.002 * f64::from(k);
/// let wall: Vec<Point3<f64>> = (-25..=25)
///     .flat_map(|row| (-25..=25).map(move |column| Point3::new(place(column), place(row), 0.5)))
///     .collect();
/// let grid = DepthGrid::new(&wall, 0.005, &Isometry3::identity()).ok_or("no points")?;
/// let sight = |x: f64, z: f64| grid.sight(&Point3::new(x, 0.001, z), 0.01, 0.01);
/// assert!(matches!(sight(0.001, 0.502), Sight::Supported { behind } if (behind - 0.002).abs() < 1e-12));
/// assert_eq!(sight(0.001, 0.53), Sight::Occluded);
/// assert_eq!(sight(0.001, 0.47), Sight::Contradicted);
/// assert_eq!(sight(0.2, 0.5), Sight::NoData);
/// # Ok::<(), &str>(())
/// ```
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct DepthGrid {
    camera_from_fixed: Isometry3<f64>,
    bin: f64,
    low: [i64; 2],
    size: [usize; 2],
    nearest: Vec<f64>,
}

/// What the depth image implies for a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Sight {
    /// The cloud passes near the point.
    Supported {
        /// Depth of the point minus depth of the cloud, metres.
        behind: f64,
    },
    /// The cloud lies in front of it.
    Occluded,
    /// The cloud lies behind it: the camera sees through the point.
    Contradicted,
    /// Nothing was seen along this ray.
    NoData,
}

impl DepthGrid {
    /// Bins `points` by their rays from a camera, at about `pitch` metres (at their mean depth). `None` without points in front of the camera.
    pub fn new(
        points: &[Point3<f64>],
        pitch: f64,
        fixed_from_camera: &Isometry3<f64>,
    ) -> Option<Self> {
        let camera_from_fixed = fixed_from_camera.inverse();
        let own = points.iter().map(|p| camera_from_fixed * p);
        let front: Vec<Point3<f64>> = own.filter(|p| p.z > 1e-6).collect();
        if front.is_empty() {
            return None;
        }
        let depth = front.iter().map(|p| p.z).sum::<f64>() / front.len() as f64;
        let bin = pitch / depth;
        let cells: Vec<[i64; 2]> = front.iter().map(|p| cell(p, bin)).collect();
        let low = [0, 1].map(|k| cells.iter().map(|c| c[k]).min().unwrap_or(0));
        let high = [0, 1].map(|k| cells.iter().map(|c| c[k]).max().unwrap_or(0));
        let size = [0, 1].map(|k| (high[k] - low[k] + 1) as usize);
        // An outlier far away must not allocate a gigapixel image.
        if size[0].saturating_mul(size[1]) > 16_000_000 {
            return None;
        }
        let mut nearest = vec![f64::INFINITY; size[0] * size[1]];
        for (point, c) in front.iter().zip(&cells) {
            let at = (c[0] - low[0]) as usize * size[1] + (c[1] - low[1]) as usize;
            nearest[at] = nearest[at].min(point.z);
        }
        Some(Self {
            camera_from_fixed,
            bin,
            low,
            size,
            nearest,
        })
    }

    /// Position of the camera.
    pub fn eye(&self) -> Point3<f64> {
        self.camera_from_fixed.inverse().translation.vector.into()
    }

    /// How far behind the cloud a point lies, metres: its depth minus that of the cloud along its ray. `None` where nothing was seen along it.
    pub fn behind(&self, point: &Point3<f64>) -> Option<f64> {
        let own = self.camera_from_fixed * point;
        self.depth(&own).map(|depth| own.z - depth)
    }

    /// The cloud's depth along the ray of a point in the frame of the camera: that of its bin, or the mean of the adjacent bins.
    fn depth(&self, point: &Point3<f64>) -> Option<f64> {
        if point.z <= 1e-6 {
            return None;
        }
        let c = cell(point, self.bin);
        if let Some(depth) = self.at(c[0], c[1]) {
            return Some(depth);
        }
        let mut sum = 0.0;
        let mut count = 0.0;
        for dx in -1..=1 {
            for dy in -1..=1 {
                if let Some(depth) = self.at(c[0] + dx, c[1] + dy) {
                    sum += depth;
                    count += 1.0;
                }
            }
        }
        (count > 0.0).then(|| sum / count)
    }

    /// Classifies `point`: supported when it is at most `front` in front of and `back` behind the cloud, metres.
    pub fn sight(&self, point: &Point3<f64>, front: f64, back: f64) -> Sight {
        match self.behind(point) {
            None => Sight::NoData,
            Some(behind) if behind > back => Sight::Occluded,
            Some(behind) if -behind > front => Sight::Contradicted,
            Some(behind) => Sight::Supported { behind },
        }
    }

    /// A point of the seen silhouette near `point` in the image, at the depth of `point`; `None` if there is none within about
    /// `most` metres. Bins are searched in square rings, and the best of the first non-empty ring is returned, so
    /// the true nearest may be closer by up to a factor of √2.
    pub fn nearest_seen(&self, point: &Point3<f64>, most: f64) -> Option<Point3<f64>> {
        let point = self.camera_from_fixed * point;
        if point.z <= 1e-6 {
            return None;
        }
        let c = cell(&point, self.bin);
        let rings = (most / (self.bin * point.z)).ceil() as i64;
        for ring in 0..=rings {
            let mut best: Option<(i64, [i64; 2])> = None;
            for dx in -ring..=ring {
                for dy in -ring..=ring {
                    let on_ring = dx.abs() == ring || dy.abs() == ring;
                    if on_ring && self.at(c[0] + dx, c[1] + dy).is_some() {
                        let candidate = (dx * dx + dy * dy, [c[0] + dx, c[1] + dy]);
                        best = Some(best.map_or(candidate, |b| b.min(candidate)));
                    }
                }
            }
            if let Some((_, [x, y])) = best {
                let at = |k: i64| (k as f64 + 0.5) * self.bin * point.z;
                let own = Point3::new(at(x), at(y), point.z);
                return Some(self.camera_from_fixed.inverse() * own);
            }
        }
        None
    }

    fn at(&self, x: i64, y: i64) -> Option<f64> {
        let (x, y) = (x - self.low[0], y - self.low[1]);
        if x < 0 || y < 0 || x as usize >= self.size[0] || y as usize >= self.size[1] {
            return None;
        }
        let depth = self.nearest[x as usize * self.size[1] + y as usize];
        depth.is_finite().then_some(depth)
    }
}

fn cell(point: &Point3<f64>, bin: f64) -> [i64; 2] {
    [
        (point.x / point.z / bin).floor() as i64,
        (point.y / point.z / bin).floor() as i64,
    ]
}

/// Whether an arm may hide `point` from a camera at `eye`: the ray to it passes within `margin` metres of the straight tool behind the tip.
pub fn behind_arm(
    point: &Point3<f64>,
    eye: &Point3<f64>,
    camera_from_tip: &Isometry3<f64>,
    margin: f64,
) -> bool {
    const TOOL: f64 = 0.3;
    let way = point - eye;
    let ray = way / way.norm().max(1e-12);
    (0..=60).any(|k| {
        let on_tool = camera_from_tip * Point3::new(0.0, 0.0, 0.01 - TOOL * f64::from(k) / 60.0);
        let tool = on_tool - eye;
        let along = tool.dot(&ray);
        along > 0.0 && along < way.norm() + margin && (tool - along * ray).norm() < margin
    })
}

/// Cosine between a surface normal and the direction to a camera at `eye`: 1 faces it, negative turns away.
pub fn facing(point: &Point3<f64>, normal: &UnitVector3<f64>, eye: &Point3<f64>) -> f64 {
    let way = point - eye;
    -normal.dot(&way) / way.norm().max(1e-12)
}

/// Which vertices of a model the camera sees: they face it, and the cloud passes within two spacings of them. `spacing` is that of the model, metres.
pub fn visible(model: &CanonicalModel, seen: &Observation, spacing: f64) -> Vec<bool> {
    let grid = DepthGrid::new(&seen.points, 0.6 * spacing, &seen.fixed_from_camera());
    let (near, eye) = (2.0 * spacing, seen.eye());
    (0..model.len())
        .map(|i| {
            let sight = grid.as_ref().map(|g| g.sight(&model.live()[i], near, near));
            facing(&model.live()[i], &model.live_normal(i), &eye) > 0.1
                && matches!(sight, Some(Sight::Supported { .. }))
        })
        .collect()
}
