//! Many inputs in one run: which file becomes which.

use crate::exit::{self, note, usage};
use crate::output::{self, is_stdio};
use anyhow::{Result, bail};
use std::collections::BTreeMap;
use std::path::{MAIN_SEPARATOR, Path, PathBuf};

/// An input and its output.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Job {
    pub(crate) input: PathBuf,
    pub(crate) output: PathBuf,
}

/// One job per input. Several inputs, or an output that is a folder, give `OUTPUT/NAME.EXTENSION`;
/// the folder is made if it is not there. Conflicts are found before any work.
pub(crate) fn jobs(
    inputs: &[PathBuf],
    output: &Path,
    extension: &str,
    force: bool,
) -> Result<Vec<Job>> {
    let ends_like_folder = output.to_string_lossy().ends_with(['/', MAIN_SEPARATOR]);
    let is_folder = output.is_dir() || ends_like_folder;
    if let ([input], false) = (inputs, is_folder) {
        return Ok(vec![Job { input: input.clone(), output: output.into() }]);
    }
    if is_stdio(output) || (output.exists() && !is_folder) {
        let name = output.display();
        return Err(usage(format!("{name}: several inputs need a folder as output: -o FOLDER/")));
    }
    let mut taken: BTreeMap<PathBuf, &Path> = BTreeMap::new();
    let mut jobs = Vec::with_capacity(inputs.len());
    for input in inputs {
        if is_stdio(input) {
            return Err(usage(
                "standard input has no name for a file in a folder; name the output",
            ));
        }
        let Some(stem) = input.file_stem() else {
            bail!("{}: names no file", input.display());
        };
        let output = output.join(stem).with_added_extension(extension);
        if let Some(other) = taken.insert(output.clone(), input) {
            let [a, b] = [other.display(), input.display()];
            return Err(usage(format!(
                "{a} and {b} would both become {}; run them apart",
                output.display()
            )));
        }
        output::check(&output, force, &[input])?;
        jobs.push(Job { input: input.clone(), output });
    }
    output::make_folder(output)?;
    Ok(jobs)
}

/// Does all jobs; one that fails does not keep the others from being done.
pub(crate) fn run<J>(jobs: &[J], mut one: impl FnMut(&J) -> Result<()>) -> Result<()> {
    if let [job] = jobs {
        return one(job);
    }
    let mut failed = 0;
    for job in jobs {
        if let Err(error) = one(job) {
            failed += 1;
            note(format_args!("error: {}", exit::line(&error)));
        }
    }
    match failed {
        0 => Ok(()),
        n => bail!("{n} of {} inputs failed", jobs.len()),
    }
}
