//! The sinks of a live view: a file, and a viewer.
//!
//! Each sink has a stream and threads of its own, so that a viewer that was closed or does not respond does not affect the file. Logging does not
//! wait. A sink that fails is given up with a message; the run continues.

use crate::Error;
use re_sdk::external::re_uri::ProxyUri;
use re_sdk::sink::FileSinkError;
use re_sdk::{
    AsComponents, DEFAULT_CONNECT_URL, DEFAULT_SERVER_PORT, RecordingStream,
    RecordingStreamBuilder, RecordingStreamError, SpawnError, SpawnOptions, spawn,
};
use std::net::{TcpStream, ToSocketAddrs};
use std::path::Path;
use std::sync::mpsc;
use std::thread;
use std::time::{Duration, Instant};

/// The name of the application in the viewer.
pub(super) const APPLICATION: &str = "explore";
/// Time within which a listening viewer answers, or a started one listens.
const ANSWER: Duration = Duration::from_secs(3);
const START: Duration = Duration::from_secs(20);
/// Time within which logged data must be sent, between two manipulations and at the end.
const KEEP_UP: Duration = Duration::from_secs(5);
const FINISH: Duration = Duration::from_secs(30);

/// The viewer that shows a run.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub enum Viewer {
    /// None: only the file is written.
    None,
    /// The viewer on this machine; if none is open, the program `rerun` is started.
    #[default]
    Here,
    /// A viewer at `HOST`, `HOST:PORT` or `rerun+http://HOST:PORT/proxy`.
    At(String),
}

/// A stream and its name in messages.
struct Sink {
    name: String,
    stream: RecordingStream,
}

/// The working sinks, and messages about the others.
pub(super) struct Sinks {
    left: Vec<Sink>,
    remarks: Vec<String>,
}

impl Sinks {
    /// Creates the file, and connects to or starts the viewer.
    pub fn open(file: &Path, viewer: &Viewer, title: &str) -> Result<Self, Error> {
        let recording = || {
            RecordingStreamBuilder::new(APPLICATION)
                .enabled(true)
                .recording_name(title)
        };
        let mut left = Vec::new();
        let uri = match viewer {
            Viewer::None => None,
            Viewer::Here => Some(start()?),
            Viewer::At(address) => Some(find(address)?),
        };
        if let Some(uri) = uri {
            let stream = recording().connect_grpc_opts(uri.to_string());
            left.push(Sink {
                name: format!("the viewer at {}", uri.origin.as_url()),
                stream: stream.map_err(failed)?,
            });
        }
        let stream = recording().save(file).map_err(|error| match error {
            RecordingStreamError::FileSink(FileSinkError::CreateFile(path, why)) => {
                failed(format!("{}: {why}", path.display()))
            }
            other => failed(other),
        })?;
        left.push(Sink {
            name: file.display().to_string(),
            stream,
        });
        Ok(Self {
            left,
            remarks: Vec::new(),
        })
    }

    /// Sets the frame and the time, seconds, of what is logged next.
    pub fn at(&self, frame: u32, time: f64) {
        for sink in &self.left {
            sink.stream.set_time_sequence("frame", frame);
            sink.stream.set_duration_secs("time", time);
        }
    }

    /// Logs an entity at the present time.
    pub fn log(&mut self, entity: &str, what: &dyn AsComponents) {
        self.each(|stream| stream.log(entity, what).map_err(|e| e.to_string()));
    }

    /// Logs an entity for all times.
    pub fn log_static(&mut self, entity: &str, what: &dyn AsComponents) {
        self.each(|stream| stream.log_static(entity, what).map_err(|e| e.to_string()));
    }

    /// Gives up the sinks that fall behind or have failed.
    pub fn check(&mut self) {
        self.each(|stream| {
            let flushed = stream.flush_with_timeout(KEEP_UP);
            flushed.map_err(|e| e.to_string())
        });
    }

    /// Applies an action to every sink; one that fails is given up.
    pub fn each(&mut self, act: impl Fn(&RecordingStream) -> Result<(), String>) {
        let sinks = std::mem::take(&mut self.left);
        for sink in sinks {
            match act(&sink.stream) {
                Ok(()) => self.left.push(sink),
                Err(reason) => {
                    let name = &sink.name;
                    let remark = format!("live view: {name} is given up: {reason}");
                    self.remarks.push(remark);
                    // Flushing may never end.
                    let _unsaid = close(sink, Duration::ZERO);
                }
            }
        }
    }

    /// Messages since the last call about sinks that failed.
    pub fn take_remarks(&mut self) -> Vec<String> {
        std::mem::take(&mut self.remarks)
    }

    /// Waits until everything is written and sent; returns messages about sinks where this is uncertain.
    pub fn finish(mut self) -> Vec<String> {
        self.close();
        self.take_remarks()
    }

    fn close(&mut self) {
        for sink in std::mem::take(&mut self.left) {
            let remark = close(sink, FINISH);
            self.remarks.extend(remark);
        }
    }
}

/// A run that ends with an error keeps what was logged.
impl Drop for Sinks {
    fn drop(&mut self) {
        self.close();
    }
}

/// Closes a sink on a separate thread, which is abandoned after `patience`: the viewer may not respond.
fn close(sink: Sink, patience: Duration) -> Option<String> {
    let (done, when_done) = mpsc::channel();
    let Sink { name, stream } = sink;
    let closing = thread::Builder::new().spawn(move || {
        let flushed = stream.flush_with_timeout(FINISH);
        drop(stream);
        // The receiver may have given up.
        let _unheard = done.send(flushed.map_err(|e| e.to_string()));
    });
    let closed = match closing {
        Ok(_) => when_done.recv_timeout(patience),
        Err(error) => Ok(Err(error.to_string())),
    };
    match closed {
        Ok(Ok(())) => None,
        Ok(Err(reason)) => Some(format!("live view: {name} is incomplete: {reason}")),
        Err(_) => Some(format!(
            "live view: {name} is incomplete: it did not respond within {} s",
            patience.as_secs()
        )),
    }
}

/// The viewer at an address.
fn find(address: &str) -> Result<ProxyUri, Error> {
    let uri = parse(address)?;
    if let Err(reason) = answer(&uri) {
        return Err(failed(format!("no viewer answers at {address}: {reason}")));
    }
    Ok(uri)
}

/// The viewer on this machine, started if none listens.
fn start() -> Result<ProxyUri, Error> {
    let uri = parse(DEFAULT_CONNECT_URL)?;
    if answer(&uri).is_ok() {
        return Ok(uri);
    }
    // Messages of the viewer must not mix with ours.
    let options = SpawnOptions {
        extra_env: vec![("RUST_LOG".into(), "error".into())],
        ..SpawnOptions::default()
    };
    spawn(&options).map_err(|error| match error {
        SpawnError::ExecutableNotFoundInPath { .. } => failed(format!(
            "no viewer is open on this machine, and there is no program `rerun` to start one: pip install rerun-sdk=={}, or write only the file",
            re_sdk::build_info().version
        )),
        other => failed(other),
    })?;
    let asked = Instant::now();
    while answer(&uri).is_err() {
        if asked.elapsed() > START {
            return Err(failed(format!(
                "the program `rerun` was started, but does not listen at {} (it needs a display): give the address of another viewer, or write only the file",
                uri.origin.as_url()
            )));
        }
        thread::sleep(Duration::from_millis(100));
    }
    Ok(uri)
}

/// `HOST`, `HOST:PORT` or the address that the viewer shows.
fn parse(address: &str) -> Result<ProxyUri, Error> {
    let host = address.rsplit(']').next().unwrap_or(address);
    let text = if address.contains("://") {
        address.to_owned()
    } else if host.contains(':') {
        format!("rerun+http://{address}/proxy")
    } else {
        format!("rerun+http://{address}:{DEFAULT_SERVER_PORT}/proxy")
    };
    text.parse()
        .map_err(|error| failed(format!("{address} is not an address of a viewer: {error}")))
}

/// Whether something listens there.
fn answer(uri: &ProxyUri) -> std::io::Result<()> {
    let (host, port) = (uri.origin.host.to_string(), uri.origin.port);
    let host = host.trim_matches(['[', ']']);
    let mut last = std::io::Error::from(std::io::ErrorKind::AddrNotAvailable);
    for address in (host, port).to_socket_addrs()? {
        match TcpStream::connect_timeout(&address, ANSWER) {
            Ok(_) => return Ok(()),
            Err(error) => last = error,
        }
    }
    Err(last)
}

fn failed(reason: impl std::fmt::Display) -> Error {
    Error::LiveView {
        reason: reason.to_string(),
    }
}
