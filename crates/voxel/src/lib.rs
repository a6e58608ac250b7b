//! Octree voxelization of 3D Gaussians, uniform and adaptive.
//!
//! A trained 3DGS scene has Gaussians at arbitrary positions. An octree divides the cube that
//! holds them, and each leaf becomes one Gaussian at the leaf's centre. A [`Strategy`] decides
//! which cells are leaves. [`voxelize`] gives the leaves in Morton order, each with its own depth
//! and its members; [`merge`] gives the merged scene.
//!
//! The paper is *Adaptive Voxelization for Transform Coding of 3D Gaussian Splatting Data* (arXiv
//! 2506.00271): uniform voxelization is its section 3.1, the adaptive criteria are section 3.2,
//! the merging is section 3.3. [`RateDistortion`] and [`Merge::Moments`] go beyond it.
//!
//! *Invariant:* the crate does no I/O, knows neither bitstreams nor renderers, and gives the same
//! bits for any number of threads and on any machine.
//!
//! ```
//! use gs_model::Scene;
//! use voxel::{Merge, Strategy, cube_of, merge, voxelize};
//!
//! // Three Gaussians of SH degree 0; two of them almost coincide.
//! let scene = Scene {
//!     means: vec![[0.0, 0.0, 0.0], [0.001, 0.0, 0.0], [1.0, 1.0, 1.0]],
//!     rotations: vec![[1.0, 0.0, 0.0, 0.0]; 3],
//!     log_scales: vec![[-4.0; 3]; 3],
//!     opacity_logits: vec![0.5; 3],
//!     sh_degree: 0,
//!     sh: vec![[0.1, 0.2, 0.3]; 3],
//!     ..Scene::default()
//! };
//! let cube = cube_of(&scene.means)?;
//! let voxels = voxelize(&scene, &cube, &Strategy::Uniform { depth: 6 })?;
//! assert_eq!(voxels.len(), 2);
//! assert_eq!(voxels.members_of(0), [0, 1]);
//!
//! let merged = merge(&scene, &voxels, Merge::Moments)?;
//! assert_eq!(merged.len(), 2);
//! assert_eq!(merged.means[0], voxels.octree().centre(0));
//! # Ok::<(), voxel::Error>(())
//! ```

// Functions marked `multiversion` are compiled for AVX2 too, and chosen at run time. The bits stay
// the same: vector instructions round each number as scalar ones do, and no multiplication is fused
// with an addition. The functions they call are `inline(always)`, so that they are compiled for
// AVX2 too.

mod check;
mod cost;
mod cube;
mod descend;
mod distortion;
mod error;
mod gaussian;
mod importance;
mod local;
mod merge;
mod order;
mod pages;
mod paper;
mod pruning;
mod rate_distortion;
mod record;
mod released;
mod strategy;
mod tiles;
mod trim;
mod voxelization;
mod voxelize;
#[cfg(feature = "reference")]
pub mod w2;

pub use cost::CostModel;
pub use cube::cube_of;
pub use error::{Error, Result};
pub use gpcc_lite::{Cube, Leaf, Octree};
pub use importance::Importance;
pub use local::local_means;
pub use merge::{Merge, Merging, Place, merge};
pub use order::morton_codes;
pub use rate_distortion::RateDistortion;
pub use record::WeightSums;
pub use released::ReleasedRule;
pub use strategy::Strategy;
pub use tiles::Tiles;
pub use trim::{Trim, TrimOutcome, trim};
pub use voxelization::Voxelization;
pub use voxelize::{voxelize, voxelize_tile};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
mod readme {}
