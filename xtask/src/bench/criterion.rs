//! What `cargo bench` left in `target/criterion`.

use std::path::Path;

use serde::Deserialize;

#[derive(Deserialize)]
struct Benchmark {
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

/// Names and median seconds of all benchmarks, sorted by name.
pub(super) fn estimates(folder: &Path) -> Vec<(String, f64)> {
    let mut out = Vec::new();
    collect(folder, &mut out);
    out.sort_by(|a, b| a.0.cmp(&b.0));
    out
}

fn collect(folder: &Path, out: &mut Vec<(String, f64)>) {
    let new = folder.join("new");
    let read = |name: &str| std::fs::read(new.join(name)).ok();
    if let (Some(id), Some(estimates)) = (read("benchmark.json"), read("estimates.json"))
        && let Ok(id) = serde_json::from_slice::<Benchmark>(&id)
        && let Ok(estimates) = serde_json::from_slice::<Estimates>(&estimates)
    {
        out.push((id.full_id, estimates.median.point_estimate * 1e-9));
        return;
    }
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        if entry.path().is_dir() {
            collect(&entry.path(), out);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn saved_estimates_are_found() {
        let dir = tempfile::tempdir().unwrap();
        let new = dir.path().join("group/name/new");
        std::fs::create_dir_all(&new).unwrap();
        std::fs::write(new.join("benchmark.json"), r#"{"full_id":"group/name"}"#).unwrap();
        std::fs::write(new.join("estimates.json"), r#"{"median":{"point_estimate":5e6}}"#).unwrap();
        assert_eq!(estimates(dir.path()), [("group/name".to_owned(), 0.005)]);
        assert!(estimates(&dir.path().join("absent")).is_empty());
    }
}
