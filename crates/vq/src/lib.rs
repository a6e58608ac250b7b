//! Covariances of 3D Gaussians: canonical forms, rotation charts and a sensitivity-weighted
//! codebook.

pub mod canonical;
pub mod error;
mod quaternion;
mod rng;
pub mod rotation;

pub use error::{Error, Result};
