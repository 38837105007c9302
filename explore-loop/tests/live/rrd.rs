//! What is in a file for the Rerun viewer, by the reader of its makers.

use re_sdk::external::re_log_encoding::DecoderApp;
use re_sdk::log::{Chunk, LogMsg};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

/// A row: what is known of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// Frame and time in nanoseconds; nothing for what holds at all times.
    pub at: Option<(i64, i64)>,
    /// How many values each component has, by its name.
    pub values: BTreeMap<String, usize>,
    /// The first number of a curve.
    pub scalar: Option<f64>,
}

/// The rows of each entity in the order of their frames.
pub type Rows = BTreeMap<String, Vec<Row>>;

/// Reads the recording, and the paths in the layout.
pub fn read(path: &Path) -> (Rows, Vec<String>) {
    try_read(path).unwrap()
}

/// The same of a file that may not be whole yet.
pub fn try_read(path: &Path) -> Result<(Rows, Vec<String>), String> {
    let mut rows = Rows::new();
    let mut layout = Vec::new();
    let file = BufReader::new(File::open(path).map_err(|e| e.to_string())?);
    for message in DecoderApp::decode_lazy(file) {
        let LogMsg::ArrowMsg(store, message) = message.map_err(|e| e.to_string())? else {
            continue;
        };
        let chunk = Chunk::from_arrow_msg(&message).unwrap();
        let entity = chunk.entity_path().to_string();
        if !store.is_recording() {
            layout.push(entity);
            continue;
        }
        for row in 0..chunk.num_rows() {
            rows.entry(entity.clone())
                .or_default()
                .push(of(&chunk, row));
        }
    }
    for entity in rows.values_mut() {
        entity.sort_by_key(|row| row.at);
    }
    Ok((rows, layout))
}

fn of(chunk: &Chunk, row: usize) -> Row {
    let time = |name: &str| {
        let times = chunk.timelines().iter().find(|(n, _)| n.as_str() == name);
        times.map(|(_, column)| column.times_raw()[row])
    };
    let mut values = BTreeMap::new();
    let mut scalar = None;
    for component in chunk.components_identifiers() {
        let Some(Ok(array)) = chunk.component_batch_raw(component, row) else {
            continue;
        };
        if component.as_str().ends_with("Scalars:scalars") {
            scalar = chunk
                .iter_slices::<f64>(component)
                .nth(row)
                .and_then(|s| s.first().copied());
        }
        values.insert(component.to_string(), array.len());
    }
    Row {
        at: time("frame").zip(time("time")),
        values,
        scalar,
    }
}
