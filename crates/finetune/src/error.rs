//! [`Error`].

use std::path::PathBuf;

/// What can go wrong in this crate.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file could not be read or written.
    #[error("{}: cannot {action}: {source}", file.display())]
    Io {
        /// The file.
        file: PathBuf,
        /// What was tried: `read`, `write`, `rename`.
        action: &'static str,
        /// The operating system's reason.
        source: std::io::Error,
    },
    /// A checkpoint that cannot be used.
    #[error("{}: not a usable checkpoint: at byte {offset}: {reason}", file.display())]
    Checkpoint {
        /// The file.
        file: PathBuf,
        /// Where in the file.
        offset: u64,
        /// What is wrong.
        reason: &'static str,
    },
    /// A checkpoint of another scene or of other options.
    #[error("checkpoint does not belong to this run: {reason}")]
    CheckpointMismatch {
        /// What differs.
        reason: String,
    },
    /// The scene is not valid.
    #[error("invalid scene: {0}")]
    Scene(#[from] gs_model::Error),
    /// There is nothing to train on.
    #[error("no training views")]
    NoViews,
    /// A photo whose size is not its camera's.
    #[error("view {index} ({name}): the photo has {photo:?} pixels, the camera {camera:?}")]
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
    /// A view of no pixels or of more than [`crate::MAX_IMAGE_EDGE`] along an edge.
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
    /// An option out of range.
    #[error("option {option}: {value} is not {expected}")]
    Option {
        /// Its name.
        option: &'static str,
        /// Its value.
        value: f64,
        /// What it has to be.
        expected: &'static str,
    },
    /// No graphics adapter that the choice of backend allows.
    #[error("no usable GPU: {reason}")]
    NoAdapter {
        /// Why not.
        reason: String,
    },
    /// The GPU refused or failed.
    #[error("GPU: {reason}")]
    Gpu {
        /// What it said.
        reason: String,
    },
}

/// Results of this crate.
pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    pub(crate) fn io(
        file: impl Into<PathBuf>,
        action: &'static str,
    ) -> impl FnOnce(std::io::Error) -> Self {
        let file = file.into();
        move |source| Self::Io { file, action, source }
    }
}
