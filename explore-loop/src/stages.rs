//! The stages that the loop calls, as traits, with ours as default.
//!
//! ```text
//! cloud ─► Register ─► Track ─► Grow ─► (closure, topology) ─► Plan ─► arms
//! ```
//! A custom pipeline swaps one stage: implement its trait and hand it to
//! [`Reconstructor::with_stages`](crate::reconstruct::Reconstructor::with_stages) or
//! [`Explorer::with_reconstructor`](crate::explore::Explorer::with_reconstructor).

use crate::Error;
use crate::canonical::merge::{FrameCloud, MergeOptions, extension, nearest_rotation};
use crate::canonical::{CanonicalModel, NewVertex};
use crate::cell::Plane;
use nalgebra::{Point3, Rotation3, UnitVector3, Vector3};

/// A point whose motion between two frames is known: a grip, by the arm's kinematics.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Landmark {
    /// Where it was, camera frame.
    pub source: Point3<f64>,
    /// Where it is.
    pub target: Point3<f64>,
    /// Standard deviation, metres; 0 is exact.
    pub sigma: f64,
}

/// What registration is given: the visible part of the live model, and the new cloud.
#[derive(Debug, Clone, Copy)]
pub struct RegisterInput<'a> {
    /// Visible live points of the model.
    pub source: &'a [Point3<f64>],
    /// Their normals.
    pub source_normals: &'a [UnitVector3<f64>],
    /// The new cloud.
    pub target: &'a [Point3<f64>],
    /// Its normals.
    pub target_normals: &'a [UnitVector3<f64>],
    /// Known motions.
    pub landmarks: &'a [Landmark],
    /// Where each source point is expected to move.
    pub initial: &'a [Vector3<f64>],
}

/// What registration answers.
#[derive(Debug, Clone, PartialEq)]
pub struct RegisterOutput {
    /// Displacement of each source point, metres.
    pub displacements: Vec<Vector3<f64>>,
    /// How far each is to be trusted, 0 to 1.
    pub confidence: Vec<f64>,
    /// Root mean square distance along the normals, metres.
    pub residual: f64,
    /// Share of the source points that found a partner.
    pub overlap: f64,
    /// Why the result must not be used, if so.
    pub failure: Option<String>,
}

impl RegisterOutput {
    /// No motion, and nobody may trust it.
    pub fn failed(reason: String, points: usize) -> Self {
        Self {
            displacements: vec![Vector3::zeros(); points],
            confidence: vec![0.0; points],
            residual: 0.0,
            overlap: 0.0,
            failure: Some(reason),
        }
    }
}

/// Brings the visible model onto the new cloud.
pub trait Register {
    /// Registers one frame.
    ///
    /// # Errors
    /// Input the method cannot take. A poor result is not an error but a [`RegisterOutput::failure`].
    fn register(&mut self, input: &RegisterInput<'_>) -> Result<RegisterOutput, Error>;
}

/// A measured vertex.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measured {
    /// Index in the model.
    pub vertex: u32,
    /// Where it was measured.
    pub position: Point3<f64>,
    /// Standard deviation, metres.
    pub sigma: f64,
}

/// Follows every vertex, seen or not.
pub trait Track {
    /// Moves `model.live` and `model.rotations` to the new frame.
    ///
    /// # Errors
    /// Measurements that cannot be used; the model stays as it was.
    fn step(
        &mut self,
        model: &mut CanonicalModel,
        measured: &[Measured],
        table: &Plane,
    ) -> Result<(), Error>;

    /// The model's vertices, rest positions or edges changed: `came_from[i]` is the index vertex `i` had.
    ///
    /// # Errors
    /// A model that is not consistent.
    fn rebuild(&mut self, model: &CanonicalModel, came_from: &[Option<u32>]) -> Result<(), Error>;
}

/// Finds the points of a frame that extend the model.
pub trait Grow {
    /// New vertices; `measured[i]` marks the vertices of the model that this frame measured.
    ///
    /// # Errors
    /// The rest positions cannot be computed.
    fn grow(
        &mut self,
        model: &CanonicalModel,
        frame: FrameCloud<'_>,
        measured: &[bool],
    ) -> Result<Vec<NewVertex>, Error>;
}

/// Weight of the last frame's motion in registration: a grip that starts to pull must not carry the whole surface along.
const PREDICTION: f64 = 0.05;

/// What the loop registers is a model of 5 mm, not a cloud of 2 mm. Its vertices stand off the surface by what tracking has left, and averaging
/// that away would keep them there ([`nonrigid_reg::Options::denoise`] 0); and what the grips hold is where the filter believes it,
/// not exactly where it is. With the defaults of single pairs two of five seeds of the liver lost track of the turning body.
const ITERATIONS: usize = 8;
const TOLERANCE: f64 = 2e-4;
const BENDING: f64 = 1.2;
const STRAIN: f64 = 0.025;
const GRIP_WEIGHT: f64 = 1e4;
const RIM_WEIGHT: f64 = 0.1;

/// [`Register`] by `nonrigid-reg`.
pub struct NonrigidRegister {
    registrar: nonrigid_reg::Registrar,
}

impl NonrigidRegister {
    /// With the node spacing and thresholds that suit a model of this spacing.
    ///
    /// # Errors
    /// A spacing the registration refuses.
    pub fn new(spacing: f64) -> Result<Self, Error> {
        let options = nonrigid_reg::Options {
            node_spacing: (2.8 * spacing).max(0.008),
            prediction: PREDICTION,
            iterations: ITERATIONS,
            tolerance: TOLERANCE,
            bending: BENDING,
            strain: STRAIN,
            landmark_weight: GRIP_WEIGHT,
            boundary_weight: RIM_WEIGHT,
            denoise: 0,
            ..Default::default()
        };
        Ok(Self {
            registrar: nonrigid_reg::Registrar::new(options),
        })
    }
}

impl Register for NonrigidRegister {
    fn register(&mut self, input: &RegisterInput<'_>) -> Result<RegisterOutput, Error> {
        let points = input.source.len();
        let source = nonrigid_reg::Cloud {
            points: input.source,
            normals: input.source_normals,
        };
        let target = nonrigid_reg::Cloud {
            points: input.target,
            normals: input.target_normals,
        };
        let landmarks: Vec<nonrigid_reg::Landmark> = input
            .landmarks
            .iter()
            .map(|l| nonrigid_reg::Landmark {
                source: l.source,
                target: l.target,
                sigma: l.sigma,
            })
            .collect();
        let answer =
            self.registrar
                .register(&source, &target, &landmarks, &[], Some(input.initial));
        let result = match answer {
            Ok(result) => result,
            // A model so far off that its grips contradict each other is one bad frame, not the end.
            Err(
                refusal @ (nonrigid_reg::Error::ContradictoryLandmarks { .. }
                | nonrigid_reg::Error::TooFewPoints { .. }),
            ) => return Ok(RegisterOutput::failed(refusal.to_string(), points)),
            Err(error) => return Err(error.into()),
        };
        let failure = match result.status {
            nonrigid_reg::Status::Converged | nonrigid_reg::Status::MaxIterations => None,
            other => Some(format!("{other:?}")),
        };
        Ok(RegisterOutput {
            displacements: result.displacements,
            confidence: result.confidence,
            residual: result.residuals.rms,
            overlap: result.overlap,
            failure,
        })
    }
}

/// [`Track`] by `topo-ekf`.
pub struct FilterTrack {
    filter: Option<topo_ekf::Filter>,
    options: topo_ekf::Options,
}

/// How far an edge may leave its shape at rest, metres: a body of 10 kPa stretches by some percent under its own weight, and a
/// stiffer memory would not let it; with a softer one hidden vertices follow the last error of the seen ones.
const EDGE_SIGMA: f64 = 1.5e-3;
/// What was measured of a vertex is as good as forgotten once it is hidden, metres a frame: registration slides it by millimetres before it
/// goes, and its shape memory knows better. With 3 mm a frame (and edges of 3 mm) seeds 1 and 3 of the liver did not close.
const PROCESS_NOISE: f64 = 0.1;

impl Default for FilterTrack {
    /// With the settings measured best for models of soft bodies.
    fn default() -> Self {
        let options = topo_ekf::Options::default()
            .with_edge_sigma(EDGE_SIGMA)
            .with_process_noise(PROCESS_NOISE);
        Self::new(options)
    }
}

impl FilterTrack {
    /// With the filter's options.
    pub fn new(options: topo_ekf::Options) -> Self {
        Self {
            filter: None,
            options,
        }
    }
}

fn rotations(model: &CanonicalModel) -> Vec<Rotation3<f64>> {
    model
        .rotations
        .iter()
        .map(|r| Rotation3::from_matrix_unchecked(nearest_rotation(r)))
        .collect()
}

impl Track for FilterTrack {
    fn step(
        &mut self,
        model: &mut CanonicalModel,
        measured: &[Measured],
        table: &Plane,
    ) -> Result<(), Error> {
        let Some(filter) = self.filter.as_mut() else {
            return Ok(());
        };
        let observations: Vec<topo_ekf::Observation> = measured
            .iter()
            .map(|m| topo_ekf::Observation {
                vertex: m.vertex,
                position: m.position,
                sigma: m.sigma,
            })
            .collect();
        let planes = [topo_ekf::Plane {
            normal: table.normal,
            offset: table.offset,
        }];
        filter.step(&topo_ekf::Frame::new(&observations).with_planes(&planes))?;
        model.live.copy_from_slice(filter.live());
        for (own, turned) in model.rotations.iter_mut().zip(filter.rotations()) {
            *own = *turned.matrix();
        }
        Ok(())
    }

    fn rebuild(&mut self, model: &CanonicalModel, came_from: &[Option<u32>]) -> Result<(), Error> {
        let turns = rotations(model);
        if self.filter.is_none() {
            self.filter = Some(topo_ekf::Filter::new(
                &model.rest,
                &model.edges,
                &self.options,
            )?);
            return Ok(());
        }
        if let Some(filter) = self.filter.as_mut() {
            filter.set_graph(
                &model.rest,
                &model.live,
                Some(&turns),
                &model.edges,
                came_from,
            )?;
        }
        Ok(())
    }
}

/// [`Grow`] by the inverse field of `gpwrm`.
pub struct FieldGrow {
    options: MergeOptions,
}

impl FieldGrow {
    /// With the defaults at a spacing.
    pub fn new(spacing: f64) -> Self {
        Self {
            options: MergeOptions::new(spacing),
        }
    }
}

impl Grow for FieldGrow {
    fn grow(
        &mut self,
        model: &CanonicalModel,
        frame: FrameCloud<'_>,
        measured: &[bool],
    ) -> Result<Vec<NewVertex>, Error> {
        Ok(extension(model, frame, measured, &self.options)?)
    }
}
