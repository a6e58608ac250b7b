//! From a trained model to a stream: outliers, voxelization, merging, coding.

use crate::bounded;
use crate::encode::{CoarseCells, Encoded, LEFT_OUT, Source, Whole, check_lengths, encode_source};
use crate::error::{Error, Result};
use crate::importance;
use crate::lod;
use crate::lossless::layout;
use crate::options::{EncodeOptions, Leaves};
use crate::survey::Survey;
use crate::tiled::{Octree, Tiled};
use gpcc_lite::morton::MAX_DEPTH;
use gs_model::Scene;
use std::borrow::Cow;
use std::ops::Range;
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
/// The same for the small Gaussians of a scene whose median one is large: a tenth of all are below one cell.
const COARSE_FOR_SMALL: f64 = 1.0;
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

/// Encodes a trained model, in three steps:
///
/// 1. It leaves out what [`EncodeOptions::prune`] says.
/// 2. It codes outliers bit for bit. These are Gaussians so far away that the octree of 21 levels would be too
///    coarse for all others. Most scenes have none.
/// 3. It voxelizes, merges and codes all others as the quality asks. With [`EncodeOptions::max_error`] it merges
///    nothing.
///
/// # Errors
/// [`Error::Voxel`] for what voxelization refuses, [`Error::CountMismatch`] if the importances in
/// `options` are not one per Gaussian, [`Error::Option`] for options out of range,
/// [`Error::NonFinite`] and [`Error::TooLarge`] for values that lossy coding cannot hold.
pub fn encode(scene: &Scene, options: &EncodeOptions) -> Result<Encoded> {
    let mut input = Input::new(scene, options)?;
    input.prune(options.prune)?;
    let encoded = match &options.max_error {
        Some(bounds) => bounded::encode(&input.scene, bounds, options)?,
        None => encode_leaves(&mut input, options)?,
    };
    let rows = encoded.rows.map(|rows| input.rows(&rows, scene.len()));
    Ok(Encoded { pruned: scene.len() - input.count, rows, ..encoded })
}

/// Outliers, voxelization and coding.
fn encode_leaves(input: &mut Input<'_>, options: &EncodeOptions) -> Result<Encoded> {
    let split = input.split()?;
    let coarse_cells = coarse_cells(&input.scene)?;
    let Tiled { voxels, importance, shared } = input.voxelize(options)?;
    let weights = Importance::Given(importance);
    let whole = shared.as_ref().map(|shared| Whole {
        tiles: tiles_of(&shared.tiles, input.scene.len() as u64, options),
        mean_importance: shared.mean_importance,
        sh_degree: None,
    });
    let source = Source {
        scene: &input.scene,
        voxels: &voxels,
        members: &voxels.members,
        weights: &weights,
        merged: false,
        whole,
    };
    let outliers = split.as_ref().map(|s| &s.1);
    let encoded = Encoded { coarse_cells, ..encode_source(&source, outliers, options)? };
    let Some((trimmed, outliers)) = &split else { return Ok(encoded) };
    let leaves = encoded.index.header.count as usize - outliers.len();
    let rows = encoded.rows.as_ref().map(|rows| trimmed.rows(rows, leaves as u32));
    Ok(Encoded { rows, ..encoded })
}

/// The tiles of a scene of so many Gaussians.
pub(crate) fn tiles_of<'a>(
    tiles: &'a [(usize, Range<u64>)],
    gaussians: u64,
    options: &EncodeOptions,
) -> lod::Tiles<'a> {
    let several = tiles.len() > 1;
    lod::Tiles { tiles, coarse_levels: several.then(|| lod::coarse_levels(gaussians, options)) }
}

/// A voxelized scene with the importance of each leaf, for [`crate::encode_voxels`].
#[derive(Clone, Debug)]
pub struct Prepared {
    /// One Gaussian per leaf, at its centre.
    pub scene: Scene,
    /// The leaves, and their members among the Gaussians that were not left out before.
    pub voxels: Voxelization,
    /// Importance per leaf, for [`EncodeOptions::importance`].
    pub importance: Vec<f32>,
    /// Gaussians to be coded bit for bit; `None` if there are none.
    pub outliers: Option<Scene>,
}

/// Voxelizes and merges as [`encode`] does, for a caller that changes the merged Gaussians before they are
/// coded. [`EncodeOptions::max_error`] has no effect.
///
/// # Errors
/// As [`encode`].
pub fn prepare(scene: &Scene, options: &EncodeOptions) -> Result<Prepared> {
    let mut input = Input::new(scene, options)?;
    input.prune(options.prune)?;
    let split = input.split()?;
    let Tiled { voxels, importance: weights, .. } = input.voxelize(options)?;
    let importance = voxels.sums(&weights);
    let weights = Importance::Given(weights);
    let scene = voxel::Merging::new(&input.scene, &voxels, Merge::Moments, &weights)?.scene();
    Ok(Prepared { scene, voxels, importance, outliers: split.map(|s| s.1) })
}

/// What is encoded, with what belongs to each Gaussian.
struct Input<'a> {
    scene: Cow<'a, Scene>,
    importance: Option<Vec<f32>>,
    /// Where each Gaussian that [`Input::prune`] kept was; `None` if it kept all.
    kept: Option<Vec<usize>>,
    /// Gaussians that [`Input::prune`] kept.
    count: usize,
}

impl<'a> Input<'a> {
    fn new(scene: &'a Scene, options: &EncodeOptions) -> Result<Self> {
        check_lengths(scene)?;
        let count = scene.len();
        if let Some(given) = &options.importance
            && given.len() != count
        {
            return Err(Error::CountMismatch { scene: given.len(), leaves: count });
        }
        let importance = options.importance.as_ref().map(|given| match options.drop_unseen {
            true => given.clone(),
            false => importance::with_unseen(scene, given),
        });
        Ok(Self { scene: Cow::Borrowed(scene), importance, kept: None, count })
    }

    /// Keeps the Gaussians at `indices` only.
    fn select(&mut self, indices: &[usize]) {
        self.scene = Cow::Owned(self.scene.select(indices));
        if let Some(values) = &mut self.importance {
            *values = indices.iter().map(|&i| values[i]).collect();
        }
    }

    /// Leaves out the least important Gaussians.
    fn prune(&mut self, fraction: f64) -> Result<()> {
        if fraction == 0.0 {
            return Ok(());
        }
        let kept = match &self.importance {
            Some(importance) => prune(importance, fraction)?,
            None => prune(&importance::without_cameras(&self.scene), fraction)?,
        };
        self.select(&kept);
        self.count = kept.len();
        self.kept = Some(kept);
        Ok(())
    }

    /// Takes the outliers out, if there are any.
    fn split(&mut self) -> Result<Option<(Trimmed, Scene)>> {
        let Some(split) = split_outliers(&self.scene)? else { return Ok(None) };
        let outliers = self.scene.select(&split.outliers);
        self.select(&split.inside);
        Ok(Some((split, outliers)))
    }

    /// The leaves, and the importance of each Gaussian.
    fn voxelize(&mut self, options: &EncodeOptions) -> Result<Tiled> {
        let seen = match (&self.importance, options.drop_unseen) {
            (None, _) => Seen::Guessed,
            (Some(_), true) => Seen::ByCamerasOnly,
            (Some(_), false) => Seen::ByCameras,
        };
        let cube = Cube::of(&self.scene.means)?;
        let given = self.importance.take();
        let strategy = match options.leaves {
            Leaves::RateDistortion => {
                let survey = Survey::of(&self.scene);
                let j_high = j_high(survey.median_log_scale(), &cube);
                let octree = Octree { cube, j_high, quality: options.quality, seen };
                return octree.voxelize(&self.scene, given);
            }
            Leaves::Uniform { depth } => Strategy::Uniform { depth },
            Leaves::Paper { j_low, j_high } => Strategy::paper(j_low, j_high),
        };
        let voxels = voxel::voxelize(&self.scene, &cube, &strategy)?;
        let importance = given.unwrap_or_else(|| importance::without_cameras(&self.scene));
        Ok(Tiled { voxels, importance, shared: None })
    }

    /// The rows of all Gaussians, from those of the ones that were kept.
    fn rows(&self, rows: &[u32], len: usize) -> Vec<u32> {
        let Some(kept) = &self.kept else { return rows.to_vec() };
        let mut all = vec![LEFT_OUT; len];
        kept.iter().zip(rows).for_each(|(&i, &row)| all[i] = row);
        all
    }
}

/// Where importances come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
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
    rate_distortion(quality, importance, seen).map(Strategy::RateDistortion)
}

/// The parameters of [`default_strategy`].
pub(crate) fn rate_distortion(
    quality: f32,
    importance: &[f32],
    seen: Seen,
) -> Result<RateDistortion> {
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
    Ok(options)
}

/// The finest depth of leaves: at least that at which [`LEAVES_PER_AXIS`] cells fit along the median Gaussian's
/// largest axis.
pub(crate) fn j_high(median: Option<f64>, cube: &Cube) -> u8 {
    let needed = median.map_or(0.0, |m| depth_of(LEAVES_PER_AXIS, m, cube));
    J_HIGH.max(needed.ceil().clamp(0.0, f64::from(MAX_DEPTH)) as u8)
}

/// Depth at which this many cells fit along a largest axis, without a greatest depth and without rounding.
fn depth_of(cells: f64, log_scale: f64, cube: &Cube) -> f64 {
    libm::log2(cube.side * cells) - log_scale * std::f64::consts::LOG2_E
}

/// The outliers that make the octree too coarse for all others, and the cube without them; `None` if
/// there are none.
///
/// Where cells an eighth as wide as the median Gaussian lie deeper than an octree's 21 levels,
/// [`voxel::trim`] weighs what a smaller cube gives the inliers against the floats of the
/// outliers.
///
/// # Errors
/// [`Error::Voxel`] if a mean or the median log-scale is not finite.
pub(crate) fn split_outliers(scene: &Scene) -> Result<Option<Trimmed>> {
    let cube = Cube::of(&scene.means)?;
    let Some(median) = Survey::of(scene).median_log_scale() else { return Ok(None) };
    let cell = libm::exp(median) / CELLS_PER_AXIS;
    // Before that no trimmed cube pays. Most scenes end here.
    if suffices(median, &cube) || cell <= 0.0 {
        return Ok(None);
    }
    let exact = 32.0 * layout::columns(scene.sh_degree) as f64;
    let weighed = Trim { bits_per_outlier: exact - BITS_AT_50, ..Trim::new(cell) };
    let trimmed = voxel::trim(&scene.means, &weighed)?;
    Ok((!trimmed.outliers.is_empty()).then_some(trimmed))
}

/// Whether an octree's 21 levels suffice for all: no Gaussian is an outlier then.
pub(crate) fn suffices(median: f64, cube: &Cube) -> bool {
    depth_of(CELLS_PER_AXIS, median, cube) <= f64::from(MAX_DEPTH)
}

/// See [`Encoded::coarse_cells`]; of the Gaussians that are no outliers.
///
/// # Errors
/// [`Error::Voxel`] if a mean is not finite.
fn coarse_cells(scene: &Scene) -> Result<Option<CoarseCells>> {
    let cube = Cube::of(&scene.means)?;
    let typical = Survey::of(scene).median_log_scale().and_then(|median| coarse(median, &cube));
    if let Some(cells) = typical {
        return Ok(Some(CoarseCells { cells, of_small: false }));
    }
    let Some(small) = small_log_scale(scene) else { return Ok(None) };
    let cells = cube.side * libm::exp2(-f64::from(MAX_DEPTH)) / libm::exp(small);
    Ok((cells > COARSE_FOR_SMALL).then_some(CoarseCells { cells, of_small: true }))
}

/// The logarithm of the largest axis below which a tenth of the Gaussians are.
fn small_log_scale(scene: &Scene) -> Option<f64> {
    let largest = |l: &[f32; 3]| l.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    let mut sizes: Vec<f32> = scene.log_scales.iter().map(largest).collect();
    let tenth = sizes.len() / 10;
    (!sizes.is_empty()).then(|| f64::from(*sizes.select_nth_unstable_by(tenth, f32::total_cmp).1))
}

/// See [`Encoded::coarse_cells`].
pub(crate) fn coarse(median: f64, cube: &Cube) -> Option<f64> {
    let cells = cube.side * libm::exp2(-f64::from(MAX_DEPTH)) / libm::exp(median);
    (cells > COARSE).then_some(cells)
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
        let median = libm::exp(Survey::of(&pair(1.0)).median_log_scale().unwrap());
        for (cells, wanted) in [(0.01, false), (0.15, false), (0.3, true), (3.0, true)] {
            let both = pair((cells * median * libm::exp2(21.0)) as f32);
            let told = coarse_cells(&both).unwrap();
            assert_eq!(told.is_some(), wanted, "{cells}");
            let right = |t: CoarseCells| (t.cells / cells - 1.0).abs() < 0.1 && !t.of_small;
            assert!(told.is_none_or(right), "{told:?}, not {cells}");
        }
        assert_eq!(coarse_cells(&Scene::default()).unwrap(), None);
    }

    #[test]
    fn a_two_centimetre_part_of_a_large_scene_became_one_gaussian_without_a_word() {
        let mut both = pair(0.0);
        // The second half is as large as all others, the first a millionth of that.
        for i in 0..2000 {
            both.means[i] = both.means[i].map(|x| 1e-6 * x);
            both.log_scales[i] = both.log_scales[i].map(|l| l - 13.8);
        }
        both.append(&pair(0.0).select(&(0..100).collect::<Vec<_>>()));
        let told = coarse_cells(&both).unwrap().expect("a warning");
        assert!(told.of_small && told.cells > 1.0, "{told:?}");
    }

    #[test]
    fn a_far_sky_took_depth_from_small_gaussians() {
        // The cube is so large that a cell at depth 18 is an eighth of the median Gaussian.
        let both = pair(0.0);
        let median = Survey::of(&both).median_log_scale();
        let cube =
            Cube { origin: [0.0; 3], side: libm::exp(median.unwrap()) / 8.0 * libm::exp2(18.0) };
        assert_eq!(j_high(median, &cube), 21);
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
        let prepared = prepare(&scene, &EncodeOptions::from_quality(60.0).unwrap()).unwrap();
        assert_eq!(prepared.voxels.len(), 64);
        for (i, &member) in prepared.voxels.members.iter().enumerate() {
            for k in 0..3 {
                let error = prepared.scene.means[i][k] - scene.means[member as usize][k];
                assert!(error.abs() < 0.0092, "{error}: half the size of a Gaussian");
            }
        }
    }
}
