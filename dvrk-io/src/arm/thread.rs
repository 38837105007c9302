//! An arm driven by a thread of its own.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use super::driver::Arm;
use crate::Error;
use crate::transport::Transport;

/// An arm with a thread that ticks it once a period. Motions are started on the [locked](ArmThread::lock) arm; they are executed and
/// monitored while the lock is free.
///
/// When it is dropped, the arm is told to hold and the thread ends. Hold the lock only briefly: without ticks there are no checks.
pub struct ArmThread {
    arm: Arc<Mutex<Arm>>,
    transport: Arc<dyn Transport>,
    period: Duration,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl std::fmt::Debug for ArmThread {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ArmThread")
            .field("period", &self.period)
            .finish_non_exhaustive()
    }
}

fn lock(arm: &Mutex<Arm>) -> MutexGuard<'_, Arm> {
    // An arm is consistent between any two of its calls; one whose call panicked must still be held.
    arm.lock().unwrap_or_else(PoisonError::into_inner)
}

impl ArmThread {
    /// Starts to drive a connected arm.
    ///
    /// # Errors
    /// [`Error::Network`]: the system cannot start a thread.
    pub fn spawn(arm: Arm) -> Result<Self, Error> {
        Self::spawn_watched(arm, |_| ())
    }

    /// The same, with a callback after each tick, for reactions that must not wait for the owner, such as a hold when another
    /// arm is in trouble ([`Arm::last_stop`], [`Arm::unready`]). The callback must be short.
    ///
    /// # Errors
    /// See [`ArmThread::spawn`].
    pub fn spawn_watched(
        arm: Arm,
        mut look: impl FnMut(&mut Arm) + Send + 'static,
    ) -> Result<Self, Error> {
        let (transport, period) = (Arc::clone(&arm.transport), arm.options.period);
        let name = arm.name.clone();
        let arm = Arc::new(Mutex::new(arm));
        let stop = Arc::new(AtomicBool::new(false));
        let its = (Arc::clone(&arm), Arc::clone(&stop), Arc::clone(&transport));
        let run = move || {
            let (arm, stop, transport) = its;
            while !stop.load(Ordering::Relaxed) {
                let next = transport.now() + period;
                let mut arm = lock(&arm);
                arm.tick();
                look(&mut arm);
                drop(arm);
                while transport.now() < next {
                    transport.wait(next);
                }
            }
        };
        let thread = std::thread::Builder::new().name(name).spawn(run);
        let thread = thread.map_err(|error| Error::Network {
            what: "thread",
            reason: error.to_string(),
        })?;
        Ok(Self {
            arm,
            transport,
            period,
            stop,
            thread: Some(thread),
        })
    }

    /// The arm between two ticks: to start a motion, to read, to hold.
    pub fn lock(&self) -> MutexGuard<'_, Arm> {
        lock(&self.arm)
    }

    /// Waits until the current motion has ended.
    ///
    /// # Errors
    /// See [`Arm::wait`]; [`Error::Network`] when the thread has ended by a panic (of a transport): the arm is told to hold.
    pub fn wait(&self, timeout: Duration) -> Result<(), Error> {
        let end = self.transport.now() + timeout;
        loop {
            {
                let mut arm = self.lock();
                // The panic poisons the lock before the thread has ended.
                let ended = self.thread.as_ref().is_none_or(JoinHandle::is_finished);
                if ended || self.arm.is_poisoned() {
                    // Nothing is sent or checked any more.
                    arm.hold();
                    return Err(Error::Network {
                        what: "thread of the arm",
                        reason: "it panicked".to_owned(),
                    });
                }
                if !arm.is_moving() {
                    return arm.outcome();
                }
                if self.transport.now() >= end {
                    return Err(arm.late("the motion", timeout));
                }
            }
            self.transport.wait(self.transport.now() + self.period / 2);
        }
    }

    /// Ends the thread and [releases](Arm::release) the arm.
    pub fn release(self) {
        drop(self);
    }
}

impl Drop for ArmThread {
    fn drop(&mut self) {
        self.lock().hold();
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // The panic of the thread has been handled by holding the arm.
            drop(thread.join());
        }
    }
}
