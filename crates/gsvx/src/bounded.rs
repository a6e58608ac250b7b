//! Encoding with a bound on the error of every attribute of every Gaussian.
//!
//! Nothing is merged. Each Gaussian has its own leaf, small enough for the bound on its mean and to hold no other
//! Gaussian. The encoder decodes the stream and measures the errors. It lowers the steps of attributes that
//! break a bound until none does. Some Gaussians cannot keep their bounds: those that share the finest cell, and
//! those for which single precision is too coarse. They are coded exactly, in a chunk with the outliers.
//!
//! Invariant: what [`encode`] returns has been decoded, and keeps all bounds.

use crate::decode::{DecodeOptions, decode_with};
use crate::encode::{encode_lossless, encode_voxels};
use crate::encoded::Encoded;
use crate::error::{Result, coding};
use crate::head::Steps;
use crate::options::{EncodeOptions, MaxError};
use crate::outliers::split_outliers;
use crate::survey::Survey;
use gpcc_lite::morton::{self, MAX_DEPTH};
use gpcc_lite::{Cube, Leaf, Octree};
use gs_model::Scene;
use rayon::prelude::*;

mod errors;

use errors::{Ratios, largest_ratios, measure};

/// After this many encodes, Gaussians that break a bound are coded exactly: finer steps no longer help.
const MAX_STEP_UPDATES: usize = 6;
/// Encodes after which everything is coded exactly.
const MOST_ENCODES: usize = 24;
/// Ratio of step to bound in the first encode, and the smallest. Below the smallest, a finer step does not reduce
/// the error.
const FIRST_STEP: f32 = 1.0;
const MIN_STEP: f32 = 0.02;
/// Greatest factor by which a step grows.
const MAX_GROWTH: f32 = 4.0;
/// A group that broke its bound then aims at this fraction of it, since changes of other steps move all errors a
/// little.
const SAFETY: f32 = 0.98;

/// Encodes a scene so that each error is at most its bound.
///
/// # Errors
/// [`Error::Option`] for bounds out of range; those of [`encode_voxels`].
pub(crate) fn encode(
    scene: &Scene,
    survey: &Survey,
    bounds: &MaxError,
    options: &EncodeOptions,
) -> Result<Encoded> {
    bounds.check()?;
    let cut;
    let scene = if scene.sh_degree > options.max_sh_degree {
        let mut less = scene.clone();
        less.cut_sh(options.max_sh_degree);
        cut = less;
        &cut
    } else {
        scene
    };
    let mut exact = vec![false; scene.len()];
    if let Some(split) = split_outliers(scene, survey)? {
        split.outliers.iter().for_each(|&i| exact[i] = true);
    }
    let mut steps = steps_over(bounds, FIRST_STEP);
    for round in 0..MOST_ENCODES {
        let Some(placed) = place(scene, &mut exact, bounds)? else { break };
        let (encoded, ratios) = encode_once(scene, &placed, &exact, bounds, (steps, options))?;
        let worst = largest_ratios(&ratios);
        if round > 0 && worst.iter().all(|&r| r <= 1.0) {
            let rows = options.rows.then(|| rows(&placed.order, &exact));
            return Ok(Encoded { max_error: Some(bounds.times(&worst)), rows, ..encoded });
        }
        steps = updated_steps(steps, &worst, round == 0, bounds);
        if round >= MAX_STEP_UPDATES {
            for (&i, ratio) in placed.order.iter().zip(&ratios) {
                // Written so that a NaN counts as broken.
                exact[i] |= !ratio.iter().all(|&r| r <= 1.0);
            }
        }
    }
    all_exact(scene)
}

/// The row of each Gaussian in the decoded scene: Gaussians of leaves first, then exact ones.
fn rows(order: &[usize], exact: &[bool]) -> Vec<u32> {
    let mut rows = vec![0; exact.len()];
    let outliers = (0..exact.len()).filter(|&i| exact[i]);
    (0..).zip(order.iter().copied().chain(outliers)).for_each(|(row, i)| rows[i] = row);
    rows
}

/// A stream that codes every Gaussian exactly.
fn all_exact(scene: &Scene) -> Result<Encoded> {
    let max_error = Some(MaxError { mean: 0.0, opacity: 0.0, shape: 0.0, sh: 0.0 });
    Ok(Encoded { max_error, ..encode_lossless(scene, false)? })
}

fn steps_over(bounds: &MaxError, factor: f32) -> Steps {
    Steps {
        opacity: factor * bounds.opacity,
        dc: factor * bounds.sh,
        sh: [factor * bounds.sh; 3],
        covariance: factor * bounds.shape,
    }
}

/// New steps, from the worst errors at the present ones. Errors are about proportional to steps. Steps may grow
/// after the `first` encode only.
fn updated_steps(steps: Steps, worst: &Ratios, first: bool, bounds: &MaxError) -> Steps {
    let least = steps_over(bounds, MIN_STEP);
    let times = |step: f32, worst: f32, least: f32| {
        let scale = match worst {
            w if first => (1.0 / w).min(MAX_GROWTH),
            w if w > 1.0 => SAFETY / w,
            _ => 1.0,
        };
        (step * scale).max(least)
    };
    let [_, opacity, dc, sh1, sh2, sh3, shape] = *worst;
    Steps {
        opacity: times(steps.opacity, opacity, least.opacity),
        dc: times(steps.dc, dc, least.dc),
        sh: [
            times(steps.sh[0], sh1, least.sh[0]),
            times(steps.sh[1], sh2, least.sh[1]),
            times(steps.sh[2], sh3, least.sh[2]),
        ],
        covariance: times(steps.covariance, shape, least.covariance),
    }
}

/// Gaussians with a leaf each.
struct Placed {
    /// Their numbers in the scene, in the order of the leaves.
    order: Vec<usize>,
    octree: Octree,
}

/// Gives a leaf to every Gaussian that is not exact. Those for which no leaf is small enough become
/// exact. `None` if all are.
fn place(scene: &Scene, exact: &mut [bool], bounds: &MaxError) -> Result<Option<Placed>> {
    loop {
        let inside: Vec<usize> = (0..scene.len()).filter(|&i| !exact[i]).collect();
        if inside.is_empty() {
            return Ok(None);
        }
        let means: Vec<[f32; 3]> = inside.iter().map(|&i| scene.means[i]).collect();
        let cube = voxel::cube_of(&means)?;
        let mut sorted: Vec<(u64, usize)> = inside
            .par_iter()
            .map(|&i| (cube.index_of(scene.means[i], MAX_DEPTH).map_or(0, morton::encode), i))
            .collect();
        sorted.par_sort_unstable();
        // One Gaussian of each finest cell stays, the others become exact.
        let before = sorted.len();
        sorted.dedup_by(|next, kept| {
            let same = next.0 == kept.0;
            exact[next.1] |= same;
            same
        });
        let placed = with_leaves(scene, cube, &sorted, bounds)?;
        let off = |k: &usize| {
            let i = placed.order[*k];
            errors::mean_error(scene, i, placed.octree.centre(*k)) > bounds.mean
        };
        let off: Vec<usize> = (0..placed.order.len()).into_par_iter().filter(off).collect();
        off.iter().for_each(|&k| exact[placed.order[k]] = true);
        // The cube may be smaller without the Gaussians that have become exact.
        if off.is_empty() && before == sorted.len() {
            return Ok(Some(placed));
        }
    }
}

/// The largest leaves that keep the bound on the mean and hold one Gaussian each.
fn with_leaves(
    scene: &Scene,
    cube: Cube,
    sorted: &[(u64, usize)],
    bounds: &MaxError,
) -> Result<Placed> {
    let apart = |k: usize| {
        // Codes differ, and their highest bits are those of the coarsest level.
        let shared = (sorted[k].0 ^ sorted[k + 1].0).leading_zeros() as u8;
        (shared - (64 - 3 * MAX_DEPTH)) / 3 + 1
    };
    let depth = |k: usize| {
        let size = errors::longest_axis(scene, sorted[k].1);
        // Half the diagonal of a cell is the greatest distance from its centre.
        let cells = 0.5 * 3f64.sqrt() * cube.side / (f64::from(bounds.mean) * size);
        let wanted = libm::ceil(libm::log2(cells)).clamp(0.0, f64::from(MAX_DEPTH)) as u8;
        let left = if k > 0 { apart(k - 1) } else { 0 };
        let right = if k + 1 < sorted.len() { apart(k) } else { 0 };
        wanted.max(left).max(right)
    };
    let depths: Vec<u8> = (0..sorted.len()).into_par_iter().map(depth).collect();
    let finest = depths.iter().copied().max().unwrap_or(0);
    let leaf = |(&(code, _), &depth): (&(u64, usize), &u8)| Leaf {
        morton: code >> (3 * (MAX_DEPTH - depth)) << (3 * (finest - depth)),
        depth,
    };
    let leaves = sorted.iter().zip(&depths).map(leaf).collect();
    let octree = Octree::new(cube, finest, leaves).map_err(coding("geometry"))?;
    Ok(Placed { order: sorted.iter().map(|s| s.1).collect(), octree })
}

/// Encodes, decodes and measures: for each Gaussian that has a leaf, its errors over their bounds.
fn encode_once(
    scene: &Scene,
    placed: &Placed,
    exact: &[bool],
    bounds: &MaxError,
    (steps, options): (Steps, &EncodeOptions),
) -> Result<(Encoded, Vec<Ratios>)> {
    let outliers: Vec<usize> = (0..scene.len()).filter(|&i| exact[i]).collect();
    let outliers = scene.select(&outliers);
    let mut inside = scene.select(&placed.order);
    let centre = |(k, mean): (usize, &mut [f32; 3])| *mean = placed.octree.centre(k);
    inside.means.par_iter_mut().enumerate().for_each(centre);
    let options = EncodeOptions {
        steps,
        importance: Some(vec![1.0; inside.len()]),
        uniform_precision: true,
        max_error: Some(*bounds),
        ..options.clone()
    };
    let encoded = encode_voxels(&inside, &placed.octree, Some(&outliers), &options)?;
    drop((inside, outliers));
    let all = DecodeOptions { max_gaussians: Some(u64::MAX), ..DecodeOptions::default() };
    let decoded = decode_with(&encoded.bytes, &all)?.scene;
    let ratios = (0..placed.order.len())
        .into_par_iter()
        .map(|k| measure(scene, placed.order[k], &decoded, k, bounds))
        .collect();
    Ok((encoded, ratios))
}
