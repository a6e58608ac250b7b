//! Processes: what they print, their time and their memory.

use std::ffi::OsStr;
use std::fs::{self, File};
use std::io::{Read as _, Seek as _};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail, ensure};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::measure::{Score, ViewScore};
use crate::scenes;

/// What some work needed.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Usage {
    /// Wall-clock seconds.
    pub(crate) wall: f64,
    /// User seconds of all threads; 0 where the system does not tell.
    pub(crate) user: f64,
    /// Greatest resident memory in MB (10^6 bytes); 0 where the system does not tell.
    pub(crate) peak_mb: f64,
}

/// What a process printed to standard output, and what it needed.
pub(crate) struct ProcessOutput {
    stdout: String,
    pub(crate) usage: Usage,
}

impl ProcessOutput {
    /// What it printed, as JSON.
    pub(crate) fn json<T: DeserializeOwned>(&self) -> Result<T> {
        serde_json::from_str(&self.stdout).with_context(|| format!("not JSON: {}", self.stdout))
    }
}

/// The result of `work` and its wall-clock seconds.
pub(crate) fn timed<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let start = Instant::now();
    let value = work();
    (value, start.elapsed().as_secs_f64())
}

/// Runs a command to its end, at most `limit`.
///
/// # Errors
/// If it cannot be started, is stopped or fails; then with the last line of its standard error.
pub(crate) fn run(command: &mut Command, limit: Duration) -> Result<ProcessOutput> {
    let program = Path::new(command.get_program());
    let name = program.file_name().unwrap_or_default().to_string_lossy().into_owned();
    // Into files: a pipe that is not read blocks a process that prints much.
    let (out, err) = (tempfile::tempfile()?, tempfile::tempfile()?);
    command.stdin(Stdio::null()).stdout(out.try_clone()?).stderr(err.try_clone()?);
    let started = Instant::now();
    let mut child = command.spawn().with_context(|| format!("start {name}"))?;
    let mut usage = Usage::default();
    let status = loop {
        // Both are gone when the process ends, so the last reading before that is kept.
        usage.peak_mb = peak_mb(child.id()).unwrap_or(usage.peak_mb);
        usage.user = user_seconds(child.id()).unwrap_or(usage.user);
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
    usage.wall = started.elapsed().as_secs_f64();
    if !status.success() {
        let said = text(err)?;
        let last = said.lines().rev().find(|l| !l.trim().is_empty()).unwrap_or("no message");
        bail!("{name} ended with {status}: {}", last.trim());
    }
    Ok(ProcessOutput { stdout: text(out)?, usage })
}

fn text(mut file: File) -> Result<String> {
    let mut bytes = Vec::new();
    file.rewind()?;
    file.read_to_end(&mut bytes)?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

/// Greatest resident memory, as Linux tells of a process that runs.
fn peak_mb(process: u32) -> Option<f64> {
    let text = fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    let line = text.lines().find_map(|l| l.strip_prefix("VmHWM:"))?;
    Some(line.split_whitespace().next()?.parse::<f64>().ok()? * 1024.0 / 1e6)
}

/// User seconds of all threads, as Linux tells of a process that runs.
fn user_seconds(process: u32) -> Option<f64> {
    let text = fs::read_to_string(format!("/proc/{process}/stat")).ok()?;
    let ticks: u64 = text.rsplit_once(") ")?.1.split(' ').nth(11)?.parse().ok()?;
    // Linux counts processor time in hundredths of a second.
    Some(ticks as f64 / 100.0)
}

/// This program's file.
pub(crate) fn own_path() -> Result<PathBuf> {
    std::env::current_exe().context("find this program")
}

/// What a program prints, if it succeeds. It runs in the workspace, whose toolchain file names the compiler.
#[must_use]
pub fn printed(program: &str, words: &[&str]) -> Option<String> {
    let out = Command::new(program).args(words).current_dir(scenes::root()).output().ok()?;
    out.status.success().then(|| String::from_utf8_lossy(&out.stdout).trim().to_owned())
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
            own_path()?.with_file_name("gsvx").with_extension(std::env::consts::EXE_EXTENSION)
        }
    };
    ensure!(path.is_file(), "{}: not there", path.display());
    Ok(path)
}

/// The command `gsvx`.
pub(crate) struct GsvxCommand(pub(crate) PathBuf);

impl GsvxCommand {
    pub(crate) fn find() -> Result<Self> {
        Ok(Self(gsvx_command()?))
    }

    /// `gsvx --json WORDS`, to which more can be added.
    pub(crate) fn words<S: AsRef<OsStr>>(&self, words: impl IntoIterator<Item = S>) -> Command {
        let mut command = Command::new(&self.0);
        command.arg("--json").args(words);
        command
    }

    /// Runs a command with `-o OUTPUT`.
    pub(crate) fn make(&self, command: &mut Command, output: &Path) -> Result<ProcessOutput> {
        // Replacing a file would also measure the disk.
        if output.is_dir() {
            fs::remove_dir_all(output)?;
        } else if output.exists() {
            fs::remove_file(output)?;
        }
        run(command.arg("-o").arg(output), NO_LIMIT)
    }

    /// Scores of a file against renders of its model at the views of some words of `gsvx compare`.
    pub(crate) fn compare(&self, model: &Path, file: &Path, views: &[String]) -> Result<Score> {
        let started = Instant::now();
        let said = run(self.words(["compare"]).arg(model).arg(file).args(views), NO_LIMIT)?;
        let said: Value = said.json()?;
        let score = |of: &Value| ViewScore {
            view: of["name"].as_str().unwrap_or_default().to_owned(),
            // The PSNR of equal pictures is infinite, which JSON cannot hold.
            psnr_db: of["psnr"].as_f64().unwrap_or(f64::INFINITY),
            ssim: of["ssim"].as_f64().unwrap_or(f64::NAN),
            ssimulacra2: of["ssimulacra2"].as_f64().unwrap_or(f64::NAN),
        };
        let ViewScore { psnr_db, ssim, ssimulacra2, .. } = score(&said);
        let views = said["views"].as_array().context("gsvx compare tells of no views")?;
        let (views, seconds) = (views.iter().map(score).collect(), started.elapsed().as_secs_f64());
        Ok(Score { psnr_db, ssim, ssimulacra2, views, seconds })
    }
}

/// A day: long enough for whatever is measured.
pub(crate) const NO_LIMIT: Duration = Duration::from_secs(86_400);
