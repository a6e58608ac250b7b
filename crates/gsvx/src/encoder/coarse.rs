//! [`Coarse`]: the coarser levels of detail of leaves whose Gaussians an optimiser moves.

use super::assemble::EncodedChunk;
use super::encode::{CodingChoice, encode_levels};
use super::lod::LodLevel;
use super::options::CodeOptions;
use super::source::GaussianSource;
use crate::error::Result;
use crate::head::Header;
use gs_model::Scene;
use voxel::{Importance, Voxelization};

/// Levels above the finest, and what stays the same while its Gaussians move.
pub(crate) struct Coarse {
    voxels: Voxelization,
    levels: Vec<LodLevel>,
    weights: Importance,
}

impl Coarse {
    /// `importance` is that of each of the finest leaves.
    pub(crate) fn new(voxels: Voxelization, levels: Vec<LodLevel>, importance: Vec<f32>) -> Self {
        Self { voxels, levels, weights: Importance::Given(importance) }
    }

    /// True if no coarser level is wanted.
    pub(crate) fn is_empty(&self) -> bool {
        self.levels.is_empty()
    }

    /// The chunks of the levels of a scene that has one Gaussian for each of the finest leaves.
    pub(crate) fn encode(&self, finest: &Scene, header: &Header) -> Result<Vec<EncodedChunk>> {
        let Self { voxels, levels, weights } = self;
        let source = GaussianSource { scene: finest, voxels, weights, merged: true, whole: None };
        let options = CodeOptions::default();
        encode_levels(
            &source,
            levels,
            header.sh_degree,
            CodingChoice::new(&header.steps, &options),
            None,
        )
    }
}
