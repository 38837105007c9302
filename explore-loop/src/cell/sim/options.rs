//! Options of a simulated cell, with their defaults.

use derive_setters::Setters;
use nalgebra::Point3;

use super::realsense::StereoOptions;
use super::sway::Sway;
use super::{Scene, SimError};

/// The material of the object.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct Material {
    /// Young's modulus, Pa. At 1000 kg/m³ and 0.2 m, 3 kPa is very soft and 30 kPa like a thick woollen cap.
    pub young: f64,
    /// Poisson's ratio, at least 0 and below 0.5.
    pub poisson: f64,
    /// Density, kg/m³.
    pub density: f64,
    /// Coefficient of Coulomb friction, with the table and with itself.
    pub friction: f64,
    /// Rate at which air drag damps motion, 1/s.
    pub damping: f64,
}

impl Default for Material {
    fn default() -> Self {
        Self {
            young: 10_000.0,
            poisson: 0.3,
            density: 1000.0,
            friction: 0.7,
            damping: 1.0,
        }
    }
}

impl Material {
    fn check(&self) -> Result<(), SimError> {
        within("young", self.young, 100.0, 1e7, "100 Pa to 10 MPa")?;
        within("poisson", self.poisson, 0.0, 0.49, "0 to 0.49")?;
        let range = "10 kg/m³ to 20000 kg/m³";
        within("density", self.density, 10.0, 20_000.0, range)?;
        within("friction", self.friction, 0.0, 5.0, "0 to 5")?;
        within("damping", self.damping, 0.0, 100.0, "0 to 100 per second")
    }
}

/// A pinhole depth camera above the centre of the table: fixed and looking straight down, or swinging about it.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct CameraOptions {
    /// Width of the image, pixels.
    pub width: usize,
    /// Height of the image, pixels.
    pub height: usize,
    /// Focal length, pixels.
    pub focal: f64,
    /// Height above the table, metres.
    pub above_table: f64,
    /// Frames a second.
    pub rate: f64,
    /// Standard deviation of the depth noise along the ray of an ideal camera, metres.
    pub noise: f64,
    /// Casts one ray for every `pixel_stride` pixels in each direction, if the object is not searched for in images.
    pub pixel_stride: usize,
    /// How the camera swings; `None` if it does not.
    pub sway: Option<Sway>,
    /// The errors of its images, and how the object is found in them.
    pub model: CameraModel,
    /// Number of colour pixels for each depth pixel in each direction, if the camera has colour images in which features are found.
    /// Default: none.
    pub features: Option<usize>,
}

/// The error model of a camera.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
pub enum CameraModel {
    /// Independent Gaussian noise; frames come on request, and table, arms and other bodies are removed without errors.
    #[default]
    Ideal,
    /// The errors of an active stereo camera; the object is segmented from its images as with a real one.
    Stereo(StereoOptions),
}

impl CameraOptions {
    /// The central part of the image of a D435 at 848 × 480: 0.55 m × 0.42 m of the table, a point every 1.3 mm.
    pub fn realsense() -> Self {
        Self {
            width: 424,
            height: 320,
            focal: 424.0,
            model: CameraModel::Stereo(StereoOptions::default()),
            ..Self::default()
        }
    }
}

impl Default for CameraOptions {
    /// Sees 0.55 m × 0.41 m of the table, a point every 1.7 mm.
    fn default() -> Self {
        Self {
            width: 320,
            height: 240,
            focal: 320.0,
            above_table: 0.55,
            rate: 10.0,
            noise: 0.0,
            pixel_stride: 1,
            sway: None,
            model: CameraModel::Ideal,
            features: None,
        }
    }
}

impl CameraOptions {
    fn check(&self) -> Result<(), SimError> {
        let (width, height) = (self.width as f64, self.height as f64);
        within("camera width", width, 16.0, 4096.0, "16 to 4096 pixels")?;
        within("camera height", height, 16.0, 4096.0, "16 to 4096 pixels")?;
        within("camera focal", self.focal, 1.0, 1e5, "1 to 100000 pixels")?;
        let above = self.above_table;
        within("camera above_table", above, 0.1, 5.0, "0.1 m to 5 m")?;
        within("camera rate", self.rate, 1.0, 200.0, "1 Hz to 200 Hz")?;
        within("camera noise", self.noise, 0.0, 0.1, "0 m to 0.1 m")?;
        let stride = self.pixel_stride as f64;
        within("camera pixel_stride", stride, 1.0, 64.0, "1 to 64")?;
        if let Some(scale) = self.features {
            within("camera features", scale as f64, 1.0, 4.0, "1 to 4 pixels")?;
        }
        if let Some(sway) = &self.sway {
            within("camera sway angle", sway.angle, 0.0, 0.8, "0 to 0.8 rad")?;
            within(
                "camera sway period",
                sway.period,
                1.0,
                1e6,
                "1 s to 1000000 s",
            )?;
        }
        match &self.model {
            CameraModel::Ideal => Ok(()),
            CameraModel::Stereo(stereo) => stereo.check(self.rate),
        }
    }
}

/// The box between the jaws, in the tip frame: what lies in it when the jaw closes is held.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct JawOptions {
    /// Half the width of a finger, along x, metres.
    pub half_width: f64,
    /// Half the distance between the open jaws, along y, metres.
    pub half_opening: f64,
    /// How far behind the tip the fingers reach, along −z, metres.
    pub behind: f64,
    /// How far in front of the tip the fingers reach, along z, metres.
    pub before: f64,
}

impl Default for JawOptions {
    fn default() -> Self {
        Self {
            half_width: 0.008,
            half_opening: 0.009,
            behind: 0.004,
            before: 0.010,
        }
    }
}

impl JawOptions {
    fn check(&self) -> Result<(), SimError> {
        for value in [self.half_width, self.half_opening, self.behind, self.before] {
            within("jaw", value, 0.0, 0.1, "0 m to 0.1 m")?;
        }
        Ok(())
    }
}

/// Resolution of the physics.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct Fidelity {
    /// Approximate number of tetrahedra.
    pub tetrahedra: usize,
    /// Longest time step, seconds; a whole number of steps makes a camera frame.
    pub step: f64,
    /// Solver substeps in each step.
    pub substeps: usize,
    /// Whether the object collides with itself.
    pub self_contact: bool,
}

impl Default for Fidelity {
    fn default() -> Self {
        Self {
            tetrahedra: 2000,
            step: 0.01,
            substeps: 4,
            self_contact: true,
        }
    }
}

impl Fidelity {
    fn check(&self) -> Result<(), SimError> {
        let tetrahedra = self.tetrahedra as f64;
        within("tetrahedra", tetrahedra, 100.0, 50_000.0, "100 to 50000")?;
        within("step", self.step, 0.0005, 0.05, "0.5 ms to 50 ms")?;
        within("substeps", self.substeps as f64, 1.0, 64.0, "1 to 64")
    }
}

/// The kinematics of the arms.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
pub enum ArmModel {
    /// Every pose within their reach is possible.
    #[default]
    Free,
    /// Joint limits of a patient-side manipulator (da Vinci S or Si, large needle driver).
    Psm,
}

/// A simulated cell.
#[derive(Debug, Clone, PartialEq, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct SimOptions {
    /// The scene on the table.
    pub scene: Scene,
    /// Number of arms, 2 or 3: from the right (+x), from the left (−x), from behind (−y in the camera frame).
    pub arms: usize,
    /// Their kinematics.
    pub arm_model: ArmModel,
    /// Determines the initial pose of the object and, with the frame number, the noise of each frame.
    pub seed: u64,
    /// A point on or next to the body to explore, camera frame, where there are several. Default: the main body of the scene, which is
    /// the largest.
    pub seed_point: Option<Point3<f64>>,
    /// The object's material.
    pub material: Material,
    /// The camera.
    pub camera: CameraOptions,
    /// The jaws of all arms.
    pub jaw: JawOptions,
    /// Resolution of the physics.
    pub fidelity: Fidelity,
    /// Largest speed of a tip, m/s.
    pub max_speed: f64,
}

impl SimOptions {
    /// Three arms around `scene` with its own material, and defaults for everything else.
    pub fn new(scene: Scene) -> Self {
        Self {
            arms: 3,
            arm_model: ArmModel::default(),
            seed: 0,
            seed_point: None,
            material: *scene.material(),
            scene,
            camera: CameraOptions::default(),
            jaw: JawOptions::default(),
            fidelity: Fidelity::default(),
            max_speed: 0.25,
        }
    }

    pub(super) fn check(&self) -> Result<(), SimError> {
        within("arms", self.arms as f64, 2.0, 3.0, "2 to 3")?;
        self.material.check()?;
        self.camera.check()?;
        for value in self.seed_point.iter().flat_map(|point| point.iter()) {
            within("seed point", *value, -10.0, 10.0, "-10 m to 10 m")?;
        }
        self.jaw.check()?;
        self.fidelity.check()?;
        let range = "0.001 m/s to 2 m/s";
        within("max_speed", self.max_speed, 0.001, 2.0, range)
    }
}

/// Rejects a value out of range.
pub(super) fn within(
    option: &'static str,
    value: f64,
    low: f64,
    high: f64,
    range: &'static str,
) -> Result<(), SimError> {
    if (low..=high).contains(&value) {
        Ok(())
    } else {
        Err(SimError::BadOption {
            option,
            value,
            range,
        })
    }
}
