//! What this process has used, where Linux tells; 0 elsewhere.

use std::fs;

/// Ticks per second of `/proc/PID/stat`: fixed by the kernel's interface.
const TICKS: f64 = 100.0;

/// Processor seconds of all threads so far, user and system.
pub(crate) fn processor_seconds() -> f64 {
    let text = fs::read_to_string("/proc/self/stat").unwrap_or_default();
    // The name in parentheses may hold spaces; user and system time are fields 14 and 15.
    let fields = text.rsplit_once(')').map_or("", |(_, rest)| rest);
    let ticks = |n: usize| -> f64 {
        fields.split_whitespace().nth(n).and_then(|f| f.parse().ok()).unwrap_or(0.0)
    };
    (ticks(11) + ticks(12)) / TICKS
}

/// As [`processor_seconds`], to the microsecond: what times are compared by on a machine that does
/// other things as well. Wall-clock time where there is no such clock.
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
    // Not allowed everywhere; the peak then counts from the start of the process.
    let _ = fs::write("/proc/self/clear_refs", "5");
}

/// Greatest resident memory since [`reset_peak`], bytes.
pub(crate) fn peak_bytes() -> u64 {
    let text = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = text.lines().find_map(|l| l.strip_prefix("VmHWM:"));
    let kib = line.and_then(|l| l.split_whitespace().next()).and_then(|n| n.parse::<u64>().ok());
    kib.unwrap_or(0) * 1024
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    #[test]
    fn work_and_memory_are_seen() {
        let before = super::processor_seconds();
        let exact = super::cpu_seconds();
        let data: Vec<u64> = (0..4_000_000).collect();
        let start = std::time::Instant::now();
        let mut sum = 0u64;
        while start.elapsed().as_millis() < 200 {
            sum = data.iter().fold(sum, |a, b| a.wrapping_mul(3).wrapping_add(*b));
        }
        assert!(sum != 1 && super::processor_seconds() > before);
        assert!(super::cpu_seconds() - exact > 0.01);
        assert!(super::peak_bytes() > 32_000_000);
    }
}
