//! The interface between the loop and a reconstruction.

use super::{FrameReport, Reconstructor};
use crate::Error;
use crate::canonical::CanonicalModel;
use crate::cell::{Observation, Plane};
use crate::visibility::visible;
use nalgebra::{Isometry3, Point3, UnitVector3};

/// A triangle mesh at rest: vertices in metres with outward normals, counter-clockwise seen from outside.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RestSurface {
    /// Vertices, m.
    pub vertices: Vec<Point3<f64>>,
    /// Outward normal of each vertex.
    pub normals: Vec<UnitVector3<f64>>,
    /// Triangles, as indices of vertices.
    pub triangles: Vec<[u32; 3]>,
}

/// Builds the canonical model from frames, for [`Explorer`](crate::explore::Explorer). [`Reconstructor`] is the default; the example
/// `custom_pipeline` has another one.
///
/// Everything is in the camera frame, in metres.
pub trait Reconstruct {
    /// Processes one frame. An unusable frame is no error: [`FrameReport::failure`] gives the reason, and the model is unchanged.
    ///
    /// # Errors
    /// Input from which later frames cannot recover: the exploration ends.
    fn process(&mut self, observation: &Observation, table: &Plane) -> Result<FrameReport, Error>;

    /// The model so far; empty before anything was seen.
    fn model(&self) -> &CanonicalModel;

    /// The surface at rest, if this reconstruction extracts one itself; with `None` (the default) it is computed through the points of the model.
    fn surface(&self) -> Option<RestSurface> {
        None
    }

    /// Updates the model before a decision is based on it. Nothing by default.
    fn consolidate(&mut self, _table: &Plane) {}

    /// Called before parts that touch in the model are pulled apart, because they may be separate. Nothing by default.
    fn divide(&mut self) {}

    /// Whether the camera sees each vertex of the model now; `spacing` is that of the model, metres. By default: it faces the camera, and
    /// the cloud passes within two spacings of it.
    fn visible_now(&self, observation: &Observation, spacing: f64) -> Vec<bool> {
        visible(self.model(), observation, spacing)
    }

    /// Standard deviation of the present position of every vertex of the model, metres, infinite where unknown; `None` (the default) if it is
    /// not estimated.
    fn uncertainty(&self) -> Option<Vec<f64>> {
        None
    }

    /// Stiffness over weight `E / (ρ g)` of the object, metres, if it is estimated.
    fn stiffness_over_weight(&self) -> Option<f64> {
        None
    }

    /// Moves the deformed body by a rigid motion of the camera frame, after it was lost and found again. Nothing by default.
    fn relocate(&mut self, _found_from_lost: &Isometry3<f64>) {}

    /// The complete state, for a checkpoint; `None` (the default) if this reconstruction cannot be resumed.
    fn save(&self) -> Option<Vec<u8>> {
        None
    }

    /// Restores the state from [`Self::save`], to the bit.
    ///
    /// # Errors
    /// [`Error::Resume`]: the bytes are not from this reconstruction, which is then unchanged.
    fn restore(&mut self, _saved: &[u8]) -> Result<(), Error> {
        Err(Error::Resume {
            reason: "this reconstruction cannot be resumed".into(),
        })
    }
}

/// For reconstructions chosen at run time.
impl<R: Reconstruct + ?Sized> Reconstruct for Box<R> {
    fn process(&mut self, observation: &Observation, table: &Plane) -> Result<FrameReport, Error> {
        (**self).process(observation, table)
    }

    fn model(&self) -> &CanonicalModel {
        (**self).model()
    }

    fn surface(&self) -> Option<RestSurface> {
        (**self).surface()
    }

    fn consolidate(&mut self, table: &Plane) {
        (**self).consolidate(table);
    }

    fn divide(&mut self) {
        (**self).divide();
    }

    fn visible_now(&self, observation: &Observation, spacing: f64) -> Vec<bool> {
        (**self).visible_now(observation, spacing)
    }

    fn uncertainty(&self) -> Option<Vec<f64>> {
        (**self).uncertainty()
    }

    fn stiffness_over_weight(&self) -> Option<f64> {
        (**self).stiffness_over_weight()
    }

    fn relocate(&mut self, found_from_lost: &Isometry3<f64>) {
        (**self).relocate(found_from_lost);
    }

    fn save(&self) -> Option<Vec<u8>> {
        (**self).save()
    }

    fn restore(&mut self, saved: &[u8]) -> Result<(), Error> {
        (**self).restore(saved)
    }
}

impl Reconstruct for Reconstructor {
    fn process(&mut self, observation: &Observation, table: &Plane) -> Result<FrameReport, Error> {
        Self::process(self, observation, table)
    }

    fn model(&self) -> &CanonicalModel {
        Self::model(self)
    }

    fn consolidate(&mut self, table: &Plane) {
        Self::consolidate(self, table);
    }

    fn divide(&mut self) {
        Self::divide(self);
    }

    fn uncertainty(&self) -> Option<Vec<f64>> {
        Self::uncertainty(self)
    }

    fn stiffness_over_weight(&self) -> Option<f64> {
        Self::stiffness_over_weight(self)
    }

    fn relocate(&mut self, found_from_lost: &Isometry3<f64>) {
        Self::relocate(self, found_from_lost);
    }

    fn save(&self) -> Option<Vec<u8>> {
        postcard::to_allocvec(self).ok()
    }

    fn restore(&mut self, saved: &[u8]) -> Result<(), Error> {
        let read: Self = postcard::from_bytes(saved).map_err(|error| Error::Resume {
            reason: format!("the state of the reconstruction cannot be read: {error}"),
        })?;
        read.check_read()?;
        *self = read;
        Ok(())
    }
}
