//! How long a computation took: processor time where the system tells it (Linux, one thread), so that other programs on the machine do not
//! count; otherwise wall time.

use std::time::Instant;

/// A running stopwatch.
pub struct Stopwatch {
    wall: Instant,
    processor: Option<f64>,
}

impl Stopwatch {
    pub fn start() -> Self {
        Self {
            wall: Instant::now(),
            processor: processor_ms(),
        }
    }

    /// Milliseconds since the start.
    pub fn ms(&self) -> f64 {
        match (self.processor, processor_ms()) {
            (Some(start), Some(end)) => end - start,
            _ => 1e3 * self.wall.elapsed().as_secs_f64(),
        }
    }
}

/// Processor time of this thread.
fn processor_ms() -> Option<f64> {
    if cfg!(feature = "rayon") {
        return None;
    }
    // The system brings its account up to date when a thread yields.
    std::thread::yield_now();
    let account = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?;
    let nanoseconds: f64 = account.split_whitespace().next()?.parse().ok()?;
    Some(1e-6 * nanoseconds)
}
