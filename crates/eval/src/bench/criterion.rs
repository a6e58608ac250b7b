//! Reads the medians that `cargo bench` left in `target/criterion`, and finds the crate of each.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, ensure};
use serde::Deserialize;

#[derive(Deserialize)]
struct Benchmark {
    group_id: String,
    full_id: String,
}

#[derive(Deserialize)]
struct Estimates {
    median: Estimate,
}

#[derive(Deserialize)]
struct Estimate {
    /// Nanoseconds.
    point_estimate: f64,
}

/// One benchmark's median.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Micro {
    pub(super) group: String,
    pub(super) name: String,
    pub(super) seconds: f64,
}

/// A bench target of a crate, and the groups that its source names.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Target {
    pub(super) package: String,
    pub(super) bench: String,
    pub(super) groups: Vec<String>,
}

impl Target {
    /// The command that measures it.
    pub(super) fn command(&self) -> String {
        format!("cargo bench -p {} --bench {}", self.package, self.bench)
    }
}

/// Folder in which `cargo bench` leaves its estimates.
pub(super) fn folder(root: &Path) -> PathBuf {
    let target = std::env::var_os("CARGO_TARGET_DIR").map(PathBuf::from);
    root.join(target.unwrap_or_else(|| "target".into())).join("criterion")
}

/// All benchmarks' medians, sorted by name.
pub(super) fn estimates(folder: &Path) -> Vec<Micro> {
    let mut out = Vec::new();
    collect(folder, &mut out);
    out.sort_by(|a, b| a.name.cmp(&b.name));
    out
}

fn collect(folder: &Path, out: &mut Vec<Micro>) {
    let new = folder.join("new");
    let read = |name: &str| std::fs::read(new.join(name)).ok();
    if let (Some(id), Some(estimates)) = (read("benchmark.json"), read("estimates.json"))
        && let Ok(id) = serde_json::from_slice::<Benchmark>(&id)
        && let Ok(estimates) = serde_json::from_slice::<Estimates>(&estimates)
    {
        let seconds = estimates.median.point_estimate * 1e-9;
        out.push(Micro { group: id.group_id, name: id.full_id, seconds });
        return;
    }
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        if entry.path().is_dir() {
            collect(&entry.path(), out);
        }
    }
}

/// The criterion benches of all crates, by their sources.
pub(super) fn targets(root: &Path) -> Vec<Target> {
    let mut out = Vec::new();
    let files = |dir: PathBuf| {
        let found = std::fs::read_dir(dir).into_iter().flatten().flatten();
        let mut paths: Vec<PathBuf> = found.map(|e| e.path()).collect();
        paths.sort();
        paths
    };
    for package in files(root.join("crates")) {
        for source in files(package.join("benches")) {
            let Ok(text) = std::fs::read_to_string(&source) else { continue };
            let parts = text.split("benchmark_group(\"").skip(1);
            let groups: Vec<String> =
                parts.filter_map(|p| Some(p.split_once('"')?.0.to_owned())).collect();
            let stem = |p: &Path| p.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            if !groups.is_empty() {
                out.push(Target { package: stem(&package), bench: stem(&source), groups });
            }
        }
    }
    out
}

/// Groups of `target` that have no estimate.
pub(super) fn missing<'a>(target: &'a Target, found: &[Micro]) -> Vec<&'a str> {
    let has = |g: &&String| !found.iter().any(|m| m.group == **g);
    target.groups.iter().filter(has).map(String::as_str).collect()
}

/// Runs every bench, with short measurements.
pub(super) fn run(root: &Path, targets: &[Target]) -> Result<()> {
    for target in targets {
        println!("{}", target.command());
        let status = Command::new("cargo")
            .current_dir(root)
            .args(["bench", "--quiet", "-p", &target.package, "--bench", &target.bench, "--"])
            .args(["--warm-up-time", "0.5", "--measurement-time", "2", "--noplot"])
            .status()
            .context("start cargo")?;
        ensure!(status.success(), "{} failed", target.command());
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn saved_estimates_are_found_and_the_others_are_named() {
        let dir = tempfile::tempdir().unwrap();
        let new = dir.path().join("group/name/new");
        std::fs::create_dir_all(&new).unwrap();
        let id = r#"{"group_id":"group","full_id":"group/name"}"#;
        std::fs::write(new.join("benchmark.json"), id).unwrap();
        std::fs::write(new.join("estimates.json"), r#"{"median":{"point_estimate":5e6}}"#).unwrap();
        let found = estimates(dir.path());
        let micro = Micro { group: "group".into(), name: "group/name".into(), seconds: 0.005 };
        assert_eq!(found, [micro]);
        assert!(estimates(&dir.path().join("absent")).is_empty());
        let groups = ["group", "other"].map(String::from).to_vec();
        let target = Target { package: "p".into(), bench: "b".into(), groups };
        assert_eq!(missing(&target, &found), ["other"]);
    }

    /// Every crate of the codec has a bench that the report includes.
    #[test]
    fn every_stage_has_a_bench() {
        let found = targets(&crate::scenes::root());
        let packages: Vec<&str> = found.iter().map(|t| t.package.as_str()).collect();
        for package in ["finetune", "gpcc-lite", "gs-model", "gsvx", "voxel"] {
            assert!(packages.contains(&package), "{package} has no bench: {packages:?}");
        }
        let codec = found.iter().find(|t| t.package == "gsvx").unwrap();
        assert_eq!((codec.bench.as_str(), codec.groups.len()), ("codec", 1));
    }
}
