//! The jobs of a study: each is run as a whole, from one seed, and kept in one file.

use super::study::{Row, Study};
use std::path::{Path, PathBuf};

/// A run from a seed; for several rows, a run and a replay for each of them.
#[derive(Clone)]
pub(super) struct Job {
    pub study: &'static str,
    pub seed: u64,
    pub run: Vec<String>,
    pub rows: Vec<Row>,
}

/// The share of one of several machines: the `index`th of `count`, from 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Shard {
    pub index: usize,
    pub count: usize,
}

impl std::str::FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("'{text}' is not I/N with I from 1 to N");
        let (index, count) = text.split_once('/').ok_or_else(wrong)?;
        let [index, count] = [index, count].map(|word| word.trim().parse::<usize>().ok());
        let (index, count) = index.zip(count).ok_or_else(wrong)?;
        if (1..=count).contains(&index) {
            Ok(Self { index, count })
        } else {
            Err(wrong())
        }
    }
}

impl Shard {
    /// Every `count`th job. Each job belongs to exactly one shard.
    pub fn of<T>(self, jobs: Vec<T>) -> Vec<T> {
        let own = jobs.into_iter().enumerate();
        let own = own.filter(|(k, _)| k % self.count == self.index - 1);
        own.map(|(_, job)| job).collect()
    }
}

/// The jobs of a study, ordered by seed, so that an interrupted study has all rows from fewer seeds.
pub(super) fn jobs(study: &Study, seeds: &[u64]) -> Vec<Job> {
    let job = |seed: u64, rows: Vec<Row>| Job {
        study: study.name,
        seed,
        run: rows[0].run.clone(),
        rows,
    };
    let mut shared: Vec<Vec<Row>> = Vec::new();
    for row in &study.rows {
        let same = |rows: &&mut Vec<Row>| row.replay.is_some() && rows[0].run == row.run;
        match shared.iter_mut().find(same) {
            Some(rows) => rows.push(row.clone()),
            None => shared.push(vec![row.clone()]),
        }
    }
    let of_seed = |&seed: &u64| shared.iter().map(move |rows| job(seed, rows.clone()));
    seeds.iter().flat_map(of_seed).collect()
}

impl Job {
    /// The name of the job: the options of its run, and the seed.
    pub fn name(&self) -> String {
        let words = self.run.iter().map(|w| w.trim_start_matches("--"));
        let plain = |c: char| {
            if c.is_ascii_alphanumeric() || c == '.' {
                c
            } else {
                '-'
            }
        };
        let options: Vec<String> = words.map(|w| w.chars().map(plain).collect()).collect();
        format!("{}_seed-{}", options.join("-"), self.seed)
    }

    /// The result file of the job.
    pub fn result(&self, out: &Path) -> PathBuf {
        let name = format!("{}.json", self.name());
        out.join("jobs").join(self.study).join(name)
    }

    /// The working folder of the job.
    pub fn work(&self, out: &Path) -> PathBuf {
        out.join("work").join(self.study).join(self.name())
    }

    /// A description of the job.
    pub fn words(&self) -> String {
        format!("{} {} --seed {}", self.study, self.run.join(" "), self.seed)
    }
}
