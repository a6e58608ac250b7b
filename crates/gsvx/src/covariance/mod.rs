//! Covariances (rotations and log-scales) in one of several modes; the header says which.

pub(crate) mod codebook;
pub(crate) mod integers;
pub mod log_euclidean;

/// Rotations (unit quaternions) and log-scales.
pub(crate) type Covariances = (Vec<[f32; 4]>, Vec<[f32; 3]>);
