//! Packed arrays, which a page can load without parsing a million decimals.
//!
//! ```text
//! position  u16 · step + low         resolution 1/65,535 of the extent of the cloud: 5 µm over 0.3 m
//! value     u16 · step + low         65,535 stands for unknown
//! index     u16, or u32 above 65,536 vertices
//! ```
//! Little-endian; Base64 in the page, plain bytes in a checkpoint.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use nalgebra::Point3;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Bytes that are written as Base64 in text formats.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct Bytes(pub Vec<u8>);

impl Serialize for Bytes {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        if serializer.is_human_readable() {
            serializer.serialize_str(&STANDARD.encode(&self.0))
        } else {
            self.0.serialize(serializer)
        }
    }
}

impl<'de> Deserialize<'de> for Bytes {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        if deserializer.is_human_readable() {
            let text = String::deserialize(deserializer)?;
            STANDARD.decode(text).map(Self).map_err(D::Error::custom)
        } else {
            Vec::deserialize(deserializer).map(Self)
        }
    }
}

/// Positions, relative to their bounding box.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Points {
    low: [f32; 3],
    step: [f32; 3],
    data: Bytes,
}

impl Points {
    /// Packs points; one that is not finite becomes the corner of the box.
    pub fn of<'a>(points: impl Iterator<Item = &'a Point3<f64>> + Clone) -> Self {
        let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        let finite = |p: &&Point3<f64>| p.iter().all(|c| c.is_finite());
        for p in points.clone().filter(finite) {
            for c in 0..3 {
                low[c] = low[c].min(p[c]);
                high[c] = high[c].max(p[c]);
            }
        }
        let scales: [Scale; 3] = std::array::from_fn(|c| Scale::over(low[c], high[c], LEVELS));
        let data = points
            .flat_map(|p| (0..3).flat_map(move |c| scales[c].level(p[c]).to_le_bytes()))
            .collect();
        Self {
            low: scales.map(|s| s.low),
            step: scales.map(|s| s.step),
            data: Bytes(data),
        }
    }

    /// Size, bytes.
    pub fn len(&self) -> usize {
        self.data.0.len()
    }
}

/// Values, some of which may be unknown.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Values {
    low: f32,
    step: f32,
    data: Bytes,
}

impl Values {
    /// Packs values; those that are not finite become unknown.
    pub fn of(values: &[f64]) -> Self {
        let finite = || values.iter().copied().filter(|v| v.is_finite());
        let (low, high) = (
            finite().fold(f64::INFINITY, f64::min),
            finite().fold(f64::NEG_INFINITY, f64::max),
        );
        let scale = Scale::over(low, high, LEVELS - 1);
        let level = |v: &f64| {
            if v.is_finite() {
                scale.level(*v)
            } else {
                u16::MAX
            }
        };
        Self {
            low: scale.low,
            step: scale.step,
            data: Bytes(values.iter().flat_map(|v| level(v).to_le_bytes()).collect()),
        }
    }

    /// Size, bytes.
    pub fn len(&self) -> usize {
        self.data.0.len()
    }
}

/// Indices of vertices.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Indices {
    wide: bool,
    data: Bytes,
}

impl Indices {
    /// Packs the corners of triangles.
    pub fn of(triangles: &[[u32; 3]]) -> Self {
        let corners = triangles.as_flattened();
        let wide = corners.iter().any(|i| u16::try_from(*i).is_err());
        let data = if wide {
            corners.iter().flat_map(|i| i.to_le_bytes()).collect()
        } else {
            let narrow = corners.iter().map(|i| *i as u16);
            narrow.flat_map(u16::to_le_bytes).collect()
        };
        Self {
            wide,
            data: Bytes(data),
        }
    }

    /// Size, bytes.
    pub fn len(&self) -> usize {
        self.data.0.len()
    }
}

/// A bit for each vertex, eight to a byte, the lowest bit first.
pub(super) fn bits(flags: &[bool]) -> Bytes {
    let byte = |eight: &[bool]| {
        let bit = |(k, flag): (usize, &bool)| u8::from(*flag) << k;
        eight.iter().enumerate().map(bit).sum()
    };
    Bytes(flags.chunks(8).map(byte).collect())
}

/// Number of the highest level.
const LEVELS: u16 = u16::MAX;

/// Levels from a lowest to a highest value.
#[derive(Clone, Copy)]
struct Scale {
    low: f32,
    step: f32,
    highest: u16,
}

impl Scale {
    fn over(low: f64, high: f64, highest: u16) -> Self {
        if !(low.is_finite() && high.is_finite()) {
            return Self {
                low: 0.0,
                step: 0.0,
                highest,
            };
        }
        Self {
            low: low as f32,
            step: ((high - low) / f64::from(highest)) as f32,
            highest,
        }
    }

    fn level(self, value: f64) -> u16 {
        if self.step <= 0.0 {
            return 0;
        }
        let level = (value - f64::from(self.low)) / f64::from(self.step);
        // NaN becomes 0.
        level.round().clamp(0.0, f64::from(self.highest)) as u16
    }
}

#[cfg(test)]
mod tests {
    use super::{Indices, Points, Values, bits};
    use nalgebra::Point3;

    fn levels(data: &[u8]) -> Vec<f64> {
        let pairs = data.chunks_exact(2);
        pairs
            .map(|b| f64::from(u16::from_le_bytes([b[0], b[1]])))
            .collect()
    }

    /// What is unpacked is off by half a step at most, and by the rounding of `low` and `step` to `f32`.
    #[test]
    fn positions_come_back_to_within_half_a_step() {
        let points: Vec<Point3<f64>> = (0..500)
            .map(|i| {
                let t = f64::from(i) * 0.37;
                Point3::new(0.1 * t.sin(), 3.0 + 0.2 * t.cos(), -0.01 * t)
            })
            .collect();
        let packed = Points::of(points.iter());
        let found = levels(&packed.data.0);
        for (i, point) in points.iter().enumerate() {
            for c in 0..3 {
                let (low, step) = (f64::from(packed.low[c]), f64::from(packed.step[c]));
                let value = low + step * found[3 * i + c];
                assert!((value - point[c]).abs() < 0.5 * step + 1e-6, "{i} {c}");
            }
        }
    }

    #[test]
    fn what_is_not_finite_is_unknown_and_harms_nothing_else() {
        let packed = Values::of(&[f64::NAN, 1.0, 3.0, f64::INFINITY]);
        assert_eq!(levels(&packed.data.0), [65_535.0, 0.0, 65_534.0, 65_535.0]);
        assert_eq!(Values::of(&[]).len(), 0);
        assert_eq!(levels(&Values::of(&[f64::NAN]).data.0), [65_535.0]);
        let points = [Point3::new(f64::NAN, 0.0, 1.0), Point3::new(1.0, 2.0, 3.0)];
        assert_eq!(Points::of(points.iter()).len(), 12);
        assert_eq!(Points::of([].iter()).len(), 0);
    }

    #[test]
    fn indices_are_as_wide_as_they_must_be() {
        assert_eq!(Indices::of(&[[0, 1, 65_535]]).len(), 6);
        let wide = Indices::of(&[[0, 1, 65_536]]);
        assert!(wide.wide);
        assert_eq!(wide.len(), 12);
        assert_eq!(bits(&[true, false, false, true, false]).0, [0b1001]);
        assert_eq!(bits(&[true; 9]).0, [255, 1]);
    }

    #[test]
    fn a_checkpoint_and_a_page_say_the_same() -> Result<(), Box<dyn std::error::Error>> {
        let packed = Values::of(&[0.5, f64::NAN, 2.0]);
        let text = serde_json::to_string(&packed)?;
        assert_eq!(serde_json::from_str::<Values>(&text)?, packed);
        let bytes = postcard::to_allocvec(&packed)?;
        assert_eq!(postcard::from_bytes::<Values>(&bytes)?, packed);
        Ok(())
    }
}
