//! Covariances of 3D Gaussians: canonical forms, rotation charts and a sensitivity-weighted
//! codebook.

#![allow(
    clippy::needless_range_loop,
    reason = "loops over the dimensions index several small arrays at once"
)]

pub mod canonical;
mod codebook;
mod covariance;
mod eigen;
pub mod error;
pub mod index;
mod kmeans;
mod nearest;
mod order;
mod quaternion;
mod range_coder;
mod rate;
mod rng;
pub mod rotation;
mod seeding;
mod sensitivity;

pub use codebook::{Codebook, Distortion, Keep, MAX_CODEWORDS, Options, TrainingReport};
pub use covariance::{Covariance, MIN_LOG_SCALE, Metric};
pub use error::{Error, Result};
pub use sensitivity::default_sensitivity;
