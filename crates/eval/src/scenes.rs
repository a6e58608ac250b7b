//! Scenes to measure on: those of `scenes.toml`, and folders.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use finetune::TrainView;
use gs_model::dataset::{Dataset, find_model, open_views};
use gs_model::{Camera, Invalid, ReadOptions, Scene};
use serde::Deserialize;

use crate::measure;

/// The scene of a run without argument.
pub const DEFAULT: &str = "room";

/// One entry of the registry.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    /// Folder, relative to the workspace root.
    dir: PathBuf,
    /// One line about the scene.
    what: String,
    /// What to put there if it is missing.
    put: String,
}

/// A scene found on disk; only its cameras are read.
#[derive(Debug)]
pub struct SceneFiles {
    /// Name in `scenes.toml`, or the folder's own name.
    pub name: String,
    /// One line about it.
    pub what: String,
    /// Where cameras, photos and model are.
    pub dataset: Dataset,
}

/// The valid Gaussians of a model of any format, or of a stream.
pub(crate) fn read_model(file: &Path) -> Result<Scene> {
    if file.extension().is_some_and(|e| e == "gsvx") {
        return Ok(gsvx::decode(&std::fs::read(file)?)?);
    }
    let codec = Some(&gsvx::gltf::CODEC);
    let options = ReadOptions { invalid: Invalid::Drop, codec, ..Default::default() };
    Ok(gs_model::model::read(file, &options)?.0)
}

/// The root of the workspace that this crate was built in.
#[must_use]
pub fn root() -> PathBuf {
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR"));
    manifest.ancestors().nth(2).unwrap_or(manifest).to_path_buf()
}

/// A scene in memory: what a codec works on, and the photos it is measured with.
pub struct TestScene {
    /// Where its files are.
    pub files: SceneFiles,
    /// The valid Gaussians of the model.
    pub model: Scene,
    /// Gaussians of the file that are not finite and were left out.
    pub invalid: usize,
    /// Training cameras.
    pub training: Vec<Camera>,
    /// Held-out cameras with their photos.
    pub held_out: Vec<TrainView>,
}

impl TestScene {
    /// Reads a scene, given as for [`find`], with at most `most` of its held-out views, evenly
    /// spread.
    ///
    /// # Errors
    /// If something of it is missing or cannot be read.
    pub fn open(scene: &str, most: usize) -> Result<Self> {
        let files = find(scene)?;
        let held_out = measure::load(spread(files.dataset.held_out().collect(), most))?;
        let (mut model, _) = gs_model::ply::read(&files.dataset.model_path)?;
        let before = model.len();
        model.drop_invalid();
        if model.is_empty() {
            bail!("{}: no valid Gaussian in it", files.dataset.model_path.display());
        }
        let invalid = before - model.len();
        let training = files.dataset.training().map(|v| v.camera.clone()).collect();
        Ok(Self { files, model, invalid, training, held_out })
    }
}

/// The name of a model: that of its file, or of its folder where all such files have one name.
pub(crate) fn name_of(model: &Path) -> String {
    let folder = model.parent().and_then(Path::file_name).unwrap_or_default().to_string_lossy();
    let stem = model.file_stem().unwrap_or_default().to_string_lossy();
    if stem == "meta" { folder.into_owned() } else { stem.into_owned() }
}

/// At most `most` of `all`, evenly spread.
pub(crate) fn spread<T: Copy>(all: Vec<T>, most: usize) -> Vec<T> {
    let n = all.len();
    if n <= most {
        return all;
    }
    (0..most).map(|i| all[i * n / most]).collect()
}

/// The registry that is built in.
fn registry() -> Result<BTreeMap<String, Entry>> {
    toml::from_str(include_str!("../scenes.toml")).context("crates/eval/scenes.toml")
}

/// The folder of a scene of `scenes.toml`.
///
/// # Errors
/// If the name is not in it.
pub fn dir_of(name: &str) -> Result<PathBuf> {
    let registry = registry()?;
    let entry =
        registry.get(name).with_context(|| format!("crates/eval/scenes.toml has no {name}"))?;
    Ok(root().join(&entry.dir))
}

/// Finds a scene by its name in `scenes.toml` or as a folder. A name wins over a folder of that
/// name; write `./name` for the folder.
///
/// # Errors
/// If there is no such scene, or something of it is missing; the message says what to put where.
pub fn find(scene: &str) -> Result<SceneFiles> {
    find_in(&registry()?, &root(), scene)
}

fn find_in(registry: &BTreeMap<String, Entry>, root: &Path, scene: &str) -> Result<SceneFiles> {
    if let Some(entry) = registry.get(scene) {
        let dir = root.join(&entry.dir);
        let remedy = || format!("put into {}: {}", entry.dir.display(), entry.put);
        if !dir.is_dir() {
            bail!("scene {scene} is not there; {}", remedy());
        }
        let dataset = open(&dir, &trained(root, scene))
            .with_context(|| format!("scene {scene} is not whole; {}", remedy()))?;
        return Ok(SceneFiles { name: scene.to_owned(), what: entry.what.clone(), dataset });
    }
    let dir = Path::new(scene);
    if !dir.is_dir() {
        let names: Vec<&str> = registry.keys().map(String::as_str).collect();
        bail!("{scene} is neither a folder nor a known scene ({})", names.join(", "));
    }
    let name = dir.canonicalize().ok().and_then(|d| d.file_name().map(|n| n.to_owned()));
    let name = name.map_or_else(|| "scene".to_owned(), |n| n.to_string_lossy().into_owned());
    let dataset = open(dir, &trained(root, &name)).with_context(|| {
        format!(
            "{scene}: a scene is a model (point_cloud.ply) and cameras with photos (sparse/0 and \
             images/, cameras.json or transforms.json)"
        )
    })?;
    Ok(SceneFiles { name, what: format!("folder {scene}"), dataset })
}

/// Where `cargo xtask train` puts the model of a scene.
#[must_use]
pub fn trained(root: &Path, scene: &str) -> PathBuf {
    root.join("out/train").join(scene).with_extension("ply")
}

/// A scene without a model has the one that was trained here, if there is one.
fn open(dir: &Path, trained: &Path) -> Result<Dataset> {
    let dataset = match find_model(dir) {
        Err(_) if trained.is_file() => {
            let (dir, model_path) = (dir.to_owned(), trained.to_owned());
            Dataset { views: open_views(&dir)?, dir, model_path }
        }
        _ => Dataset::open(dir)?,
    };
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
        assert!(line.contains("`cargo xtask fetch playroom` (0.63 GB"), "{line}");
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

    #[test]
    fn a_scene_without_a_model_has_the_one_that_was_trained_here() {
        let root = tempfile::tempdir().unwrap();
        let dir = root.path().join("a");
        testing::copy_room(&dir);
        std::fs::remove_file(dir.join("point_cloud.ply")).unwrap();
        let model = || {
            let found = find_in(&registry().unwrap(), root.path(), dir.to_str().unwrap());
            found.map(|files| files.dataset.model_path)
        };
        assert!(format!("{:#}", model().unwrap_err()).contains("point_cloud.ply"));
        let trained = trained(root.path(), "a");
        std::fs::create_dir_all(trained.parent().unwrap()).unwrap();
        std::fs::write(&trained, "ply").unwrap();
        assert_eq!(model().unwrap(), trained);
    }

    #[test]
    fn spread_keeps_the_first_and_reaches_far() {
        assert_eq!(spread((0..7).collect(), 3), [0, 2, 4]);
        assert_eq!(spread((0..7).collect(), 9).len(), 7);
    }
}
