//! Measures whether the model follows a pixel tracker: a reference for real recordings, which have no ground truth.
//!
//! Any tracker of points in videos gives the pixel of each of its points in every frame; with the depth of the frame this is a point of the surface.
//! The tracker is independent of the model, the arms and elasticity.
//!
//! ```text
//! q_k(t) = z (u − cx)/fx, z (v − cy)/fy, z           z: depth of the cloud along the ray of pixel (u, v) of track k in frame t
//! anchored once, in the first frame in which q_k lies within a spacing of a vertex i measured in it:  x_k = R_iᵀ (q_k − p_i)
//! e_k(t) = q_k − (p_i + R_i x_k)                     afterwards
//! tracking error  ‖e_k(t)‖ over all tracks and frames: mean, 95 %, maximum;     slide  mean of its part along the surface
//! ```
//! The tracker has errors too: this measures how far the two disagree. Source: the validation of the paper on real tissue, where dense pixel
//! tracks and depth are the reference.

use super::{MeasureError, Spread};
use crate::Error;
use crate::baseline::depth::DepthMap;
use crate::canonical::{CanonicalModel, graph};
use crate::cell::Observation;
use mesh_io::Array;
use nalgebra::{Point3, Vector3};
use std::collections::{BTreeMap, BTreeSet};

/// Pixels of many points in many frames.
///
/// ```
/// use explore_loop::measure::PixelTracks;
///
/// let table = b"frame,track,column,row\n0,0,310.5,240.0\n0,1,320.0,250.0\n1,0,311.0,240.5\n";
/// assert_eq!(PixelTracks::parse(table)?.count(), 2);
/// assert!(PixelTracks::parse(b"frame,track,column,row\n0,0.5,310.5,240.0\n").is_err());
/// # Ok::<(), explore_loop::measure::MeasureError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Default, serde::Serialize, serde::Deserialize)]
pub struct PixelTracks {
    /// By frame number: the tracks visible in it, with column and row.
    frames: BTreeMap<usize, Vec<(usize, [f64; 2])>>,
}

impl PixelTracks {
    /// Reads a NumPy file with an array of the shape (frames, tracks, 2) or (frames, tracks, 3): column, row and optionally visibility (visible above
    /// 0.5); NaN where not visible. Any other file is read as a table with the columns `frame, track, column, row`, counted from 0, with a line for
    /// each track and frame in which it was visible.
    ///
    /// # Errors
    /// Neither of the two; an array of another shape; frames or tracks that are not whole numbers.
    pub fn parse(bytes: &[u8]) -> Result<Self, MeasureError> {
        let bad = |reason: String| MeasureError::BadTracks { reason };
        if bytes.starts_with(b"\x93NUMPY") {
            let array = Array::parse(bytes).map_err(|error| bad(error.to_string()))?;
            return Self::of_array(&array);
        }
        let columns = ["frame", "track", "column", "row"];
        let table = mesh_io::read_table::<4>(bytes, columns);
        let table = table.map_err(|error| bad(error.to_string()))?;
        let mut tracks = Self::default();
        for (line, [frame, track, column, row]) in table.lines.iter().zip(&table.rows) {
            let (Some(frame), Some(track)) = (whole(*frame), whole(*track)) else {
                return Err(bad(format!(
                    "line {line}: frame {frame} and track {track} must be whole numbers, counted from 0"
                )));
            };
            let seen = tracks.frames.entry(frame).or_default();
            seen.push((track, [*column, *row]));
        }
        Ok(tracks)
    }

    /// Number of tracks that were visible in some frame.
    pub fn count(&self) -> usize {
        let seen = self.frames.values().flatten();
        seen.map(|(track, _)| *track)
            .collect::<BTreeSet<usize>>()
            .len()
    }

    fn of_array(array: &Array) -> Result<Self, MeasureError> {
        let &[_, tracks, numbers @ (2 | 3)] = &array.shape[..] else {
            return Err(MeasureError::BadTracks {
                reason: format!(
                    "an array of the shape {:?}, but must be (frames, tracks, 2) or (frames, tracks, 3)",
                    array.shape
                ),
            });
        };
        let pixel = |(track, p): (usize, &[f64])| {
            let seen = p[0].is_finite() && p[1].is_finite() && p.get(2).is_none_or(|s| *s > 0.5);
            seen.then(|| (track, [p[0], p[1]]))
        };
        let frames = array.values.chunks_exact((tracks * numbers).max(1));
        let seen = frames.map(|frame| (0..).zip(frame.chunks_exact(numbers)).filter_map(pixel));
        Ok(Self {
            frames: (0..).zip(seen.map(Iterator::collect)).collect(),
        })
    }
}

/// A non-negative whole number.
fn whole(number: f64) -> Option<usize> {
    const MOST: f64 = 9e15;
    let counts = (0.0..MOST).contains(&number) && number.fract() == 0.0;
    counts.then_some(number as usize)
}

/// Focal lengths and principal point of a camera, pixels: fx, fy, cx, cy; the centre of the first pixel is at 0, 0.
pub type Pinhole = [f64; 4];

/// A track anchored to a vertex.
#[derive(Debug, Clone, Copy)]
struct Tie {
    id: u64,
    /// Offset from the vertex, at rest.
    offset: Vector3<f64>,
}

/// Disagreement of model and tracker.
#[derive(Debug, Clone, Copy, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[non_exhaustive]
pub struct TrackErrors {
    /// Tracks in the file.
    pub tracks: usize,
    /// Tracks that were anchored to the model.
    pub tied: usize,
    /// Number of comparisons: tracks times frames.
    pub compared: usize,
    /// Distance between them, metres.
    pub error_m: Spread,
    /// Mean of the part of the distance along the surface, metres.
    pub slide_m: f64,
}

/// Compares a model with pixel tracks, frame by frame.
#[derive(Debug)]
pub struct TrackComparison {
    tracks: PixelTracks,
    camera: Pinhole,
    spacing: f64,
    ties: BTreeMap<usize, Tie>,
    /// In single precision: there are as many as tracks times frames.
    errors: Vec<f32>,
    slide: f64,
}

impl TrackComparison {
    /// For tracks in the images of a camera, and a model of this spacing, metres.
    ///
    /// # Errors
    /// Focal lengths that are not positive, or a principal point that is not finite.
    pub fn new(tracks: PixelTracks, camera: Pinhole, spacing: f64) -> Result<Self, MeasureError> {
        let [fx, fy, cx, cy] = camera;
        let sound = fx > 0.0 && fy > 0.0 && camera.iter().all(|x| x.is_finite());
        if !sound {
            return Err(MeasureError::BadTracks {
                reason: format!(
                    "the focal lengths {fx} and {fy} must be positive, and the principal point {cx}, {cy} finite"
                ),
            });
        }
        Ok(Self {
            tracks,
            camera,
            spacing,
            ties: BTreeMap::new(),
            errors: Vec::new(),
            slide: 0.0,
        })
    }

    /// Adds a frame, by its number, after the model was registered to it.
    ///
    /// # Errors
    /// A cloud from which no depth map can be computed.
    pub fn frame(
        &mut self,
        number: usize,
        observation: &Observation,
        measured: &[bool],
        model: &CanonicalModel,
    ) -> Result<(), Error> {
        let Some(pixels) = self.tracks.frames.get(&number) else {
            return Ok(());
        };
        let Some(depth) = DepthMap::new(&observation.measured().points)? else {
            return Ok(());
        };
        let [fx, fy, cx, cy] = self.camera;
        let fixed_from_camera = observation.fixed_from_camera();
        let place = |[u, v]: [f64; 2]| {
            let hit = depth.at(&Point3::new((u - cx) / fx, (v - cy) / fy, 1.0))?;
            Some((
                fixed_from_camera * hit.point,
                fixed_from_camera.rotation * hit.normal,
            ))
        };
        let seen: Vec<_> = pixels
            .iter()
            .filter_map(|(track, pixel)| Some((*track, place(*pixel)?)))
            .collect();
        let vertices: BTreeMap<u64, usize> = model.ids().iter().copied().zip(0..).collect();
        let mut fresh = Vec::new();
        for (track, (point, normal)) in seen {
            let Some(tie) = self.ties.get(&track) else {
                fresh.push((track, point));
                continue;
            };
            // If the vertex was removed, no other vertex is the same material.
            if let Some(&i) = vertices.get(&tie.id) {
                let error = point - (model.live()[i] + model.rotations()[i] * tie.offset);
                self.errors.push(error.norm() as f32);
                self.slide += (error - *normal * normal.dot(&error)).norm();
            }
        }
        self.tie(&fresh, measured, model);
        Ok(())
    }

    /// Anchors tracks to the nearest measured vertices.
    fn tie(&mut self, fresh: &[(usize, Point3<f64>)], measured: &[bool], model: &CanonicalModel) {
        let measured: Vec<usize> = (0..model.len())
            .filter(|&i| measured.get(i) == Some(&true))
            .collect();
        let places: Vec<Point3<f64>> = measured.iter().map(|&i| model.live()[i]).collect();
        let Some(tree) = graph::tree(&places) else {
            return;
        };
        for (track, point) in fresh {
            let (nearest, distance) = graph::nearest(&tree, point);
            if distance < self.spacing {
                let i = measured[nearest];
                let offset = model.rotations()[i].transpose() * (point - model.live()[i]);
                let id = model.ids()[i];
                self.ties.insert(*track, Tie { id, offset });
            }
        }
    }

    /// The errors; `None` if nothing could be compared.
    pub fn errors(&self) -> Option<TrackErrors> {
        let count = self.errors.len();
        if count == 0 {
            return None;
        }
        let mut sorted = self.errors.clone();
        sorted.sort_by(f32::total_cmp);
        let sum: f64 = sorted.iter().map(|e| f64::from(*e)).sum();
        let at = |share: f64| f64::from(sorted[((count - 1) as f64 * share).round() as usize]);
        Some(TrackErrors {
            tracks: self.tracks.count(),
            tied: self.ties.len(),
            compared: count,
            error_m: Spread {
                mean: sum / count as f64,
                p95: at(0.95),
                max: at(1.0),
            },
            slide_m: self.slide / count as f64,
        })
    }
}
