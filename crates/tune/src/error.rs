//! [`Error`].

use std::path::PathBuf;

/// What can go wrong in this crate.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// Views that the rasterizer refuses, a GPU that is not there or fails.
    #[error(transparent)]
    Finetune(#[from] finetune::Error),
    /// The scene is not valid.
    #[error("invalid scene")]
    Scene(#[from] gs_model::Error),
    /// The codec refuses the scene or the target.
    #[error(transparent)]
    Codec(#[from] gsvx::Error),
    /// The photos show something else than the model.
    #[error(
        "the photos do not show this model: its renders match them to {psnr:.1} dB on average; \
         check that model, cameras and photos belong together"
    )]
    OtherPhotos {
        /// Mean PSNR of the model at the training views, dB.
        psnr: f64,
    },
    /// A target in bytes below what the coarsest plan reaches.
    #[error(
        "target of {target} bytes is below what a tune of this model reaches, about {smallest} bytes; ask \
         for more, or drop SH degrees first"
    )]
    TargetTooSmall {
        /// Bytes asked for.
        target: u64,
        /// Bytes of the smallest plan, about.
        smallest: u64,
    },
    /// No camera sees a Gaussian.
    #[error("no camera sees the model; check that model and cameras belong together")]
    NothingSeen,
    /// An option out of range.
    #[error("{option} is {value}, must be {range}")]
    Option {
        /// Its name.
        option: &'static str,
        /// Its value.
        value: f64,
        /// The accepted range.
        range: &'static str,
    },
    /// A checkpoint could not be read or written.
    #[error("{}: cannot {action}", file.display())]
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
        /// Why, if what it holds was refused.
        source: Option<Box<dyn std::error::Error + Send + Sync>>,
    },
    /// A checkpoint of another run.
    #[error(
        "{}: the checkpoint is of another model, other cameras or other options; name another file",
        file.display()
    )]
    OtherRun {
        /// The file.
        file: PathBuf,
    },
}

/// Results of this crate.
pub type Result<T> = std::result::Result<T, Error>;
