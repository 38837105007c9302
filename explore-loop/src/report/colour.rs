//! Colours shared by pictures, the page and the live view.

/// Red, green and blue.
pub type Rgb = [u8; 3];

/// Colour by the time of first sight: blue early, yellow late. `share` is 0 for the first frame and 1 for the last.
pub fn first_seen(share: f64) -> Rgb {
    mix([60, 110, 200], [250, 200, 60], share)
}

/// Interpolates two colours; `share` is clamped to 0 to 1.
pub fn mix(from: Rgb, to: Rgb, share: f64) -> Rgb {
    let share = share.clamp(0.0, 1.0);
    std::array::from_fn(|c| {
        let (from, to) = (f64::from(from[c]), f64::from(to[c]));
        (from + share * (to - from)) as u8
    })
}
