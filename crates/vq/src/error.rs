//! The crate's one error type.

/// Shorthand for results of this crate.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// Everything that can go wrong in this crate.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A quantisation step that is not finite or too small.
    #[error("quantisation step {step} is not a finite number of at least 2^-30")]
    BadStep {
        /// The step given.
        step: f64,
    },
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
    /// An index of a quaternion component above 3.
    #[error("quaternion component {index} does not exist")]
    BadComponent {
        /// The index given.
        index: u8,
    },
}
