//! MCAP files record by record, as no writer that checks what it is given would make them.

use dvrk_io::cdr::{self, Endian, Header, JointState, Message, Plane, PointCloud2, PointField};
use dvrk_io::cdr::{Pose, PoseStamped, Time};
use explore_loop::nalgebra::{Isometry3, Point3};

pub const MAGIC: &[u8] = b"\x89MCAP0\r\n";
const TYPES: [&str; 4] = [
    PointCloud2::TYPE,
    PoseStamped::TYPE,
    JointState::TYPE,
    Plane::TYPE,
];
const TOPICS: [&str; 4] = [
    "/cell/points",
    "/PSM1/measured_cp",
    "/PSM1/jaw/measured_js",
    "/cell/table",
];
pub const POINTS: u16 = 1;
pub const POSE: u16 = 2;
pub const JAW: u16 = 3;
pub const TABLE: u16 = 4;

fn text(text: &str) -> Vec<u8> {
    let length = text.len() as u32;
    [&length.to_le_bytes()[..], text.as_bytes()].concat()
}

pub fn record(kind: u8, body: &[u8]) -> Vec<u8> {
    let length = body.len() as u64;
    [&[kind][..], &length.to_le_bytes(), body].concat()
}

pub fn schema(id: u16, name: &str, encoding: &str) -> Vec<u8> {
    let body = [
        &id.to_le_bytes()[..],
        &text(name),
        &text(encoding),
        &text("x"),
    ];
    record(3, &body.concat())
}

pub fn channel(id: u16, schema: u16, topic: &str, encoding: &str) -> Vec<u8> {
    let ids = [id.to_le_bytes(), schema.to_le_bytes()].concat();
    let body = [&ids[..], &text(topic), &text(encoding), &0u32.to_le_bytes()];
    record(4, &body.concat())
}

/// Schemas of all types, of this encoding.
pub fn schemas(encoding: &str) -> Vec<u8> {
    let all = TYPES
        .iter()
        .zip(1..)
        .map(|(name, id)| schema(id, name, encoding));
    all.collect::<Vec<_>>().concat()
}

/// Channels of all topics.
pub fn channels() -> Vec<u8> {
    let all = TOPICS
        .iter()
        .zip(1..)
        .map(|(topic, id)| channel(id, id, topic, "cdr"));
    all.collect::<Vec<_>>().concat()
}

pub fn message(channel: u16, log_ns: u64, data: &[u8]) -> Vec<u8> {
    let times = [log_ns.to_le_bytes(), log_ns.to_le_bytes()].concat();
    let body = [
        &channel.to_le_bytes()[..],
        &0u32.to_le_bytes(),
        &times,
        data,
    ];
    record(5, &body.concat())
}

/// A chunk under the name of a compression, and what is in it as it is.
pub fn chunk(content: &[u8], compression: &str, stored: &[u8]) -> Vec<u8> {
    let head = [0, u64::MAX / 2, content.len() as u64].map(u64::to_le_bytes);
    let body = [
        &head.concat()[..],
        &crc32fast::hash(content).to_le_bytes(),
        &text(compression),
        &(stored.len() as u64).to_le_bytes(),
        stored,
    ];
    record(6, &body.concat())
}

/// A zstd frame whose blocks are stored: any decoder reads it.
pub fn zstd(content: &[u8]) -> Vec<u8> {
    let mut out = [0xFD2F_B528u32.to_le_bytes().as_slice(), &[0xA0]].concat();
    out.extend((content.len() as u32).to_le_bytes());
    let none: [&[u8]; 1] = [b""];
    let blocks: Vec<&[u8]> = content.chunks(100_000).collect();
    let blocks = if blocks.is_empty() {
        &none[..]
    } else {
        &blocks
    };
    let mut blocks = blocks.iter().peekable();
    while let Some(block) = blocks.next() {
        let head = ((block.len() as u32) << 3) | u32::from(blocks.peek().is_none());
        out.extend(&head.to_le_bytes()[..3]);
        out.extend(*block);
    }
    out
}

/// A whole file around these records.
pub fn file(body: &[u8], profile: &str) -> Vec<u8> {
    let head = record(1, &[text(profile), text("test")].concat());
    let end = [record(15, &[0; 4]), record(2, &[0; 20])].concat();
    [MAGIC, &head, body, &end, MAGIC].concat()
}

pub fn header(stamp_ns: u64, frame: &str) -> Header {
    Header {
        stamp: Time {
            sec: (stamp_ns / 1_000_000_000) as i32,
            nanosec: (stamp_ns % 1_000_000_000) as u32,
        },
        frame_id: frame.to_owned(),
    }
}

/// How a cloud is laid out in its message.
pub struct Layout {
    /// Offset and type of x, y and z: 7 for 32-bit floats, 8 for 64, 3 for 16-bit integers.
    pub fields: [(&'static str, u32, u8); 3],
    pub step: u32,
    pub big: bool,
    /// Points in a row; all of them if 0. The last row is filled with NaN.
    pub width: usize,
    pub row_step: Option<u32>,
}

pub const PLAIN: Layout = Layout {
    fields: [("x", 0, 7), ("y", 4, 7), ("z", 8, 7)],
    step: 12,
    big: false,
    width: 0,
    row_step: None,
};

pub fn cloud(stamp_ns: u64, points: &[Point3<f64>], layout: &Layout) -> Vec<u8> {
    let width = if layout.width == 0 {
        points.len()
    } else {
        layout.width
    };
    let height = points.len().div_ceil(width.max(1)).max(1);
    let mut data = Vec::new();
    let nowhere = Point3::from([f64::NAN; 3]);
    for k in 0..width * height {
        let point = points.get(k).unwrap_or(&nowhere);
        let mut bytes = vec![0xAB; layout.step as usize];
        for ((_, offset, kind), value) in layout.fields.iter().zip(point.iter()) {
            let mut number = match kind {
                8 => value.to_le_bytes().to_vec(),
                3 => ((1e3 * value).round() as i16).to_le_bytes().to_vec(),
                _ => (*value as f32).to_le_bytes().to_vec(),
            };
            if layout.big {
                number.reverse();
            }
            bytes[*offset as usize..][..number.len()].copy_from_slice(&number);
        }
        data.extend(bytes);
    }
    let field = |(name, offset, datatype): &(&str, u32, u8)| PointField {
        name: (*name).to_owned(),
        offset: *offset,
        datatype: *datatype,
        count: 1,
    };
    let message = PointCloud2 {
        header: header(stamp_ns, "camera"),
        height: height as u32,
        width: width as u32,
        fields: layout.fields.iter().map(field).collect(),
        is_bigendian: layout.big,
        point_step: layout.step,
        row_step: layout.row_step.unwrap_or(width as u32 * layout.step),
        data,
        is_dense: layout.width == 0,
    };
    let endian = if layout.big {
        Endian::Big
    } else {
        Endian::Little
    };
    cdr::encode(&message, endian).unwrap()
}

pub fn pose(stamp_ns: u64, frame: &str, change: impl FnOnce(&mut Pose)) -> Vec<u8> {
    let mut pose = Pose::from(&Isometry3::translation(0.3, 0.0, 0.3));
    change(&mut pose);
    let header = header(stamp_ns, frame);
    cdr::encode(&PoseStamped { header, pose }, Endian::Little).unwrap()
}

pub fn jaw(stamp_ns: u64, position: &[f64]) -> Vec<u8> {
    let state = JointState {
        header: header(stamp_ns, ""),
        name: vec!["jaw".into()],
        position: position.to_vec(),
        velocity: Vec::new(),
        effort: Vec::new(),
    };
    cdr::encode(&state, Endian::Little).unwrap()
}
