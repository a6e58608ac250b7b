#![doc = include_str!("../README.md")]
#![cfg_attr(docsrs, feature(doc_cfg))]

mod attributes;
mod bytes;
mod chunk;
pub mod covariance;
mod decode;
mod decoded_chunk;
#[cfg(feature = "encode")]
mod encoder;
mod error;
pub mod gltf;
mod head;
pub mod importance;
mod lossless;
mod parallel;
mod reader;
pub mod sequence;

pub use decode::{
    ALWAYS_ACCEPTED, DEFAULT_GROWTH, DecodeOptions, DecodeOutcome, Decoder, Source, decode,
    decode_leaves, decode_with, default_max_gaussians, faults,
};
#[cfg(feature = "encode")]
pub use encoder::{
    Aim, Choices, CoarseCells, CodeOptions, DEFAULT_QUALITY, EncodeOptions, EncodeProgress,
    EncodeWarning, EncodedStream, Encoder, EncoderOutput, ImportanceFrom, JoinOutcome, LEFT_OUT,
    Leaves, MaxError, Measure, MissedAim, Plan, PrepareOptions, Preset, SequenceEncoder,
    SequenceOptions, Survey, VoxelScene, check_values, decimate, encode, encode_lossless,
    encode_voxels, join, latents, prepare, prune, rate,
};
pub use error::{Error, Result};
pub use gpcc_lite::{Cube, Leaf, Octree};
pub use gs_model::Scene;
pub use head::{Chunk, Header, Index, Kind, Layer, SIGNATURE, Steps, VERSION};
pub use reader::Reader;
#[cfg(feature = "encode")]
pub use voxel::{Strategy, Voxelization};

// The example of the repository's README is a test too.
#[cfg(doctest)]
#[doc = include_str!("../../../README.md")]
struct RootReadme;
