//! The crate's one error type.

/// Shorthand for results of this crate.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// Everything that can go wrong in this crate.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A bit depth outside its range.
    #[error("{bits} bits given, {low} to {high} are possible")]
    BadBits {
        /// The depth given.
        bits: u8,
        /// Smallest depth allowed.
        low: u8,
        /// Largest depth allowed.
        high: u8,
    },
    /// A log-scale that is NaN, infinite or absurdly large.
    #[error("log-scale {value} is not a finite number within ±1e4")]
    BadLogScale {
        /// The log-scale given.
        value: f32,
    },
    /// Entries that do not form a positive semi-definite matrix other than zero.
    #[error("entries {entries:?} (xx, xy, xz, yy, yz, zz) are not a covariance")]
    NotACovariance {
        /// The entries given.
        entries: [f64; 6],
    },
    /// Slices that should run in parallel and do not.
    #[error("{covariances} covariances with {others} sensitivities or indices")]
    LengthMismatch {
        /// Number of covariances.
        covariances: usize,
        /// Length of the other slice.
        others: usize,
    },
    /// No covariances, or more than indices can name.
    #[error("{count} covariances: 1 to 2^31 - 1 are possible")]
    BadCount {
        /// The number given.
        count: usize,
    },
    /// A sensitivity that is negative, NaN or infinite.
    #[error("sensitivity {index} is {value}")]
    BadSensitivity {
        /// Position in the slice.
        index: usize,
        /// The value there.
        value: f32,
    },
    /// A number of codewords outside its range.
    #[error("{count} codewords: 1 to 2^20 are possible, kept ones included")]
    TooManyCodewords {
        /// The number asked for or read.
        count: usize,
    },
    /// An index beyond the codebook.
    #[error("codeword {index} of {length}")]
    BadIndex {
        /// The index given.
        index: u32,
        /// Number of codewords.
        length: usize,
    },
}
