//! How much memory to use.

use crate::exit::usage;
use anyhow::Result;
use indicatif::DecimalBytes;

/// The bound where the system does not say how much memory there is.
const UNKNOWN: u64 = 4 << 30;
/// Bytes that the process has besides its tiles, and that a tile takes while it is encoded: measured, with SH of
/// degree 3.
const PROCESS: u64 = 150_000_000;
const TILE: u64 = 150_000_000;
/// An encode in memory takes so many times the bytes of the models.
const TIMES: u64 = 2;

/// Most bytes to use: as asked for, or a quarter of the machine's.
fn bound(asked: Option<u64>) -> u64 {
    asked.unwrap_or_else(|| total().map_or(UNKNOWN, |all| all / 4))
}

/// Whether files of so many bytes are not encoded in memory.
pub(crate) fn is_large(bytes: u64) -> bool {
    bytes.saturating_mul(TIMES) > bound(None)
}

/// Tiles that are encoded at once.
pub(crate) fn tiles_at_once(asked: Option<u64>) -> Result<usize> {
    match bound(asked).saturating_sub(PROCESS) / TILE {
        0 => Err(usage(format!("--memory: at least {} are needed", DecimalBytes(PROCESS + TILE)))),
        n => Ok((n as usize).min(rayon::current_num_threads())),
    }
}

/// Bytes of memory that the machine has; `None` where there is no such file.
fn total() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find_map(|l| l.strip_prefix("MemTotal:"))?;
    Some(line.split_whitespace().next()?.parse::<u64>().ok()? * 1024)
}
