//! What a model is tuned to: photos, or renders of the model itself.

use crate::exit::note;
use crate::progress::Meter;
use crate::views;
use anyhow::Result;
use finetune::{RenderOptions, TrainView, photo_match, render};
use gs_model::{Camera, Scene};
use std::path::Path;

/// Training views with their photos; none, with a warning, if there are no photos at all.
pub(crate) fn photos(path: &Path) -> Result<Vec<TrainView>> {
    let training = views::training(path, views::read(path)?)?;
    let found = tune::photos(path, &training)?;
    // Photos are compared pixel by pixel, so a lens that distorts is not ignored here.
    let bent = |v: &&TrainView| v.camera.ignored_distortion.is_some();
    if let Some(TrainView { camera, .. }) = found.views.iter().find(bent) {
        let model = camera.ignored_distortion.clone().unwrap_or_default();
        let (file, camera) = (path.to_owned(), camera.name.clone());
        return Err(gs_model::Error::DistortedCamera { file, camera, model }.into());
    }
    found.notes.iter().for_each(note);
    Ok(found.views)
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
    let one = |mut camera: Camera| {
        // A render has no lens.
        camera.ignored_distortion = None;
        let mut photo = render(scene, &camera, &RenderOptions::default());
        // What a screen shows is clamped; differences beyond it do not count.
        photo.rgb.iter_mut().for_each(|v| *v = v.clamp(0.0, 1.0));
        bar.inc();
        TrainView { camera, photo }
    };
    cameras.into_iter().map(one).collect()
}
