//! `sensor_msgs/PointCloud2`: a table of bytes, and the description of its columns.
//!
//! ```text
//! point (row, column) starts at   row · row_step + column · point_step
//! its field f is at               … + f.offset, of type f.datatype, in the byte order of `is_bigendian`
//! ```
//! The byte order of the table is its own: it does not depend on that of the message around it.

use nalgebra::Point3;

use super::{Decoder, Encoder, Header, Message};
use crate::Error;

mod features;

/// `PointField::INT32`.
const INT32: u8 = 5;
/// `PointField::UINT32`.
const UINT32: u8 = 6;
/// `PointField::FLOAT32`.
const FLOAT32: u8 = 7;
/// `PointField::FLOAT64`.
const FLOAT64: u8 = 8;

/// A `sensor_msgs/PointField`: one column.
#[derive(Debug, Clone, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct PointField {
    /// `x`, `y`, `z`, `rgb`, …
    pub name: String,
    /// Bytes from the start of the point.
    pub offset: u32,
    /// 7 is a 32-bit, 8 a 64-bit float; 1 to 6 are integers.
    pub datatype: u8,
    /// Elements in the field.
    pub count: u32,
}

/// A `sensor_msgs/PointCloud2`.
///
/// ```
/// use dvrk_io::cdr::{Endian, Header, PointCloud2, decode, encode};
/// use dvrk_io::nalgebra::Point3;
///
/// // Multiples of 1/4 are exact in 32 bits.
/// let points = [Point3::new(0.25, -0.5, 0.75), Point3::new(0.0, 0.25, 1.0)];
/// let colours = [[255, 0, 10], [1, 2, 3]];
/// let cloud = PointCloud2::from_coloured_points(Header::default(), &points, &colours)?;
/// assert_eq!((cloud.width, cloud.height, cloud.point_step), (2, 1, 16));
/// let received: PointCloud2 = decode(&encode(&cloud, Endian::Big)?)?;
/// assert_eq!(received.points()?, points);
/// assert_eq!(received.colours()?, Some(colours.to_vec()));
/// # Ok::<(), dvrk_io::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct PointCloud2 {
    /// When, and in which frame.
    pub header: Header,
    /// Rows: 1 when the cloud is not an image.
    pub height: u32,
    /// Points in a row.
    pub width: u32,
    /// The columns of the table.
    pub fields: Vec<PointField>,
    /// Whether numbers in `data` have their most significant byte first.
    pub is_bigendian: bool,
    /// Bytes from point to point.
    pub point_step: u32,
    /// Bytes from row to row.
    pub row_step: u32,
    /// The table.
    pub data: Vec<u8>,
    /// Whether every point is valid.
    pub is_dense: bool,
}

/// How to read one coordinate.
#[derive(Clone, Copy)]
struct Column {
    offset: usize,
    double: bool,
}

impl PointCloud2 {
    /// A cloud with 32-bit x, y, z and nothing else, one row.
    ///
    /// # Errors
    /// A point that is not finite as 32-bit floats, or more than 2³² / 12 points.
    pub fn from_points(header: Header, points: &[Point3<f64>]) -> Result<Self, Error> {
        const STEP: u32 = 12;
        let mut data = Vec::with_capacity(points.len() * STEP as usize);
        for (index, point) in points.iter().enumerate() {
            let single = point.map(|value| value as f32);
            if !single.iter().all(|value| value.is_finite()) {
                return Err(Error::NonFinitePoint {
                    index,
                    point: (*point).into(),
                });
            }
            data.extend(single.iter().flat_map(|value| value.to_le_bytes()));
        }
        let bytes = u32::try_from(data.len()).map_err(|_| Error::TooLong {
            field: "data",
            length: data.len(),
        })?;
        let field = |(index, name): (u32, &str)| PointField {
            name: name.to_owned(),
            offset: 4 * index,
            datatype: FLOAT32,
            count: 1,
        };
        Ok(Self {
            header,
            height: 1,
            width: bytes / STEP,
            fields: (0..).zip(["x", "y", "z"]).map(field).collect(),
            is_bigendian: false,
            point_step: STEP,
            row_step: bytes,
            data,
            is_dense: true,
        })
    }

    /// The same with a colour for every point, in a field `rgb` as ROS has it: 32 bits declared as a float, blue in the least significant byte.
    ///
    /// # Errors
    /// Another number of colours than of points, and those of [`Self::from_points`].
    pub fn from_coloured_points(
        header: Header,
        points: &[Point3<f64>],
        colours: &[[u8; 3]],
    ) -> Result<Self, Error> {
        if points.len() != colours.len() {
            let reason = format!("{} colours for {} points", colours.len(), points.len());
            return Err(Error::BadCloud { reason });
        }
        let plain = Self::from_points(header, points)?;
        let step = plain.point_step + 4;
        let bytes = usize::try_from(step)
            .unwrap_or(usize::MAX)
            .saturating_mul(points.len());
        let row_step = u32::try_from(bytes).map_err(|_| Error::TooLong {
            field: "data",
            length: bytes,
        })?;
        let mut data = Vec::with_capacity(bytes);
        let rows = plain.data.chunks_exact(plain.point_step as usize);
        for (row, [red, green, blue]) in rows.zip(colours) {
            data.extend_from_slice(row);
            data.extend([*blue, *green, *red, 0]);
        }
        let mut fields = plain.fields;
        fields.push(PointField {
            name: "rgb".to_owned(),
            offset: plain.point_step,
            datatype: FLOAT32,
            count: 1,
        });
        Ok(Self {
            fields,
            point_step: step,
            row_step,
            data,
            ..plain
        })
    }

    /// Every point in the order of the table, invalid ones (NaN or zeros) included.
    ///
    /// # Errors
    /// No x, y or z of a float type, a field outside the point, or fewer bytes than the sizes say.
    pub fn points(&self) -> Result<Vec<Point3<f64>>, Error> {
        let columns = [self.column("x")?, self.column("y")?, self.column("z")?];
        self.check_size()?;
        // Allocated at once: 300,000 points in a growing vector would be copied twice.
        let mut points = Vec::with_capacity(self.height as usize * self.width as usize);
        let (first, adjacent) = (columns[0].offset, columns.map(|column| column.offset));
        let adjacent = adjacent == [first, first + 4, first + 8];
        if adjacent && columns.iter().all(|column| !column.double) && !self.is_bigendian {
            // The usual format, without a branch for each number.
            let single = |bytes: &[u8], at: usize| {
                let mut value = [0; 4];
                value.copy_from_slice(&bytes[at..at + 4]);
                f64::from(f32::from_le_bytes(value))
            };
            for row in self.rows() {
                points.extend(row.map(|point| {
                    let xyz = &point[first..first + 12];
                    Point3::new(single(xyz, 0), single(xyz, 4), single(xyz, 8))
                }));
            }
        } else {
            for row in self.rows() {
                let point = |bytes| Point3::from(columns.map(|column| self.value(bytes, column)));
                points.extend(row.map(point));
            }
        }
        Ok(points)
    }

    /// Red, green and blue of every point in the order of the table; `None` without a field `rgb` or `rgba`.
    ///
    /// Both are 32 bits, declared as a float or as an integer: blue, green, red, and alpha or nothing, from the
    /// least significant byte on. Points with invalid coordinates have colours too.
    ///
    /// # Errors
    /// Another data type, a field outside the point, or fewer bytes than the sizes say.
    pub fn colours(&self) -> Result<Option<Vec<[u8; 3]>>, Error> {
        let mut fields = self.fields.iter();
        let Some(field) = fields.find(|field| field.name == "rgb" || field.name == "rgba") else {
            return Ok(None);
        };
        if !matches!(field.datatype, INT32 | UINT32 | FLOAT32) {
            let (name, found) = (&field.name, field.datatype);
            return Err(Error::BadCloud {
                reason: format!("field {name} has data type {found}, not 32 bits"),
            });
        }
        self.check_fits(field, 4)?;
        self.check_size()?;
        let colour = |point| {
            let [blue, green, red, _] = self.little_endian(point, field.offset as usize);
            [red, green, blue]
        };
        Ok(Some(self.rows().flatten().map(colour).collect()))
    }

    /// The bytes of each point, row by row; requires [`Self::check_size`].
    fn rows(&self) -> impl Iterator<Item = impl Iterator<Item = &[u8]>> {
        let (step, width) = (self.point_step as usize, self.width as usize);
        let stride = self.stride() as usize;
        let rows = (0..self.height as usize).map(move |row| &self.data[row * stride..]);
        rows.map(move |row| row.chunks_exact(step).take(width))
    }

    /// Bytes from row to row. Some drivers leave `row_step` at 0 and have no padding.
    fn stride(&self) -> u64 {
        if self.row_step == 0 {
            u64::from(self.width) * u64::from(self.point_step)
        } else {
            u64::from(self.row_step)
        }
    }

    fn check_fits(&self, field: &PointField, size: u64) -> Result<(), Error> {
        if u64::from(field.offset) + size <= u64::from(self.point_step) {
            return Ok(());
        }
        let (name, offset, step) = (&field.name, field.offset, self.point_step);
        Err(Error::BadCloud {
            reason: format!(
                "field {name} at byte {offset} does not fit into points of {step} bytes"
            ),
        })
    }

    fn column(&self, name: &str) -> Result<Column, Error> {
        let bad = |what: String| Error::BadCloud {
            reason: format!("field {name}{what}"),
        };
        let field = self.fields.iter().find(|field| field.name == name);
        let field = field.ok_or_else(|| bad(" is missing".to_owned()))?;
        let size = match field.datatype {
            FLOAT32 => 4,
            FLOAT64 => 8,
            other => {
                return Err(bad(format!(
                    " has data type {other}, not 32- or 64-bit float"
                )));
            }
        };
        self.check_fits(field, size)?;
        Ok(Column {
            offset: field.offset as usize,
            double: size == 8,
        })
    }

    /// After this check every row starts inside the data and holds `width` whole points.
    fn check_size(&self) -> Result<(), Error> {
        let (row, stride) = (
            u64::from(self.width) * u64::from(self.point_step),
            self.stride(),
        );
        // The last row need not be padded to `row_step`. 2³² · 2³² · 2³² bytes: use u128.
        let needed =
            u128::from(self.height.saturating_sub(1)) * u128::from(stride) + u128::from(row);
        let data = self.data.len();
        if self.height > 1 && stride < row {
            let (step, width, point) = (self.row_step, self.width, self.point_step);
            return Err(Error::BadCloud {
                reason: format!("row_step {step} < {width} points of {point} bytes"),
            });
        }
        if self.height > 0 && needed > data as u128 {
            let reason = format!(
                "{} × {} points need {needed} bytes, data has {data}",
                self.height, self.width
            );
            return Err(Error::BadCloud { reason });
        }
        // An empty table with 2³² rows would otherwise be traversed row by row.
        if self.width == 0 && self.height > 1 {
            return Err(Error::BadCloud {
                reason: format!("{} rows of no points", self.height),
            });
        }
        Ok(())
    }

    fn value(&self, point: &[u8], column: Column) -> f64 {
        if column.double {
            f64::from_le_bytes(self.little_endian(point, column.offset))
        } else {
            f64::from(f32::from_le_bytes(self.little_endian(point, column.offset)))
        }
    }

    fn little_endian<const N: usize>(&self, point: &[u8], offset: usize) -> [u8; N] {
        let mut bytes = [0; N];
        bytes.copy_from_slice(&point[offset..offset + N]);
        if self.is_bigendian {
            bytes.reverse();
        }
        bytes
    }
}

impl Message for PointCloud2 {
    const TYPE: &'static str = "sensor_msgs/msg/PointCloud2";

    fn read(decoder: &mut Decoder<'_>) -> Result<Self, Error> {
        // Length of the name, offset, data type, count: at least 4 + 4 + 1 + 4 bytes.
        const FIELD: usize = 13;
        Ok(Self {
            header: Header::read(decoder)?,
            height: decoder.u32("height")?,
            width: decoder.u32("width")?,
            fields: decoder.sequence("fields", FIELD, |d| {
                Ok(PointField {
                    name: d.string("fields.name")?,
                    offset: d.u32("fields.offset")?,
                    datatype: d.u8("fields.datatype")?,
                    count: d.u32("fields.count")?,
                })
            })?,
            is_bigendian: decoder.bool("is_bigendian")?,
            point_step: decoder.u32("point_step")?,
            row_step: decoder.u32("row_step")?,
            data: decoder.bytes("data")?.to_vec(),
            is_dense: decoder.bool("is_dense")?,
        })
    }

    fn write(&self, encoder: &mut Encoder) -> Result<(), Error> {
        self.header.write(encoder)?;
        encoder.u32(self.height);
        encoder.u32(self.width);
        encoder.sequence("fields", &self.fields, |e, field| {
            e.string("fields.name", &field.name)?;
            e.u32(field.offset);
            e.u8(field.datatype);
            e.u32(field.count);
            Ok(())
        })?;
        encoder.bool(self.is_bigendian);
        encoder.u32(self.point_step);
        encoder.u32(self.row_step);
        encoder.bytes("data", &self.data)?;
        encoder.bool(self.is_dense);
        Ok(())
    }
}
