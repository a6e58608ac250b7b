//! Doubts whether cameras are those of a model, in words.

use crate::exit::note;
use anyhow::{Result, anyhow};
use gs_model::{Scene, View};
use std::path::Path;
use tune::CameraDoubt;

/// Says why cameras, which `path` names, may not be the model's own, and what becomes of them.
pub(crate) fn warn(path: &Path, doubt: &CameraDoubt) {
    warn_with(path, doubt, ", but with --drop-unseen they are");
}

/// As [`warn`]; `unless` says when importances that are not used are.
pub(crate) fn warn_with(path: &Path, doubt: &CameraDoubt, unless: &str) {
    note(format_args!("warning: {}", words(path, doubt, unless)));
}

/// What [`warn_with`] says.
pub(crate) fn words(path: &Path, doubt: &CameraDoubt, unless: &str) -> String {
    let then = match doubt {
        CameraDoubt::Photos(error) => {
            return format!("{}; the cameras are not used", named(path, error));
        }
        CameraDoubt::Share(_) => String::new(),
        CameraDoubt::Misfit(_) => format!("; their importances are not used{unless}"),
    };
    format!("{}: {doubt}{then}", path.display())
}

/// What photos beside cameras say of these.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum PhotoVerdict {
    /// They show the model: the cameras are its own.
    Proven,
    /// There are no photos, or they show too little.
    Unknown,
    /// They show something else: the cameras may not be its own.
    Doubted,
}

/// What photos beside the cameras, which `path` names, say of these. Warns of a doubt.
///
/// # Errors
/// If what the cameras do not see would be lost.
pub(crate) fn by_photos(
    scene: &Scene,
    path: &Path,
    views: &[View],
    drop_unseen: bool,
) -> Result<PhotoVerdict> {
    match tune::check_photos(scene, views) {
        Ok(true) => Ok(PhotoVerdict::Proven),
        Ok(false) => Ok(PhotoVerdict::Unknown),
        Err(error) if drop_unseen => Err(refused(path, &error)),
        Err(error) => {
            warn(path, &CameraDoubt::Photos(error));
            Ok(PhotoVerdict::Doubted)
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
