//! What cameras see of a scene, tile by tile: of each tile from the cameras that can see it, with nothing else in front.

use super::inputs::changed;
use super::thinned::ThinnedModel;
use crate::doubts::{self, PhotoVerdict};
use crate::exit::note;
use crate::views::{self, Origin, PlacedCameras, ReadViews};
use anyhow::Result;
use finetune::Visibility;
use gs_model::{Camera, Scene, View};
use gsvx::{Choices, ImportanceFrom};
use serde::{Deserialize, Serialize};
use std::convert::Infallible;
use std::path::{Path, PathBuf};

/// The cameras of a plan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct CameraFile {
    path: PathBuf,
    /// Of the training cameras: whoever encodes a part has to see the same.
    checksum: u32,
}

/// Cameras that were read.
pub(crate) struct PlanCameras {
    path: PathBuf,
    /// With the places of photos.
    views: Vec<View>,
    /// Pinhole cameras that show what the photos show.
    cameras: Vec<Camera>,
    pub(super) origin: Option<Origin>,
}

impl PlanCameras {
    /// Reads the cameras of a scene folder or of a camera file.
    pub(crate) fn read(path: &Path) -> Result<Self> {
        let ReadViews { views, origin } = views::training(path, [0.0; 3])?;
        let read = ReadViews { views: views.clone(), origin };
        let PlacedCameras { cameras, origin } = views::as_pinholes(path, read)?;
        Ok(Self { path: path.into(), views, cameras, origin })
    }

    /// What stands in the plan.
    pub(crate) fn file(&self) -> CameraFile {
        let checksum = crc32c::crc32c(format!("{:?}", self.cameras).as_bytes());
        CameraFile { path: self.path.clone(), checksum }
    }

    /// What they see of a tile.
    pub(crate) fn of(&self, tile: &Scene) -> Visibility {
        let Ok(seen) = Visibility::of(tile, &self.about(tile), |_| Ok::<_, Infallible>(()));
        seen
    }

    /// What photos beside the cameras say of these. Warns of a doubt.
    ///
    /// # Errors
    /// If what the cameras do not see would be lost.
    pub(super) fn by_photos(&self, model: ThinnedModel, choices: Choices) -> Result<PhotoVerdict> {
        let model = model.scene();
        let moved = |view: &View| View {
            camera: view.camera.clone().relative_to(model.origin),
            ..view.clone()
        };
        let views: Vec<View> = self.views.iter().map(moved).collect();
        let alone = choices.importance == ImportanceFrom::CamerasAlone;
        doubts::by_photos(&model, &self.path, &views, alone)
    }

    /// Whether a stream of this tile by their importances shows that they may not be the model's own. Warns if so.
    pub(crate) fn is_doubted(&self, tile: &Scene, choices: Choices) -> Result<bool> {
        let Some(doubt) = tune::misfit(tile, &self.about(tile), choices.quality)? else {
            return Ok(false);
        };
        if choices.importance == ImportanceFrom::CamerasAlone {
            note(format_args!("warning: {}: {doubt}", self.path.display()));
            return Ok(false);
        }
        doubts::warn(&self.path, &doubt);
        Ok(true)
    }

    fn about(&self, tile: &Scene) -> Vec<Camera> {
        let moved = |camera: &Camera| camera.clone().relative_to(tile.origin);
        self.cameras.iter().map(moved).collect()
    }

    /// Warns if they see little; `share` is that of the opacity in a sample.
    ///
    /// # Errors
    /// If they see nothing.
    pub(crate) fn check(&self, share: f64) -> Result<()> {
        views::check(share, &self.path)
    }
}

impl CameraFile {
    /// The cameras, as they were when the plan was made.
    pub(crate) fn open(&self) -> Result<PlanCameras> {
        let cameras = PlanCameras::read(&self.path)?;
        if cameras.file() != *self {
            return Err(changed(&self.path));
        }
        Ok(cameras)
    }
}
