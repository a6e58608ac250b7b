//! [`Targets`]: what a scene is tuned to.

use finetune::{Photo, TrainView, check_cameras, check_views};
use gs_model::Camera;

use crate::error::Result;

/// What a scene is tuned to.
#[derive(Clone, Debug)]
pub enum Targets {
    /// Photos.
    Photos(Vec<TrainView>),
    /// Renders of the scene itself at these cameras, without their lenses. Nearby views then count as much as these.
    Renders(Vec<Camera>),
}

impl Targets {
    /// Whether these are renders.
    #[must_use]
    pub fn are_renders(&self) -> bool {
        matches!(self, Self::Renders(_))
    }

    /// The cameras of the views.
    pub fn cameras(&self) -> impl Iterator<Item = &Camera> {
        self.each().into_iter().map(|(camera, _)| camera)
    }

    /// Each camera, and the values of its photo; of a render, which is not made yet, none.
    pub(crate) fn each(&self) -> Vec<(&Camera, &[u8])> {
        match self {
            Self::Photos(views) => views.iter().map(camera_and_photo).collect(),
            Self::Renders(cameras) => cameras.iter().map(|camera| (camera, &[][..])).collect(),
        }
    }

    /// The cameras, and their photos; no photos if these are renders.
    pub(crate) fn into_parts(self) -> Result<(Vec<Camera>, Vec<Photo>)> {
        match self {
            Self::Photos(views) => {
                check_views(&views)?;
                Ok(views.into_iter().map(|view| (view.camera, view.photo)).unzip())
            }
            Self::Renders(cameras) => {
                let plain = |camera| Camera { lens: None, ..camera };
                let cameras: Vec<Camera> = cameras.into_iter().map(plain).collect();
                check_cameras(&cameras)?;
                Ok((cameras, Vec::new()))
            }
        }
    }
}

/// What tells two views apart.
pub(crate) fn camera_and_photo(view: &TrainView) -> (&Camera, &[u8]) {
    (&view.camera, &view.photo.rgb)
}
