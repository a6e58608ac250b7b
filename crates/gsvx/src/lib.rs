//! A progressive codec for trained 3D Gaussian splatting scenes.
//!
//! ```no_run
//! use gsvx::{DecodeOptions, EncodeOptions};
//! use voxel::{Cube, Merge, Strategy, merge, voxelize};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let (scene, _) = gs_model::ply::read("point_cloud.ply")?;
//! let cube = Cube::of(&scene.means)?;
//! let voxels = voxelize(&scene, &cube, &Strategy::Uniform { depth: 12 })?;
//! let merged = merge(&scene, &voxels, Merge::Moments)?;
//! let encoded = gsvx::encode(&merged, &voxels, &EncodeOptions::from_quality(60.0)?)?;
//! let decoded = gsvx::decode(&encoded.bytes, &DecodeOptions::default())?;
//! assert_eq!(decoded.scene.means, merged.means);
//! # Ok(())
//! # }
//! ```

pub mod attributes;
pub mod covariance;
mod decode;
mod encode;
mod error;
pub mod importance;
mod options;
pub mod rate;
pub mod stream;

pub use decode::{DEFAULT_GAUSSIANS_PER_BYTE, DecodeOptions, Decoded, decode};
pub use encode::{Encoded, encode};
pub use error::{Error, Result};
pub use options::{
    CovarianceMode, DEFAULT_QUALITY, EncodeOptions, Entropy, OpacityDomain, PaperQp, Steps,
};
