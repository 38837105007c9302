//! Progress of a study, and how long the rest will take.
//!
//! ```text
//! rest = Σ over the open jobs of the mean time of jobs with the same options (else of the same study, else of all)  /  jobs at a time
//! ```
//! Only timed jobs count: before the first one is done, no estimate is given.

use super::job::Job;
use super::result::Done;
use super::run::done;
use crate::Failure;
use mesh_io::program::{Output, warn};
use std::collections::BTreeMap;
use std::path::Path;

/// Durations of jobs in seconds, by study and options.
#[derive(Default)]
pub(super) struct Times(BTreeMap<(&'static str, Vec<String>), Vec<f64>>);

impl Times {
    /// Adds the duration of a job.
    pub fn add(&mut self, job: &Job, seconds: f64) {
        self.0
            .entry((job.study, job.run.clone()))
            .or_default()
            .push(seconds);
    }

    /// The durations of all finished jobs in a folder, and the jobs that are not finished.
    pub fn of<'j>(out: &Path, jobs: &'j [Job]) -> Result<(Self, Vec<&'j Job>), Failure> {
        let (mut times, mut open) = (Self::default(), Vec::new());
        for job in jobs {
            match done(out, job)? {
                Some(result) => times.add(job, result.seconds),
                None => open.push(job),
            }
        }
        Ok((times, open))
    }

    fn mean<'t>(times: impl Iterator<Item = &'t Vec<f64>>) -> Option<f64> {
        let all: Vec<f64> = times.flatten().copied().collect();
        (!all.is_empty()).then(|| all.iter().sum::<f64>() / all.len() as f64)
    }

    /// The expected duration of a job, seconds, if any was timed.
    pub fn expected(&self, job: &Job) -> Option<f64> {
        let same = self.0.get(&(job.study, job.run.clone()));
        let of_study = || {
            Self::mean(
                self.0
                    .iter()
                    .filter(|(k, _)| k.0 == job.study)
                    .map(|(_, t)| t),
            )
        };
        let of_all = || Self::mean(self.0.values());
        Self::mean(same.into_iter())
            .or_else(of_study)
            .or_else(of_all)
    }

    /// The expected duration of several jobs, `at_a_time` of them in parallel.
    pub fn rest<'j>(&self, jobs: impl Iterator<Item = &'j Job>, at_a_time: usize) -> Option<f64> {
        let mut count = 0;
        let each: Option<Vec<f64>> = jobs
            .inspect(|_| count += 1)
            .map(|job| self.expected(job))
            .collect();
        let sum: f64 = each?.into_iter().sum();
        Some(sum / at_a_time.clamp(1, count.max(1)) as f64)
    }
}

/// A duration for people.
pub(super) fn duration(seconds: f64) -> String {
    match seconds {
        s if s < 90.0 => format!("{s:.0} s"),
        s if s < 5400.0 => format!("{:.0} min", s / 60.0),
        s if s < 172_800.0 => format!("{:.1} h", s / 3600.0),
        s => format!("{:.1} days", s / 86_400.0),
    }
}

/// Prints a line for each finished job.
pub(super) struct Progress {
    times: Times,
    open: Vec<Job>,
    count: usize,
    at_a_time: usize,
    output: Output,
}

impl Progress {
    pub fn new(
        out: &Path,
        jobs: &[Job],
        at_a_time: usize,
        output: Output,
    ) -> Result<Self, Failure> {
        let (times, open) = Times::of(out, jobs)?;
        Ok(Self {
            times,
            open: open.into_iter().cloned().collect(),
            count: jobs.len(),
            at_a_time,
            output,
        })
    }

    /// Prints what there is to do.
    pub fn begin(&self) {
        let (open, count) = (self.open.len(), self.count);
        self.output.note(&format!(
            "{} of {count} jobs are done; {}",
            count - open,
            self.left()
        ));
    }

    pub fn done(&mut self, job: &Job, result: &Done) {
        self.times.add(job, result.seconds);
        let stops: Vec<&str> = result.runs.iter().map(super::result::Ran::stop).collect();
        self.close(job);
        let (words, took) = (job.words(), duration(result.seconds));
        self.output.note(&format!(
            "{} {words}: {}, {took}; {}",
            self.place(),
            stops.join(", "),
            self.left()
        ));
    }

    pub fn failed(&mut self, job: &Job, why: &str) {
        self.close(job);
        warn(&format!(
            "{} {}: not done: {why}",
            self.place(),
            job.words()
        ));
    }

    fn close(&mut self, job: &Job) {
        self.open
            .retain(|o| (o.study, o.name()) != (job.study, job.name()));
    }

    fn place(&self) -> String {
        format!("[{}/{}]", self.count - self.open.len(), self.count)
    }

    fn left(&self) -> String {
        if self.open.is_empty() {
            return "nothing left".into();
        }
        match self.times.rest(self.open.iter(), self.at_a_time) {
            Some(seconds) => format!("about {} left", duration(seconds)),
            None => "the time needed is known after the first one".into(),
        }
    }
}
