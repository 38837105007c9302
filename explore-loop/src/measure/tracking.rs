//! Measures whether the vertices follow the material.
//!
//! Each vertex is anchored to the material in the frame in which it is added to the model: to a triangle of the true surface
//! and barycentric coordinates in it. These define where the vertex ought to be in every later frame.
//!
//! ```text
//! e_i               true position of vertex i − its live position
//! prediction error  mean ‖e_i‖ over the unseen vertices of a frame, then over the frames
//!   while held      the same over the frames in which an arm holds, when the object moves and the prediction matters
//! slide             mean ‖e_i − (n_i·e_i) n_i‖ over the seen vertices of a frame, then over the frames; n_i the true normal
//! ```
//! A seen vertex cannot be far from the surface, but it can slide along it; only the tangential part shows that.
//! The normal part when the vertex is added is the noise of one measurement, and is contained in every later error of the vertex.

use super::{MeasureError, Sampling, ShapeMeasures, Surface, TrueSurface};
use crate::canonical::CanonicalModel;
use nalgebra::{Point3, Vector3};
use std::collections::BTreeMap;

/// A point on a triangle of the true surface, which follows the material.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
struct Anchor {
    triangle: u32,
    weights: [f64; 3],
}

/// Holds the ground truth and compares models with it.
pub struct Measurer {
    rest: TrueSurface,
    surface: Surface,
    anchors: BTreeMap<u64, Anchor>,
    hidden: Mean,
    hidden_held: Mean,
    slide: Mean,
}

impl std::fmt::Debug for Measurer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Measurer")
            .field("anchors", &self.anchors.len())
            .finish_non_exhaustive()
    }
}

/// Errors of tracking over a run, metres; `None` where there was nothing to measure.
#[derive(Debug, Clone, Copy, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct TrackingMeasures {
    /// Mean distance of unseen vertices to their material points.
    pub prediction_error: Option<f64>,
    /// The same over the frames in which an arm held the object.
    pub prediction_error_held: Option<f64>,
    /// Mean tangential error of seen vertices.
    pub slide: Option<f64>,
}

#[derive(Debug, Clone, Copy, Default, serde::Serialize, serde::Deserialize)]
struct Mean {
    sum: f64,
    count: usize,
}

impl Mean {
    fn add(&mut self, value: Option<f64>) {
        if let Some(value) = value {
            self.sum += value;
            self.count += 1;
        }
    }

    fn get(self) -> Option<f64> {
        (self.count > 0).then(|| self.sum / self.count as f64)
    }
}

/// What a [`Measurer`] has accumulated.
#[derive(Debug, Clone, Default, serde::Serialize, serde::Deserialize)]
pub struct MeasurerState {
    anchors: BTreeMap<u64, Anchor>,
    hidden: Mean,
    hidden_held: Mean,
    slide: Mean,
}

impl Measurer {
    /// What was accumulated so far.
    pub fn save(&self) -> MeasurerState {
        MeasurerState {
            anchors: self.anchors.clone(),
            hidden: self.hidden,
            hidden_held: self.hidden_held,
            slide: self.slide,
        }
    }

    /// Continues from the state of another measurer of the same object.
    ///
    /// # Errors
    /// [`MeasureError::OtherObject`]: the state refers to triangles that the true surface does not have.
    pub fn restore(&mut self, saved: MeasurerState) -> Result<(), MeasureError> {
        let triangles = self.rest.triangles.len();
        let known = |anchor: &Anchor| (anchor.triangle as usize) < triangles;
        if !saved.anchors.values().all(known) {
            return Err(MeasureError::OtherObject);
        }
        self.anchors = saved.anchors;
        self.hidden = saved.hidden;
        self.hidden_held = saved.hidden_held;
        self.slide = saved.slide;
        Ok(())
    }

    /// Creates a measurer from the true surface at the first observation.
    ///
    /// # Errors
    /// Those of [`Surface::new`].
    pub fn new(rest: TrueSurface) -> Result<Self, MeasureError> {
        let surface = rest.surface()?;
        Ok(Self {
            rest,
            surface,
            anchors: BTreeMap::new(),
            hidden: Mean::default(),
            hidden_held: Mean::default(),
            slide: Mean::default(),
        })
    }

    /// The true surface at rest.
    pub fn rest(&self) -> &TrueSurface {
        &self.rest
    }

    /// The same surface, validated.
    pub fn surface(&self) -> &Surface {
        &self.surface
    }

    /// Explored shares and shape difference of a model at `spacing`.
    pub fn shape(&self, model: &CanonicalModel, spacing: f64) -> ShapeMeasures {
        ShapeMeasures::of(model.rest(), &self.surface, spacing, Sampling::default())
    }

    /// Adds a frame to the means of the run: the model after it, which vertices it measured, whether an arm held the object, and the true
    /// surface then. Returns the distance of each vertex from its material point, metres.
    ///
    /// # Errors
    /// A true surface with another number of vertices than at first, or an invalid one.
    pub fn frame(
        &mut self,
        model: &CanonicalModel,
        measured: &[bool],
        held: bool,
        now: &TrueSurface,
    ) -> Result<Vec<f64>, MeasureError> {
        self.anchor(model, now)?;
        let hidden = self.prediction_error(model, measured, now);
        self.hidden.add(hidden);
        if held {
            self.hidden_held.add(hidden);
        }
        self.slide.add(self.slide(model, measured, now));
        Ok(self.live_errors(model, now))
    }

    /// The means over all frames so far.
    pub fn tracking(&self) -> TrackingMeasures {
        TrackingMeasures {
            prediction_error: self.hidden.get(),
            prediction_error_held: self.hidden_held.get(),
            slide: self.slide.get(),
        }
    }

    /// Anchors vertices that are new in `model` to the true surface `now`.
    ///
    /// # Errors
    /// A true surface with another number of vertices than at first, or an invalid one.
    pub fn anchor(
        &mut self,
        model: &CanonicalModel,
        now: &TrueSurface,
    ) -> Result<(), MeasureError> {
        if now.vertices.len() != self.rest.vertices.len() {
            return Err(MeasureError::TruthChanged {
                expected: self.rest.vertices.len(),
                found: now.vertices.len(),
            });
        }
        if model.ids().iter().all(|id| self.anchors.contains_key(id)) {
            return Ok(());
        }
        let surface = Surface::new(&now.vertices, &self.rest.triangles)?;
        for (id, live) in model.ids().iter().zip(model.live()) {
            self.anchors.entry(*id).or_insert_with(|| {
                let nearest = surface.nearest(live);
                Anchor {
                    triangle: nearest.triangle,
                    weights: nearest.weights,
                }
            });
        }
        Ok(())
    }

    /// Distance of each vertex's live position from its material point, metres.
    pub fn live_errors(&self, model: &CanonicalModel, now: &TrueSurface) -> Vec<f64> {
        model
            .ids()
            .iter()
            .zip(model.live())
            .map(|(id, live)| {
                self.corners(*id, now).map_or(0.0, |(corners, weights)| {
                    (place(&corners, weights) - live).norm()
                })
            })
            .collect()
    }

    /// Mean of [`Self::live_errors`] over the vertices that `seen` does not mark; `None` when all are seen.
    pub fn prediction_error(
        &self,
        model: &CanonicalModel,
        seen: &[bool],
        now: &TrueSurface,
    ) -> Option<f64> {
        let errors = self.live_errors(model, now);
        mean(
            errors
                .iter()
                .zip(seen)
                .filter(|(_, s)| !**s)
                .map(|(e, _)| *e),
        )
    }

    /// Mean tangential error of the vertices that `seen` marks, metres; `None` when none is.
    pub fn slide(&self, model: &CanonicalModel, seen: &[bool], now: &TrueSurface) -> Option<f64> {
        let tangential = |(id, live): (&u64, &Point3<f64>)| {
            let (corners, weights) = self.corners(*id, now)?;
            let error = place(&corners, weights) - live;
            let [a, b, c] = corners;
            let normal = (b - a).cross(&(c - a)).try_normalize(1e-300)?;
            Some((error - normal * normal.dot(&error)).norm())
        };
        mean(
            model
                .ids()
                .iter()
                .zip(model.live())
                .zip(seen)
                .filter(|(_, s)| **s)
                .filter_map(|(vertex, _)| tangential(vertex)),
        )
    }

    /// The present corners of the triangle a vertex is anchored to, and its coordinates in it.
    fn corners(&self, id: u64, now: &TrueSurface) -> Option<([Point3<f64>; 3], [f64; 3])> {
        let anchor = self.anchors.get(&id)?;
        let [a, b, c] = self.rest.triangles[anchor.triangle as usize]
            .map(|i| now.vertices.get(i as usize).copied());
        Some(([a?, b?, c?], anchor.weights))
    }
}

fn place(corners: &[Point3<f64>; 3], weights: [f64; 3]) -> Point3<f64> {
    let sum: Vector3<f64> = corners
        .iter()
        .zip(weights)
        .map(|(corner, weight)| corner.coords * weight)
        .sum();
    Point3::from(sum)
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let mut mean = Mean::default();
    for value in values {
        mean.add(Some(value));
    }
    mean.get()
}
