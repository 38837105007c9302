//! The command line of `explore replay`.

use crate::without::Part;
use crate::{Features, Reconstruction, ResultArgs};
use mesh_io::program::{not_negative, numbers, positive};
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
#[command(
    after_help = "Example: explore replay session.mcap --topic points=/camera/depth/points --out rebuilt"
)]
pub(crate) struct ReplayArgs {
    /// The recording (MCAP with ROS 2 messages, or a rosbag2 directory)
    pub session: PathBuf,
    /// Topic of the points, the depth image, its camera_info, the colour image with the same rays, the features, the pose of a moving camera, the table,
    /// the truth or an arm: points, depth, camera_info, colour, features, camera, table, truth, PSM1/measured_cp, PSM1/jaw/measured_js, PSM1/jaw/setpoint_js or PSM1/measured_js
    #[arg(long = "topic", value_name = "ROLE=/NAME", value_parser = topic)]
    pub topics: Vec<(dvrk_io::session::Role, String)>,
    /// The clouds or depth images show everything in view: find table and object in each
    #[arg(long)]
    pub find_object: bool,
    /// As --find-object, with camera, table and arms of this cell (TOML, as for `explore robot`): the arms are removed by means of their joint values
    #[cfg(feature = "dvrk")]
    #[arg(long, value_name = "FILE")]
    pub cell: Option<PathBuf>,
    /// A point on or next to the object in the first frame, camera frame, m; otherwise the largest body is the object
    #[arg(long, value_name = "X,Y,Z", value_parser = numbers::<3>, allow_hyphen_values = true)]
    pub seed_point: Option<[f64; 3]>,
    /// Spacing of the model, mm
    #[arg(long, value_name = "MM", default_value_t = 5.0, value_parser = positive)]
    pub spacing: f64,
    /// Whether features of the colour image are landmarks, if they were recorded
    #[arg(long, value_enum, default_value_t = Features::On)]
    pub features: Features,
    /// What builds the model
    #[arg(long, value_enum, default_value_t = Reconstruction::Body)]
    pub reconstruction: Reconstruction,
    /// Pixel tracks of any tracker, to compare the model with: a NumPy array (frames, tracks, 2 or 3: column, row, visible) or a table frame,track,column,row
    #[arg(long, value_name = "FILE", requires = "intrinsics")]
    pub tracks: Option<PathBuf>,
    /// The camera that the pixels belong to: focal lengths and principal point, pixels
    #[arg(long, value_name = "FX,FY,CX,CY", value_parser = numbers::<4>, allow_hyphen_values = true, requires = "tracks")]
    pub intrinsics: Option<[f64; 4]>,
    /// Also write a picture of the model every N frames
    #[arg(long, value_name = "N")]
    pub pictures: Option<u32>,
    /// Stop this long after the first frame, seconds
    #[arg(long, value_name = "SECONDS", value_parser = not_negative)]
    pub until: Option<f64>,
    /// Move every point by Gaussian noise of this standard deviation, mm: with a few seeds, to tell an improvement from chance
    #[arg(long, value_name = "MM", default_value_t = 0.0, value_parser = not_negative)]
    pub noise: f64,
    /// Seed of that noise
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// Leave parts of the method out, to measure what each contributes
    #[arg(long, value_enum, value_name = "PARTS", value_delimiter = ',')]
    pub without: Vec<Part>,
    #[command(flatten)]
    pub results: ResultArgs,
}

impl ReplayArgs {
    /// A recording with the defaults of the command line.
    pub fn of(session: &Path) -> Self {
        Self {
            session: session.into(),
            topics: Vec::new(),
            find_object: false,
            #[cfg(feature = "dvrk")]
            cell: None,
            seed_point: None,
            spacing: 5.0,
            features: Features::On,
            reconstruction: Reconstruction::Body,
            tracks: None,
            intrinsics: None,
            pictures: None,
            until: None,
            noise: 0.0,
            seed: 0,
            without: Vec::new(),
            results: ResultArgs::default(),
        }
    }
}

/// `ROLE=/NAME`.
fn topic(text: &str) -> Result<(dvrk_io::session::Role, String), String> {
    let (role, topic) = text
        .split_once('=')
        .ok_or_else(|| format!("'{text}' is not ROLE=/NAME"))?;
    let role = role.parse().map_err(|error| format!("{error}"))?;
    Ok((role, topic.to_owned()))
}
