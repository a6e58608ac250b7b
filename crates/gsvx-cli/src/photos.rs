//! What a model is tuned to: photos, or renders of the model itself.

use crate::exit::note;
use crate::progress::Meter;
use crate::views;
use anyhow::{Context, Result, anyhow};
use finetune::TrainView;
use gs_model::{Camera, Scene, View};
use std::path::Path;
use tune::{CameraDoubt, Targets};

/// Training views, which `path` names, with their photos; none, with a warning, if there are no photos at all.
pub(crate) fn photos(
    scene: &Scene,
    path: &Path,
    training: &[View],
    force: bool,
) -> Result<Vec<TrainView>> {
    let mut found = tune::photos(path, training)?;
    let checked = found.check(scene, force);
    found.warnings.iter().for_each(|warning| note(format_args!("warning: {warning}")));
    checked.with_context(|| path.display().to_string())?;
    Ok(found.views)
}

/// Whether the photos beside the cameras, which `path` names, show something else than the model there: then the cameras
/// may not be its own. Warns if so.
///
/// # Errors
/// If what the cameras do not see would be lost.
pub(crate) fn doubt_cameras(
    scene: &Scene,
    path: &Path,
    views: &[View],
    drop_unseen: bool,
) -> Result<bool> {
    match tune::check_photos(scene, views) {
        Ok(_) => Ok(false),
        Err(error) if drop_unseen => Err(refused(path, &error)),
        Err(error) => {
            views::warn(path, &CameraDoubt::Photos(error));
            Ok(true)
        }
    }
}

/// The error if photos beside the cameras, which `path` names, show something else, and what the cameras do not see would
/// be lost.
pub(crate) fn refused(path: &Path, error: &tune::Error) -> anyhow::Error {
    anyhow!(
        "{}; without --drop-unseen the model is encoded as if there were no cameras",
        named(path, error)
    )
}

/// What photos beside the cameras, which `path` names, show instead of the model.
pub(crate) fn named(path: &Path, error: &tune::Error) -> String {
    let keep = match error {
        tune::Error::OtherPhotos { turned: true, .. } => " (an SPZ: pass --axes keep)",
        _ => "",
    };
    format!("{}: {}{keep}", path.display(), gs_model::chain(error))
}

/// Photos, or renders of the model.
pub(crate) fn training(scene: &Scene, targets: Targets) -> Vec<TrainView> {
    let cameras = match targets {
        Targets::Photos(views) => return views,
        Targets::Renders(cameras) => cameras,
    };
    let bar = Meter::new("renders", cameras.len());
    let one = |camera: Camera| {
        let view = TrainView::rendered(scene, camera);
        bar.inc();
        view
    };
    cameras.into_iter().map(one).collect()
}
