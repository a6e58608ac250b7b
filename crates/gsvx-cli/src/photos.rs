//! What a model is tuned to: photos, or renders of the model itself.

use crate::exit::note;
use crate::progress::Meter;
use anyhow::{Context, Result};
use finetune::TrainView;
use gs_model::{Camera, Scene, View};
use std::path::Path;
use tune::Targets;

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
