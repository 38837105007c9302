//! How a recording is read, from the command line: as frames of the object, or as scans of everything in view.

use crate::{Failure, ReplayArgs};
use dvrk_io::session::{Role, SessionReader, TopicCount};
use explore_loop::cell::replay::{ReplayCell, ScanOptions};
use explore_loop::nalgebra::Point3;
use std::path::Path;

/// Where the data are recorded, and how the object is found in them if necessary.
#[derive(Default)]
pub(crate) struct Recording {
    topics: Vec<(Role, String)>,
    scans: Option<ScanOptions>,
}

impl Recording {
    /// # Errors
    /// The cell file is invalid.
    pub fn of(args: &ReplayArgs) -> Result<Self, Failure> {
        let known = Self::of_cell(args)?.unwrap_or_default();
        let asked = args.find_object.then(ScanOptions::default);
        let seed = args.seed_point.map(Point3::from);
        let scans = known.scans.or(asked);
        Ok(Self {
            scans: scans.map(|scans| scans.with_seed(seed)),
            ..known
        })
    }

    #[cfg(not(feature = "dvrk"))]
    #[allow(
        clippy::unnecessary_wraps,
        reason = "a cell file, if given, can be invalid"
    )]
    fn of_cell(_: &ReplayArgs) -> Result<Option<Self>, Failure> {
        Ok(None)
    }

    #[cfg(feature = "dvrk")]
    fn of_cell(args: &ReplayArgs) -> Result<Option<Self>, Failure> {
        use explore_loop::cell::dvrk::CellFile;

        let Some(path) = &args.cell else {
            return Ok(None);
        };
        let file = CellFile::load(path)?;
        let camera = &file.camera;
        let named = [
            (Role::Points, &camera.cloud),
            (Role::Depth, &camera.image),
            (Role::CameraInfo, &camera.info),
            (Role::Colour, &camera.colour),
        ];
        let named = named.into_iter();
        let topics = named.filter_map(|(role, topic)| Some((role, topic.clone()?)));
        let topics = topics.collect();
        let options = file.scan_options().map_err(|error| error.to_string())?;
        Ok(Some(Self {
            topics,
            scans: Some(options),
        }))
    }

    /// A reader of its topics; topics from the command line take precedence over those from the cell file.
    pub fn reader(&self, args: &ReplayArgs) -> SessionReader {
        let topics = self.topics.iter().chain(&args.topics);
        topics.fold(SessionReader::default(), |reader, (role, topic)| {
            reader.with_topic(role.clone(), topic)
        })
    }

    /// The recording as a cell that can be watched.
    ///
    /// # Errors
    /// The recording cannot be read, or is empty.
    pub fn cell(self, reader: &SessionReader, path: &Path) -> Result<ReplayCell, String> {
        match self.scans {
            None => frames(reader, path),
            Some(options) => found(reader, path, options),
        }
    }
}

/// The recording as frames of the object.
fn frames(reader: &SessionReader, path: &Path) -> Result<ReplayCell, String> {
    let session = reader.frames(path).map_err(|error| error.to_string())?;
    if session.stamps().len() == 0 {
        return Err(without_clouds(session.topics()));
    }
    ReplayCell::streamed(session).map_err(|error| error.to_string())
}

/// The recording as scans of everything in view, in which the object is found.
fn found(reader: &SessionReader, path: &Path, options: ScanOptions) -> Result<ReplayCell, String> {
    let scans = reader.scans(path).map_err(|error| error.to_string())?;
    if scans.stamps().len() == 0 {
        return Err(without_clouds(scans.topics()));
    }
    ReplayCell::of_scans(scans, options).map_err(|error| error.to_string())
}

/// Why there are no frames, and which options may help.
fn without_clouds(topics: &[TopicCount]) -> String {
    let of_type = |kind: &str| -> Vec<&str> {
        let some = topics.iter().filter(|t| t.count > 0);
        let named = some.filter(|t| t.type_name.ends_with(kind));
        named.map(|t| t.topic.as_str()).collect()
    };
    let clouds = of_type("/PointCloud2");
    if let (Some(image), Some(lens)) = (of_type("/Image").first(), of_type("/CameraInfo").first())
        && clouds.is_empty()
    {
        return format!(
            "no points on the expected topics; there are images on {image}: if they are depth images, use --find-object --topic depth={image} --topic camera_info={lens}"
        );
    }
    if let Some(first) = clouds.first() {
        let clouds = clouds.join(", ");
        return format!(
            "no points on the expected topics; there are clouds on {clouds}: choose one with --topic points={first}, and add --find-object if they show everything in view"
        );
    }
    let name = |t: &TopicCount| format!("{} ({})", t.topic, t.type_name);
    let all: Vec<String> = topics.iter().map(name).collect();
    format!("no point clouds; the topics are {}", all.join(", "))
}
