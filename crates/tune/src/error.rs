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
    /// A photo that cannot be used.
    #[error("photo {}: {reason}", file.display())]
    Photo {
        /// The file.
        file: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// Too many photos that cannot be used.
    #[error("of {all} photos more than a tenth are missing or broken: {files}")]
    Photos {
        /// Number of photos.
        all: usize,
        /// The names of the first ones.
        files: String,
        /// What is wrong with one of them.
        source: Box<Error>,
    },
    /// There are photos, but too few of them are those of the views.
    #[error(
        "{}: {missing} of {views} photos are not found: looked for {} with any extension, also in folders that end \
         in _2, _4 and _8; there is {there}",
        path.display(), looked_for.display()
    )]
    NoPhotos {
        /// The scene.
        path: PathBuf,
        /// Number of views without a photo.
        missing: usize,
        /// Number of views.
        views: usize,
        /// Where the photo of the first of them is expected.
        looked_for: PathBuf,
        /// The photos that are in its place.
        there: String,
    },
    /// There are photos, but of a format that is not read.
    #[error(
        "{}: {count} photos in {} are .{extension}, which is not read; convert them to PNG or JPEG",
        path.display(), folder.display()
    )]
    UnreadPhotos {
        /// The scene.
        path: PathBuf,
        /// The folder of the photos.
        folder: PathBuf,
        /// Their number.
        count: usize,
        /// Their extension.
        extension: String,
    },
    /// Grey photos of a model in colour.
    #[error(
        "all {views} photos are grey, and the model is not: a tune to them takes its colours away; use the photos in colour"
    )]
    GreyPhotos {
        /// Number of photos.
        views: usize,
    },
    /// The photos show something else than the model, or are of other views than those of their cameras.
    #[error(
        "the photos do not show this model at their cameras: {psnr:.1} dB at {views} of them, and renders of other \
         cameras resemble them as much or more. {}",
        cause_of_misfit(*turned)
    )]
    OtherPhotos {
        /// Number of photos that were compared.
        views: usize,
        /// Mean PSNR of the model at these photos, dB.
        psnr: f64,
        /// They show the model turned by 180 degrees about x.
        turned: bool,
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
    #[error(
        "these cameras see nothing of the model; are they its own? {}",
        finetune::MISFIT_CAUSES
    )]
    NothingSeen,
    /// The cancellation flag was set before the first step: there is no result yet.
    #[error("interrupted before the first step")]
    Interrupted,
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

/// Why photos do not show a model.
fn cause_of_misfit(turned: bool) -> &'static str {
    match turned {
        true => {
            "They do with the model turned by 180 degrees about x: its axes are those of another tool"
        }
        false => finetune::MISFIT_CAUSES,
    }
}
