//! Clouds of features: x, y, z and a descriptor.
//!
//! ```text
//! descriptor     256 bits as eight UINT32, bit k of the descriptor in word k / 32
//! ```

use super::{Error, Header, PointCloud2, PointField, UINT32};
use crate::features::{Descriptor, Feature};
use nalgebra::Point3;

const NAME: &str = "descriptor";
/// Bytes of a descriptor.
const BYTES: u32 = 32;

impl PointCloud2 {
    /// The features of a frame, with a field `descriptor` of eight 32-bit words beside x, y and z.
    ///
    /// # Errors
    /// Those of [`Self::from_points`].
    pub fn from_features(header: Header, features: &[Feature]) -> Result<Self, Error> {
        let points: Vec<Point3<f64>> = features.iter().map(|f| f.point).collect();
        let plain = Self::from_points(header, &points)?;
        let step = plain.point_step + BYTES;
        let length = features.len().saturating_mul(step as usize);
        let row_step = u32::try_from(length).map_err(|_| Error::TooLong {
            field: "data",
            length,
        })?;
        let mut data = Vec::with_capacity(length);
        let rows = plain.data.chunks_exact(plain.point_step as usize);
        for (row, feature) in rows.zip(features) {
            data.extend_from_slice(row);
            data.extend(feature.descriptor.0.iter().flat_map(|w| w.to_le_bytes()));
        }
        let mut fields = plain.fields;
        fields.push(PointField {
            name: NAME.to_owned(),
            offset: plain.point_step,
            datatype: UINT32,
            count: 8,
        });
        Ok(Self {
            fields,
            point_step: step,
            row_step,
            data,
            ..plain
        })
    }

    /// The features of the cloud; those with non-finite points are skipped.
    ///
    /// # Errors
    /// No field `descriptor` of eight 32-bit words, and those of [`Self::points`].
    pub fn features(&self) -> Result<Vec<Feature>, Error> {
        let field = self.fields.iter().find(|field| field.name == NAME);
        let words = |field: &&PointField| field.datatype == UINT32 && field.count == 8;
        let field = field.filter(words).ok_or_else(|| Error::BadCloud {
            reason: format!("field {NAME} of eight 32-bit words is missing"),
        })?;
        self.check_fits(field, u64::from(BYTES))?;
        let points = self.points()?;
        let offset = field.offset as usize;
        let descriptor = |bytes: &[u8]| {
            let word = |k: usize| u32::from_le_bytes(self.little_endian(bytes, offset + 4 * k));
            Descriptor(std::array::from_fn(word))
        };
        let feature = |(point, bytes)| Feature {
            point,
            descriptor: descriptor(bytes),
        };
        let all = points.into_iter().zip(self.rows().flatten());
        let finite = |f: &Feature| f.point.iter().all(|x| x.is_finite());
        Ok(all.map(feature).filter(finite).collect())
    }
}
