//! [`Error`]: what this crate refuses, and why.

/// What can go wrong in this crate.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A mean is NaN or infinite. `gs_model` finds and drops such Gaussians on request.
    #[error("Gaussian {index} has a NaN or infinite coordinate; drop invalid Gaussians first")]
    NonFiniteMean {
        /// The first such Gaussian.
        index: usize,
    },
    /// A mean lies outside the half-open cube.
    #[error("Gaussian {index} lies outside the cube; take the cube of all means (cube_of)")]
    OutsideCube {
        /// The first such Gaussian.
        index: usize,
    },
    /// The cube's side is not positive and finite, or its origin is not finite.
    #[error("the cube (origin {origin:?}, side {side}) is not finite or has no volume")]
    InvalidCube {
        /// Minimum corner as given.
        origin: [f64; 3],
        /// Side as given.
        side: f64,
    },
    /// An octree depth above the greatest that a Morton code holds.
    #[error("octree depth {depth} is above the greatest, {max}")]
    DepthTooGreat {
        /// Depth as given.
        depth: u8,
        /// Greatest depth.
        max: u8,
    },
    /// `j_low` is above `j_high`.
    #[error("lowest leaf depth {j_low} is above the highest, {j_high}")]
    DepthRange {
        /// Lowest leaf depth as given.
        j_low: u8,
        /// Highest leaf depth as given.
        j_high: u8,
    },
    /// A parameter that must be finite and within a range is not.
    #[error("parameter {name} = {value} is outside {range}")]
    Parameter {
        /// Its name.
        name: &'static str,
        /// Value as given.
        value: f64,
        /// Allowed range, in words.
        range: &'static str,
    },
    /// A per-Gaussian array does not have one entry per Gaussian.
    #[error("{name} has {got} entries for {want} Gaussians")]
    Length {
        /// Which array.
        name: &'static str,
        /// Its length.
        got: usize,
        /// Number of Gaussians.
        want: usize,
    },
    /// Leaves that are no pruned octree.
    #[error(transparent)]
    Octree(#[from] gpcc_lite::Error),
    /// More Gaussians than a `u32` counts.
    #[error("{0} Gaussians are more than the 2^32 - 1 that can be voxelized together")]
    TooMany(usize),
    /// The voxelization names a Gaussian that the scene does not have.
    #[error(
        "the voxelization names Gaussian {member}, but the scene has {len}; \
         merge the scene that was voxelized"
    )]
    Member {
        /// The first such index.
        member: u32,
        /// Number of Gaussians.
        len: usize,
    },
}

/// Result of this crate.
pub type Result<T> = std::result::Result<T, Error>;
