//! A codebook of 3D Gaussian covariances, weighted by sensitivity, after Compressed 3DGS
//! (Niedermayr et al., CVPR 2024).
//!
//! A Gaussian's covariance is split into a normalised covariance of trace 1 and the scale factor
//! gamma = |s| ([`Covariance::split`]). The codebook ([`Codebook`]) holds normalised covariances as
//! integers: those of a rotation and of normalised log-scales ([`Codebook::integers`]). A decoder
//! multiplies them out and computes no eigenvectors. The crate knows nothing of files, scenes or
//! streams: how integers become bytes is the caller's business.
//!
//! Invariant: equal input gives an equal codebook on every machine and for any number of threads.
//!
//! ```
//! use vq::{Codebook, Covariance, Options};
//!
//! let covariances: Vec<Covariance> = (0..1000u32)
//!     .map(|i| {
//!         let t = i as f32 / 1000.0;
//!         let split = Covariance::split([1.0, t, 0.3, t * t], [-3.0, -4.0 + t, -6.0]);
//!         split.map(|(covariance, _log_gamma)| covariance)
//!     })
//!     .collect::<Result<_, _>>()?;
//! let sensitivities = vec![1.0; 1000];
//! let codebook = Codebook::train(&covariances, &sensitivities, &Options::with_codewords(64))?;
//! let indices = codebook.assign(&covariances);
//! let fit = codebook.distortion(&covariances, &sensitivities, &indices)?;
//! assert!(fit.mean < 1e-3);
//! # Ok::<(), vq::Error>(())
//! ```

#![allow(
    clippy::needless_range_loop,
    reason = "loops over the dimensions index several small arrays at once"
)]

mod canonical;
mod codebook;
mod covariance;
mod eigen;
mod error;
mod kmeans;
mod nearest;
mod order;
mod quaternion;
mod rng;
mod rotation;
mod seeding;
mod sensitivity;

pub use codebook::{Codebook, Distortion, Keep, MAX_CODEWORDS, Options, TrainingReport};
pub use covariance::{Covariance, MIN_LOG_SCALE, Metric};
pub use error::{Error, Result};
pub use sensitivity::default_sensitivity;

/// The README's example, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
