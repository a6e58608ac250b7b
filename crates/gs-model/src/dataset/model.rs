//! Finding the model in a folder.

use std::path::{Path, PathBuf};

use crate::error::{Error, Result};
use crate::fs::names;

/// See [`super::Dataset::open`].
pub(super) fn find(dir: &Path) -> Result<PathBuf> {
    let direct = dir.join("point_cloud.ply");
    if direct.is_file() {
        return Ok(direct);
    }
    let iterations = dir.join("point_cloud");
    let last = names(&iterations)?
        .iter()
        .filter_map(|name| {
            let n: u64 = name.to_str()?.strip_prefix("iteration_")?.parse().ok()?;
            let file = iterations.join(name).join("point_cloud.ply");
            file.is_file().then_some((n, file))
        })
        .max();
    if let Some((_, file)) = last {
        return Ok(file);
    }
    let mut models: Vec<PathBuf> = names(dir)?
        .iter()
        .map(|name| dir.join(name))
        .filter(|p| p.extension().is_some_and(|e| e.eq_ignore_ascii_case("ply")) && p.is_file())
        .collect();
    // The Inria trainer puts the SfM points that it started from beside its output.
    models.retain(|p| !p.ends_with("input.ply"));
    match &models[..] {
        [only] => Ok(only.clone()),
        several => {
            let names = several.iter().filter_map(|p| p.file_name());
            let found = names.map(|n| n.to_string_lossy().into_owned()).collect();
            Err(Error::NotOneModel { dir: dir.into(), found })
        }
    }
}
