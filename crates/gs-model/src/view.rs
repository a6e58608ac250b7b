//! [`View`]: a posed photo.

use std::path::PathBuf;

use crate::camera::Camera;

/// One posed photo.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// Where the photo was taken from.
    pub camera: Camera,
    /// Where the photo is expected. It may be missing: see [`View::has_photo`].
    pub image_path: PathBuf,
}

impl View {
    /// True if the photo is there.
    #[must_use]
    pub fn has_photo(&self) -> bool {
        self.image_path.is_file()
    }
}
