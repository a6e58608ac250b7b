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
    /// Program, compiler and stream format, with their versions.
    pub(crate) versions: Vec<(String, String)>,
    /// Seed of the fine-tune's order of views.
    pub(crate) seed: u64,
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

/// What this run is made of: hashes of its inputs, and everything the machine tells.
pub(crate) fn of(program: &str, model: &str, views: &str) -> Manifest {
    Manifest {
        command: command(),
        commit: commit(),
        versions: versions(),
        seed: tune::FineTuneOptions::default().seed,
        program_sha256: program.to_owned(),
        model_sha256: model.to_owned(),
        views_sha256: views.to_owned(),
        threads: rayon::current_num_threads(),
        processor: processor(),
        target: format!("{}-{}", std::env::consts::ARCH, std::env::consts::OS),
    }
}

/// The command line of this run.
fn command() -> String {
    let args: Vec<String> = std::env::args().skip(1).collect();
    format!("cargo xtask {}", args.join(" "))
}

fn versions() -> Vec<(String, String)> {
    let own = env!("CARGO_PKG_VERSION").to_owned();
    let compiler = Command::new("rustc").arg("--version").output().ok();
    let compiler = compiler.and_then(|o| String::from_utf8(o.stdout).ok()).unwrap_or_default();
    let compiler = compiler.trim().trim_start_matches("rustc ").to_owned();
    let mut out = vec![("gsvx".to_owned(), own)];
    if !compiler.is_empty() {
        out.push(("rustc".to_owned(), compiler));
    }
    out
}

/// Commit of the checkout.
fn commit() -> String {
    let git = |args: &[&str]| {
        let out = Command::new("git").args(args).current_dir(crate::scenes::root()).output();
        out.ok().filter(|o| o.status.success()).and_then(|o| String::from_utf8(o.stdout).ok())
    };
    let Some(head) = git(&["rev-parse", "--short=12", "HEAD"]) else { return String::new() };
    let dirty = git(&["status", "--porcelain", "-uno"]).is_some_and(|s| !s.trim().is_empty());
    format!("{}{}", head.trim(), if dirty { "-dirty" } else { "" })
}

/// Threads and processor, in words.
pub(crate) fn machine() -> String {
    format!("{} threads, {}", rayon::current_num_threads(), processor())
}

/// The processor's name, from Linux' `/proc/cpuinfo`; empty elsewhere.
fn processor() -> String {
    let text = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let line = text.lines().find_map(|l| l.strip_prefix("model name"));
    line.map(|l| l.trim_start_matches([' ', '\t', ':']).to_owned()).unwrap_or_default()
}
