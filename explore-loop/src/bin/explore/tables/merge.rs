//! Merges results from several machines into one folder.

use super::result::Done;
use super::study::Study;
use super::{answer, write_tables};
use crate::output::OutputFolder;
use crate::{Failure, TablesArgs};
use explore_loop::Error;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Merges the results of several folders, and makes the tables of all.
pub(super) fn merge(args: &TablesArgs, studies: &[Study]) -> Result<bool, Failure> {
    let _out = OutputFolder::create(&args.out)?;
    let mut answers = Vec::new();
    for study in studies {
        for dir in &args.merge {
            for path in results(dir, study)? {
                take(&path, &args.out, study)?;
            }
        }
        let mut seeds = BTreeSet::new();
        for path in results(&args.out, study)? {
            seeds.extend(Done::read(&path)?.map(|result| result.seed));
        }
        if !seeds.is_empty() {
            answers.extend(write_tables(args, study, &seeds)?);
        }
    }
    answer(args, &answers)?;
    if answers.is_empty() {
        let dirs: Vec<String> = args.merge.iter().map(|d| d.display().to_string()).collect();
        return Err(format!("{}: no results of a study there", dirs.join(", ")).into());
    }
    Ok(true)
}

/// The result files of a study in a folder, in order.
fn results(dir: &Path, study: &Study) -> Result<Vec<PathBuf>, Failure> {
    let mut paths = Vec::new();
    match std::fs::read_dir(dir.join("jobs").join(study.name)) {
        Ok(entries) => {
            for entry in entries {
                paths.push(entry?.path());
            }
        }
        Err(error) if error.kind() == std::io::ErrorKind::NotFound && dir.is_dir() => {}
        Err(error) => return Err(format!("{}: {error}", dir.display()).into()),
    }
    paths.retain(|path| path.extension().is_some_and(|ending| ending == "json"));
    paths.sort();
    Ok(paths)
}

/// Copies a result; a result that is already there must be the same.
fn take(path: &Path, out: &Path, study: &Study) -> Result<(), Failure> {
    let (Some(result), Some(name)) = (Done::read(path)?, path.file_name()) else {
        return Ok(());
    };
    let folder = out.join("jobs").join(study.name);
    let place = folder.join(name);
    match Done::read(&place)? {
        Some(known) if known.agrees_with(&result) => Ok(()),
        Some(_) => {
            let (a, b) = (path.display(), place.display());
            Err(
                format!("{a} and {b} are results of the same job and differ: remove one of them")
                    .into(),
            )
        }
        None => {
            std::fs::create_dir_all(&folder).map_err(|error| Error::Write {
                path: folder.clone(),
                error,
            })?;
            result.write(&place)
        }
    }
}
