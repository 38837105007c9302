//! Compressed chunks: zstd by `ruzstd`, LZ4 frames by `lz4_flex`, both without a C library.
//!
//! ```text
//! zstd frame = magic · descriptor · window · dictionary · size · block* · checksum
//! block      = header(3 bytes: last(1 bit) · kind(2) · size(21)) · bytes
//! ```
//!
//! A chunk that a killed recorder left incomplete is decoded up to its last complete block. An LZ4 decoder returns
//! blocks one by one. A zstd decoder withholds data that later blocks may refer to until it has read the last block, so
//! the last complete block is marked as the last one first.

use std::io::{self, Read, Write};

use lz4_flex::frame::{BlockMode, BlockSize, FrameDecoder, FrameEncoder, FrameInfo};
use ruzstd::decoding::StreamingDecoder;
use ruzstd::encoding::{CompressionLevel, compress_to_vec};

/// Largest compressed chunk that is decoded, in bytes of its content, which is held in memory.
pub(super) const LARGEST: u64 = 128 << 20;

/// Compression of chunks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub enum Compression {
    /// None.
    #[default]
    None,
    /// LZ4 frames: fastest to read.
    Lz4,
    /// Zstandard at about the ratio of its level 1, the only one `ruzstd` implements.
    Zstd,
}

impl Compression {
    /// All variants.
    pub const ALL: [Self; 3] = [Self::None, Self::Lz4, Self::Zstd];

    /// Its name in an MCAP file.
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "",
            Self::Lz4 => "lz4",
            Self::Zstd => "zstd",
        }
    }

    pub(super) fn of_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|known| known.name() == name)
    }

    /// The compressed form of `content`.
    pub(super) fn compress(self, content: Vec<u8>) -> io::Result<Vec<u8>> {
        match self {
            Self::None => Ok(content),
            Self::Lz4 => {
                // Small blocks, so that a truncated chunk is lost only from the cut on.
                let info = FrameInfo::new()
                    .block_size(BlockSize::Max64KB)
                    .block_mode(BlockMode::Linked);
                let mut encoder = FrameEncoder::with_frame_info(info, Vec::new());
                encoder.write_all(&content)?;
                encoder.finish().map_err(io::Error::other)
            }
            Self::Zstd => Ok(compress_to_vec(
                content.as_slice(),
                CompressionLevel::Fastest,
            )),
        }
    }

    /// Reads from `source` until `size` bytes are decoded, or one byte more to detect a wrong size. Bytes decoded
    /// before an error stay in `content`. Memory grows with the decoded bytes, not with the stated `size`.
    pub(super) fn decompress(
        self,
        source: &mut dyn Read,
        length: u64,
        size: u64,
        content: &mut Vec<u8>,
    ) -> io::Result<()> {
        let mut source = source.take(length);
        // Several consecutive frames are one stream.
        while source.limit() > 0 && content.len() as u64 <= size {
            let left = size + 1 - content.len() as u64;
            let before = source.limit();
            match self {
                Self::None => source.by_ref().take(left).read_to_end(content),
                Self::Lz4 => {
                    let decoder = FrameDecoder::new(&mut source);
                    decoder.take(left).read_to_end(content)
                }
                Self::Zstd => {
                    let decoder = StreamingDecoder::new_with_max_window_size(&mut source, LARGEST);
                    let decoder = decoder.map_err(io::Error::other)?;
                    decoder.take(left).read_to_end(content)
                }
            }?;
            if source.limit() == before {
                break;
            }
        }
        Ok(())
    }
}

/// Length of the header of a zstd block.
const BLOCK_HEADER: usize = 3;
const BLOCK_KIND_RLE: u32 = 1;

/// Marks the last complete block of a truncated zstd frame as its last one, and drops the rest; false when there
/// is none.
pub(super) fn close_zstd_frame(frame: &mut Vec<u8>) -> bool {
    let Some(mut at) = zstd_header_length(frame) else {
        return false;
    };
    let mut last = None;
    while let Some(&[a, b, c]) = frame
        .get(at..)
        .and_then(<[u8]>::first_chunk::<BLOCK_HEADER>)
    {
        let header = u32::from_le_bytes([a, b, c, 0]);
        let (kind, size) = (header >> 1 & 3, (header >> 3) as usize);
        let stored = if kind == BLOCK_KIND_RLE { 1 } else { size };
        let end = at + BLOCK_HEADER + stored;
        if end > frame.len() {
            break;
        }
        last = Some((at, end));
        if header & 1 == 1 {
            break;
        }
        at = end;
    }
    let Some((start, end)) = last else {
        return false;
    };
    frame.truncate(end);
    frame[start] |= 1;
    // Without a checksum.
    frame[4] &= !0b100;
    true
}

/// Bytes before the first block.
fn zstd_header_length(frame: &[u8]) -> Option<usize> {
    const MAGIC: [u8; 4] = [0x28, 0xB5, 0x2F, 0xFD];
    let descriptor = *frame.strip_prefix(&MAGIC)?.first()?;
    let single_segment = descriptor >> 5 & 1 == 1;
    let dictionary = [0, 1, 2, 4][usize::from(descriptor & 3)];
    let size = match descriptor >> 6 {
        0 => usize::from(single_segment),
        1 => 2,
        2 => 4,
        _ => 8,
    };
    Some(MAGIC.len() + 1 + usize::from(!single_segment) + dictionary + size)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests")]
    use super::*;

    fn decoded(compression: Compression, bytes: &[u8], size: usize) -> (io::Result<()>, Vec<u8>) {
        let mut content = Vec::new();
        let length = bytes.len() as u64;
        let result = compression.decompress(&mut &*bytes, length, size as u64, &mut content);
        (result, content)
    }

    /// Text that compresses, several blocks long.
    fn text() -> Vec<u8> {
        (0..60_000_u32)
            .flat_map(|i| (i / 7).to_le_bytes())
            .chain((0..255).cycle().take(200_000))
            .collect()
    }

    #[test]
    fn what_is_compressed_is_decompressed() {
        for compression in Compression::ALL {
            for content in [vec![], vec![7; 1], vec![0; 1 << 20], text()] {
                let packed = compression.compress(content.clone()).unwrap();
                let (result, found) = decoded(compression, &packed, content.len());
                result.unwrap();
                assert!(found == content);
                // Two frames are one stream; a size that is too small is betrayed by one byte more.
                let twice = [packed.clone(), packed].concat();
                assert!(decoded(compression, &twice, 2 * content.len()).1 == content.repeat(2));
                if let Some(less) = content.len().checked_sub(1) {
                    assert_eq!(decoded(compression, &twice, less).1.len(), content.len());
                }
            }
        }
    }

    #[test]
    fn a_cut_frame_is_decoded_to_its_last_whole_block() {
        let content = text();
        for compression in [Compression::Lz4, Compression::Zstd] {
            let packed = compression.compress(content.clone()).unwrap();
            let mut longest = 0;
            for length in (0..packed.len()).step_by(997) {
                let mut cut = packed[..length].to_vec();
                if compression == Compression::Zstd && !close_zstd_frame(&mut cut) {
                    continue;
                }
                let (_, found) = decoded(compression, &cut, content.len());
                assert!(content.starts_with(&found));
                assert!(found.len() >= longest);
                longest = found.len();
            }
            assert!(longest >= 128 << 10, "{compression:?}: {longest}");
        }
    }
}
