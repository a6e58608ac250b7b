//! Processes: what they print, their time and their memory.

use std::ffi::OsStr;
use std::fs::File;
use std::io::{Read as _, Seek as _};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail, ensure};
use serde::de::DeserializeOwned;

use crate::{scenes, usage};

/// What a process left and needed.
pub(crate) struct Done {
    /// What it printed to standard output.
    pub(crate) stdout: String,
    /// Wall-clock seconds.
    pub(crate) wall: f64,
    /// User seconds of all threads.
    pub(crate) user: f64,
    /// Greatest resident memory in MB (10^6 bytes).
    pub(crate) peak_mb: f64,
}

impl Done {
    /// What it printed, as JSON.
    pub(crate) fn json<T: DeserializeOwned>(&self) -> Result<T> {
        serde_json::from_str(&self.stdout).with_context(|| format!("not JSON: {}", self.stdout))
    }
}

/// Runs a command to its end, at most `limit`.
///
/// # Errors
/// If it cannot be started, is stopped or fails; then with the last line of its standard error.
pub(crate) fn run(command: &mut Command, limit: Duration) -> Result<Done> {
    let program = Path::new(command.get_program());
    let name = program.file_name().unwrap_or_default().to_string_lossy().into_owned();
    // Into files: a pipe that is not read blocks a process that prints much.
    let (out, err) = (tempfile::tempfile()?, tempfile::tempfile()?);
    command.stdin(Stdio::null()).stdout(out.try_clone()?).stderr(err.try_clone()?);
    let started = Instant::now();
    let mut child = command.spawn().with_context(|| format!("start {name}"))?;
    let (mut peak, mut user) = (0, 0.0);
    let status = loop {
        // Both are gone when the process ends, so the last reading before that is kept.
        let id = child.id().to_string();
        peak = usage::peak_bytes(&id).unwrap_or(peak);
        user = usage::user_seconds(&id).unwrap_or(user);
        if let Some(status) = child.try_wait().with_context(|| format!("wait for {name}"))? {
            break status;
        }
        if started.elapsed() > limit {
            // It may end by itself meanwhile; either way it is gone afterwards.
            let _ = child.kill();
            let _ = child.wait();
            bail!("{name} was stopped after {} s", limit.as_secs());
        }
        std::thread::sleep(Duration::from_millis(3));
    };
    let wall = started.elapsed().as_secs_f64();
    if !status.success() {
        let said = text(err)?;
        let last = said.lines().rev().find(|l| !l.trim().is_empty()).unwrap_or("no message");
        bail!("{name} ended with {status}: {}", last.trim());
    }
    Ok(Done { stdout: text(out)?, wall, user, peak_mb: peak as f64 / 1e6 })
}

fn text(mut file: File) -> Result<String> {
    let mut bytes = Vec::new();
    file.rewind()?;
    file.read_to_end(&mut bytes)?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

/// A day: long enough for whatever is measured.
pub(crate) const NO_LIMIT: Duration = Duration::from_secs(86_400);

/// Another process of this program.
pub(crate) fn own(words: &[&str]) -> Result<Command> {
    let mut command = Command::new(std::env::current_exe().context("find this program")?);
    command.args(words);
    Ok(command)
}

/// The command `gsvx`: what the environment variable GSVX names, or built now beside this program.
///
/// # Errors
/// If the file is not there, or the command does not build.
pub fn gsvx_command() -> Result<PathBuf> {
    let path = match std::env::var_os("GSVX") {
        Some(path) => scenes::root().join(path),
        None => {
            let profile = if cfg!(debug_assertions) { "dev" } else { "release" };
            eprintln!("build gsvx ...");
            let status = Command::new("cargo")
                .current_dir(scenes::root())
                .args(["build", "--quiet", "--package", "gsvx-cli", "--profile", profile])
                .status()
                .context("start cargo")?;
            ensure!(status.success(), "gsvx-cli does not build");
            let beside = std::env::current_exe().context("find this program")?;
            beside.with_file_name("gsvx").with_extension(std::env::consts::EXE_EXTENSION)
        }
    };
    ensure!(path.is_file(), "{}: not there", path.display());
    Ok(path)
}

/// The command `gsvx`.
pub(crate) struct GsvxCommand(PathBuf);

impl GsvxCommand {
    pub(crate) fn find() -> Result<Self> {
        Ok(Self(gsvx_command()?))
    }

    pub(crate) fn path(&self) -> &Path {
        &self.0
    }

    /// Runs `gsvx --json WORDS`.
    pub(crate) fn run(&self, words: &[&dyn AsRef<OsStr>]) -> Result<Done> {
        run(Command::new(&self.0).arg("--json").args(words.iter().map(|w| w.as_ref())), NO_LIMIT)
    }

    /// Runs `gsvx --json WORDS -o OUTPUT`.
    pub(crate) fn make(&self, words: &[&dyn AsRef<OsStr>], output: &Path) -> Result<Done> {
        // Replacing a file would also measure the disk.
        if output.is_dir() {
            std::fs::remove_dir_all(output)?;
        } else if output.exists() {
            std::fs::remove_file(output)?;
        }
        self.run(&[words, &[&"-o", &output]].concat())
    }
}
