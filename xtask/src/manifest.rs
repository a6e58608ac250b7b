//! Where a result came from.

use std::process::Command;

use serde::{Deserialize, Serialize};

/// Provenance of a run.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Manifest {
    /// Command line.
    pub(crate) command: String,
    /// Commit of the checkout, "-dirty" if it has changes; empty without git.
    pub(crate) commit: String,
    /// SHA-256 of the program.
    pub(crate) program_sha256: String,
    /// SHA-256 of the model file.
    pub(crate) model_sha256: String,
    /// SHA-256 over cameras and photos of the measured views.
    pub(crate) views_sha256: String,
    /// Threads available.
    pub(crate) threads: usize,
    /// Processor, where the system tells.
    pub(crate) processor: String,
    /// Target architecture and system.
    pub(crate) target: String,
}

/// Commit of the checkout.
pub(crate) fn commit() -> String {
    let git = |args: &[&str]| {
        let out = Command::new("git").args(args).current_dir(crate::scenes::root()).output();
        out.ok().filter(|o| o.status.success()).and_then(|o| String::from_utf8(o.stdout).ok())
    };
    let Some(head) = git(&["rev-parse", "--short=12", "HEAD"]) else { return String::new() };
    let dirty = git(&["status", "--porcelain", "-uno"]).is_some_and(|s| !s.trim().is_empty());
    format!("{}{}", head.trim(), if dirty { "-dirty" } else { "" })
}

/// The processor's name, from Linux' `/proc/cpuinfo`; empty elsewhere.
pub(crate) fn processor() -> String {
    let text = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let line = text.lines().find_map(|l| l.strip_prefix("model name"));
    line.map(|l| l.trim_start_matches([' ', '\t', ':']).to_owned()).unwrap_or_default()
}
