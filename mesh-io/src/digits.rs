//! Numbers with three significant digits.

/// `1.7320508` as `1.73`, `152.4` as `152`, `0.00012345` as `0.000123`, very large and small ones with an exponent.
pub fn three(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return value.to_string();
    }
    let magnitude = value.abs().log10().floor();
    if !(-5.0..7.0).contains(&magnitude) {
        return format!("{value:.2e}");
    }
    let decimals = (2.0 - magnitude).max(0.0) as usize;
    let rounded = 10f64.powf(2.0 - magnitude);
    let text = format!("{:.decimals$}", (value * rounded).round() / rounded);
    if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        text
    }
}

#[cfg(test)]
mod tests {
    use super::three;

    #[test]
    fn three_digits_are_left() {
        for (value, text) in [
            (3f64.sqrt(), "1.73"),
            (152.4, "152"),
            (1234.5, "1230"),
            (0.000_123_45, "0.000123"),
            (0.02, "0.02"),
            (1.0, "1"),
            (0.0, "0"),
            (-0.5, "-0.5"),
            (1e12, "1.00e12"),
        ] {
            assert_eq!(three(value), text);
        }
    }
}
