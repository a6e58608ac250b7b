//! [`Dataset`]: photos with cameras, and a model trained on them.

use std::path::{Path, PathBuf};

use crate::camera::{Camera, View};
use crate::error::{Error, Result};
use crate::photos::Finder;
use crate::{colmap, fs, inria, nerf};

/// Every how many views one is held out.
pub const HOLD_OUT_EVERY: usize = 8;

/// A folder with posed photos and a trained model of them.
#[derive(Clone, Debug, PartialEq)]
pub struct Dataset {
    /// The folder.
    pub dir: PathBuf,
    /// All views, sorted by image name (bytewise).
    pub views: Vec<View>,
    /// The trained model, a PLY file.
    pub model_path: PathBuf,
}

impl Dataset {
    /// Opens a folder.
    ///
    /// Cameras are those of the first of these that is there:
    /// - `sparse/0/` (or `sparse/`), a COLMAP model; photos in `images/`;
    /// - `cameras.json`, an output folder of the Inria trainer; photos where [`crate::inria`]
    ///   finds them;
    /// - `transforms.json`; photos at the paths it names.
    ///
    /// The model is the first of `point_cloud.ply`, `point_cloud/iteration_N/point_cloud.ply`
    /// with the largest `N`, and a single `*.ply` in the folder.
    ///
    /// # Errors
    /// [`Error::Io`] if the folder is not there, [`Error::NotADataset`],
    /// [`Error::Malformed`] if two images share a name, and those of the
    /// readers in [`crate::colmap`], [`crate::inria`] and [`crate::nerf`]. A photo that is missing is not an error here; one with another extension, or in `images_2`,
    /// `images_4` or `images_8` (after the name of its folder), is found.
    pub fn open(dir: impl AsRef<Path>) -> Result<Self> {
        let dir = dir.as_ref();
        let views = open_views(dir)?;
        Ok(Self { dir: dir.into(), views, model_path: find_model(dir)? })
    }

    /// The held-out views: the first and every [`HOLD_OUT_EVERY`]th after it, by sorted name.
    pub fn held_out(&self) -> impl ExactSizeIterator<Item = &View> {
        self.views.iter().step_by(HOLD_OUT_EVERY)
    }

    /// The views that are not held out.
    pub fn training(&self) -> impl Iterator<Item = &View> {
        let views = self.views.iter().enumerate();
        views.filter(|(i, _)| i % HOLD_OUT_EVERY != 0).map(|(_, view)| view)
    }
}

/// The views of a folder as [`Dataset::open`] takes it, whether or not it holds a model, or of a file: a
/// `cameras.json` of Inria's trainer or a `transforms.json`. Sorted by image name. Views of a `cameras.json`
/// file have the names of the images as their paths.
///
/// # Errors
/// As [`Dataset::open`], without those about the model.
pub fn open_views(path: impl AsRef<Path>) -> Result<Vec<View>> {
    let path = path.as_ref();
    let mut views = if path.is_file() { of_file(path)? } else { of_folder(path)? };
    views.sort_by(|a, b| a.camera.name.cmp(&b.camera.name));
    match views.windows(2).find(|pair| pair[0].camera.name == pair[1].camera.name) {
        Some(pair) => {
            let image = format!("image {:?}", pair[0].camera.name);
            Err(Error::malformed(path, &image, "two views have this name"))
        }
        None => Ok(views),
    }
}

/// The points of the COLMAP model in a folder, where training begins.
///
/// # Errors
/// [`Error::NotADataset`] if there is none; those of [`colmap::read_points`].
pub fn open_points(dir: impl AsRef<Path>) -> Result<Vec<colmap::Point>> {
    let dir = dir.as_ref();
    match sparse_of(dir) {
        Some(sparse) => colmap::read_points(sparse),
        None => Err(Error::not_a_dataset(dir, "no points: expected sparse/0/points3D.bin or .txt")),
    }
}

/// The folder of the COLMAP model of a scene.
fn sparse_of(dir: &Path) -> Option<PathBuf> {
    [dir.join("sparse/0"), dir.join("sparse")].into_iter().find(|s| colmap::is_model(s))
}

fn of_folder(dir: &Path) -> Result<Vec<View>> {
    let transforms = dir.join("transforms.json");
    if let Some(sparse) = sparse_of(dir) {
        let mut finder = Finder::default();
        let mut view = |camera: Camera| {
            let expected = Path::new("images").join(&camera.name);
            let found = finder.find(dir, &expected)?;
            Ok(View { image_path: found.unwrap_or_else(|| dir.join(expected)), camera })
        };
        colmap::read_cameras(sparse)?.into_iter().map(&mut view).collect()
    } else if dir.join("cameras.json").is_file() {
        inria::views(dir)
    } else if transforms.is_file() {
        nerf::views_from_bytes(&transforms, &fs::read(&transforms)?)
    } else {
        // A missing folder is reported as such, not as a folder without cameras.
        std::fs::read_dir(dir).map_err(|e| Error::io(dir, "list", e))?;
        let reason = "no cameras: expected sparse/0/images.bin or .txt (COLMAP), cameras.json (Inria \
                      output) or transforms.json (NeRF)";
        Err(Error::not_a_dataset(dir, reason))
    }
}

fn of_file(path: &Path) -> Result<Vec<View>> {
    // Inria's cameras.json is a list, a transforms.json an object.
    let text = fs::read(path)?;
    if text.trim_ascii_start().starts_with(b"[") {
        let view = |camera: Camera| View { image_path: camera.name.clone().into(), camera };
        Ok(inria::cameras_from_bytes(path, &text)?.into_iter().map(view).collect())
    } else {
        nerf::views_from_bytes(path, &text)
    }
}

/// The trained model in a folder: see [`Dataset::open`].
///
/// # Errors
/// [`Error::NotADataset`], [`Error::Io`].
pub fn find_model(dir: impl AsRef<Path>) -> Result<PathBuf> {
    let dir = dir.as_ref();
    let direct = dir.join("point_cloud.ply");
    if direct.is_file() {
        return Ok(direct);
    }
    let iterations = dir.join("point_cloud");
    let last = fs::names(&iterations)?
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
    let mut models: Vec<PathBuf> = fs::names(dir)?
        .iter()
        .map(|name| dir.join(name))
        .filter(|p| p.extension().is_some_and(|e| e.eq_ignore_ascii_case("ply")) && p.is_file())
        .collect();
    // The Inria trainer puts the SfM points that it started from beside its output.
    models.retain(|p| !p.ends_with("input.ply"));
    match &models[..] {
        [only] => Ok(only.clone()),
        [] => {
            let reason = "no model: expected point_cloud.ply, point_cloud/iteration_N/point_cloud.ply or a \
                          single .ply file";
            Err(Error::not_a_dataset(dir, reason))
        }
        several => {
            let names = several.iter().filter_map(|p| Some(p.file_name()?.to_string_lossy()));
            let names = names.collect::<Vec<_>>().join(", ");
            let reason = format!("several models: {names}; rename one to point_cloud.ply");
            Err(Error::not_a_dataset(dir, reason))
        }
    }
}
