//! From a trained model to a stream: outliers, voxelization, merging, coding.

use crate::bounded;
use crate::encode::{Encoded, Source, check_lengths, encode_source};
use crate::error::{Error, Result};
use crate::importance;
use crate::lossless::layout;
use crate::options::EncodeOptions;
use gpcc_lite::morton::MAX_DEPTH;
use gs_model::Scene;
use voxel::{Cube, Importance, Merge, RateDistortion, Strategy, Trim, Trimmed, Voxelization};

/// Finest leaf depth the default strategy considers; leaves that deep are rare, and what an
/// unbounded scene needs for its nearest Gaussians.
const J_HIGH: u8 = 17;
/// Where far parts make the cube large, the octree is so deep that this many of its finest leaves fit
/// along the largest axis of a median Gaussian (at most `MAX_DEPTH`): small Gaussians need far finer ones
/// than the median. With 8, a room below a sky 1000 units away lost 2 dB.
const LEAVES_PER_AXIS: f64 = 64.0;
/// Cells this many times smaller than the median Gaussian's largest axis are needed at least. An outlier costs the
/// octree about three bits a level, less than its floats, so outliers are split off only where the greatest
/// depth does not suffice for these: see [`split_outliers`].
const CELLS_PER_AXIS: f64 = 8.0;
/// Cells of this part of the median Gaussian's largest axis are worth a warning. Two rooms 1e4 units apart, with 0.07,
/// lose 1 dB at quality 75; 1e5 units apart, with 0.7, 15 dB.
const COARSE: f64 = 0.2;
/// Lagrangian weight at quality 50, in the units of [`RateDistortion::lambda`]. It follows the
/// square of the attribute steps, so that positions and attributes stay in balance.
const LAMBDA_AT_50: f64 = 3e-3;
/// The same for guessed importances.
const LAMBDA_AT_50_GUESSED: f64 = 4e-3;
const QUALITY_PER_OCTAVE: f64 = 15.0;
/// Exponent on importance for the choice of leaves (measured; 1 merges too eagerly where little
/// is seen, 0.5 too little).
const EXPONENT: f64 = 0.8;
/// Distortion of leaving a Gaussian out per unit of importance.
const DROP: f64 = 5.0;
/// Attribute bits per Gaussian at quality 50, and how they grow per quality point.
const BITS_AT_50: f64 = 60.0;
const BITS_PER_POINT: f64 = 1.2;

/// Encodes a trained model. Gaussians so far away that they would cost all others precision are coded
/// bit for bit (see [`split_outliers`]); all others are voxelized and merged as the quality asks. With
/// [`EncodeOptions::max_error`] nothing is merged.
///
/// # Errors
/// [`Error::Voxel`] for what voxelization refuses, [`Error::CountMismatch`] if the importances in
/// `options` are not one per Gaussian, [`Error::NonFinite`] and [`Error::TooLarge`] for values that lossy
/// coding cannot hold.
pub fn encode(scene: &Scene, options: &EncodeOptions) -> Result<Encoded> {
    check_lengths(scene)?;
    if let Some(bounds) = &options.max_error {
        return bounded::encode(scene, bounds, options);
    }
    if let Some(given) = options.importance.as_ref().filter(|i| i.len() != scene.len()) {
        return Err(Error::CountMismatch { scene: given.len(), leaves: scene.len() });
    }
    let strategy = |importance: &[f32], seen| {
        let only = seen == Seen::ByCameras && options.drop_unseen;
        let seen = if only { Seen::ByCamerasOnly } else { seen };
        default_strategy(options.quality, importance, seen)
    };
    let keep = |given: &Vec<f32>| match options.drop_unseen {
        true => given.clone(),
        false => importance::with_unseen(scene, given),
    };
    let importance = options.importance.as_ref().map(keep);
    let Some(split) = split_outliers(scene)? else {
        let options = EncodeOptions { importance, ..options.clone() };
        return encode_with(scene, strategy, None, &options);
    };
    let outliers = scene.select(&split.outliers);
    let inside = scene.select(&split.inside);
    let of_inside = |given: Vec<f32>| split.inside.iter().map(|&i| given[i]).collect();
    let importance = importance.map(of_inside);
    let options = EncodeOptions { importance, ..options.clone() };
    let encoded = encode_with(&inside, strategy, Some(&outliers), &options)?;
    let leaves = encoded.index.header.count as usize - outliers.len();
    let rows = encoded.rows.as_ref().map(|rows| split.rows(rows, leaves as u32));
    Ok(Encoded { rows, ..encoded })
}

/// As [`encode`], with a voxelization of the caller's choice. `outliers` are coded exactly. Importances
/// are taken as they are: [`EncodeOptions::drop_unseen`] has no effect.
///
/// # Errors
/// As [`encode`].
pub fn encode_with(
    scene: &Scene,
    strategy: impl FnOnce(&[f32], Seen) -> Result<Strategy>,
    outliers: Option<&Scene>,
    options: &EncodeOptions,
) -> Result<Encoded> {
    let importance = options.importance.as_deref();
    let (voxels, weights) = voxels_and_weights(scene, strategy, importance)?;
    let source = Source { scene, voxels: &voxels, weights: &weights, merged: false };
    encode_source(&source, outliers, options)
}

/// A voxelized scene with the importance of each leaf.
#[derive(Clone, Debug)]
pub struct Prepared {
    /// One Gaussian per leaf, at its centre.
    pub scene: Scene,
    /// The leaves and their members.
    pub voxels: Voxelization,
    /// Importance per leaf, for [`EncodeOptions::importance`] of [`crate::encode_voxels`].
    pub importance: Vec<f32>,
}

/// Where importances come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Seen {
    /// The rasterizer's sum of squared blending weights over cameras. Nothing is left out: see
    /// [`importance::with_unseen`].
    ByCameras,
    /// The same from cameras that show all that counts: what they see too little of to pay for its bits
    /// is left out.
    ByCamerasOnly,
    /// [`importance::without_cameras`]: a guess, on which nothing is left out.
    Guessed,
}

/// The default voxelization strategy at a quality of 0 to 100.
///
/// `importance` has one entry per Gaussian of the scene.
///
/// # Errors
/// [`Error::Option`] if `quality` is out of range.
pub fn default_strategy(quality: f32, importance: &[f32], seen: Seen) -> Result<Strategy> {
    EncodeOptions::from_quality(quality)?;
    let (lambda, exponent, drop) = match seen {
        Seen::ByCameras => (LAMBDA_AT_50, EXPONENT, None),
        Seen::ByCamerasOnly => (LAMBDA_AT_50, EXPONENT, Some(DROP)),
        Seen::Guessed => (LAMBDA_AT_50_GUESSED, 1.0, None),
    };
    let above = f64::from(quality) - 50.0;
    let mut options = RateDistortion::new(lambda * libm::exp2(-2.0 * above / QUALITY_PER_OCTAVE));
    options.j_high = J_HIGH;
    options.cost.gaussian = (BITS_AT_50 + BITS_PER_POINT * above).max(10.0);
    options.drop = drop;
    let given = importance.iter().map(|&v| {
        let v = if v.is_finite() { f64::from(v).max(0.0) } else { 0.0 };
        libm::pow(v, exponent) as f32
    });
    options.importance = Importance::Given(given.collect());
    Ok(Strategy::RateDistortion(options))
}

/// Voxelizes with `strategy` and merges, weighting members by importance.
///
/// `importance` is per Gaussian of `scene`, from cameras; `None` uses
/// [`importance::without_cameras`].
///
/// # Errors
/// [`Error::Voxel`] for what voxelization refuses, [`Error::CountMismatch`] if the importances
/// are not one per Gaussian.
pub fn prepare(
    scene: &Scene,
    strategy: impl FnOnce(&[f32], Seen) -> Result<Strategy>,
    importance: Option<&[f32]>,
) -> Result<Prepared> {
    let (voxels, weights) = voxels_and_weights(scene, strategy, importance)?;
    let merged = voxel::merge_weighted(scene, &voxels, Merge::Moments, &weights)?;
    let importance =
        Source { scene, voxels: &voxels, weights: &weights, merged: false }.importance();
    Ok(Prepared { scene: merged, voxels, importance })
}

/// The leaves, and the importance that weighs their members.
fn voxels_and_weights(
    scene: &Scene,
    strategy: impl FnOnce(&[f32], Seen) -> Result<Strategy>,
    importance: Option<&[f32]>,
) -> Result<(Voxelization, Importance)> {
    check_lengths(scene)?;
    let seen = if importance.is_some() { Seen::ByCameras } else { Seen::Guessed };
    let importance = match importance {
        Some(given) if given.len() == scene.len() => given.to_vec(),
        Some(given) => {
            return Err(Error::CountMismatch { scene: given.len(), leaves: scene.len() });
        }
        None => importance::without_cameras(scene),
    };
    let cube = Cube::of(&scene.means)?;
    let mut strategy = strategy(&importance, seen)?;
    if let Strategy::RateDistortion(options) = &mut strategy {
        options.j_high = options.j_high.max(needed_depth(scene, &cube));
    }
    let voxels = voxel::voxelize(scene, &cube, &strategy)?;
    Ok((voxels, Importance::Given(importance)))
}

/// Depth at which [`LEAVES_PER_AXIS`] cells fit along the median Gaussian's largest axis.
fn needed_depth(scene: &Scene, cube: &Cube) -> u8 {
    let of = |median| depth_of(LEAVES_PER_AXIS, median, cube);
    median_log_scale(scene).map_or(0.0, of).ceil().clamp(0.0, f64::from(MAX_DEPTH)) as u8
}

/// Depth at which this many cells fit along a largest axis, without a greatest depth and without rounding.
fn depth_of(cells: f64, log_scale: f64, cube: &Cube) -> f64 {
    libm::log2(cube.side * cells) - log_scale * std::f64::consts::LOG2_E
}

/// The median of the logarithms of the largest axes.
fn median_log_scale(scene: &Scene) -> Option<f64> {
    let mut sizes: Vec<f32> = scene
        .log_scales
        .iter()
        .map(|l| l.iter().copied().fold(f32::NEG_INFINITY, f32::max))
        .collect();
    if sizes.is_empty() {
        return None;
    }
    let middle = sizes.len() / 2;
    Some(f64::from(*sizes.select_nth_unstable_by(middle, f32::total_cmp).1))
}

/// The outliers that make the octree too coarse for all others, and the cube without them; `None` if
/// there are none.
///
/// Where cells an eighth as wide as the median Gaussian lie deeper than an octree's 21 levels,
/// [`voxel::trim`] weighs what a smaller cube gives the inliers against the floats of the
/// outliers. Select [`Trimmed::inside`] for [`prepare`], and [`Trimmed::outliers`] for
/// [`encode_with`].
///
/// # Errors
/// [`Error::Voxel`] if a mean or the median log-scale is not finite.
pub fn split_outliers(scene: &Scene) -> Result<Option<Trimmed>> {
    let cube = Cube::of(&scene.means)?;
    let Some(median) = median_log_scale(scene) else { return Ok(None) };
    let cell = libm::exp(median) / CELLS_PER_AXIS;
    // Before that no trimmed cube pays. Most scenes end here.
    if depth_of(CELLS_PER_AXIS, median, &cube) <= f64::from(MAX_DEPTH) || cell <= 0.0 {
        return Ok(None);
    }
    let exact = 32.0 * layout::columns(scene.sh_degree) as f64;
    let weighed = Trim { bits_per_outlier: exact - BITS_AT_50, ..Trim::new(cell) };
    let trimmed = voxel::trim(&scene.means, &weighed)?;
    Ok((!trimmed.outliers.is_empty()).then_some(trimmed))
}

/// Side of the finest cells, in units of the median Gaussian's largest axis, if they are so coarse that positions
/// err visibly at any quality: where parts of a scene lie so far apart that an octree's 21 levels do not suffice.
/// Ask after [`split_outliers`]. The parts are better encoded apart.
///
/// # Errors
/// [`Error::Voxel`] if a mean is not finite.
pub fn coarse_cells(scene: &Scene) -> Result<Option<f64>> {
    let side = Cube::of(&scene.means)?.side;
    let Some(median) = median_log_scale(scene) else { return Ok(None) };
    let cells = side * libm::exp2(-f64::from(MAX_DEPTH)) / libm::exp(median);
    Ok((cells > COARSE).then_some(cells))
}

/// Leaves out the given fraction of the Gaussians, those of least importance, and returns the indices of
/// the others in ascending order. Among equals the later ones are left out first; an importance that is
/// not a positive number counts as 0.
///
/// # Errors
/// [`Error::Option`] if `fraction` is not from 0 to below 1.
pub fn prune(importance: &[f32], fraction: f64) -> Result<Vec<usize>> {
    if !(0.0..1.0).contains(&fraction) {
        return Err(Error::Option { option: "prune", value: fraction, range: "from 0 to below 1" });
    }
    let out = (fraction * importance.len() as f64) as usize;
    let clean = |i: usize| {
        let v = importance[i];
        if v.is_finite() { v.max(0.0) } else { 0.0 }
    };
    let mut order: Vec<usize> = (0..importance.len()).collect();
    order.sort_unstable_by(|&a, &b| clean(a).total_cmp(&clean(b)).then(b.cmp(&a)));
    let mut kept = order.split_off(out);
    kept.sort_unstable();
    Ok(kept)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pruning_leaves_out_the_least_important() {
        let importance = [3.0, 0.0, f32::NAN, 5.0, 1.0, 0.0];
        assert_eq!(prune(&importance, 0.0).unwrap(), [0, 1, 2, 3, 4, 5]);
        assert_eq!(prune(&importance, 0.34).unwrap(), [0, 1, 3, 4]);
        assert_eq!(prune(&importance, 0.5).unwrap(), [0, 3, 4]);
        assert_eq!(prune(&[], 0.5).unwrap(), Vec::<usize>::new());
        for fraction in [-0.1, 1.0, f64::NAN] {
            assert!(matches!(prune(&importance, fraction), Err(Error::Option { .. })));
        }
    }

    /// Two copies of a scene, a distance apart.
    fn pair(distance: f32) -> Scene {
        let one = testing::trained_like(2000, 0, &mut testing::Rng::seeded(5));
        let mut both = one.clone();
        both.append(&one);
        both.means[2000..].iter_mut().for_each(|p| p[0] += distance);
        both
    }

    #[test]
    fn two_parts_far_apart_got_coarse_without_a_word() {
        let median = libm::exp(median_log_scale(&pair(1.0)).unwrap());
        for (cells, wanted) in [(0.01, false), (0.15, false), (0.3, true), (3.0, true)] {
            let both = pair((cells * median * libm::exp2(21.0)) as f32);
            let told = coarse_cells(&both).unwrap();
            assert_eq!(told.is_some(), wanted, "{cells}");
            assert!(told.is_none_or(|t| (t / cells - 1.0).abs() < 0.1), "{told:?}, not {cells}");
        }
        assert_eq!(coarse_cells(&Scene::default()).unwrap(), None);
    }

    #[test]
    fn a_far_sky_took_depth_from_small_gaussians() {
        // The cube is so large that a cell at depth 18 is an eighth of the median Gaussian.
        let both = pair(0.0);
        let median = libm::exp(median_log_scale(&both).unwrap());
        let cube = Cube { origin: [0.0; 3], side: median / 8.0 * libm::exp2(18.0) };
        assert_eq!(needed_depth(&both, &cube), 21);
    }

    /// A cluster and one floater, far away.
    #[test]
    fn a_floater_does_not_coarsen_the_rest() {
        let mut scene = Scene {
            means: (0..64)
                .map(|i| [0.1 * (i % 4) as f32, 0.1 * (i / 4 % 4) as f32, 0.1 * (i / 16) as f32])
                .collect(),
            rotations: vec![[1.0, 0.0, 0.0, 0.0]; 64],
            log_scales: vec![[-4.0; 3]; 64],
            opacity_logits: vec![2.0; 64],
            sh_degree: 0,
            sh: vec![[0.3; 3]; 64],
        };
        scene.means[63] = [3000.0, 0.0, 0.0];
        let strategy = |importance: &[f32], seen| default_strategy(60.0, importance, seen);
        let prepared = prepare(&scene, strategy, None).unwrap();
        assert_eq!(prepared.voxels.len(), 64);
        for (i, &member) in prepared.voxels.members.iter().enumerate() {
            for k in 0..3 {
                let error = prepared.scene.means[i][k] - scene.means[member as usize][k];
                assert!(error.abs() < 0.0092, "{error}: half the size of a Gaussian");
            }
        }
    }
}
