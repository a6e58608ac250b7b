//! The system of *Adaptive Voxelization for Transform Coding of 3D Gaussian Splatting Data* (Wang, Sridhara, Pavez,
//! Ortega, Chang, arXiv 2506.00271) but for its fine-tune: what gsvx started from, and what it is measured beside.
//!
//! The steps, in the paper's order:
//!
//! | step | section | where |
//! |---|---|---|
//! | overview: from voxelized Gaussians to a stream, and back | 2.2 | `codec` |
//! | positions by an octree | 2.3 | `positions` |
//! | covariances, lossy: vector quantisation | 2.3 | `covariance/lossy`, on the crate `vq` |
//! | covariances, lossless: prediction from neighbours | 2.3 | `covariance/lossless` |
//! | SH coefficients and opacity by RAHT and RLGR | 2.4 | `sh_and_opacity` |
//! | uniform voxelization | 3.1 | [`voxelize`] with [`Strategy::Uniform`] |
//! | adaptive voxelization | 3.2 | [`voxelize`] with [`Strategy::paper`] |
//! | initialisation of the merged Gaussians | 3.3 | [`voxelize`] |
//! | fine-tuning with the means fixed | 3.3 | `tune::FineTune`, between [`voxelize`] and [`encode`] |
//!
//! The paper has no container. This one (`container`) holds everything that a decoder needs, so it counts
//! more than the paper does, which leaves out the indices into the codebook.
//!
//! Where it differs:
//! - SH channels go through RLGR one by one, not three together; YUV is an orthonormal transform; opacity is a logit.
//! - Steps are parts of each channel's range in 8 bits, as in the authors' code; the text has no such step.
//! - The codebook clusters square roots of covariances by squared blending weights, not covariances by gradients. No
//!   Gaussian is kept out of it, and it is not tuned.
//! - What the text calls predictive lifting is the predicting transform of G-PCC, without an update, as the authors run
//!   TMC13 for lossless covariances.
//! - Leaves of adaptive voxelization keep their depth, as the text has it (the authors' code codes all at the greatest).
//!
//! *Invariant:* encoder and decoder give the same bytes and floats on every machine and for any number
//! of threads. [`decode`] gives a valid scene or an error, whatever it is given.
//!
//! The README has an example.

mod codec;
mod container;
mod covariance;
mod error;
mod positions;
mod sh_and_opacity;
mod voxelization;

pub use codec::{PaperOptions, PaperStream, decode, decode_within, encode};
pub use covariance::CovarianceCoding;
pub use error::{Error, Result};
pub use gpcc_lite::Limits;
pub use sh_and_opacity::Qp;
pub use voxel::{Strategy, Voxelization};
pub use voxelization::{PaperVoxels, voxelize};

/// The README's example, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
