//! The encoder: chunks of leaves, levels of detail, and the head in front of them.

use super::assemble::{EncodedChunk, assemble, joined, without_zero_degrees};
use super::check::{
    check_centres, check_length, check_lengths, check_steps, checked_outliers, used_degree,
};
use super::encoded::EncodedStream;
use super::lod::{self, LodLevel};
use super::options::CodeOptions;
use super::source::{GaussianSource, Whole};
use crate::chunk::CodingSettings;
use crate::error::{Error, Result};
use crate::head::{Header, Steps};
use crate::importance;
use gpcc_lite::Octree;
use gs_model::Scene;
use rayon::prelude::*;
use std::ops::Range;
use voxel::{Importance, Voxelization};

/// How a source is coded.
#[derive(Clone, Copy)]
pub(crate) struct CodingChoice<'a> {
    pub(crate) steps: &'a Steps,
    pub(crate) options: &'a CodeOptions,
    /// See [`CodingSettings::lambda`].
    pub(crate) lambda: Option<f32>,
    /// Keep the decoded scene: [`EncodedStream::decoded`].
    pub(crate) keep: bool,
}

impl<'a> CodingChoice<'a> {
    /// By the quantiser's own trade of errors for bits.
    pub(crate) fn new(steps: &'a Steps, options: &'a CodeOptions) -> Self {
        Self { steps, options, lambda: None, keep: false }
    }
}

/// Encodes a voxelized scene.
///
/// `scene` holds one Gaussian per leaf of `octree`, in leaf order, each at its leaf's centre (what
/// [`voxel::merge`] returns, or a fine-tuned version of it). `importance` is that of each leaf, in any unit; without it
/// [`crate::importance::without_cameras`] guesses. `outliers` are coded bit for bit; a decoder returns them behind the leaves, in their order.
///
/// # Errors
/// [`Length`](crate::Error::Length), [`OffCentre`](crate::Error::OffCentre) or
/// [`NonFinite`](crate::Error::NonFinite) if the scene does not fit,
/// [`InvalidOutlier`](crate::Error::InvalidOutlier) if an outlier does not.
pub fn encode_voxels(
    scene: &Scene,
    octree: &Octree,
    outliers: Option<&Scene>,
    importance: Option<&[f32]>,
    steps: &Steps,
    options: &CodeOptions,
) -> Result<EncodedStream> {
    check_lengths(scene)?;
    check_centres(scene, octree)?;
    if let Some(given) = importance {
        check_length("importances", given.len(), scene.len())?;
    }
    let importance = match importance {
        Some(given) => given.to_vec(),
        None => importance::without_cameras(scene),
    };
    let weights = &Importance::Given(importance);
    let voxels = &Voxelization::one_each(octree.clone());
    let source = GaussianSource { scene, voxels, weights, merged: true, whole: None };
    encode_source(&source, outliers, CodingChoice::new(steps, options))
}

/// Encodes the leaves of a source, a chunk at a time on each thread.
pub(crate) fn encode_source(
    source: &GaussianSource<'_>,
    outliers: Option<&Scene>,
    coding: CodingChoice<'_>,
) -> Result<EncodedStream> {
    let CodingChoice { steps, options, keep, .. } = coding;
    check_steps(steps)?;
    let outliers = checked_outliers(outliers, source.scene.sh_degree)?;
    let exact_degree = outliers.map_or(0, |o| used_degree(o, options.max_sh_degree));
    let used = || used_degree(source.scene, options.max_sh_degree).max(exact_degree);
    let sh_degree = source.whole.and_then(|w| w.sh_degree).unwrap_or_else(used);
    let header = Header {
        count: 0,
        sh_degree,
        j_high: source.voxels.octree().depth(),
        cube: source.voxels.octree().cube(),
        steps: *steps,
        antialiased: source.scene.antialiased,
        origin: source.scene.origin,
    };
    let tiles = source.whole.map_or(lod::LodTiles::ONE, |w| w.tiles);
    let levels = lod::levels(source.voxels, options, tiles)?;
    let mut decoded = keep.then(|| source.scene.emptied(sh_degree));
    if let Some(decoded) = &mut decoded {
        let leaves = source.voxels.len();
        decoded.try_reserve(leaves).map_err(|_| Error::memory(leaves))?;
    }
    let chunks = encode_levels(source, &levels, sh_degree, coding, decoded.as_mut())?;
    let chunks = without_zero_degrees(chunks, exact_degree);
    let (header, chunks) = joined(&header, chunks, outliers, exact_degree);
    if let Some(decoded) = &mut decoded {
        decoded.cut_sh(header.sh_degree);
        outliers.into_iter().for_each(|outliers| decoded.append(outliers));
    }
    let left_out = source.voxels.dropped().len();
    let rows = source.voxels.leaf_of_each(source.scene.len());
    Ok(EncodedStream { left_out, rows, decoded, ..assemble(header, chunks)? })
}

/// Encodes levels of the leaves of a source, the last one first. `decoded` gets the Gaussians that a decoder makes of the
/// finest level.
pub(crate) fn encode_levels(
    source: &GaussianSource<'_>,
    levels: &[LodLevel],
    sh_degree: u8,
    coding: CodingChoice<'_>,
    mut decoded: Option<&mut Scene>,
) -> Result<Vec<EncodedChunk>> {
    let CodingChoice { steps, lambda, .. } = coding;
    let how = CodingSettings { steps, sh_degree, fit: true, lambda };
    let importance = source.importance();
    let jobs: Vec<_> = levels
        .iter()
        .rev()
        .map(|level| (level, classes(source, level, &level.sum(&importance), coding)))
        .collect();
    drop(importance);
    let each = jobs.iter().flat_map(|(level, classes)| {
        level.cuts.windows(2).map(move |cut| (*level, &classes[..], cut[0]..cut[1]))
    });
    let empty = decoded.as_ref().map(|decoded| decoded.emptied(sh_degree));
    let encode = |(level, classes, range): (&LodLevel, &[f32], Range<usize>)| {
        let mut kept = empty.clone().filter(|_| level.lod == 0);
        let chunk = source.encode_chunk(how, level, classes, range, kept.as_mut())?;
        Ok((chunk, kept))
    };
    let each: Vec<_> = each.collect();
    // At most a quarter of the Gaussians at a time, for memory's sake: a chunk keeps two cores busy.
    let at_once = (each.len() / 4).clamp(1, rayon::current_num_threads());
    let mut chunks = Vec::with_capacity(each.len());
    for some in each.chunks(at_once) {
        let encoded: Vec<Result<_>> =
            some.par_iter().with_max_len(1).map(|job| encode(job.clone())).collect();
        // The first error, on any number of threads.
        for encoded in encoded {
            let (chunk, kept) = encoded?;
            chunks.push(chunk);
            if let (Some(decoded), Some(kept)) = (&mut decoded, kept) {
                decoded.append(&kept);
            }
        }
    }
    Ok(chunks)
}

/// The classes of the leaves of a level, from the importance of each.
fn classes(
    source: &GaussianSource<'_>,
    level: &LodLevel,
    importance: &[f32],
    CodingChoice { steps, options, .. }: CodingChoice<'_>,
) -> Vec<f32> {
    let step = steps.covariance;
    match source.whole.filter(|_| level.lod == 0) {
        _ if options.uniform_precision => {
            vec![f32::from(importance::MEAN_CLASS); importance.len()]
        }
        Some(Whole { mean_importance, .. }) => {
            importance::log_classes_about(mean_importance, importance, step)
        }
        // Relative to the mean of the tile.
        None => {
            let of = |tile: &Range<usize>| importance::log_classes(&importance[tile.clone()], step);
            level.tiles.iter().flat_map(of).collect()
        }
    }
}
