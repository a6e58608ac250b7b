//! Peak memory of this process, as Linux counts it.

/// Peak resident set in MB (10^6 bytes); 0 where the system does not say.
pub(crate) fn own_mb() -> f64 {
    status("VmHWM:")
}

/// Resident set now, MB.
pub(crate) fn now_mb() -> f64 {
    status("VmRSS:")
}

fn status(field: &str) -> f64 {
    let text = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = text.lines().find_map(|l| l.strip_prefix(field));
    let kib = line.and_then(|l| l.split_whitespace().next()?.parse::<f64>().ok());
    kib.unwrap_or(0.0) * 1024.0 / 1e6
}

/// Starts the peak anew, where the system lets a process do that.
pub(crate) fn reset() {
    // 5: reset the peak resident set (man 5 proc).
    let _ = std::fs::write("/proc/self/clear_refs", "5");
}
