//! The command line.

use cech_complex::{Cylinder, Options, Orientation};
use mesh_io::{Load, Vertices};

pub const USAGE: &str = "usage: betti CLOUD --radius R --height H [--from S --to S] [--max-scale S] [--spacing D] [--max-simplices N] [--orientation separate|free] \
    [--units m|cm|mm] [--size METRES] [--up x|y|z] [--body N]";
/// A cylinder fits its sampling when its radius is this many spacings.
const RADIUS_PER_SPACING: f64 = 1.25;

/// What was asked for.
pub struct Arguments {
    pub file: String,
    pub cylinder: Cylinder,
    pub from: f64,
    pub to: f64,
    pub max_scale: f64,
    pub spacing: f64,
    pub max_simplices: usize,
    pub orientation: Orientation,
    pub load: Load,
}

pub fn parse(mut words: impl Iterator<Item = String>) -> Result<Arguments, String> {
    let mut file = None;
    let mut lengths: [(&str, Option<f64>); 6] = [
        "--radius",
        "--height",
        "--from",
        "--to",
        "--max-scale",
        "--spacing",
    ]
    .map(|name| (name, None));
    let mut max_simplices = Options::default().max_simplices;
    let mut orientation = Options::default().orientation;
    // Every point counts, whether a face uses it or not.
    let mut load = Load::default().with_vertices(Vertices::AsInFile);
    while let Some(word) = words.next() {
        if let Some((name, value)) = lengths.iter_mut().find(|(name, _)| *name == word) {
            *value = Some(positive(name, words.next())?);
        } else if word == "--max-simplices" {
            let given = words.next().unwrap_or_default();
            max_simplices = given
                .parse()
                .map_err(|_| format!("--max-simplices needs a whole number, got {given:?}"))?;
        } else if word == "--orientation" {
            orientation = match words.next().as_deref() {
                Some("separate") => Options::default().orientation,
                Some("free") => Orientation::Free,
                other => {
                    let given = other.unwrap_or_default();
                    return Err(format!("--orientation is separate or free, not {given:?}"));
                }
            };
        } else if load
            .option(&word, || words.next())
            .map_err(|error| error.to_string())?
        {
        } else if word.starts_with("--") {
            return Err(format!("unknown option {word}; {USAGE}"));
        } else if let Some(first) = file.replace(word) {
            return Err(format!("two files given, {first} and another; {USAGE}"));
        }
    }
    let [radius, height, from, to, max_scale, spacing] = lengths.map(|(_, value)| value);
    let file = file.ok_or_else(|| format!("no file given; {USAGE}"))?;
    let radius = radius.ok_or_else(|| format!("--radius is missing; {USAGE}"))?;
    let height = height.ok_or_else(|| format!("--height is missing; {USAGE}"))?;
    let from = from.unwrap_or(1.0);
    let to = to.unwrap_or(from);
    let max_scale = max_scale.unwrap_or(from.max(to).max(1.0));
    if from > to || to > max_scale {
        return Err(format!(
            "scales must ascend: --from {from}, --to {to}, --max-scale {max_scale}"
        ));
    }
    Ok(Arguments {
        file,
        cylinder: Cylinder::new(radius, height).map_err(|error| error.to_string())?,
        from,
        to,
        max_scale,
        spacing: spacing.unwrap_or(radius / RADIUS_PER_SPACING),
        max_simplices,
        orientation,
        load,
    })
}

fn positive(name: &str, word: Option<String>) -> Result<f64, String> {
    let word = word.unwrap_or_default();
    match word.parse::<f64>() {
        Ok(value) if value > 0.0 && value.is_finite() => Ok(value),
        _ => Err(format!("{name} needs a positive number, got {word:?}")),
    }
}
