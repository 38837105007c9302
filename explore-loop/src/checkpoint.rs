//! A file from which an interrupted run is resumed.
//!
//! ```text
//! EXPLORER   version   length of the content   blocks: up to 65,536 bytes of the content, then their CRC-32
//! 8 bytes    u32       u64                                                            u32          (little endian)
//! ```
//! A checkpoint is written beside the previous one and then renamed: at any moment there is a whole one, or none yet. The version changes with the
//! content, and a checkpoint of another version is rejected. Every block has a checksum, so that an error names the damaged bytes.

use crate::Error;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::fs::File;
use std::io::Write;
use std::path::Path;

/// The version that is written and read.
pub const VERSION: u32 = 10;

const MAGIC: &[u8; 8] = b"EXPLORER";
const HEAD: usize = 20;
const BLOCK: usize = 65_536;

/// Why a checkpoint was rejected.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CheckpointError {
    /// The file cannot be read.
    #[error(transparent)]
    Unreadable(#[from] std::io::Error),
    /// It is another kind of file.
    #[error("byte {byte}: this is not a checkpoint")]
    Foreign {
        /// First byte that differs.
        byte: usize,
    },
    /// It was written by another version of the program.
    #[error(
        "byte 8: a checkpoint of version {found}; this program resumes only from version {VERSION}"
    )]
    Version {
        /// Its version.
        found: u32,
    },
    /// It is too short or too long.
    #[error("byte {found}: the checkpoint ends here, but should have {expected} bytes")]
    Length {
        /// Its length, bytes.
        found: usize,
        /// The expected length, bytes.
        expected: u64,
    },
    /// A block does not match its checksum.
    #[error("bytes {from} to {to}: damaged: the checksum does not match")]
    Damaged {
        /// First byte of the block.
        from: usize,
        /// Last byte of the block.
        to: usize,
    },
    /// The content is not in the form that this program writes.
    #[error("byte {HEAD}: the content cannot be read: {reason}")]
    Content {
        /// The reason.
        reason: String,
    },
}

/// Writes a checkpoint atomically: on an error, the previous file stays.
///
/// # Errors
/// [`Error::Write`] with the file; [`Error::Resume`] when the content cannot be serialised.
///
/// ```
/// use explore_loop::{Error, checkpoint};
///
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("checkpoint.bin");
/// let content = (7_u32, vec![0.5, 0.25]);
/// checkpoint::write(&path, &content)?;
/// assert_eq!(checkpoint::read::<(u32, Vec<f64>)>(&path)?, content);
///
/// // One damaged bit is found.
/// let mut bytes = std::fs::read(&path)?;
/// bytes[24] ^= 1;
/// std::fs::write(&path, bytes)?;
/// assert!(matches!(checkpoint::read::<(u32, Vec<f64>)>(&path), Err(Error::Checkpoint { .. })));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn write(path: &Path, content: &impl Serialize) -> Result<(), Error> {
    let content = postcard::to_allocvec(content).map_err(|error| Error::Resume {
        reason: error.to_string(),
    })?;
    let mut bytes = MAGIC.to_vec();
    bytes.extend(VERSION.to_le_bytes());
    bytes.extend((content.len() as u64).to_le_bytes());
    for block in content.chunks(BLOCK) {
        bytes.extend(block);
        bytes.extend(crc32fast::hash(block).to_le_bytes());
    }
    let mut name = path.as_os_str().to_owned();
    name.push(".part");
    let aside = Path::new(&name);
    let written = File::create(aside).and_then(|mut file| {
        file.write_all(&bytes)?;
        file.sync_all()
    });
    let renamed = written.and_then(|()| std::fs::rename(aside, path));
    renamed.map_err(|error| Error::Write {
        path: path.to_owned(),
        error,
    })
}

/// Reads a checkpoint.
///
/// # Errors
/// [`Error::Checkpoint`] with the file and the byte at which it is not a complete checkpoint of this version.
pub fn read<T: DeserializeOwned>(path: &Path) -> Result<T, Error> {
    std::fs::read(path)
        .map_err(CheckpointError::from)
        .and_then(|bytes| parse(&bytes))
        .map_err(|error| Error::Checkpoint {
            path: path.to_owned(),
            error,
        })
}

fn parse<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, CheckpointError> {
    let differs = MAGIC.iter().zip(bytes).position(|(a, b)| a != b);
    if let Some(byte) = differs.or((bytes.len() < HEAD).then_some(bytes.len())) {
        return Err(CheckpointError::Foreign { byte });
    }
    let number = |from: usize, count: usize| {
        let mut wide = [0; 8];
        wide[..count].copy_from_slice(&bytes[from..from + count]);
        u64::from_le_bytes(wide)
    };
    let (found, length) = (number(8, 4) as u32, number(12, 8));
    if found != VERSION {
        return Err(CheckpointError::Version { found });
    }
    let expected = (HEAD as u64)
        .saturating_add(length)
        .saturating_add(length.div_ceil(BLOCK as u64).saturating_mul(4));
    if expected != bytes.len() as u64 {
        let found = bytes.len();
        return Err(CheckpointError::Length { found, expected });
    }
    let mut content = Vec::with_capacity(length as usize);
    let mut from = HEAD;
    for block in bytes[HEAD..].chunks(BLOCK + 4) {
        let (data, sum) = block.split_at(block.len() - 4);
        if crc32fast::hash(data).to_le_bytes() != *sum {
            let to = from + block.len() - 1;
            return Err(CheckpointError::Damaged { from, to });
        }
        content.extend(data);
        from += block.len();
    }
    postcard::from_bytes(&content).map_err(|error| CheckpointError::Content {
        reason: error.to_string(),
    })
}

#[cfg(test)]
mod tests {
    use super::{BLOCK, CheckpointError, HEAD, parse, read, write};

    /// Every byte counts: whichever is changed or missing, the file is refused, with the place.
    #[test]
    fn damage_is_found_where_it_is() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("checkpoint.bin");
        let content: Vec<f64> = (0..20_000).map(f64::from).collect();
        write(&path, &content)?;
        assert_eq!(read::<Vec<f64>>(&path)?, content);
        let whole = std::fs::read(&path)?;
        for byte in (0..whole.len()).step_by(997).chain(0..HEAD) {
            let mut broken = whole.clone();
            broken[byte] ^= 0x10;
            match parse::<Vec<f64>>(&broken) {
                Err(CheckpointError::Damaged { from, to }) => assert!((from..=to).contains(&byte)),
                Err(CheckpointError::Foreign { byte: found }) => assert_eq!(found, byte),
                Err(CheckpointError::Version { .. }) => assert!((8..12).contains(&byte)),
                Err(CheckpointError::Length { .. }) => assert!((12..HEAD).contains(&byte)),
                other => return Err(format!("byte {byte}: {other:?}").into()),
            }
        }
        for length in [0, 1, 7, 8, HEAD - 1, HEAD, BLOCK, whole.len() - 1] {
            assert!(
                parse::<Vec<f64>>(&whole[..length]).is_err(),
                "{length} bytes"
            );
        }
        assert!(parse::<Vec<f64>>(&[&whole[..], &[0]].concat()).is_err());
        Ok(())
    }
}
