//! [`TrainView`]: a posed photo.

use gs_model::lens::Lens;
use gs_model::{Camera, Scene};

use crate::error::{Error, Result};
use crate::forward::render;
use crate::image::Photo;
use crate::metrics::{Scores, ssimulacra2};
use crate::options::RenderOptions;

/// A posed photo to train on.
#[derive(Clone, Debug)]
pub struct TrainView {
    /// Where the photo was taken from.
    pub camera: Camera,
    /// The photo, of the camera's size.
    pub photo: Photo,
}

impl TrainView {
    /// A render of a model in place of a photo. It has no lens.
    #[must_use]
    pub fn rendered(scene: &Scene, camera: Camera) -> Self {
        let camera = Camera { lens: None, ..camera };
        let photo = Photo::from(&render(scene, &camera, &RenderOptions::default()));
        Self { camera, photo }
    }

    /// PSNR of a scene's render against the photo, dB; at most 100.
    #[must_use]
    pub fn psnr(&self, scene: &Scene) -> f64 {
        self.photo.psnr_of(&render(scene, &self.camera, &RenderOptions::default()))
    }

    /// SSIMULACRA2 of a scene's render against the photo.
    #[must_use]
    pub fn ssimulacra2(&self, scene: &Scene) -> f64 {
        let shown = render(scene, &self.camera, &RenderOptions::default());
        ssimulacra2(&shown, &self.photo.image())
    }

    /// All scores of a scene's render against the photo; a PSNR is at most 100 dB.
    #[must_use]
    pub fn scores(&self, scene: &Scene) -> Scores {
        let shown = render(scene, &self.camera, &RenderOptions::default());
        let scores = Scores::of(&shown, &self.photo.image());
        Scores { psnr: scores.psnr.min(100.0), ..scores }
    }
}

/// Checks that there are views, and that each has an undistorted camera of a possible size and a photo
/// of that size.
///
/// # Errors
/// [`Error::NoViews`], [`Error::PhotoSize`], [`Error::ViewSize`], [`Error::DistortedView`].
pub fn check_views(views: &[TrainView]) -> Result<()> {
    check_cameras(views.iter().map(|view| &view.camera))?;
    for (index, TrainView { camera, photo }) in views.iter().enumerate() {
        let (width, height) = (camera.width, camera.height);
        let is_complete = photo.rgb.len() as u64 == 3 * u64::from(width) * u64::from(height);
        if (photo.width, photo.height) != (width, height) || !is_complete {
            let (name, photo) = (camera.name.clone(), (photo.width, photo.height));
            return Err(Error::PhotoSize { index, name, photo, camera: (width, height) });
        }
    }
    Ok(())
}

/// Checks that there are cameras, and that each is undistorted and of a possible size.
///
/// # Errors
/// [`Error::NoViews`], [`Error::ViewSize`], [`Error::DistortedView`].
pub fn check_cameras<'a>(cameras: impl IntoIterator<Item = &'a Camera>) -> Result<()> {
    let mut cameras = cameras.into_iter().enumerate().peekable();
    cameras.peek().ok_or(Error::NoViews)?;
    for (index, camera) in cameras {
        let (width, height) = (camera.width, camera.height);
        let name = camera.name.clone();
        if width == 0 || height == 0 || !camera.image_fits() {
            return Err(Error::ViewSize { index, name, width, height });
        }
        if let Some(Lens { model, .. }) = camera.lens.clone() {
            return Err(Error::DistortedView { index, name, model });
        }
    }
    Ok(())
}
