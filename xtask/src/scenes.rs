//! The registry of scenes, `scenes.toml`, and scenes given as folders.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use gs_model::dataset::Dataset;
use serde::Deserialize;

/// The scene of a run without argument.
pub(crate) const DEFAULT: &str = "room";

/// One entry of the registry.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Entry {
    /// Folder, relative to the workspace root.
    dir: PathBuf,
    /// One line about the scene.
    what: String,
    /// What to put there if it is missing.
    put: String,
}

/// A scene found on disk.
#[derive(Debug)]
pub(crate) struct Found {
    /// Registry name, or the folder's own name.
    pub(crate) name: String,
    /// One line about it.
    pub(crate) what: String,
    /// Cameras, photos and model.
    pub(crate) dataset: Dataset,
}

impl Found {
    /// MB (10^6 bytes) of the model's floats: 59 a Gaussian at SH degree 3.
    pub(crate) fn raw_mb(&self) -> Result<f64> {
        let (scene, _) = gs_model::ply::read(&self.dataset.model_path)?;
        Ok((scene.len() * (11 + 3 * scene.sh_len()) * 4) as f64 / 1e6)
    }
}

/// The workspace root: xtask is only ever run from its checkout.
pub(crate) fn root() -> PathBuf {
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR"));
    manifest.parent().unwrap_or(manifest).to_path_buf()
}

/// The registry that is built in.
pub(crate) fn registry() -> Result<BTreeMap<String, Entry>> {
    toml::from_str(include_str!("../scenes.toml")).context("xtask/scenes.toml")
}

/// The folder of a scene of the registry.
pub(crate) fn dir_of(name: &str) -> Result<PathBuf> {
    let registry = registry()?;
    let entry = registry.get(name).with_context(|| format!("xtask/scenes.toml has no {name}"))?;
    Ok(root().join(&entry.dir))
}

/// Finds a scene by registry name or as a folder. A name wins over a folder of that name; write
/// `./name` for the folder.
pub(crate) fn find(scene: &str) -> Result<Found> {
    find_in(&registry()?, &root(), scene)
}

fn find_in(registry: &BTreeMap<String, Entry>, root: &Path, scene: &str) -> Result<Found> {
    if let Some(entry) = registry.get(scene) {
        let dir = root.join(&entry.dir);
        let remedy = || format!("put into {}: {}", entry.dir.display(), entry.put);
        if !dir.is_dir() {
            bail!("scene {scene} is not there; {}", remedy());
        }
        let dataset =
            open(&dir).with_context(|| format!("scene {scene} is not whole; {}", remedy()))?;
        return Ok(Found { name: scene.to_owned(), what: entry.what.clone(), dataset });
    }
    let dir = Path::new(scene);
    if !dir.is_dir() {
        let names: Vec<&str> = registry.keys().map(String::as_str).collect();
        bail!("{scene} is neither a folder nor a known scene ({})", names.join(", "));
    }
    let dataset = open(dir).with_context(|| {
        format!(
            "{scene}: a scene is a model (point_cloud.ply) and cameras with photos (sparse/0 and \
             images/, cameras.json or transforms.json)"
        )
    })?;
    let name = dir.canonicalize().ok().and_then(|d| d.file_name().map(|n| n.to_owned()));
    let name = name.map_or_else(|| "scene".to_owned(), |n| n.to_string_lossy().into_owned());
    Ok(Found { name, what: format!("folder {scene}"), dataset })
}

fn open(dir: &Path) -> Result<Dataset> {
    let dataset = Dataset::open(dir)?;
    if dataset.views.is_empty() {
        bail!("{} lists no camera", dir.display());
    }
    if let Some(view) = dataset.held_out().find(|v| !v.has_photo()) {
        bail!("photo {} is missing", view.image_path.display());
    }
    Ok(dataset)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_registry_knows_the_papers_scenes() {
        let registry = registry().unwrap();
        for name in [DEFAULT, "fox", "bonsai", "playroom", "truck", "train", "drjohnson"] {
            assert!(registry.contains_key(name), "{name}");
        }
    }

    #[test]
    fn a_missing_scene_says_what_to_put_where_in_one_line() {
        let empty = tempfile::tempdir().unwrap();
        let error = find_in(&registry().unwrap(), empty.path(), "playroom").unwrap_err();
        let line = format!("{error:#}");
        assert!(line.contains("scenes/playroom") && line.contains("point_cloud.ply"), "{line}");
        assert!(line.contains("sparse/0") && !line.contains('\n'), "{line}");
    }

    #[test]
    fn an_unknown_name_lists_the_known_ones() {
        let error = find("no-such-scene").unwrap_err().to_string();
        assert!(error.contains("playroom") && error.contains("no-such-scene"), "{error}");
    }

    #[test]
    fn a_folder_that_is_no_scene_says_what_it_needs() {
        let dir = tempfile::tempdir().unwrap();
        let error = format!("{:#}", find(dir.path().to_str().unwrap()).unwrap_err());
        assert!(error.contains("point_cloud.ply") && !error.contains('\n'), "{error}");
    }
}
