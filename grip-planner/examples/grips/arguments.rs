//! The command line.

use std::path::PathBuf;

use grip_planner::Plane;
use grip_planner::nalgebra::{Point3, UnitVector3, Vector3};
use mesh_io::program::{Loading, Output, numbers};

/// Plans where arms grip an object, and how they turn it over
#[derive(Debug, clap::Parser)]
#[command(
    name = "grips",
    after_help = "Example: grips liver.stl --units mm --arms 3 --out grips.svg

Exit code 0: a set of grips can be carried out; 1: none can, or a file cannot be read or written; 2: the command line is wrong."
)]
pub struct Arguments {
    /// Mesh (PLY, OBJ, STL, OFF): of a closed one the part that the camera sees is known, of an open one all
    pub model: PathBuf,
    /// How many arms: one from either end of the table, a third from behind
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u8).range(2..=3))]
    pub arms: u8,
    /// Position of the camera, m [default: above the centre, at two and a half diagonals]
    #[arg(long, value_name = "X,Y,Z", value_parser = camera, allow_hyphen_values = true)]
    pub camera: Option<Point3<f64>>,
    /// The table A x + B y + C z + D = 0, positive on the free side, m [default: z up, through the lowest vertex]
    #[arg(long, value_name = "A,B,C,D", value_parser = plane, allow_hyphen_values = true)]
    pub plane: Option<Plane>,
    #[command(flatten)]
    pub loading: Loading,
    /// The picture
    #[arg(long, value_name = "FILE.svg", default_value = "grips.svg")]
    pub out: PathBuf,
    #[command(flatten)]
    pub output: Output,
}

fn camera(text: &str) -> Result<Point3<f64>, String> {
    numbers(text).map(Point3::from)
}

fn plane(text: &str) -> Result<Plane, String> {
    let [a, b, c, d] = numbers(text)?;
    let normal = Vector3::new(a, b, c);
    let length = normal.norm();
    let unit = UnitVector3::try_new(normal, 1e-9).ok_or("A, B, C have no direction")?;
    Ok(Plane {
        normal: unit,
        offset: d / length,
    })
}
