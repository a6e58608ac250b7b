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

/// [`peak_bytes`] in MB (10^6 bytes).
pub(crate) fn peak_mb() -> f64 {
    peak_bytes() as f64 / 1e6
}

/// Resident memory now, bytes.
pub(crate) fn resident_bytes() -> u64 {
    memory("self", "VmRSS:").unwrap_or(0)
}

/// Greatest resident memory of another process, bytes; nothing once it has gone.
pub(crate) fn peak_bytes_of(process: &str) -> Option<u64> {
    memory(process, "VmHWM:")
}

fn memory(process: &str, field: &str) -> Option<u64> {
    let text = fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    let line = text.lines().find_map(|l| l.strip_prefix(field))?;
    Some(line.split_whitespace().next()?.parse::<u64>().ok()? * 1024)
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    #[test]
    fn work_and_memory_are_seen() {
        let before = super::cpu_seconds();
        let data: Vec<u64> = (0..4_000_000).collect();
        let start = std::time::Instant::now();
        let mut sum = 0u64;
        while start.elapsed().as_millis() < 200 {
            sum = data.iter().fold(sum, |a, b| a.wrapping_mul(3).wrapping_add(*b));
        }
        assert!(sum != 1 && super::cpu_seconds() - before > 0.01);
        assert!(super::peak_bytes() > 32_000_000);
    }
}
