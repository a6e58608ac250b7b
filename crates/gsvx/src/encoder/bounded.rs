//! Encoding with a bound on the error of every attribute of every Gaussian.
//!
//! Nothing is merged. Each Gaussian has its own leaf, small enough for the bound on its mean and to hold no other
//! Gaussian. The encoder decodes the stream and measures the errors. It lowers the steps of attributes that
//! break a bound until none does. Some Gaussians cannot keep their bounds: those that share the finest cell, and
//! those for which single precision is too coarse. They are coded exactly, in a chunk with the outliers.
//!
//! Invariant: what [`encode`] returns has been decoded, and keeps all bounds.

use super::encode::{CodingChoice, encode_source};
use super::encoded::EncodedStream;
use super::options::{CodeOptions, MaxError};
use super::source::GaussianSource;
use crate::error::Result;
use crate::head::Steps;
use gs_model::Scene;
use rayon::prelude::*;
use voxel::{Importance, Voxelization};

mod errors;
mod place;
mod steps;

use errors::{largest_ratios, ratios};
use place::{PlacedLeaves, place};

/// After this many encodes, Gaussians that break a bound are coded exactly: finer steps no longer help.
const MAX_STEP_UPDATES: usize = 6;
/// Encodes after which everything is coded exactly.
const MOST_ENCODES: usize = 24;

/// Encodes a scene so that each error is at most its bound. `outliers` are coded exactly. `None` if all Gaussians
/// have to be.
///
/// # Errors
/// [`crate::Error::Option`] for bounds out of range; those of [`crate::encode_voxels`].
pub(crate) fn encode(
    scene: &Scene,
    outliers: &[usize],
    bounds: &MaxError,
    options: &CodeOptions,
) -> Result<Option<EncodedStream>> {
    bounds.check()?;
    let mut exact = vec![false; scene.len()];
    outliers.iter().for_each(|&i| exact[i] = true);
    let mut steps = steps::first(bounds);
    for round in 0..MOST_ENCODES {
        let Some(placed) = place(scene, &mut exact, bounds)? else { break };
        let encoded = encode_once(scene, &placed, &exact, &steps, options)?;
        let decoded = encoded.decode()?;
        let ratios = ratios(scene, &placed.order, &decoded, bounds);
        let worst = largest_ratios(&ratios);
        if round > 0 && worst.iter().all(|&r| r <= 1.0) {
            let max_error = Some(bounds.times(&worst));
            let rows = rows(&placed.order, &exact);
            return Ok(Some(EncodedStream { max_error, rows, ..encoded }));
        }
        steps = steps::next(steps, &worst, round == 0, bounds);
        if round >= MAX_STEP_UPDATES {
            for (&i, ratio) in placed.order.iter().zip(&ratios) {
                // Written so that a NaN counts as broken.
                exact[i] |= !ratio.iter().all(|&r| r <= 1.0);
            }
        }
    }
    Ok(None)
}

/// The row of each Gaussian in the decoded scene: Gaussians of leaves first, then exact ones.
fn rows(order: &[usize], exact: &[bool]) -> Vec<u32> {
    let mut rows = vec![0; exact.len()];
    let outliers = (0..exact.len()).filter(|&i| exact[i]);
    (0..).zip(order.iter().copied().chain(outliers)).for_each(|(row, i)| rows[i] = row);
    rows
}

/// Encodes the Gaussians at the centres of their leaves, and the exact ones.
fn encode_once(
    scene: &Scene,
    placed: &PlacedLeaves,
    exact: &[bool],
    steps: &Steps,
    options: &CodeOptions,
) -> Result<EncodedStream> {
    let outliers: Vec<usize> = (0..scene.len()).filter(|&i| exact[i]).collect();
    let outliers = scene.select(&outliers);
    let mut inside = scene.select(&placed.order);
    let centre = |(k, mean): (usize, &mut [f32; 3])| *mean = placed.octree.centre(k);
    inside.means.par_iter_mut().enumerate().for_each(centre);
    let source = GaussianSource {
        scene: &inside,
        voxels: &Voxelization::one_each(placed.octree.clone()),
        weights: &Importance::Given(vec![1.0; inside.len()]),
        merged: true,
        whole: None,
    };
    let options = &CodeOptions { uniform_precision: true, ..*options };
    // The quantiser's trade of errors for bits is off: it makes single errors large.
    let coding = CodingChoice { lambda: Some(0.0), ..CodingChoice::new(steps, options) };
    encode_source(&source, Some(&outliers), coding)
}
