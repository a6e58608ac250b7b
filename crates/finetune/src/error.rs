//! [`Error`].

/// What can go wrong in this crate.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// There is nothing to train on.
    #[error("no training views")]
    NoViews,
    /// A photo whose size is not its camera's.
    #[error(
        "view {index} ({name}): the photo has {}x{} pixels, the camera {}x{}",
        photo.0, photo.1, camera.0, camera.1
    )]
    PhotoSize {
        /// Index of the view.
        index: usize,
        /// Its camera's name.
        name: String,
        /// Width and height of the photo.
        photo: (u32, u32),
        /// Width and height of the camera.
        camera: (u32, u32),
    },
    /// A view of no pixels, or too large ([`gs_model::Camera::image_fits`]).
    #[error("view {index} ({name}): cannot train on {width}x{height} pixels")]
    ViewSize {
        /// Index of the view.
        index: usize,
        /// Its camera's name.
        name: String,
        /// Width in pixels.
        width: u32,
        /// Height in pixels.
        height: u32,
    },
    /// A view whose photo is distorted, so that renders cannot be compared with it.
    #[error("view {index} ({name}): the lens ({model}) distorts: undistort the photo first")]
    DistortedView {
        /// Index of the view.
        index: usize,
        /// Its camera's name.
        name: String,
        /// The lens model.
        model: String,
    },
    /// No graphics adapter that the choice of backend allows.
    #[error("no usable GPU: {reason}")]
    NoAdapter {
        /// Why not.
        reason: String,
    },
    /// The GPU failed, or cannot hold the run.
    #[error("GPU: {reason}")]
    Gpu {
        /// Why.
        reason: String,
    },
}

/// Results of this crate.
pub type Result<T> = std::result::Result<T, Error>;
