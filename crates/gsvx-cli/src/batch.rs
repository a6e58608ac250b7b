//! Many inputs in one run: which file becomes which.

use crate::exit::{self, note, usage};
use crate::output::{self, is_stdio};
use anyhow::{Context, Result, bail};
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
    let inputs = inputs.iter().map(|i| wildcard::expand(i)).collect::<Result<Vec<_>>>()?.concat();
    let ends_like_folder = output.to_string_lossy().ends_with(['/', MAIN_SEPARATOR]);
    let is_folder = output.is_dir() || ends_like_folder;
    if let ([input], false) = (&inputs[..], is_folder) {
        return Ok(vec![Job { input: input.clone(), output: output.into() }]);
    }
    if is_stdio(output) || (output.exists() && !is_folder) {
        let name = output.display();
        return Err(usage(format!("{name}: several inputs need a folder as output: -o FOLDER/")));
    }
    let mut taken: BTreeMap<PathBuf, &Path> = BTreeMap::new();
    let mut jobs = Vec::with_capacity(inputs.len());
    for input in &inputs {
        if is_stdio(input) {
            return Err(usage(
                "standard input has no name for a file in a folder; name the output",
            ));
        }
        let Some(stem) = input.file_stem() else {
            bail!("{}: names no file", input.display());
        };
        let mut file = stem.to_os_string();
        file.push(".");
        file.push(extension);
        let output = output.join(file);
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
    std::fs::create_dir_all(output)
        .with_context(|| format!("{}: the folder cannot be made", output.display()))?;
    Ok(jobs)
}

/// Jobs that only read.
pub(crate) fn readers(inputs: &[PathBuf]) -> Result<Vec<Job>> {
    let inputs = inputs.iter().map(|i| wildcard::expand(i)).collect::<Result<Vec<_>>>()?.concat();
    Ok(inputs.into_iter().map(|input| Job { input, output: PathBuf::new() }).collect())
}

/// Does all jobs; one that fails does not keep the others from being done.
pub(crate) fn run(jobs: &[Job], mut one: impl FnMut(&Job) -> Result<()>) -> Result<()> {
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

/// Patterns such as `*.ply`. Shells on Unix replace them by names; those on Windows leave it to the
/// command.
mod wildcard {
    use super::{Context, Path, PathBuf, Result, bail};

    /// The files that a pattern stands for, sorted; a name without wildcards stands for itself.
    pub(super) fn expand(path: &Path) -> Result<Vec<PathBuf>> {
        if cfg!(windows) { matching(path) } else { Ok(vec![path.into()]) }
    }

    pub(super) fn matching(path: &Path) -> Result<Vec<PathBuf>> {
        let pattern = path.file_name().map(|n| n.to_string_lossy().into_owned());
        let Some(pattern) = pattern.filter(|p| p.contains(['*', '?'])) else {
            return Ok(vec![path.into()]);
        };
        let dir = path.parent().filter(|p| !p.as_os_str().is_empty());
        let list = std::fs::read_dir(dir.unwrap_or(Path::new(".")))
            .with_context(|| format!("{}: no such folder", path.display()))?;
        let names = list.flatten().map(|e| e.file_name());
        let mut found: Vec<PathBuf> = names
            .filter(|n| fits(&lower(&pattern), &lower(&n.to_string_lossy())))
            .map(|n| dir.map_or_else(|| PathBuf::from(&n), |d| d.join(&n)))
            .collect();
        if found.is_empty() {
            bail!("{}: no such file", path.display());
        }
        found.sort();
        Ok(found)
    }

    fn lower(text: &str) -> Vec<char> {
        text.to_lowercase().chars().collect()
    }

    fn fits(pattern: &[char], name: &[char]) -> bool {
        match (pattern, name) {
            ([], []) => true,
            (['*', rest @ ..], _) => (0..=name.len()).any(|skip| fits(rest, &name[skip..])),
            (['?', rest @ ..], [_, name @ ..]) => fits(rest, name),
            ([p, rest @ ..], [n, name @ ..]) => p == n && fits(rest, name),
            _ => false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wildcards_were_not_expanded_on_windows() {
        let dir = tempfile::tempdir().unwrap();
        for name in ["a.ply", "b.PLY", "c.spz", "dd.ply"] {
            std::fs::write(dir.path().join(name), "").unwrap();
        }
        let names = |pattern: &str| {
            let found = wildcard::matching(&dir.path().join(pattern)).unwrap();
            let name = |p: PathBuf| p.file_name().unwrap().to_str().unwrap().to_owned();
            found.into_iter().map(name).collect::<Vec<_>>()
        };
        assert_eq!(names("*.ply"), ["a.ply", "b.PLY", "dd.ply"]);
        assert_eq!(names("?.*"), ["a.ply", "b.PLY", "c.spz"]);
        assert_eq!(names("plain.ply"), ["plain.ply"]);
        assert!(wildcard::matching(&dir.path().join("*.gsvx")).is_err());
    }
}
