//! [`Dataset`]: photos with cameras, and a model trained on them.

mod model;

use std::path::{Path, PathBuf};

use crate::camera::{Camera, LensDistortion};
use crate::error::{Error, Result};
pub use crate::view::View;
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
    /// [`Error::Io`] if the folder is not there, [`Error::NoCameras`], [`Error::NotOneModel`],
    /// [`Error::Malformed`] if two images share a name, and those of the
    /// readers in [`crate::colmap`], [`crate::inria`] and [`crate::nerf`]: distorted cameras are
    /// refused. A photo that is missing is not an error here.
    pub fn open(dir: impl AsRef<Path>) -> Result<Self> {
        let dir = dir.as_ref();
        let views = open_views(dir, LensDistortion::Refuse)?;
        Ok(Self { dir: dir.into(), views, model_path: model::find(dir)? })
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
/// As [`Dataset::open`], without those about the model; distorted cameras are refused as asked for.
pub fn open_views(path: impl AsRef<Path>, distortion: LensDistortion) -> Result<Vec<View>> {
    let path = path.as_ref();
    let mut views =
        if path.is_file() { of_file(path, distortion)? } else { of_folder(path, distortion)? };
    views.sort_by(|a, b| a.camera.name.cmp(&b.camera.name));
    match views.windows(2).find(|pair| pair[0].camera.name == pair[1].camera.name) {
        Some(pair) => {
            let image = format!("image {:?}", pair[0].camera.name);
            Err(Error::malformed(path, &image, "two views have this name"))
        }
        None => Ok(views),
    }
}

fn of_folder(dir: &Path, distortion: LensDistortion) -> Result<Vec<View>> {
    let sparse = [dir.join("sparse/0"), dir.join("sparse")];
    if let Some(sparse) = sparse.iter().find(|s| colmap::is_model(s)) {
        let images = dir.join("images");
        let view = |camera: Camera| View { image_path: images.join(&camera.name), camera };
        Ok(colmap::read_cameras(sparse, distortion)?.into_iter().map(view).collect())
    } else if dir.join("cameras.json").is_file() {
        inria::read_views(dir)
    } else if dir.join("transforms.json").is_file() {
        nerf::read_views(dir.join("transforms.json"), distortion)
    } else {
        // A missing folder is reported as such, not as a folder without cameras.
        std::fs::read_dir(dir).map_err(|e| Error::io(dir, "list", e))?;
        Err(Error::NoCameras { dir: dir.into() })
    }
}

fn of_file(path: &Path, distortion: LensDistortion) -> Result<Vec<View>> {
    // Inria's cameras.json is a list, a transforms.json an object.
    let text = fs::read(path)?;
    if text.iter().find(|b| !b.is_ascii_whitespace()) == Some(&b'[') {
        let view = |camera: Camera| View { image_path: camera.name.clone().into(), camera };
        Ok(inria::read_cameras(path)?.into_iter().map(view).collect())
    } else {
        nerf::read_views(path, distortion)
    }
}
