#![doc = include_str!("../README.md")]

pub mod attributes;
pub mod covariance;
mod decode;
mod encode;
mod error;
mod gaussians;
pub mod importance;
pub mod lod;
pub mod lossless;
mod options;
mod ordered;
mod outliers;
mod prepare;
pub mod rate;
pub mod slices;
pub mod stream;

pub use decode::{DEFAULT_GAUSSIANS_PER_BYTE, DecodeOptions, Decoded, Decoder, Part, decode};
pub use encode::{Encoded, encode};
pub use error::{Error, Result};
pub use lossless::encode_lossless;
pub use options::{
    CovarianceMode, DEFAULT_QUALITY, EncodeOptions, Entropy, OpacityDomain, PaperQp, Steps,
};
pub use prepare::{Prepared, Seen, default_strategy, encode_model, prepare, prune, split_outliers};
