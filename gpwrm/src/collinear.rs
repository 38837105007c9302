//! The rotation of a thin neighbourhood: nodes on a line, or nearly so.
//!
//! A line does not determine the roll about itself, and an almost straight one determines it by offsets so small that their squares
//! are lost in `M`. The two are therefore found one after the other: the smallest rotation that maps the line to its moved direction, and then
//! the roll from the offsets `y` (rotated) and `z` (moved) perpendicular to it,
//!
//! ```text
//! θ = atan2( Σ w b·(y × z), Σ w y·z )        b = direction of the moved line
//! S = the length of that pair of sums        E = Σ w (y² + z²) − 2 S      residual of the best roll
//! R = Roll(b, max(0, 1 − E/S) θ) · Turn(a → b)
//! ```
//!
//! For a rigid motion `E = 0`, and the roll is applied in full however small the offsets are, down to the rounding of the coordinates.
//! If the offsets are noise, the residual is as large as the explained part, and no roll is applied.

use nalgebra::{Rotation3, Unit, Vector3};

use crate::moments::{Moments, Sample};
use crate::rotation::shortest_turn;

/// The rotation, and whether the nodes determine its roll; undetermined parts are taken from `base`.
pub(crate) fn rotation(
    moments: &Moments,
    samples: &[Sample],
    base: &Rotation3<f64>,
) -> (Rotation3<f64>, bool) {
    let eigen = moments.scatter.symmetric_eigen();
    let along: Vector3<f64> = eigen.eigenvectors.column(eigen.eigenvalues.imax()).into();
    let moved = (moments.scatter + moments.cross) * along;
    // A line that has collapsed to a point has no direction.
    let Some(line) = Unit::try_new(moved, 1e-12) else {
        return (*base, false);
    };
    let laid = shortest_turn(&(base * along), &line) * base;
    let (angle, trust) = roll(moments, samples, &laid, &line);
    let rolled = Rotation3::from_axis_angle(&line, trust * angle) * laid;
    (rolled, trust > 0.5)
}

/// The roll about `line` and its confidence, 0 to 1.
fn roll(
    moments: &Moments,
    samples: &[Sample],
    laid: &Rotation3<f64>,
    line: &Unit<Vector3<f64>>,
) -> (f64, f64) {
    let across = |v: Vector3<f64>| v - line.as_ref() * line.dot(&v);
    let (mut sine, mut cosine, mut spread) = (0.0, 0.0, 0.0);
    for s in samples {
        let d = s.position - moments.centre;
        let m = d + s.displacement - moments.shift;
        let (y, z) = (across(laid * d), across(m));
        // Offsets at the level of rounding are ignored: with a large weight they would dominate the others.
        if y.norm() <= moments.grain + moments.rounding * d.norm() {
            continue;
        }
        sine += s.weight * line.dot(&y.cross(&z));
        cosine += s.weight * y.dot(&z);
        spread += s.weight * (y.norm_squared() + z.norm_squared());
    }
    let explained = f64::hypot(sine, cosine);
    if explained <= 0.0 {
        return (0.0, 0.0);
    }
    let left = (spread - 2.0 * explained).max(0.0);
    (f64::atan2(sine, cosine), (1.0 - left / explained).max(0.0))
}
