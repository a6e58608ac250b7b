//! The crate's one error type.

/// Result of this crate.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// What is wrong with an input or a stream.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// Another kind of file.
    #[error("not a stream of the paper's codec, version 1")]
    Signature,
    /// The stream ends early.
    #[error("the stream ends inside {what}")]
    Truncated {
        /// What was being read.
        what: &'static str,
    },
    /// A value that no encoder writes.
    #[error("corrupt stream: {what}")]
    Corrupt {
        /// What is wrong.
        what: &'static str,
    },
    /// An option out of range.
    #[error("{name} is {value}, {range} are possible")]
    Option {
        /// Its name.
        name: &'static str,
        /// Its value.
        value: u8,
        /// What it may be.
        range: &'static str,
    },
    /// The scene is not one Gaussian per leaf, in leaf order, at the leaf's centre.
    #[error(
        "Gaussian {index} of {gaussians} is not at the centre of its leaf ({leaves} leaves); \
         give the scene that was voxelized"
    )]
    NotVoxelized {
        /// The first such Gaussian.
        index: usize,
        /// Number of Gaussians.
        gaussians: usize,
        /// Number of leaves.
        leaves: usize,
    },
    /// The scene to encode is not valid.
    #[error("the scene cannot be encoded")]
    Scene(#[from] gs_model::Error),
    /// Voxelization failed.
    #[error("voxelization")]
    Voxelization(#[from] voxel::Error),
    /// Coding or decoding of a part failed.
    #[error("coding of {what}")]
    Coding {
        /// The part.
        what: &'static str,
        /// Why.
        source: gpcc_lite::Error,
    },
    /// The codebook is not valid, or cannot be trained.
    #[error("codebook of covariances")]
    Codebook(#[from] vq::Error),
}

/// Names the part that was coded.
pub(crate) fn coding(what: &'static str) -> impl Fn(gpcc_lite::Error) -> Error {
    move |source| Error::Coding { what, source }
}
