//! Time and memory that this process has used. Memory is known on Linux only, and 0 elsewhere.

use std::fs;

/// Processor seconds of all threads so far, user and system. Other processes do not change them.
/// Wall-clock seconds where there is no such clock.
#[cfg(unix)]
pub(crate) fn cpu_seconds() -> f64 {
    use rustix::time::{ClockId, clock_gettime};
    let now = clock_gettime(ClockId::ProcessCPUTime);
    now.tv_sec as f64 + now.tv_nsec as f64 * 1e-9
}

#[cfg(not(unix))]
pub(crate) fn cpu_seconds() -> f64 {
    use std::sync::LazyLock;
    use std::time::Instant;
    static START: LazyLock<Instant> = LazyLock::new(Instant::now);
    START.elapsed().as_secs_f64()
}

/// Begins to measure the peak anew.
pub(crate) fn reset_peak() {
    // 5: the peak resident set (man 5 proc). Not allowed everywhere; the peak then counts from the
    // start of the process, and the figure is too high, never too low.
    let _ = fs::write("/proc/self/clear_refs", "5");
}

/// Greatest resident memory since [`reset_peak`], bytes.
pub(crate) fn peak_bytes() -> u64 {
    peak_bytes_of("self").unwrap_or(0)
}

/// Greatest resident memory of another process, bytes; nothing once it has gone.
pub(crate) fn peak_bytes_of(process: &str) -> Option<u64> {
    memory(process, "VmHWM:")
}

/// User seconds of all threads of another process; nothing once it has gone.
pub(crate) fn user_seconds_of(process: &str) -> Option<f64> {
    let text = fs::read_to_string(format!("/proc/{process}/stat")).ok()?;
    let ticks: u64 = text.rsplit_once(") ")?.1.split(' ').nth(11)?.parse().ok()?;
    // Linux counts processor time in hundredths of a second.
    Some(ticks as f64 / 100.0)
}

fn memory(process: &str, field: &str) -> Option<u64> {
    let text = fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    let line = text.lines().find_map(|l| l.strip_prefix(field))?;
    Some(line.split_whitespace().next()?.parse::<u64>().ok()? * 1024)
}
