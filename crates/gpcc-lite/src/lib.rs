//! Geometry and attribute coding of voxelized point clouds.
//!
//! The crate knows voxels, and integers per voxel; what they mean is the caller's business. It
//! follows the tools of MPEG's G-PCC (octree, RAHT, predicting and lifting transforms) with
//! entropy coding of its own; streams are not those of G-PCC, and are described in
//! `docs/bitstream-gpcc.md` of the repository.
//!
//! * [`geometry`]: leaves of a pruned octree, each of its own depth, lossless, with level of
//!   detail.
//! * [`raht`]: the region-adaptive hierarchical transform, one list of merges for all channels.
//! * [`attribute`]: RAHT, prediction, quantisation and entropy coding of a group of channels in
//!   one call; [`coeffs`] is its entropy coder alone.
//! * [`predict`]: lossless integers by nearest coded neighbours, and lossy lifting.
//! * [`range`], [`model`], [`mix`], [`rlgr`], [`quant`]: the parts.
//!
//! Encoders and decoders give the same bytes and values on every machine and for every number
//! of threads. Decoders take hostile input: an error or a wrong result, never a panic, and
//! memory in proportion to what the caller allows ([`Limits`]).
//!
//! ```
//! use gpcc_lite::attribute::{self, Options};
//! use gpcc_lite::quant::Step;
//! use gpcc_lite::raht::Plan;
//! use gpcc_lite::{Leaf, Limits, geometry, morton};
//!
//! # fn main() -> gpcc_lite::Result<()> {
//! // A diagonal of voxels in a cube of depth 7, with one value each.
//! let leaves: Vec<Leaf> =
//!     (0..100).map(|i| Leaf { morton: morton::encode([i, i, i]), depth: 7 }).collect();
//! let values: Vec<i32> = (0..100).collect();
//!
//! let shape = geometry::encode(&leaves, 7)?;
//! let plan = Plan::new(&leaves, 7)?;
//! let colour = attribute::encode(&plan, &[&values], &[Step::from_qp(10)], &Options::default())?;
//!
//! let g = geometry::decode(&shape, &Limits::for_stream(shape.len()))?;
//! assert_eq!(g.leaves, leaves);
//! let plan = Plan::new(&g.leaves, g.j_high)?;
//! let back = attribute::decode(&plan, &colour.bytes, 1)?;
//! assert_eq!(back, colour.reconstruction);
//! assert!(back[0].iter().zip(&values).all(|(a, b)| (a - b).abs() <= 4));
//! # Ok(())
//! # }
//! ```

pub mod attribute;
mod bytes;
pub mod coeffs;
mod context;
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
pub mod range;
mod rdoq;
pub mod rlgr;
mod symbol_coder;
mod symbols;

pub use error::{Error, Result};
pub use leaf::Leaf;
pub use limits::Limits;

/// The README's example, run with the documentation's.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
