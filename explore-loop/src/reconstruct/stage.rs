//! The seam between the loop and a reconstruction.

use super::{FrameReport, Reconstructor};
use crate::Error;
use crate::canonical::CanonicalModel;
use crate::cell::{Observation, Plane};
use crate::visibility::visible;
use nalgebra::{Isometry3, Point3, UnitVector3};

/// A surface at rest as triangles: vertices in metres with outward normals, counter-clockwise seen from outside.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RestSurface {
    /// Vertices, m.
    pub vertices: Vec<Point3<f64>>,
    /// Outward normal of each vertex.
    pub normals: Vec<UnitVector3<f64>>,
    /// Triangles, by index of vertices.
    pub triangles: Vec<[u32; 3]>,
}

/// Builds the canonical model from frames: what [`Explorer`](crate::explore::Explorer) drives. [`Reconstructor`] is the default, the example
/// `custom_pipeline` another one.
///
/// Everything is in the camera frame, in metres.
pub trait Reconstruct {
    /// Takes one frame. A frame that cannot be used is no error: [`FrameReport::failure`] says why, and the model stays as it was.
    ///
    /// # Errors
    /// Input that no later frame can mend: the exploration ends.
    fn process(&mut self, observation: &Observation, table: &Plane) -> Result<FrameReport, Error>;

    /// The model so far; empty before anything was seen.
    fn model(&self) -> &CanonicalModel;

    /// The surface at rest as this reconstruction itself draws it; `None` (the default) if it is to be drawn through the points of the model.
    fn surface(&self) -> Option<RestSurface> {
        None
    }

    /// Brings the model up to date before a decision is made on it. Nothing by default.
    fn consolidate(&mut self, _table: &Plane) {}

    /// For every vertex of the model, whether the camera sees it now; `spacing` is that of the model, metres. By default: it faces
    /// the camera, and the cloud passes within two spacings of it.
    fn visible_now(&self, observation: &Observation, spacing: f64) -> Vec<bool> {
        visible(self.model(), observation, spacing)
    }

    /// Standard deviation of the place of every vertex of the model now, metres, infinite where nothing is known of it; `None` (the default) if it is
    /// not estimated.
    fn uncertainty(&self) -> Option<Vec<f64>> {
        None
    }

    /// Stiffness over weight `E / (ρ g)` of the object, metres, if it is estimated.
    fn stiffness_over_weight(&self) -> Option<f64> {
        None
    }

    /// Carries the body, as it is bent now, by a rigid motion of the camera frame: it was lost, and found again there. Nothing by default.
    fn relocate(&mut self, _found_from_lost: &Isometry3<f64>) {}

    /// Everything that is known, to be written to a checkpoint; `None` (the default) if this reconstruction cannot be resumed.
    fn save(&self) -> Option<Vec<u8>> {
        None
    }

    /// Goes on from what [`Self::save`] gave, to the bit.
    ///
    /// # Errors
    /// [`Error::Resume`]: the bytes are none of this reconstruction; it is then as before.
    fn restore(&mut self, _saved: &[u8]) -> Result<(), Error> {
        Err(Error::Resume {
            reason: "this reconstruction cannot be resumed".into(),
        })
    }
}

/// What is chosen at run time.
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
