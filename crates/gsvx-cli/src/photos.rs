//! What a model is tuned to: photos, or renders of the model itself.

use crate::exit::note;
use anyhow::{Context, Result};
use finetune::TrainView;
use gs_model::{Scene, View};
use std::path::Path;

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
