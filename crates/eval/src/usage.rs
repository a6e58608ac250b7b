//! Time and memory that a process has used, as Linux tells; nothing elsewhere, or once it has gone. A process is an id,
//! or [`SELF`].

use std::fs;

/// This process.
pub(crate) const SELF: &str = "self";

/// Begins to measure the peak of this process anew.
pub(crate) fn reset_peak() {
    // 5: the peak resident set (man 5 proc). Not allowed everywhere; the peak then counts from the
    // start of the process, and the figure is too high, never too low.
    let _ = fs::write("/proc/self/clear_refs", "5");
}

/// Greatest resident memory, bytes.
pub(crate) fn peak_bytes(process: &str) -> Option<u64> {
    let text = fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    let line = text.lines().find_map(|l| l.strip_prefix("VmHWM:"))?;
    Some(line.split_whitespace().next()?.parse::<u64>().ok()? * 1024)
}

/// User seconds of all threads.
pub(crate) fn user_seconds(process: &str) -> Option<f64> {
    let text = fs::read_to_string(format!("/proc/{process}/stat")).ok()?;
    let ticks: u64 = text.rsplit_once(") ")?.1.split(' ').nth(11)?.parse().ok()?;
    // Linux counts processor time in hundredths of a second.
    Some(ticks as f64 / 100.0)
}
