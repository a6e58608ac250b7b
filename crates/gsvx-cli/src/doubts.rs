//! Doubts whether cameras are those of a model, in words.

use crate::exit::note;
use anyhow::{Result, anyhow};
use gs_model::{Scene, View};
use std::path::Path;
use tune::CameraDoubt;

/// Says why cameras, which `path` names, may not be the model's own, and what becomes of them.
pub(crate) fn warn(path: &Path, doubt: &CameraDoubt) {
    let then = match doubt {
        CameraDoubt::Photos(error) => {
            return note(format_args!("warning: {}; the cameras are not used", named(path, error)));
        }
        CameraDoubt::Share(_) => "",
        CameraDoubt::Misfit(_) => {
            "; their importances are not used, but with --drop-unseen they are"
        }
    };
    note(format_args!("warning: {}: {doubt}{then}", path.display()));
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
            warn(path, &CameraDoubt::Photos(error));
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
fn named(path: &Path, error: &tune::Error) -> String {
    let keep = match error {
        tune::Error::OtherPhotos { turned: true, .. } => " (an SPZ: pass --axes keep)",
        _ => "",
    };
    format!("{}: {}{keep}", path.display(), gs_model::chain(error))
}
