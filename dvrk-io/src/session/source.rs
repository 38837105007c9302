//! The bytes of a session: in memory, in a file, or in the files of a rosbag2 directory.
//!
//! A rosbag2 directory contains `metadata.yaml` and the files listed there under `relative_file_paths`. A killed recorder
//! leaves no `metadata.yaml`: then every `.mcap` file of the directory is used. Only two lists and two values are
//! read from `metadata.yaml`, line by line: its layout is always the same, and a YAML library could be made to recurse
//! deeply.

use std::fs::File;
use std::io::{BufReader, Cursor, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use crate::Error;

/// The files of a session, in the order of their recording.
#[derive(Debug, Clone)]
pub(super) enum Source<'a> {
    Bytes(&'a [u8]),
    Files(Vec<PathBuf>),
}

trait ReadSeek: Read + Seek + Send {}
impl<T: Read + Seek + Send> ReadSeek for T {}

/// One open file.
pub(super) struct Input<'a> {
    stream: Box<dyn ReadSeek + 'a>,
    /// Present offset of the stream.
    position: u64,
    length: u64,
    path: PathBuf,
}

impl Source<'static> {
    /// # Errors
    /// The path does not exist, or is a directory without MCAP files.
    pub(super) fn of_path(path: &Path) -> Result<Self, Error> {
        if path.is_dir() {
            bag_files(path).map(Self::Files)
        } else {
            Ok(Self::Files(vec![path.to_owned()]))
        }
    }
}

impl<'a> Source<'a> {
    pub(super) fn parts(&self) -> usize {
        match self {
            Self::Bytes(_) => 1,
            Self::Files(files) => files.len(),
        }
    }

    pub(super) fn path(&self, part: usize) -> PathBuf {
        match self {
            Self::Bytes(_) => PathBuf::new(),
            Self::Files(files) => files.get(part).cloned().unwrap_or_default(),
        }
    }

    pub(super) fn open(&self, part: usize) -> Result<Input<'a>, Error> {
        let path = self.path(part);
        let (stream, length): (Box<dyn ReadSeek + 'a>, _) = match self {
            Self::Bytes(bytes) => (Box::new(Cursor::new(*bytes)), bytes.len() as u64),
            Self::Files(_) => {
                let opened = File::open(&path).and_then(|file| Ok((file.metadata()?, file)));
                let (metadata, file) = opened.map_err(|error| io_error(&path, error))?;
                (Box::new(BufReader::new(file)), metadata.len())
            }
        };
        Ok(Input {
            stream,
            position: 0,
            length,
            path,
        })
    }
}

impl Input<'_> {
    pub(super) fn length(&self) -> u64 {
        self.length
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// A reader at offset `at`; the recorded offset becomes invalid.
    pub(super) fn stream_at(&mut self, at: u64) -> Result<&mut dyn Read, Error> {
        self.seek(at)?;
        self.position = u64::MAX;
        Ok(&mut self.stream)
    }

    /// Replaces `buffer` by the `length` bytes at `at`, or by fewer if the file ends.
    pub(super) fn read(&mut self, at: u64, length: u64, buffer: &mut Vec<u8>) -> Result<(), Error> {
        buffer.clear();
        self.seek(at)?;
        let read = (&mut self.stream).take(length).read_to_end(buffer);
        self.position = at + read.map_err(|error| io_error(&self.path, error))? as u64;
        Ok(())
    }

    fn seek(&mut self, at: u64) -> Result<(), Error> {
        if self.position != at {
            // The recorded offset is invalid after an error.
            self.position = u64::MAX;
            let sought = self.stream.seek(SeekFrom::Start(at));
            self.position = sought.map_err(|error| io_error(&self.path, error))?;
        }
        Ok(())
    }
}

pub(super) fn io_error(path: &Path, error: std::io::Error) -> Error {
    Error::Io {
        path: path.to_owned(),
        error,
    }
}

const METADATA: &str = "metadata.yaml";

fn bag_files(folder: &Path) -> Result<Vec<PathBuf>, Error> {
    let metadata = folder.join(METADATA);
    match std::fs::read_to_string(&metadata) {
        Ok(text) => listed_files(folder, &metadata, &text),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => unlisted_files(folder),
        Err(error) => Err(io_error(&metadata, error)),
    }
}

fn listed_files(folder: &Path, metadata: &Path, text: &str) -> Result<Vec<PathBuf>, Error> {
    let bad = |reason: String| Error::BadBag {
        path: metadata.to_owned(),
        reason,
    };
    let storage = scalar(text, "storage_identifier").unwrap_or_default();
    if storage != "mcap" {
        return Err(bad(format!(
            "its storage is `{storage}`, but only mcap is supported; convert it with `ros2 bag convert`"
        )));
    }
    let mode = scalar(text, "compression_mode").unwrap_or_default();
    if !mode.is_empty() && !mode.eq_ignore_ascii_case("none") {
        return Err(bad(format!(
            "compression mode `{mode}` hides whole files or messages from an MCAP reader: record with \
             compressed chunks instead (--storage-preset-profile zstd_fast)"
        )));
    }
    let names = list(text, "relative_file_paths");
    if names.is_empty() {
        return Err(bad("it lists no files under relative_file_paths".to_owned()));
    }
    Ok(names.iter().map(|name| inside(folder, name)).collect())
}

/// Old recorders list `bag/bag_0.mcap`, relative to the parent of the directory.
fn inside(folder: &Path, name: &str) -> PathBuf {
    let direct = folder.join(name);
    match Path::new(name).file_name() {
        Some(file) if !direct.exists() => folder.join(file),
        _ => direct,
    }
}

/// `…_10` sorts after `…_9`: shorter names first.
fn unlisted_files(folder: &Path) -> Result<Vec<PathBuf>, Error> {
    let entries = std::fs::read_dir(folder).and_then(Iterator::collect::<Result<Vec<_>, _>>);
    let entries = entries.map_err(|error| io_error(folder, error))?;
    let is_mcap = |path: &PathBuf| {
        path.extension()
            .is_some_and(|extension| extension == "mcap")
    };
    let mut files: Vec<_> = entries
        .iter()
        .map(std::fs::DirEntry::path)
        .filter(is_mcap)
        .collect();
    files.sort_by_key(|path| (path.as_os_str().len(), path.clone()));
    if files.is_empty() {
        return Err(Error::BadBag {
            path: folder.to_owned(),
            reason: format!("the directory has neither {METADATA} nor .mcap files"),
        });
    }
    Ok(files)
}

/// The value after `key:` on a line.
fn scalar(text: &str, key: &str) -> Option<String> {
    let value = |line: &str| Some(unquoted(line.trim().strip_prefix(key)?.strip_prefix(':')?));
    text.lines().find_map(value)
}

/// The items after `key:`, either `- item` on the next lines or `[item, item]` on the same line.
fn list(text: &str, key: &str) -> Vec<String> {
    if let Some(value) = scalar(text, key).filter(|value| !value.is_empty()) {
        let items = value
            .trim_start_matches('[')
            .trim_end_matches(']')
            .split(',');
        return items
            .map(unquoted)
            .filter(|item| !item.is_empty())
            .collect();
    }
    let below = text
        .lines()
        .skip_while(|line| !line.trim().starts_with(key))
        .skip(1);
    let item = |line: &str| line.trim().strip_prefix("- ").map(unquoted);
    below.map_while(item).collect()
}

fn unquoted(value: &str) -> String {
    let value = value.trim();
    let inner = |quote| value.strip_prefix(quote)?.strip_suffix(quote);
    inner('"')
        .or_else(|| inner('\''))
        .unwrap_or(value)
        .to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_ways_to_lay_out_a_list() {
        let block = "a:\n  relative_file_paths:\n    - \"b_0.mcap\"\n    - b_1.mcap\n  duration:\n    - x\n";
        let flow = "relative_file_paths: ['b_0.mcap', b_1.mcap]\n";
        for text in [block, flow] {
            assert_eq!(list(text, "relative_file_paths"), ["b_0.mcap", "b_1.mcap"]);
        }
        assert!(list("relative_file_paths: []", "relative_file_paths").is_empty());
        assert_eq!(
            scalar("  storage_identifier: \"mcap\"", "storage_identifier").as_deref(),
            Some("mcap")
        );
    }
}
