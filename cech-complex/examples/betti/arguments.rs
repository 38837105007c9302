//! The command line.

use cech_complex::{Cylinder, Options, Orientation};
use clap::ValueEnum;
use mesh_io::program::{Failure, Loading, Output, positive};
use std::path::PathBuf;

/// Cylinder radius in spacings that suits an even sampling.
const RADIUS_PER_SPACING: f64 = 1.25;

/// Betti numbers of the surface that an oriented cloud was sampled from
#[derive(Debug, clap::Parser)]
#[command(
    name = "betti",
    after_help = "Example: betti scan.pcd --radius 0.009 --height 0.007

Lengths are in metres. A radius of 1.25 times the spacing of the points fits; the height is the reach along the normals."
)]
pub struct Arguments {
    /// Cloud or mesh: PLY, PCD, XYZ, NPY, OBJ, STL or OFF
    pub cloud: PathBuf,
    /// Radius of the cylinder around each point, m
    #[arg(long, value_name = "R", value_parser = positive)]
    radius: f64,
    /// Half its height, m
    #[arg(long, value_name = "H", value_parser = positive)]
    height: f64,
    /// Scale at which Betti numbers are taken, in radii
    #[arg(long, value_name = "S", default_value_t = 1.0, value_parser = positive)]
    pub from: f64,
    /// Scale up to which they have to persist [default: --from]
    #[arg(long, value_name = "S", value_parser = positive)]
    to: Option<f64>,
    /// Scale up to which the complex is built [default: the largest of 1, --from and --to]
    #[arg(long, value_name = "S", value_parser = positive)]
    max_scale: Option<f64>,
    /// Only the Betti numbers at --from, without building the complex: five times faster
    #[arg(long, conflicts_with_all = ["to", "max_scale", "spacing"])]
    pub only: bool,
    /// Spacing of the points, m, for the classification of vertices [default: R/1.25]
    #[arg(long, value_name = "D", value_parser = positive)]
    spacing: Option<f64>,
    /// Largest number of simplices before giving up
    #[arg(long, value_name = "N", default_value_t = Options::default().max_simplices)]
    max_simplices: usize,
    /// Whether the signs of normals are meaningful
    #[arg(long, value_enum, default_value_t = Signs::Separate)]
    pub orientation: Signs,
    #[command(flatten)]
    pub loading: Loading,
    #[command(flatten)]
    pub output: Output,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Signs {
    /// Sheets that face away from each other are separate surfaces
    Separate,
    /// The signs are arbitrary
    Free,
}

impl Arguments {
    pub fn to(&self) -> f64 {
        self.to.unwrap_or(self.from)
    }

    pub fn spacing(&self) -> f64 {
        self.spacing.unwrap_or(self.radius / RADIUS_PER_SPACING)
    }

    pub fn cylinder(&self) -> Result<Cylinder, cech_complex::Error> {
        Cylinder::new(self.radius, self.height)
    }

    /// Options for building the complex.
    pub fn options(&self) -> Result<Options, Failure> {
        let (from, to) = (self.from, self.to());
        let least = if self.only { from } else { 1.0 };
        let most = self.max_scale.unwrap_or(from.max(to).max(least));
        if from > to || to > most {
            let scales = format!("--from {from}, --to {to}, --max-scale {most}");
            return Err(format!("scales must ascend: {scales}").into());
        }
        let options = Options::default()
            .with_max_scale(most)
            .with_max_simplices(self.max_simplices);
        Ok(match self.orientation {
            Signs::Separate => options,
            Signs::Free => options.with_orientation(Orientation::Free),
        })
    }
}
