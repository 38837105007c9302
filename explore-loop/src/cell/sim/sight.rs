//! The view of the camera: everything is rendered, and the points of the object are taken from the image.
//!
//! ```text
//! view at an instant ──► z-buffer ──┬─► pixels that show the object                    (an ideal camera with nothing else in view)
//!                                   └─► depth image ──► the object found in it         (a real camera, or other bodies in view)
//! ```

use dvrk_io::depth::{Capsule, DepthImage, Scan};
use dvrk_io::features::Feature;
use nalgebra::{Isometry3, Point3, Vector3};

use super::body::Body;
use super::camera::{DepthCamera, Thing, gripper};
use super::colour_image::ColourCamera;
use super::gripper::{Gripper, between};
use super::links::Links;
use super::mesh::TriangleMesh;
use super::options::{CameraModel, JawOptions, SimOptions};
use super::segment::{Seen, Segmenter, capsules};
use super::texture::Texture;
use crate::cell::{ArmState, CellError, Plane};

/// The colour of table, arms and other bodies.
const GREY: [u8; 3] = [128; 3];

/// The scene in front of the camera at an instant.
pub(super) struct View {
    /// Seconds.
    pub stamp: f64,
    /// Surface of the object, camera frame.
    pub surface: Vec<Point3<f64>>,
    pub arms: Vec<ArmState>,
    /// Distance of the fingers of each arm from its centre plane, metres.
    openings: Vec<f64>,
}

impl View {
    /// The scene at present.
    pub fn of(
        body: &Body,
        grippers: &[Gripper],
        jaw: &JawOptions,
        camera_from_world: &Isometry3<f64>,
        stamp: f64,
    ) -> Self {
        let surface = body.surface();
        Self {
            stamp,
            surface: surface.iter().map(|p| camera_from_world * p).collect(),
            arms: grippers.iter().map(Gripper::state).collect(),
            openings: grippers.iter().map(|g| g.finger_opening(jaw)).collect(),
        }
    }

    /// The scene interpolated at `share` of the way from this view to the next.
    pub fn toward(self, next: Self, share: f64) -> Self {
        let surface = self.surface.iter().zip(&next.surface);
        let arms = self.arms.into_iter().zip(next.arms);
        Self {
            surface: surface.map(|(a, b)| a + (b - a) * share).collect(),
            arms: arms
                .map(|(a, b)| ArmState {
                    camera_from_tip: between(&a.camera_from_tip, &b.camera_from_tip, share),
                    ..b
                })
                .collect(),
            ..next
        }
    }
}

/// The camera, and what is needed to render the object.
pub(super) struct Sight {
    camera: DepthCamera,
    colours: Option<ColourCamera>,
    seed: u64,
    /// Triangles of the object.
    triangles: Vec<[usize; 3]>,
    /// Colour of the object, as a function of positions in the scene's own frame.
    texture: Texture,
    own: Vec<Point3<f64>>,
    /// The body beside the object, camera frame.
    beside: Option<TriangleMesh>,
    /// Remote centres that the shafts of the arms pass through, camera frame; empty if they are straight behind their tips.
    remote_centres: Vec<Isometry3<f64>>,
    /// Segments the object from images, if this is necessary.
    segmenter: Option<Segmenter>,
    table: Plane,
    /// Pose of the camera relative to its rest pose; `None` if it does not move.
    camera_from_rest: Option<Isometry3<f64>>,
    /// Surface of the object as last rendered, in the frame of the camera.
    drawn: Vec<Point3<f64>>,
}

impl Sight {
    /// A view of an object with these triangles, whose vertices are at `own` in the scene's own frame.
    pub fn new(
        options: &SimOptions,
        table: &Plane,
        triangles: Vec<[usize; 3]>,
        own: Vec<Point3<f64>>,
        beside: Option<TriangleMesh>,
    ) -> Result<Self, dvrk_io::Error> {
        let scale = options.camera.features;
        let colours = scale.map(|scale| ColourCamera::new(&options.camera, scale));
        let ideal = options.camera.model == CameraModel::Ideal;
        let segmenter = (!ideal || beside.is_some())
            .then(|| Segmenter::new(&options.camera, table, options.seed_point));
        Ok(Self {
            camera: DepthCamera::new(options.camera),
            colours: colours.transpose()?,
            seed: options.seed,
            triangles,
            texture: Texture::of(options.scene.name(), options.seed),
            own,
            beside,
            remote_centres: Vec::new(),
            segmenter: segmenter.transpose()?,
            table: *table,
            camera_from_rest: None,
            drawn: Vec::new(),
        })
    }

    /// For arms whose shafts pass through these points.
    pub fn with_remote_centres(self, remote_centres: Vec<Isometry3<f64>>) -> Self {
        Self {
            remote_centres,
            ..self
        }
    }

    /// Sets the pose of the camera, relative to its rest pose.
    pub fn look_from(&mut self, rest_from_camera: &Isometry3<f64>) {
        let camera_from_rest = rest_from_camera.inverse();
        self.camera_from_rest = Some(camera_from_rest);
        if let Some(segmenter) = &mut self.segmenter {
            segmenter.look_from(&camera_from_rest, &self.table);
        }
    }

    /// A point in the frame of the camera.
    fn own_frame(&self, point: &Point3<f64>) -> Point3<f64> {
        self.camera_from_rest
            .map_or(*point, |camera| camera * point)
    }

    fn all_own(&self, points: &[Point3<f64>]) -> Vec<Point3<f64>> {
        points.iter().map(|p| self.own_frame(p)).collect()
    }

    /// The table in the frame of the camera.
    fn own_table(&self) -> Plane {
        self.camera_from_rest
            .map_or(self.table, |camera| self.table.carried(&camera))
    }

    /// The links of an arm behind its fingers.
    fn links(&self, arm: usize, camera_from_tip: &Isometry3<f64>) -> Links {
        match self.remote_centres.get(arm) {
            None => Links::straight(camera_from_tip),
            Some(centre) => Links::through(camera_from_tip, &centre.translation.vector.into()),
        }
    }

    /// The points of the object in a view, with the noise of frame `frame`, in the frame of the camera.
    pub fn see(&mut self, view: &View, frame: u64) -> Result<Seen, CellError> {
        self.draw(view);
        let arms = view.arms.iter().zip(&view.openings).enumerate();
        let tools: Vec<_> = arms
            .flat_map(|(k, (arm, opening))| {
                let pose = &arm.camera_from_tip;
                capsules(pose, *opening, &self.links(k, pose))
            })
            .map(|tool| Capsule {
                start: self.own_frame(&tool.start),
                end: self.own_frame(&tool.end),
                ..tool
            })
            .collect();
        let mut seen = self.points(&tools, frame)?;
        let features = self.features(&seen, &tools, frame);
        seen.features = features.map_err(|error| CellError::Failed(error.to_string()))?;
        Ok(seen)
    }

    /// The points of the object.
    fn points(&mut self, tools: &[Capsule], frame: u64) -> Result<Seen, CellError> {
        let colour = |pixel| self.colour(&self.camera, pixel);
        let Some(segmenter) = &self.segmenter else {
            return Ok(Seen {
                points: self.camera.points(self.seed, frame),
                colours: self.camera.object_pixels().map(colour).collect(),
                ..Seen::default()
            });
        };
        let image = self.camera.image(&self.own_table(), self.seed, frame);
        let seen = image.and_then(|image| segmenter.points(&image, tools, colour));
        let seen = seen.map_err(|error| CellError::Failed(error.to_string()))?;
        if let Some(segmenter) = &mut self.segmenter {
            segmenter.follow(&seen);
        }
        Ok(seen)
    }

    /// The depth image of a view, with the noise of frame `frame`, table and arms included.
    pub fn image(&mut self, view: &View, frame: u64) -> Result<DepthImage, CellError> {
        self.draw(view);
        let image = self.camera.image(&self.own_table(), self.seed, frame);
        image.map_err(|error| CellError::Failed(error.to_string()))
    }

    /// Features of the colour image on the object, if there is one.
    fn features(
        &self,
        seen: &Seen,
        tools: &[Capsule],
        frame: u64,
    ) -> Result<Option<Vec<Feature>>, dvrk_io::Error> {
        let Some(colours) = &self.colours else {
            return Ok(None);
        };
        let image = self.camera.image(&self.own_table(), self.seed, frame)?;
        let scan = Scan::from_image(&image, colours.intrinsics())?;
        let known: Vec<bool>;
        let of_object = if self.segmenter.is_some() && !seen.points.is_empty() {
            &seen.of_object
        } else {
            let shows = |at| self.camera.thing(at) == Thing::Object;
            known = (0..scan.points().len()).map(shows).collect();
            &known
        };
        let colour = |pixel| self.colour(&colours.camera, pixel);
        let own = [self.seed, frame];
        let features = colours.features(&scan, of_object, tools, colour, own)?;
        Ok(Some(features))
    }

    fn draw(&mut self, view: &View) {
        let arms: Vec<_> = view
            .arms
            .iter()
            .zip(&view.openings)
            .enumerate()
            .map(|(k, (arm, opening))| {
                let pose = &arm.camera_from_tip;
                gripper(pose, *opening, &self.links(k, pose))
            })
            .map(|(vertices, triangles)| (self.all_own(&vertices), triangles))
            .collect();
        self.drawn = self.all_own(&view.surface);
        let beside = self.beside.as_ref();
        let beside = beside.map(|beside| (self.all_own(&beside.vertices), &beside.triangles));
        let colours = self.colours.as_mut().map(|c| &mut c.camera);
        for camera in std::iter::once(&mut self.camera).chain(colours) {
            camera.clear();
            camera.draw(&self.drawn, &self.triangles, Thing::Object);
            if let Some((vertices, triangles)) = &beside {
                camera.draw(vertices, triangles, Thing::Beside);
            }
            for (vertices, triangles) in &arms {
                camera.draw(vertices, triangles, Thing::Arm);
            }
        }
    }

    /// The colour of a pixel of the rendered image.
    fn colour(&self, camera: &DepthCamera, pixel: usize) -> [u8; 3] {
        if camera.thing(pixel) != Thing::Object {
            return GREY;
        }
        let hit = camera.hit(pixel, &self.drawn, &self.triangles);
        hit.map_or(GREY, |(corners, weights)| {
            let sum = corners.iter().zip(weights);
            let at = sum.fold(Vector3::zeros(), |p, (v, w)| p + self.own[*v].coords * w);
            self.texture.colour(&at.into())
        })
    }
}
