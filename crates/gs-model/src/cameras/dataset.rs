//! [`Dataset`]: photos with cameras, and a model trained on them.

use std::path::{Path, PathBuf};

use super::{colmap, places};
use crate::cameras::camera::View;
pub use crate::cameras::places::{CameraSet, cameras_in, open_cameras};
use crate::error::{Error, Result};
use crate::fs;

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
    /// [`open_cameras`] says where cameras and photos are looked for.
    ///
    /// The model is the first of `point_cloud.ply`, `point_cloud/iteration_N/point_cloud.ply`
    /// with the largest `N`, and a single `*.ply` in the folder.
    ///
    /// # Errors
    /// [`Error::NotADataset`], and those of [`open_cameras`].
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

/// The views of [`open_cameras`].
///
/// # Errors
/// As [`open_cameras`].
pub fn open_views(path: impl AsRef<Path>) -> Result<Vec<View>> {
    Ok(open_cameras(path)?.views)
}

/// The points of the COLMAP model in a folder, where training begins.
///
/// # Errors
/// [`Error::NotADataset`] if there is none; those of [`colmap::read_points`].
pub fn open_points(dir: impl AsRef<Path>) -> Result<Vec<colmap::Point>> {
    let dir = dir.as_ref();
    match places::sparse_model(dir)? {
        Some(sparse) => colmap::read_points(sparse),
        None => Err(Error::not_a_dataset(dir, "no points: expected sparse/0/points3D.bin or .txt")),
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
