//! Geometry and attribute coding of voxelized point clouds.
//!
//! The crate knows voxels, and numbers per voxel; what they mean is the caller's business. It
//! follows the tools of MPEG's G-PCC (octree, RAHT, predicting transform) with entropy
//! coding of its own. Its streams are not those of G-PCC; `docs/format.md` of the repository
//! describes them.
//!
//! * [`geometry`]: leaves of a pruned octree, each with a depth of its own, lossless.
//! * [`raht`]: the region-adaptive hierarchical transform, one list of merges for all channels.
//! * [`attribute`]: RAHT, quantisation and entropy coding of a group of channels in one call.
//! * [`coder`], [`model`], [`mix`]: the entropy coder and its models.
//! * [`paper`]: what only the paper's codec and measuring use.
//!
//! Encoders and decoders give the same bytes and values on every machine. Decoders may be given
//! hostile input: they return an error or a wrong result and never panic, and their memory is
//! bounded by what the caller allows ([`Limits`]).
//!
//! ```
//! use gpcc_lite::raht::{RahtPlan, Rows, forward, inverse};
//! use gpcc_lite::{Leaf, Octree, morton};
//!
//! // Occupied voxels in Morton order, each with one row of channels.
//! let leaves: Vec<Leaf> =
//!     (0..100).map(|i| Leaf { morton: morton::encode([i, i, i]), depth: 7 }).collect();
//! let plan = RahtPlan::new(Octree::of_points(7, leaves)?);
//! let mut rows = Rows::new(100, 1);
//! (0..100).for_each(|i| rows.row_mut(i)[0] = i as f32);
//! forward(&plan, &mut rows)?; // The mean in row 0, differences of means in all others.
//! assert!((rows.row(0)[0] - 49.5).abs() < 1e-4);
//! inverse(&plan, &mut rows)?;
//! assert!((0..100).all(|i| (rows.row(i)[0] - i as f32).abs() < 1e-4));
//! # Ok::<(), gpcc_lite::Error>(())
//! ```
//!
//! The README shows a whole round trip with quantisation and entropy coding.

pub mod attribute;
mod bit;
mod bytes;
pub mod coder;
mod coefficients;
mod cube;
mod error;
pub mod geometry;
mod hood;
mod leaf;
mod limits;
mod logistic;
pub mod mix;
pub mod model;
pub mod morton;
mod octree;
pub mod paper;
pub mod raht;
mod symbols;

pub use bytes::{put_varint, varint};
pub use cube::{Cube, Grid};
pub use error::{Error, Result};
pub use leaf::Leaf;
pub use limits::Limits;
pub use octree::Octree;

/// The README's examples, run with those of the documentation.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
