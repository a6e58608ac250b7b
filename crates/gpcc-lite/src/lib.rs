//! Geometry and attribute coding of voxelized point clouds.
//!
//! The crate knows voxels, and integers per voxel; what they mean is the caller's business. It
//! follows the tools of MPEG's G-PCC (octree, RAHT, predicting and lifting transforms) with
//! entropy coding of its own; streams are not those of G-PCC, and are described in
//! `docs/bitstream-gpcc.md` of the repository.
//!
//! * [`geometry`]: leaves of a pruned octree, each of its own depth, lossless.
//! * [`raht`]: the region-adaptive hierarchical transform, one list of merges for all channels.
//! * [`attribute`]: RAHT, quantisation and entropy coding of a group of channels in one call.
//! * [`predict`]: lossless integers by nearest coded neighbours, and lossy lifting.
//! * [`coder`], [`model`], [`mix`]: the entropy coder and its models; [`rlgr`]: run-length /
//!   Golomb-Rice coding, which the paper uses.
//!
//! Encoders and decoders give the same bytes and values on every machine. Decoders take hostile input:
//! an error or a wrong result, never a panic, and memory in proportion to what the caller allows
//! ([`Limits`]).
//!
//! ```
//! use gpcc_lite::attribute::{self, Options};
//! use gpcc_lite::coder::{Decoder, Encoder};
//! use gpcc_lite::raht::{Plan, Rows};
//! use gpcc_lite::{Leaf, Limits, geometry, morton};
//!
//! # fn main() -> gpcc_lite::Result<()> {
//! // A diagonal of voxels in a cube of depth 7, with one value each.
//! let leaves: Vec<Leaf> =
//!     (0..100).map(|i| Leaf { morton: morton::encode([i, i, i]), depth: 7 }).collect();
//! let shape = geometry::encode(&leaves, 7)?;
//! let back = geometry::decode(&shape, &Limits::for_stream(shape.len()))?;
//! assert_eq!(back.leaves, leaves);
//!
//! let plan = Plan::new(&leaves, 7)?;
//! let mut rows = Rows::new(100, 1);
//! (0..100).for_each(|i| rows.row_mut(i)[0] = i as f32);
//! let mut coder = Encoder::default();
//! attribute::encode(&mut coder, &plan, &[2.0], &Options::default(), &mut rows)?;
//! let bytes = coder.finish();
//!
//! let mut decoded = Rows::new(100, 1);
//! attribute::decode(&mut Decoder::new(&bytes)?, &plan, &[2.0], &mut decoded)?;
//! assert_eq!(decoded, rows);
//! assert!((0..100).all(|i| (decoded.row(i)[0] - i as f32).abs() <= 4.0));
//! # Ok(())
//! # }
//! ```

pub mod attribute;
mod bytes;
pub mod coder;
mod coefficients;
mod error;
pub mod geometry;
mod hood;
pub mod leaf;
mod limits;
pub mod mix;
pub mod model;
pub mod morton;
pub mod predict;
pub mod quant;
pub mod raht;
pub mod rlgr;

pub use error::{Error, Result};
pub use leaf::Leaf;
pub use limits::Limits;

/// The README's example, run with the documentation's.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
