//! A codebook of 3D Gaussian covariances, weighted by sensitivity, after Compressed 3DGS
//! (Niedermayr et al., CVPR 2024): what the paper's lossy covariance compression (section 2.3) uses.
//!
//! A Gaussian's covariance is split into a normalised covariance of trace 1 and the scale factor
//! gamma = |s| ([`Covariance::split`]). The codebook ([`Codebook`]) holds normalised covariances as
//! integers: those of a rotation and of normalised log-scales ([`Codebook::integers`]). A decoder
//! multiplies them out and computes no eigenvectors. The crate knows nothing of files, scenes or
//! streams: how integers become bytes is the caller's business.
//!
//! Invariant: equal input gives an equal codebook on every machine and for any number of threads.

mod canonical;
mod codebook;
mod codeword;
mod covariance;
mod error;
mod nearest;
mod order;
mod sensitivity;
mod training;

pub use codebook::{Codebook, MAX_CODEWORDS};
pub use covariance::{Covariance, MIN_LOG_SCALE};
pub use error::{Error, Result};
pub use sensitivity::default_sensitivity;

/// The README's example, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
