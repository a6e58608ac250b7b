//! What a model is tuned to: photos, or renders of the model itself.

use crate::exit::note;
use crate::progress::Meter;
use crate::views;
use anyhow::{Context, Result, anyhow, bail};
use finetune::{Photo, RenderOptions, TrainView, photo_match};
use gs_model::{Camera, Scene, View};
use std::path::Path;

/// Training views with their photos; `None` if none of the photos is there.
pub(crate) fn photos(path: &Path) -> Result<Option<Vec<TrainView>>> {
    let training = views::training(path, views::read(path)?)?;
    if !training.iter().any(|v| v.image_path.is_file()) {
        return Ok(None);
    }
    // Photos are compared pixel by pixel, so a lens that distorts is not ignored here.
    let bent = |v: &&View| v.camera.ignored_distortion.is_some();
    if let Some(View { camera, .. }) = training.iter().find(bent) {
        let model = camera.ignored_distortion.clone().unwrap_or_default();
        let (file, camera) = (path.to_owned(), camera.name.clone());
        return Err(gs_model::Error::DistortedCamera { file, camera, model }.into());
    }
    training.iter().map(photo).collect::<Result<_>>().map(Some)
}

fn photo(view: &View) -> Result<TrainView> {
    let file = view.image_path.display();
    let photo = image::ImageReader::open(&view.image_path)
        .and_then(image::ImageReader::with_guessed_format)
        .with_context(|| format!("photo {file}"))?
        .decode()
        // An image error repeats its own cause.
        .map_err(|e| anyhow!("photo {file}: PNG or JPEG expected: {e}"))?
        .to_rgb8();
    let (width, height) = photo.dimensions();
    let Some(camera) = view.camera.scaled_to(width, height) else {
        bail!("photo {file} is {width}x{height}, which is not its camera's aspect ratio");
    };
    let photo = Photo::new(width, height, photo.into_raw())
        .with_context(|| format!("photo {file} is empty"))?;
    Ok(TrainView { camera, photo })
}

/// A model of the photos shows them better than this, dB; photos of anything else rarely reach it.
const LEAST_MATCH: f64 = 15.0;
/// Photos that are compared with the model; more only take longer.
const MATCHED: usize = 8;

/// Warns of photos, which `path` names, that the model does not show.
pub(crate) fn warn_of_others(scene: &Scene, training: &[TrainView], path: &Path) {
    let Some(found) = photo_match(scene, training, MATCHED, &RenderOptions::default()) else {
        return;
    };
    if found.mean_psnr < LEAST_MATCH {
        note(format_args!(
            "warning: {}: the model shows these photos at {:.1} dB only (mean of {}); are they of \
             this scene?",
            path.display(),
            found.mean_psnr,
            found.views
        ));
    }
}

/// Renders of the model at some cameras.
pub(crate) fn renders(scene: &Scene, cameras: Vec<Camera>) -> Vec<TrainView> {
    let bar = Meter::new("renders", cameras.len());
    let one = |camera: Camera| {
        let view = TrainView::rendered(scene, camera);
        bar.inc();
        view
    };
    cameras.into_iter().map(one).collect()
}
