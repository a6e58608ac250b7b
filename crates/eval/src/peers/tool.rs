//! Finds and runs another project's program.

use std::env;
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use gs_model::Scene;

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

/// What a tool left.
pub(super) struct Done {
    /// What it printed.
    pub(super) stdout: String,
}

/// Runs an encoder in an empty folder. Returns the bytes of the file `name` that it was asked to
/// write, and what it printed.
pub(super) fn written(
    name: &str,
    run: impl FnOnce(&Path, &Path) -> Result<Done>,
) -> Result<(Vec<u8>, Done)> {
    let dir = tempfile::tempdir().context("make a folder for a tool")?;
    let path = dir.path().join(name);
    let done = run(dir.path(), &path)?;
    Ok((contents(&path)?, done))
}

/// Runs a decoder in a folder that holds `stream` under `name`, and reads the PLY that it was asked
/// to write.
pub(super) fn decoded(
    stream: &[u8],
    name: &str,
    run: impl FnOnce(&Path, &Path, &Path) -> Result<Done>,
) -> Result<Scene> {
    let dir = tempfile::tempdir().context("make a folder for a tool")?;
    let (path, back) = (dir.path().join(name), dir.path().join("back.ply"));
    fs::write(&path, stream).with_context(|| format!("write {}", path.display()))?;
    run(dir.path(), &path, &back)?;
    contents(&back)?;
    super::read(&back)
}

/// Runs `tool` in `dir` and waits, at most `limit`.
pub(super) fn run<S: AsRef<OsStr>>(
    tool: &Path,
    args: &[S],
    dir: &Path,
    limit: Duration,
) -> Result<Done> {
    let name = tool.file_name().unwrap_or_default().to_string_lossy().into_owned();
    // Into files: a pipe that is not read blocks a tool that prints much.
    let (out, err) = (dir.join("stdout.txt"), dir.join("stderr.txt"));
    let open =
        |path: &Path| fs::File::create(path).with_context(|| format!("create {}", path.display()));
    let started = Instant::now();
    let mut child = Command::new(tool)
        .args(args)
        .current_dir(dir)
        .stdin(Stdio::null())
        .stdout(open(&out)?)
        .stderr(open(&err)?)
        .spawn()
        .with_context(|| format!("start {}", tool.display()))?;
    let status = loop {
        if let Some(status) = child.try_wait().with_context(|| format!("wait for {name}"))? {
            break status;
        }
        if started.elapsed() > limit {
            // It may end by itself meanwhile; either way it is gone afterwards.
            let _ = child.kill();
            let _ = child.wait();
            bail!("{name} was stopped after {} s (--peer-seconds)", limit.as_secs());
        }
        std::thread::sleep(Duration::from_millis(5));
    };
    let text = |path: &Path| -> String {
        fs::read(path).map(|b| String::from_utf8_lossy(&b).into_owned()).unwrap_or_default()
    };
    if !status.success() {
        let said = text(&err);
        let last = said.lines().rev().find(|l| !l.trim().is_empty()).unwrap_or("no message");
        bail!("{name} ended with {status}: {}", last.trim());
    }
    Ok(Done { stdout: text(&out) })
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
