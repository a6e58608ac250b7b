//! The crate's one error type.

/// Shorthand for results of this crate.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// Everything that can go wrong in this crate.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A log-scale that is NaN, infinite or absurdly large.
    #[error("log-scale {value} is not a finite number within ±1e4")]
    BadLogScale {
        /// The log-scale given.
        value: f32,
    },
    /// Not one sensitivity per covariance.
    #[error("{covariances} covariances with {sensitivities} sensitivities")]
    LengthMismatch {
        /// Number of covariances.
        covariances: usize,
        /// Number of sensitivities.
        sensitivities: usize,
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
    #[error("{count} codewords: 1 to 2^20 are possible")]
    BadCodewords {
        /// The number asked for or read.
        count: usize,
    },
    /// Integers that no trained codeword has.
    #[error("{integers:?} is not a codeword")]
    BadInteger {
        /// The integers given.
        integers: [i32; 6],
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
