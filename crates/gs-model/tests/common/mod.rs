//! Helpers shared by the integration tests.
#![allow(dead_code, reason = "each test binary uses some of them")]

use std::path::PathBuf;

/// A path in the shared test data beside the workspace, or a loud `None` where it is absent.
pub(crate) fn shared(path: &str) -> Option<PathBuf> {
    let full = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared").join(path);
    if full.exists() {
        Some(full)
    } else {
        eprintln!("SKIPPED: no {}", full.display());
        None
    }
}
