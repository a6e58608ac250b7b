//! Where a result came from.

use crate::process::printed;

/// Provenance of a run: names and values. `hashes` are of the program, the model, and cameras with photos.
pub(crate) fn of([program, model, views]: &[String; 3]) -> Vec<(&'static str, String)> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let target = format!("{}-{}", std::env::consts::ARCH, std::env::consts::OS);
    let seed = tune::FineTuneOptions::default().seed;
    vec![
        ("Command", format!("cargo xtask {}", args.join(" "))),
        ("Commit", commit()),
        ("Version", env!("CARGO_PKG_VERSION").to_owned()),
        ("Compiler", printed("rustc", &["--version"]).unwrap_or_default()),
        ("Seed of the fine-tune; everything else is without chance", seed.to_string()),
        ("Model SHA-256", model.clone()),
        ("Cameras and photos SHA-256", views.clone()),
        ("Program SHA-256", program.clone()),
        ("Machine", format!("{}, {target}", machine())),
    ]
}

/// Commit of the checkout, "-dirty" if it has changes; empty without git.
fn commit() -> String {
    let dirty = printed("git", &["status", "--porcelain", "-uno"]).is_some_and(|s| !s.is_empty());
    let head = printed("git", &["rev-parse", "--short=12", "HEAD"]);
    head.map_or(String::new(), |head| head + if dirty { "-dirty" } else { "" })
}

/// Threads and processor, in words. Only Linux tells the processor's name.
pub(crate) fn machine() -> String {
    let text = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let line = text.lines().find_map(|l| l.strip_prefix("model name")).unwrap_or_default();
    let processor = line.trim_start_matches([' ', '\t', ':']);
    format!("{} threads, {processor}", rayon::current_num_threads())
}
