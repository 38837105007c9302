//! What the user asked for.

use grip_planner::Plane;
use grip_planner::nalgebra::{Point3, UnitVector3, Vector3};
use mesh_io::Load;

pub const USAGE: &str = "usage: grips MODEL [--arms 2|3] [--camera X,Y,Z] [--plane A,B,C,D] [--units m|cm|mm] [--size METRES] [--up x|y|z] [--body N] [--out FILE.svg]

  example: grips liver.stl --units mm --arms 3

  MODEL       a mesh (PLY, OBJ, STL, OFF): closed, then what the camera sees of it counts as known; or open, then all of it
  --arms      how many arms: one from either end of the table, a third from behind (default 3)
  --camera    where the camera is (default: above the middle, two and a half diagonals away)
  --plane     the table A x + B y + C z + D = 0, with A x + B y + C z + D >= 0 on the free side (default: z up, through the lowest vertex)
  --units     the unit of the mesh (default m); --size its longest extent instead; --up its axis that points up (default z)
  --body      which body of several: 1 is the largest
  --out       the picture (default grips.svg)";

/// The command line.
pub struct Arguments {
    pub model: String,
    pub arms: usize,
    pub camera: Option<Point3<f64>>,
    pub plane: Option<Plane>,
    pub load: Load,
    pub out: String,
}

impl Arguments {
    pub fn parse(mut words: impl Iterator<Item = String>) -> Result<Self, String> {
        let mut model = None;
        let mut rest = Self {
            model: String::new(),
            arms: 3,
            camera: None,
            plane: None,
            // No body between these can be held by jaws of centimetres.
            load: Load::default().with_extent([1e-3, 10.0]),
            out: "grips.svg".into(),
        };
        while let Some(word) = words.next() {
            let given = rest.load.option(&word, || words.next());
            if given.map_err(|error| error.to_string())? {
                continue;
            }
            let mut value = || words.next().ok_or(format!("{word} takes a value"));
            match word.as_str() {
                "--arms" => rest.arms = arms(&value()?)?,
                "--camera" => rest.camera = Some(Point3::from(numbers("--camera", &value()?)?)),
                "--plane" => rest.plane = Some(plane(&value()?)?),
                "--out" => rest.out = value()?,
                option if option.starts_with("--") => {
                    return Err(format!("unknown option {option}"));
                }
                _ if model.is_none() => model = Some(word),
                _ => return Err(format!("one model at a time: what is '{word}'?")),
            }
        }
        rest.model = model.ok_or("which model?")?;
        Ok(rest)
    }
}

fn arms(text: &str) -> Result<usize, String> {
    match text {
        "2" => Ok(2),
        "3" => Ok(3),
        other => Err(format!("--arms {other}: 2 or 3")),
    }
}

fn plane(text: &str) -> Result<Plane, String> {
    let [a, b, c, d] = numbers("--plane", text)?;
    let normal = Vector3::new(a, b, c);
    let length = normal.norm();
    let unit = UnitVector3::try_new(normal, 1e-9)
        .ok_or(format!("--plane {text}: A, B, C have no direction"))?;
    Ok(Plane {
        normal: unit,
        offset: d / length,
    })
}

fn numbers<const N: usize>(option: &str, text: &str) -> Result<[f64; N], String> {
    let bad = || format!("{option} {text}: {N} finite numbers with commas between them");
    let parts: Result<Vec<f64>, _> = text.split(',').map(|p| p.trim().parse::<f64>()).collect();
    let parts = parts.map_err(|_| bad())?;
    let finite = parts.iter().all(|x| x.is_finite());
    parts.try_into().ok().filter(|_| finite).ok_or_else(bad)
}
