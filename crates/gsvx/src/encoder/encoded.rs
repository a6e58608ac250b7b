//! [`EncodedStream`]: a finished stream, and what is known of it.

use super::options::MaxError;
use crate::decode::{DecodeOptions, decode_with};
use crate::error::Result;
use crate::head::{Index, Kind};
use gs_model::Scene;

/// A finished stream.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct EncodedStream {
    /// The stream.
    pub bytes: Vec<u8>,
    /// Its head.
    pub index: Index,
    /// Gaussians that were left out because no rasterizer draws them: [`gs_model::LEAST_DRAWN_LOGIT`].
    pub transparent: usize,
    /// Gaussians that [`crate::PrepareOptions::prune`] left out.
    pub pruned: usize,
    /// Gaussians that the voxelization left out; those that it merged are not counted.
    pub left_out: usize,
    /// Where the finest cells are so coarse that positions err visibly at any quality: parts of the scene lie so
    /// far apart, or differ so much in size, that an octree's 21 levels do not suffice. The parts are better
    /// encoded apart.
    pub coarse_cells: Option<CoarseCells>,
    /// The greatest errors, where [`crate::Aim::MaxError`] bounds them: they have been measured.
    pub max_error: Option<MaxError>,
    /// The row in which a decoder returns each Gaussian of the input. Gaussians that were merged share one.
    /// [`LEFT_OUT`] stands for those left out. [`crate::latents`] has no input, and leaves this empty.
    pub rows: Vec<u32>,
    /// What [`EncodedStream::decode`] returns, if [`crate::Encoder::keep_decoded`] asks for it.
    pub decoded: Option<Scene>,
}

/// How coarse the finest cells are; see [`EncodedStream::coarse_cells`].
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct CoarseCells {
    /// Side of a cell, in units of the largest axis of a Gaussian.
    pub cells: f64,
    /// Of the Gaussian below which a tenth of all are smaller, rather than of the median one.
    pub of_small: bool,
}

impl CoarseCells {
    /// Which Gaussians are meant: "typical" or "small".
    #[must_use]
    pub(crate) fn which(&self) -> &'static str {
        if self.of_small { "small" } else { "typical" }
    }
}

/// In [`EncodedStream::rows`]: a Gaussian that is not in the stream.
pub const LEFT_OUT: u32 = u32::MAX;

impl EncodedStream {
    /// The scene of the finest level.
    ///
    /// # Errors
    /// As [`crate::decode`], of bytes that have been changed.
    pub fn decode(&self) -> Result<Scene> {
        let all = DecodeOptions { max_gaussians: Some(u64::MAX), ..DecodeOptions::default() };
        Ok(decode_with(&self.bytes, &all)?.scene)
    }

    /// The number of bytes of each part of the stream; see [`Index::parts`].
    #[must_use]
    pub fn parts(&self) -> Vec<(&'static str, u64)> {
        self.index.parts()
    }

    /// The number of Gaussians that are coded bit for bit.
    #[must_use]
    pub fn exact(&self) -> usize {
        let chunks = self.index.chunks.iter().filter(|c| c.kind == Kind::Exact);
        chunks.map(|c| c.count as usize).sum()
    }

    /// The number of Gaussians that are coded exactly where others are not.
    #[must_use]
    pub fn outliers(&self) -> usize {
        let exact = self.exact();
        if exact as u64 == self.index.header.count { 0 } else { exact }
    }

    /// The share of the bytes that Gaussians take that are coded exactly, from 0 to 1.
    #[must_use]
    pub fn exact_share(&self) -> f64 {
        let chunks = self.index.chunks.iter().filter(|c| c.kind == Kind::Exact);
        let bytes: u64 = chunks.flat_map(|c| &c.layers).map(|l| l.len).sum();
        bytes as f64 / self.bytes.len().max(1) as f64
    }
}

impl AsRef<[u8]> for EncodedStream {
    fn as_ref(&self) -> &[u8] {
        &self.bytes
    }
}
