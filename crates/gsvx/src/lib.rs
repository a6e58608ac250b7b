#![doc = include_str!("../README.md")]
#![cfg_attr(docsrs, feature(doc_cfg))]

#[cfg(feature = "encode")]
mod assemble;
mod attributes;
#[cfg(feature = "encode")]
mod bounded;
mod bytes;
#[cfg(feature = "encode")]
mod check;
mod chunk;
pub mod covariance;
mod decode;
mod decoded_chunk;
#[cfg(feature = "encode")]
mod encode;
#[cfg(feature = "encode")]
mod encoded;
#[cfg(feature = "encode")]
mod encoder;
mod error;
#[cfg(feature = "encode")]
mod exact;
mod head;
pub mod importance;
#[cfg(feature = "encode")]
mod join;
#[cfg(feature = "encode")]
pub mod latents;
#[cfg(feature = "encode")]
mod lod;
mod lossless;
#[cfg(feature = "encode")]
mod options;
#[cfg(feature = "encode")]
mod outliers;
mod parallel;
#[cfg(feature = "encode")]
mod plan;
#[cfg(feature = "encode")]
mod prepare;
#[cfg(feature = "encode")]
mod preset;
#[cfg(feature = "encode")]
pub mod rate;
mod reader;
#[cfg(feature = "encode")]
mod source;
#[cfg(feature = "encode")]
mod strategy;
#[cfg(feature = "encode")]
mod survey;
#[cfg(feature = "encode")]
mod tiled;
#[cfg(feature = "encode")]
mod warning;

pub use decode::{
    DEFAULT_GAUSSIANS_PER_BYTE, DecodeOptions, Decoded, Decoder, Source, decode, decode_leaves,
    decode_with,
};
#[cfg(feature = "encode")]
pub use encode::encode_voxels;
#[cfg(feature = "encode")]
pub use encoded::{CoarseCells, Encoded, LEFT_OUT};
#[cfg(feature = "encode")]
pub use encoder::{Aim, EncodeProgress, Encoder, Made};
pub use error::{Error, Result};
#[cfg(feature = "encode")]
pub use exact::encode_lossless;
pub use gpcc_lite::{Cube, Leaf, Octree};
pub use gs_model::Scene;
pub use head::{Chunk, Header, Index, Kind, Layer, SIGNATURE, Steps, VERSION};
#[cfg(feature = "encode")]
pub use join::{Joined, join};
#[cfg(feature = "encode")]
pub use options::{DEFAULT_QUALITY, EncodeOptions, Leaves, MaxError};
#[cfg(feature = "encode")]
pub use plan::{Choices, Plan};
#[cfg(feature = "encode")]
pub use prepare::{Prepared, encode, prepare, prune};
#[cfg(feature = "encode")]
pub use preset::Preset;
pub use reader::Reader;
#[cfg(feature = "encode")]
pub use strategy::{Seen, default_strategy};
#[cfg(feature = "encode")]
pub use survey::Survey;
#[cfg(feature = "encode")]
pub use voxel::{Strategy, Voxelization};
#[cfg(feature = "encode")]
pub use warning::{EncodeWarning, Missed};

// The example of the repository's README is a test too.
#[cfg(doctest)]
#[doc = include_str!("../../../README.md")]
struct RootReadme;
