//! [`Dataset`]: photos with cameras, and a model trained on them.

mod model;

use std::path::{Path, PathBuf};

use crate::camera::LensDistortion;
use crate::error::{Error, Result};
pub use crate::view::View;
use crate::{colmap, inria, nerf};

/// Every how many views one is held out.
pub const HOLD_OUT_EVERY: usize = 8;

/// What kind of folder a [`Dataset`] was opened from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A COLMAP project: `sparse/0/` and `images/`.
    Colmap,
    /// An output folder of the Inria trainer: `cameras.json`.
    Inria,
    /// `transforms.json`, as NeRF tools write it.
    Nerf,
}

/// A folder with posed photos and a trained model of them.
#[derive(Clone, Debug, PartialEq)]
pub struct Dataset {
    /// The folder.
    pub dir: PathBuf,
    /// What the cameras were read from.
    pub kind: Kind,
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
    /// [`Error::Io`] if the folder is not there, [`Error::NoCameras`], [`Error::NoModel`],
    /// [`Error::ManyModels`], [`Error::DuplicateView`] if two images share a name, and those of the
    /// readers in [`crate::colmap`], [`crate::inria`] and [`crate::nerf`]: distorted cameras are
    /// refused. A photo that is missing is not an error here.
    pub fn open(dir: impl AsRef<Path>) -> Result<Self> {
        let dir = dir.as_ref();
        let (kind, views) = open_views(dir)?;
        Ok(Self { dir: dir.into(), kind, views, model_path: model::find(dir)? })
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

/// The views of a folder, sorted by image name, whether or not it holds a model. Distorted cameras
/// are refused, so renders can be compared with the photos.
///
/// # Errors
/// As [`Dataset::open`], without those about the model.
pub fn open_views(dir: impl AsRef<Path>) -> Result<(Kind, Vec<View>)> {
    open_views_with(dir, LensDistortion::Refuse)
}

/// As [`open_views`], with a choice of what to do with distorted cameras.
///
/// # Errors
/// As [`open_views`], without [`Error::DistortedCamera`] for [`LensDistortion::Ignore`].
pub fn open_views_with(
    dir: impl AsRef<Path>,
    distortion: LensDistortion,
) -> Result<(Kind, Vec<View>)> {
    let dir = dir.as_ref();
    let sparse = [dir.join("sparse/0"), dir.join("sparse")];
    let (kind, mut views) = if let Some(sparse) = sparse.iter().find(|s| colmap::is_model(s)) {
        let cameras = colmap::read_cameras_with(sparse, distortion)?;
        let images = dir.join("images");
        let views = cameras
            .into_iter()
            .map(|camera| View { image_path: images.join(&camera.name), camera });
        (Kind::Colmap, views.collect::<Vec<_>>())
    } else if dir.join("cameras.json").is_file() {
        (Kind::Inria, inria::read_views(dir)?)
    } else if dir.join("transforms.json").is_file() {
        (Kind::Nerf, nerf::read_views_with(dir.join("transforms.json"), distortion)?)
    } else {
        // A missing folder is reported as such, not as a folder without cameras.
        std::fs::read_dir(dir).map_err(|e| Error::io(dir, "list", e))?;
        return Err(Error::NoCameras { dir: dir.into() });
    };
    views.sort_by(|a, b| a.camera.name.cmp(&b.camera.name));
    if let Some(pair) = views.windows(2).find(|pair| pair[0].camera.name == pair[1].camera.name) {
        let name = pair[0].camera.name.clone();
        return Err(Error::DuplicateView { file: dir.into(), what: "image", name });
    }
    Ok((kind, views))
}

/// The views of a folder, as [`open_views_with`], or of a file: a `cameras.json` of Inria's trainer or a
/// `transforms.json`. Sorted by image name. Views of a `cameras.json` have the names of the images as their
/// paths.
///
/// # Errors
/// Those of [`open_views_with`] and of the readers in [`crate::inria`] and [`crate::nerf`].
pub fn open_views_at(path: impl AsRef<Path>, distortion: LensDistortion) -> Result<Vec<View>> {
    let path = path.as_ref();
    if !path.is_file() {
        return Ok(open_views_with(path, distortion)?.1);
    }
    // Inria's cameras.json is a list, a transforms.json an object.
    let text = std::fs::read(path).map_err(|e| Error::io(path, "read", e))?;
    let list = text.iter().find(|b| !b.is_ascii_whitespace()) == Some(&b'[');
    let mut views = if list {
        let cameras = inria::read_cameras(path)?.into_iter();
        cameras.map(|camera| View { image_path: camera.name.clone().into(), camera }).collect()
    } else {
        nerf::read_views_with(path, distortion)?
    };
    views.sort_by(|a, b| a.camera.name.cmp(&b.camera.name));
    Ok(views)
}
