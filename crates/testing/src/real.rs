//! Files that tests read: those of `fixtures`, and those of `../shared` beside the workspace where that is.

use std::path::PathBuf;

use gs_model::{Scene, ply};

fn workspace() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// A path in `fixtures`.
#[must_use]
pub fn fixture(path: &str) -> PathBuf {
    workspace().join("fixtures").join(path)
}

/// A path in `../shared`; `None`, said loudly, if it is not there.
#[must_use]
pub fn shared(path: &str) -> Option<PathBuf> {
    let full = workspace().join("../shared").join(path);
    if full.exists() {
        return Some(full);
    }
    eprintln!("SKIPPED: ../shared/{path} is not there");
    None
}

/// A small model that was trained on photos.
///
/// # Panics
/// If the fixture cannot be read.
#[must_use]
pub fn leica() -> Scene {
    ply::read(fixture("leica/point_cloud.ply")).unwrap().0
}
