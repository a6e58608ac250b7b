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
//!
//! ```
//! use vq::{Codebook, Covariance, default_sensitivity};
//!
//! // Per Gaussian: quaternion (w, x, y, z), log-scales, opacity in 0..=1.
//! let gaussians = [
//!     ([1.0, 0.0, 0.0, 0.0], [-3.0, -3.2, -6.0], 0.9),
//!     ([0.9, 0.1, 0.4, 0.0], [-4.0, -3.9, -5.0], 0.5),
//!     ([0.9, 0.1, 0.4, 0.0], [-4.1, -4.0, -5.1], 0.7),
//! ];
//! let mut covariances = Vec::new();
//! let mut log_gammas = Vec::new(); // The sizes: coded apart, as one number per Gaussian.
//! let mut sensitivities = Vec::new();
//! for (quaternion, log_scales, opacity) in gaussians {
//!     let (covariance, log_gamma) = Covariance::split(quaternion, log_scales)?;
//!     covariances.push(covariance);
//!     log_gammas.push(log_gamma);
//!     sensitivities.push(default_sensitivity(opacity, log_scales));
//! }
//!
//! let codebook = Codebook::train(&covariances, &sensitivities, 256)?;
//! let indices = codebook.assign(&covariances);
//!
//! // What a stream stores is all that a decoder needs.
//! let codebook = Codebook::from_integers(&codebook.integers())?;
//! let (quaternion, normalised) = codebook.decode(indices[0])?;
//! let log_scales = normalised.map(|l| l + log_gammas[0]);
//! assert!((log_scales[0] + 3.0).abs() < 0.02 && quaternion[0] > 0.99);
//! # Ok::<(), vq::Error>(())
//! ```

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
