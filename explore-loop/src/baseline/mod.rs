//! The baseline: fusion into a canonical volume through a warp field, as in DynamicFusion.
//!
//! ```text
//! depth map ─► warp of the canonical surface onto it ─► fusion into the canonical volume through the warp ─► nodes on new surface
//! ```
//! R. A. Newcombe, D. Fox, S. M. Seitz, *DynamicFusion: Reconstruction and Tracking of Non-rigid Scenes in Real-Time*, CVPR 2015. The canonical
//! model is a truncated signed distance volume; the warp field is made of sparse nodes blended as dual quaternions and is regularised
//! as rigidly as possible over a hierarchy of nodes. The baseline knows nothing of a table, weight, material or
//! topology, nor of arms unless [`DynamicFusionOptions::grip_radius`] is set.
//!
//! | file | step | section of the paper |
//! |---|---|---|
//! | `depth` | the depth map of a cloud | (that paper has a depth camera) |
//! | `warp` | nodes, weights, dual-quaternion blending, hierarchy, new nodes | 3.1, 3.3.2, 3.4 |
//! | `tsdf` | the volume: fusion through the warp, its surface | 3.2 |
//! | `solve`, `equations` | data term, rigidity, Gauss–Newton, sparse Cholesky | 3.3 |
//! | `vertices` | points of the surface that keep their identity | (ours, to measure with) |
//!
//! # Differences from that paper
//! - The input is a point cloud instead of a depth image; `depth` converts it. Triangulating the points keeps the signed distance projective, along
//!   the ray, as in that paper; the distance to the nearest point would be wrong by the gaps between points 5 mm apart.
//! - The Jacobian of the blend is exact, and the normal equations are solved as a whole, not block by block.
//! - The scale of Tukey's penalty shrinks over the iterations: objects move by up to 8 mm between frames here.
//! - Residuals are taken at the vertices of the canonical surface in view, not at the pixels of its rendering. λ is therefore weighed against about a
//!   thousand residuals, and its value cannot be compared with that of the other paper; λ and the scales of both penalties are the best of those tried
//!   (README of the workspace).
//! - A fused distance is weighted by the cosine between surface and ray, and less far from the nodes. That paper weights it by the mean distance of the nodes.
//! - Every node of the hierarchy is an unknown, and an edge penalises the disagreement about the positions of both its ends. All edges have the same
//!   weight, whereas that paper weights each edge by the larger radius of its two nodes.
//! - Pieces of surface with less than a tenth of the triangles of the largest piece are dropped: surface that is fused out of place breaks off.
//! # Limits
//! The defaults suit objects that are turned over: the field is stiff enough not to fold. Bending that is too strong for such a field is followed late:
//! `tests/baseline.rs` has the figures for the defaults and for a softer field.

pub(crate) mod depth;
mod equations;
mod options;
mod solve;
mod tsdf;
mod vertices;
mod warp;

pub use options::{Association, DynamicFusionOptions};

use crate::Error;
use crate::canonical::CanonicalModel;
use crate::cell::{ArmState, Observation, Plane};
use crate::reconstruct::{FrameReport, Reconstruct, RestSurface};
use depth::DepthMap;
use nalgebra::{Isometry3, Point3};
use solve::{Frame, Held};
use std::time::Instant;
use tsdf::Volume;
use warp::Warp;

/// Margin around the first view for surface that appears later, as a share of its longest side.
const ROOM: f64 = 0.7;
/// A vertex within this distance of the observed surface, along the ray, counts as measured, m.
const SEEN: f64 = 0.0025;
/// Most voxels of the volume; a larger volume gets larger voxels.
const MOST_VOXELS: f64 = 2e7;

/// Builds the canonical model as DynamicFusion does.
pub struct DynamicFusion {
    options: DynamicFusionOptions,
    model: CanonicalModel,
    scene: Option<Scene>,
    grips: Vec<Option<Grip>>,
    frame: u32,
}

/// The state after the first frame.
struct Scene {
    volume: Volume,
    warp: Warp,
    surface: RestSurface,
}

/// What a jaw grips: points at rest, and their positions in the frame of the tip.
struct Grip {
    points: Vec<(Point3<f64>, Point3<f64>)>,
}

impl std::fmt::Debug for DynamicFusion {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("DynamicFusion")
            .field("options", &self.options)
            .field("frame", &self.frame)
            .field("vertices", &self.model.len())
            .finish_non_exhaustive()
    }
}

impl DynamicFusion {
    /// Starts with an empty model.
    ///
    /// # Errors
    /// [`Error::BadSetting`]: a setting out of its range.
    pub fn new(options: DynamicFusionOptions) -> Result<Self, Error> {
        options.check()?;
        Ok(Self {
            options,
            model: CanonicalModel::default(),
            scene: None,
            grips: Vec::new(),
            frame: 0,
        })
    }

    /// Number of nodes of the warp field that blend.
    pub fn nodes(&self) -> usize {
        self.scene.as_ref().map_or(0, |s| s.warp.nodes().len())
    }

    /// Where the warp field moves a point of the canonical frame; the identity before the first frame.
    pub fn warp(&self, place: &Point3<f64>) -> Point3<f64> {
        self.scene.as_ref().map_or(*place, |s| s.warp.apply(place))
    }

    /// The first frame: places the volume and the warp field around the observed surface.
    fn begin(&self, depth: &DepthMap, cloud: &[Point3<f64>]) -> Option<Scene> {
        let options = &self.options;
        let usable: Vec<Point3<f64>> = cloud
            .iter()
            .filter(|p| p.coords.iter().all(|x| x.is_finite()))
            .copied()
            .collect();
        let [low, high] = tsdf::around(&usable, 0.0)?;
        let [low, high] = tsdf::around(&[low, high], ROOM * (high - low).amax())?;
        let voxel = options
            .voxel
            .max(((high - low).product() / MOST_VOXELS).cbrt());
        let mut volume = Volume::new(&low, &high, voxel, options.truncation, options.weight);
        // The first view alone must give a surface, even where it is seen at a slant, so it is integrated often enough for a voxel to count.
        for _ in 0..(2.0 * options.weight[0]).ceil().clamp(1.0, 100.0) as usize {
            volume.integrate_still(depth);
        }
        let influence = options.influence * options.nodes;
        let warp = Warp::new(options.nodes, influence, options.levels, options.coarsening);
        let surface = volume.surface();
        let mut scene = Scene {
            volume,
            warp,
            surface,
        };
        scene.insert_nodes(options);
        Some(scene)
    }

    /// Every later frame.
    fn follow(&mut self, scene: &mut Scene, depth: &DepthMap, arms: &[ArmState]) {
        let held = self.held(&scene.warp, arms);
        let frame = Frame {
            depth,
            held: &held,
            options: &self.options,
        };
        let points =
            vertices::skinned(&scene.surface.vertices, &scene.surface.normals, &scene.warp);
        frame.solve(&mut scene.warp, &points);
    }

    /// Fuses the frame through the warp, and adds nodes on new surface.
    fn fuse(&self, scene: &mut Scene, depth: &DepthMap) {
        let reach = self.options.reach * self.options.nodes;
        scene.volume.integrate(depth, &scene.warp, reach);
        scene.surface = scene.volume.surface();
        scene.insert_nodes(&self.options);
    }

    /// Updates the vertices of the model and reports which of them the frame measured.
    fn report(&mut self, scene: &Scene, depth: &DepthMap, report: &mut FrameReport) {
        let spacing = self.options.spacing;
        let before = self.model.live().to_vec();
        let count = self.model.len();
        report.added =
            vertices::follow_surface(&mut self.model, &scene.surface, spacing, self.frame);
        vertices::pose(&mut self.model, &scene.warp);
        if report.added > 0 || self.model.len() != count {
            self.model.join(spacing);
        } else {
            let moved = before
                .iter()
                .zip(self.model.live())
                .map(|(a, b)| (b - a).norm());
            report.moved = moved.sum::<f64>() / count.max(1) as f64;
        }
        let frame = Frame {
            depth,
            held: &[],
            options: &self.options,
        };
        let points = vertices::skinned(self.model.rest(), self.model.rest_normals(), &scene.warp);
        let pairs = frame.associate(&scene.warp, &points, self.options.tukey[1]);
        report.measured = vec![false; self.model.len()];
        for pair in &pairs {
            report.measured[pair.point] = pair.residual().abs() < SEEN;
            report.residual += pair.residual().abs() / pairs.len() as f64;
        }
        let seen = report.measured.iter().filter(|m| **m).count();
        report.overlap = seen as f64 / pairs.len().max(1) as f64;
        self.model.measured(&report.measured, self.frame);
    }

    /// The gripped points and where the arms have moved them.
    fn held(&self, warp: &Warp, arms: &[ArmState]) -> Vec<Held> {
        let mut held = Vec::new();
        for (grip, arm) in self.grips.iter().zip(arms) {
            for (rest, in_tip) in grip.iter().flat_map(|g| &g.points).filter(|_| arm.holding) {
                held.extend(warp.skin(rest).map(|skin| Held {
                    rest: *rest,
                    skin,
                    target: arm.camera_from_tip * in_tip,
                }));
            }
        }
        held
    }

    /// Records what newly closed jaws grip, and forgets what opened jaws have released.
    fn take_grips(&mut self, arms: &[ArmState]) {
        let radius = self.options.grip_radius;
        self.grips.resize_with(arms.len(), || None);
        for (grip, arm) in self.grips.iter_mut().zip(arms) {
            if !arm.holding || radius <= 0.0 {
                *grip = None;
            } else if grip.is_none() {
                let tip_from_camera: Isometry3<f64> = arm.camera_from_tip.inverse();
                let live = self.model.rest().iter().zip(self.model.live());
                let in_tip = live.map(|(rest, live)| (*rest, tip_from_camera * live));
                *grip = Some(Grip {
                    points: in_tip.filter(|(_, p)| p.coords.norm() < radius).collect(),
                });
            }
        }
    }
}

impl Scene {
    fn insert_nodes(&mut self, options: &DynamicFusionOptions) {
        let fresh = self.warp.support(&self.surface.vertices);
        self.volume
            .reach(&fresh, &self.warp, options.reach * options.nodes);
    }
}

impl Reconstruct for DynamicFusion {
    fn process(&mut self, observation: &Observation, _: &Plane) -> Result<FrameReport, Error> {
        if observation.camera.is_some() {
            return Err(Error::CameraMoves {
                reconstruction: "the DynamicFusion-style reconstruction",
            });
        }
        let start = Instant::now();
        let mut report = FrameReport {
            frame: self.frame,
            measured: vec![false; self.model.len()],
            ..FrameReport::default()
        };
        if let Some(depth) = DepthMap::new(&observation.points)? {
            let registration = Instant::now();
            let scene = match self.scene.take() {
                None => self.begin(&depth, &observation.points),
                Some(mut scene) => {
                    self.follow(&mut scene, &depth, &observation.arms);
                    report.registration_ms = registration.elapsed().as_secs_f64() * 1e3;
                    self.fuse(&mut scene, &depth);
                    Some(scene)
                }
            };
            if let Some(scene) = scene {
                self.report(&scene, &depth, &mut report);
                self.scene = Some(scene);
            }
            self.take_grips(&observation.arms);
        } else {
            let points = observation.points.len();
            report.failure = Some(format!("no surface through {points} points"));
        }
        self.frame += 1;
        report.frame_ms = start.elapsed().as_secs_f64() * 1e3;
        Ok(report)
    }

    fn model(&self) -> &CanonicalModel {
        &self.model
    }

    fn surface(&self) -> Option<RestSurface> {
        self.scene.as_ref().map(|s| s.surface.clone())
    }
}
