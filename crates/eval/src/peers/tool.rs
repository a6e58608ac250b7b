//! Finds and runs another project's program.

use std::env;
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use anyhow::{Result, bail};

use crate::process;

/// The tool that a flag names, or the one on the PATH; or why there is none.
pub(super) fn find(given: Option<&Path>, name: &str) -> Result<PathBuf, String> {
    if let Some(path) = given {
        return if path.is_file() {
            // Tools run in a folder of their own.
            path.canonicalize().map_err(|e| format!("{}: {e}", path.display()))
        } else {
            Err(format!("{} is not a file", path.display()))
        };
    }
    let dirs = env::var_os("PATH").unwrap_or_default();
    let found = env::split_paths(&dirs).map(|dir| dir.join(name)).find(|p| p.is_file());
    let flag = name.replace('_', "-");
    found.ok_or_else(|| format!("{name} is not on the PATH (or give --{flag} FILE)"))
}

/// Two tools of one folder.
pub(super) fn pair(dir: Option<&Path>, names: [&str; 2]) -> Result<[PathBuf; 2], String> {
    let one = |name: &str| match dir {
        Some(dir) => find(Some(&dir.join(name)), name),
        None => find(None, name).map_err(|_| {
            format!("{} and {} are not on the PATH (or give --spz DIR)", names[0], names[1])
        }),
    };
    Ok([one(names[0])?, one(names[1])?])
}

/// Runs `tool` in `dir` and waits, at most `limit`. Returns what it printed.
pub(super) fn run<S: AsRef<OsStr>>(
    tool: &Path,
    args: &[S],
    dir: &Path,
    limit: Duration,
) -> Result<String> {
    Ok(process::run(Command::new(tool).args(args).current_dir(dir), limit)?.stdout)
}

/// What a tool wrote. Some of them report success and write nothing.
pub(super) fn contents(path: &Path) -> Result<Vec<u8>> {
    match fs::read(path) {
        Ok(bytes) if !bytes.is_empty() => Ok(bytes),
        _ => bail!(
            "it reported success but wrote no {}",
            path.file_name().unwrap_or_default().to_string_lossy()
        ),
    }
}
