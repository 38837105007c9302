//! Runs jobs, each in processes of its own, and keeps their results.
//!
//! ```text
//! job    lock ─► run (from its checkpoint, if it was interrupted) ─► a replay for each row that asks for one ─► result ─► folder removed
//! ```
//! A finished job is never run again. The processes of the job hold the lock too: another study, or this one after its program was killed, leaves the
//! job alone for as long as any of them works in its folder.

use super::job::Job;
use super::progress::Progress;
use super::result::{Done, Ran};
use super::study::Row;
use crate::Failure;
use crate::recorder::interruption;
use explore_loop::report::metrics::Metrics;
use mesh_io::program::Output;
use std::collections::VecDeque;
use std::fs::{File, TryLockError};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Interval between two checks of a process.
const POLL: Duration = Duration::from_millis(20);
/// How long processes may take to end by themselves when the study is interrupted.
const PATIENCE: Duration = Duration::from_secs(20);
/// Exit code of a program that panicked, and of one that did not understand its command line.
const PANICKED: i32 = 101;
const MISUNDERSTOOD: i32 = 2;

/// Runs jobs in a folder.
pub(super) struct Runner<'a> {
    program: PathBuf,
    out: &'a Path,
    output: Output,
    interrupted: Arc<AtomicBool>,
}

/// The outcome of trying a job.
enum Attempt {
    Done(Done),
    /// Another process is running it.
    Busy,
    Interrupted,
    /// It failed for a reason that says nothing about the method.
    Failed(String),
}

/// The outcome of a process.
enum Step {
    Ended(Option<Box<Metrics>>, Option<String>),
    Interrupted,
    Failed(String),
}

impl<'a> Runner<'a> {
    pub fn new(out: &'a Path, output: Output) -> Result<Self, Failure> {
        Ok(Self {
            program: std::env::current_exe()?,
            out,
            output,
            interrupted: interruption()?,
        })
    }

    /// Runs the jobs that are not finished, `at_a_time` in parallel; returns whether all are finished now.
    pub fn carry_out(&self, jobs: Vec<Job>, at_a_time: usize) -> Result<bool, Failure> {
        let progress = Mutex::new(Progress::new(self.out, &jobs, at_a_time, self.output)?);
        let mut open = VecDeque::new();
        for job in jobs {
            if done(self.out, &job)?.is_none() {
                open.push_back(job);
            }
        }
        lock(&progress).begin();
        let (open, whole) = (Mutex::new(open), AtomicBool::new(true));
        let work = || -> Result<(), String> {
            while let Some(job) = next(&open) {
                match self
                    .attempt(&job)
                    .map_err(|e| format!("{}: {e}", job.words()))?
                {
                    Attempt::Done(result) => lock(&progress).done(&job, &result),
                    Attempt::Busy => {
                        lock(&open).push_back(job);
                        std::thread::sleep(10 * POLL);
                    }
                    Attempt::Failed(why) => {
                        lock(&progress).failed(&job, &why);
                        whole.store(false, Ordering::Relaxed);
                    }
                    Attempt::Interrupted => whole.store(false, Ordering::Relaxed),
                }
                if self.interrupted.load(Ordering::Relaxed) {
                    break;
                }
            }
            Ok(())
        };
        let outcomes: Vec<Result<(), String>> = std::thread::scope(|scope| {
            let workers: Vec<_> = (0..at_a_time).map(|_| scope.spawn(work)).collect();
            let joined = workers.into_iter().map(std::thread::ScopedJoinHandle::join);
            joined
                .map(|outcome| outcome.unwrap_or_else(|_| Err("a worker panicked".into())))
                .collect()
        });
        outcomes.into_iter().collect::<Result<(), String>>()?;
        if self.interrupted.load(Ordering::Relaxed) {
            return Err("interrupted; the same command continues".into());
        }
        Ok(whole.into_inner())
    }

    fn attempt(&self, job: &Job) -> Result<Attempt, Failure> {
        let work = job.work(self.out);
        std::fs::create_dir_all(&work)?;
        let held = File::options()
            .create(true)
            .append(true)
            .open(work.join("lock"))?;
        match held.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => return Ok(Attempt::Busy),
            Err(TryLockError::Error(error)) => return Err(error.into()),
        }
        // The previous holder of the lock may have finished it.
        if let Some(result) = done(self.out, job)? {
            return Ok(Attempt::Done(result));
        }
        let started = Instant::now();
        let runs = match self.runs(job, &work, &held)? {
            Ok(runs) => runs,
            Err(ended) => return Ok(ended),
        };
        // The metrics of a resumed run include the time before.
        let told = runs.iter().filter_map(|ran| ran.metrics.as_ref());
        let told: f64 = told.map(|metrics| metrics.wall_s).sum();
        let result = Done {
            study: job.study.into(),
            seed: job.seed,
            seconds: started.elapsed().as_secs_f64().max(told),
            version: env!("CARGO_PKG_VERSION").into(),
            runs,
        };
        let path = job.result(self.out);
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder)?;
        }
        result.write(&path)?;
        std::fs::remove_dir_all(&work)?;
        Ok(Attempt::Done(result))
    }

    /// The run and the replays of a job.
    fn runs(
        &self,
        job: &Job,
        work: &Path,
        held: &File,
    ) -> Result<Result<Vec<Ran>, Attempt>, Failure> {
        let folder = work.join("run");
        let explored = self.step(&run_words(job), &folder, held)?;
        if job.rows.iter().all(|row| row.replay.is_none()) {
            return Ok(explored.of_rows(job));
        }
        if let Step::Interrupted | Step::Failed(_) = explored {
            return Ok(explored.of_rows(job));
        }
        let mut runs = Vec::new();
        for (k, row) in job.rows.iter().enumerate() {
            let session = folder.join("session.mcap").display().to_string();
            let words = [
                vec!["replay".into(), session],
                row.replay.clone().unwrap_or_default(),
            ]
            .concat();
            let replayed = self.step(&words, &work.join(format!("replay_{k}")), held)?;
            let of_row = Job {
                rows: vec![row.clone()],
                ..job.clone()
            };
            match replayed.of_rows(&of_row) {
                Ok(ran) => runs.extend(ran),
                Err(ended) => return Ok(Err(ended)),
            }
        }
        Ok(Ok(runs))
    }

    /// Runs the program in a folder; an interrupted run there is resumed.
    fn step(&self, words: &[String], folder: &Path, held: &File) -> Result<Step, Failure> {
        let runs = words[0] == "run";
        let resumes = runs && folder.join("checkpoint.bin").is_file();
        if !resumes {
            remove(folder)?;
        }
        std::fs::create_dir_all(folder)?;
        let (metrics, log) = (folder.join("metrics.json"), folder.join("errors.txt"));
        let mut command = Command::new(&self.program);
        command.args(words).args(["--quiet", "--out"]).arg(folder);
        if resumes {
            command.arg("--resume");
        }
        // The lock is passed as standard input: it is released when the last process that holds it ends.
        command
            .stdin(Stdio::from(held.try_clone()?))
            .stdout(Stdio::null());
        let mut child = command.stderr(File::create(&log)?).spawn()?;
        let status = self.wait(&mut child)?;
        let said = std::fs::read_to_string(&log).unwrap_or_default();
        let said = said
            .lines()
            .rfind(|line| !line.trim().is_empty())
            .unwrap_or_default()
            .to_owned();
        if let Some(metrics) = read(&metrics)? {
            return Ok(Step::Ended(Some(Box::new(metrics)), None));
        }
        let asked = self.interrupted.load(Ordering::Relaxed);
        if asked || said.starts_with("error: interrupted") {
            return Ok(Step::Interrupted);
        }
        if resumes {
            // The files there cannot be resumed from.
            remove(folder)?;
            return self.step(words, folder, held);
        }
        Ok(match status.code() {
            Some(PANICKED) => Step::Ended(None, Some(format!("panicked: {said}"))),
            // A replay leaves no metrics when an error ends it; a run does, but for what keeps it from starting.
            Some(code) if !runs && code != MISUNDERSTOOD => Step::Ended(None, Some(said)),
            Some(_) => Step::Failed(said),
            None => Step::Failed(format!("{status}")),
        })
    }

    /// Waits for a process; after an interruption only for a short time.
    fn wait(&self, child: &mut Child) -> Result<ExitStatus, Failure> {
        let mut asked: Option<Instant> = None;
        loop {
            if let Some(status) = child.try_wait()? {
                return Ok(status);
            }
            if self.interrupted.load(Ordering::Relaxed) {
                // Ctrl-C at the terminal has reached the process as well.
                let since = *asked.get_or_insert_with(Instant::now);
                if since.elapsed() > PATIENCE {
                    child.kill()?;
                }
            }
            std::thread::sleep(POLL);
        }
    }
}

impl Step {
    /// The outcome as the results of the rows of a job.
    fn of_rows(self, job: &Job) -> Result<Vec<Ran>, Attempt> {
        let (metrics, error) = match self {
            Self::Ended(metrics, error) => (metrics, error),
            Self::Interrupted => return Err(Attempt::Interrupted),
            Self::Failed(why) => return Err(Attempt::Failed(why)),
        };
        let ran = |row: &Row| Ran {
            row: row.values.clone(),
            command: command(job, row),
            metrics: metrics.as_deref().cloned(),
            error: error.clone(),
        };
        Ok(job.rows.iter().map(ran).collect())
    }
}

fn run_words(job: &Job) -> Vec<String> {
    let seed = ["--seed".to_owned(), job.seed.to_string()];
    [&["run".to_owned()][..], &job.run, &seed].concat()
}

/// The command for a row, as one would type it.
fn command(job: &Job, row: &Row) -> String {
    let run = format!("explore {}", run_words(job).join(" "));
    match &row.replay {
        None => run,
        Some(options) => {
            let replay = [
                &["explore replay explored/session.mcap".to_owned()][..],
                options,
            ]
            .concat();
            format!("{run} && {}", replay.join(" "))
        }
    }
}

/// The result of a job, if it is finished and belongs to the same runs.
pub(super) fn done(out: &Path, job: &Job) -> Result<Option<Done>, Failure> {
    let Some(result) = Done::read(&job.result(out))? else {
        return Ok(None);
    };
    let has = |row: &Row| {
        let same = |ran: &Ran| ran.row == row.values && ran.command == command(job, row);
        result.runs.iter().any(same)
    };
    Ok(job.rows.iter().all(has).then_some(result))
}

fn next(open: &Mutex<VecDeque<Job>>) -> Option<Job> {
    lock(open).pop_front()
}

fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

fn read(path: &Path) -> Result<Option<Metrics>, Failure> {
    match std::fs::read(path) {
        Ok(bytes) => Ok(Some(serde_json::from_slice(&bytes)?)),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(error.into()),
    }
}

/// Removes a folder if it is there.
fn remove(folder: &Path) -> Result<(), Failure> {
    match std::fs::remove_dir_all(folder) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(error.into()),
        _ => Ok(()),
    }
}
