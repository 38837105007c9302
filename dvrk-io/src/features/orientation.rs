//! The direction of a corner: from its pixel to the centroid of the grey values around it.
//!
//! ```text
//! (m_x, m_y) = Σ (x, y) I(x, y)   over a disc of 15 pixels        direction = (m_x, m_y) / |(m_x, m_y)|
//! ```
//! It rotates with the image, so that a descriptor computed relative to it does not. It is quantised in steps of 12°.

use super::GreyImage;

/// Radius of the disc, pixels.
const RADIUS: isize = 15;
/// Steps of a whole turn.
pub(super) const TURNS: usize = 30;

/// The direction of the neighbourhood of a pixel, in steps of 12°.
pub(super) fn turn(image: &GreyImage, column: usize, row: usize) -> usize {
    let (mut mx, mut my) = (0_i32, 0_i32);
    for y in -RADIUS..=RADIUS {
        let half = (RADIUS * RADIUS - y * y).isqrt();
        let mut line = 0;
        for x in -half..=half {
            let value = image.at(column.wrapping_add_signed(x), row.wrapping_add_signed(y));
            mx += x as i32 * value;
            line += value;
        }
        my += y as i32 * line;
    }
    let along = |step: usize| {
        let [cos, sin] = direction(step);
        i64::from(mx) * cos + i64::from(my) * sin
    };
    // Of equal ones the first: a neighbourhood without a direction is not rotated.
    (0..TURNS)
        .rev()
        .max_by_key(|&step| along(step))
        .unwrap_or(0)
}

/// Cosine and sine of a step, in 1/16384, as integers so that no math library affects the result.
pub(super) fn direction(step: usize) -> [i64; 2] {
    /// Cosines of 0°, 12°, … 84°, and 96°, …, 180°.
    const COS: [i64; 16] = [
        16384, 16026, 14968, 13255, 10963, 8192, 5063, 1713, -1713, -5063, -8192, -10963, -13255,
        -14968, -16026, -16384,
    ];
    /// Sines of the same.
    const SIN: [i64; 16] = [
        0, 3406, 6664, 9630, 12176, 14189, 15582, 16294, 16294, 15582, 14189, 12176, 9630, 6664,
        3406, 0,
    ];
    let step = step % TURNS;
    if step <= 15 {
        [COS[step], SIN[step]]
    } else {
        [COS[TURNS - step], -SIN[TURNS - step]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_is_cosine_and_sine() {
        for step in 0..TURNS {
            let angle = std::f64::consts::TAU * step as f64 / TURNS as f64;
            let [cos, sin] = direction(step).map(|c| c as f64 / 16384.0);
            assert!((cos - angle.cos()).abs() < 5e-5 && (sin - angle.sin()).abs() < 5e-5);
        }
    }
}
