//! The `gsvx` command as a process of its own: what it prints, its time and its memory.

use std::ffi::OsStr;
use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail, ensure};

use crate::{scenes, usage};

/// What a process needed.
pub(crate) struct Cost {
    /// Wall-clock seconds.
    pub(crate) wall: f64,
    /// User seconds of all threads.
    pub(crate) user: f64,
    /// Greatest resident memory in MB (10^6 bytes).
    pub(crate) peak_mb: f64,
    /// What it printed to standard output.
    pub(crate) printed: Vec<u8>,
}

/// The command, relative to the root of the workspace.
pub(crate) fn find(gsvx: &Path) -> Result<PathBuf> {
    let gsvx = scenes::root().join(gsvx);
    ensure!(
        gsvx.is_file(),
        "{}: not there; run `cargo build --release -p gsvx-cli` first",
        gsvx.display()
    );
    Ok(gsvx)
}

/// Runs `gsvx WORDS INPUT -o OUTPUT`.
pub(crate) fn measure(
    gsvx: &Path,
    words: &[impl AsRef<OsStr>],
    input: &Path,
    output: &Path,
) -> Result<Cost> {
    // Replacing a file would also measure the disk.
    if output.exists() {
        std::fs::remove_file(output)?;
    }
    let started = Instant::now();
    let mut child = Command::new(gsvx)
        .args(words)
        .arg(input)
        .arg("-o")
        .arg(output)
        .stdout(Stdio::piped())
        .spawn()
        .with_context(|| format!("start {}", gsvx.display()))?;
    let (mut peak, mut ticks) = (0u64, 0u64);
    let status = loop {
        // Both files are gone when the process ends, so the last reading before that is kept.
        let proc = format!("/proc/{}", child.id());
        peak = usage::peak_bytes_of(&child.id().to_string()).unwrap_or(peak);
        if let Ok(text) = std::fs::read_to_string(format!("{proc}/stat"))
            && let Some((_, rest)) = text.rsplit_once(") ")
        {
            ticks = rest.split(' ').nth(11).and_then(|v| v.parse().ok()).unwrap_or(ticks);
        }
        if let Some(status) = child.try_wait().context("wait for gsvx")? {
            break status;
        }
        std::thread::sleep(Duration::from_millis(3));
    };
    if !status.success() {
        let words: Vec<_> = words.iter().map(|w| w.as_ref().to_string_lossy()).collect();
        bail!("gsvx {} failed with {status}", words.join(" "));
    }
    // A report of one line fits the pipe, so the process never waits for a reader.
    let mut printed = Vec::new();
    if let Some(mut pipe) = child.stdout.take() {
        pipe.read_to_end(&mut printed).context("read what gsvx printed")?;
    }
    // Linux counts processor time in hundredths of a second.
    let user = ticks as f64 / 100.0;
    Ok(Cost { wall: started.elapsed().as_secs_f64(), user, peak_mb: peak as f64 / 1e6, printed })
}
