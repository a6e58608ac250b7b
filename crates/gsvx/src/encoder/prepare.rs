//! From a trained model to a stream: outliers, voxelization, merging, coding.

use super::bounded;
use super::check::{about_input, check_length, check_lengths};
use super::encode::{CodingChoice, encode_source};
use super::encoded::{EncodedStream, LEFT_OUT};
use super::exact::all_exact;
use super::lod;
use super::options::{EncodeOptions, ImportanceFrom, MaxError, PrepareOptions};
use super::outliers::split_outliers;
use super::source::{GaussianSource, Whole};
use super::strategy::j_high;
use super::survey::Survey;
use super::tiled::{self, TileRules, TiledLeaves};
use crate::error::{Error, Result};
use crate::head::Steps;
use crate::importance;
use gs_model::Scene;
use std::borrow::Cow;
use voxel::{Importance, Merge, TrimOutcome, Voxelization};

/// Encodes a trained model at a quality from 0 (smallest) to 100 (best), in three steps:
///
/// 1. It leaves out what no rasterizer draws ([`gs_model::LEAST_DRAWN_LOGIT`]), and what
///    [`PrepareOptions::prune`] says.
/// 2. It codes outliers bit for bit. These are Gaussians so far away that the octree of 21 levels would be too
///    coarse for all others. Most scenes have none.
/// 3. It voxelizes, merges and codes all others as the quality asks.
///
/// `importance` is what each Gaussian shows to cameras, in any unit: see [`crate::importance`]. Without it
/// [`importance::without_cameras`] guesses.
///
/// # Errors
/// [`Error::Voxel`] for what voxelization refuses, [`Error::Length`] if the importances are not one per Gaussian,
/// [`Error::Option`] for options out of range, [`Error::NonFinite`], [`Error::ZeroRotation`] and
/// [`Error::TooLarge`] for values that lossy coding cannot hold. They count the Gaussians of `scene`.
pub fn encode(
    scene: &Scene,
    importance: Option<&[f32]>,
    quality: f32,
    options: &EncodeOptions,
) -> Result<EncodedStream> {
    encode_keeping(scene, importance, quality, options, false)
}

/// As [`encode`]; with `keep` it has [`EncodedStream::decoded`].
pub(super) fn encode_keeping(
    scene: &Scene,
    importance: Option<&[f32]>,
    quality: f32,
    options: &EncodeOptions,
    keep: bool,
) -> Result<EncodedStream> {
    let steps = Steps::of_quality(quality)?;
    let EncodeOptions { prepare, code } = options;
    let encode = || {
        let mut input = Input::lossy(scene, importance, quality, prepare)?;
        let kept = input.scene.len();
        let outliers = split_outliers(&input.scene, &input.survey)?;
        let coding = CodingChoice { keep, ..CodingChoice::new(&steps, code) };
        let encoded = encode_leaves(&mut input, outliers, (quality, prepare), coding)?;
        Ok(input.counted(encoded, scene.len(), kept))
    };
    encode().map_err(|error| about_input(error, scene, code.max_sh_degree))
}

/// Encodes a trained model with a bound on every error. Nothing is merged, and of the options [`PrepareOptions::prune`]
/// and those of the layout of the stream count.
///
/// # Errors
/// As [`encode`].
pub(crate) fn encode_within(
    scene: &Scene,
    importance: Option<&[f32]>,
    bounds: &MaxError,
    options: &EncodeOptions,
) -> Result<EncodedStream> {
    let EncodeOptions { prepare, code } = options;
    let encode = || {
        let mut input = Input::new(scene, importance)?;
        input.prune(prepare.prune)?;
        let outliers = split_outliers(&input.scene, &input.survey)?;
        let outliers = outliers.map_or(Vec::new(), |split| split.outliers);
        if input.scene.sh_degree > code.max_sh_degree {
            input.scene.to_mut().cut_sh(code.max_sh_degree);
        }
        let encoded = match bounded::encode(&input.scene, &outliers, bounds, code)? {
            Some(encoded) => encoded,
            None => EncodedStream {
                max_error: Some(MaxError::all(0.0)),
                ..all_exact(&input.scene, false)?
            },
        };
        Ok(input.counted(encoded, scene.len(), input.scene.len()))
    };
    encode().map_err(|error| about_input(error, scene, code.max_sh_degree))
}

/// Voxelization and coding.
fn encode_leaves(
    input: &mut Input<'_>,
    split: Option<TrimOutcome>,
    (quality, prepare): (f32, &PrepareOptions),
    coding: CodingChoice<'_>,
) -> Result<EncodedStream> {
    let outliers = input.take_out(split.as_ref())?;
    let leaves = input.voxelize(quality, prepare)?;
    let encoded = encode_tiled(&input.scene, leaves, outliers.as_ref(), coding)?.0;
    let leaves = encoded.index.header.count as u32;
    let rows = match &split {
        Some(split) => split.rows(&encoded.rows, leaves - split.outliers.len() as u32),
        None => encoded.rows,
    };
    Ok(EncodedStream { coarse_cells: input.survey.coarse_cells(), rows, ..encoded })
}

/// The stream of a voxelized scene, and its leaves and the importance of each Gaussian again.
pub(super) fn encode_tiled(
    scene: &Scene,
    leaves: TiledLeaves,
    outliers: Option<&Scene>,
    coding: CodingChoice<'_>,
) -> Result<(EncodedStream, Voxelization, Importance)> {
    let TiledLeaves { voxels, importance, shared } = leaves;
    let whole = shared.as_ref().map(|shared| Whole {
        tiles: lod::LodTiles::new(
            &shared.tiles,
            shared.tiles.len() > 1,
            scene.len() as u64,
            coding.options,
        ),
        mean_importance: shared.mean_importance,
        sh_degree: None,
    });
    let weights = Importance::Given(importance);
    let source = GaussianSource { scene, voxels: &voxels, weights: &weights, merged: false, whole };
    let encoded = encode_source(&source, outliers, coding)?;
    Ok((encoded, voxels, weights))
}

/// A scene without what is not coded as leaves, for a sequence.
pub(super) struct Inside {
    pub(super) scene: Scene,
    /// Where each of its Gaussians was.
    pub(super) rows: Vec<usize>,
    pub(super) leaves: TiledLeaves,
    pub(super) outliers: Option<Scene>,
    /// Natural logarithm of a typical Gaussian's largest axis.
    pub(super) log_size: f64,
}

/// Voxelizes as [`encode`] does.
pub(super) fn inside(
    scene: &Scene,
    importance: Option<&[f32]>,
    quality: f32,
    options: &PrepareOptions,
) -> Result<Inside> {
    let mut input = Input::lossy(scene, importance, quality, options)?;
    let split = split_outliers(&input.scene, &input.survey)?;
    let mut rows = input.kept.clone().unwrap_or_else(|| (0..scene.len()).collect());
    let outliers = input.take_out(split.as_ref())?;
    if let Some(split) = &split {
        rows = split.inside.iter().map(|&i| rows[i]).collect();
    }
    let leaves = input.voxelize(quality, options)?;
    let log_size = input.survey.median_log_scale().unwrap_or_default();
    Ok(Inside { scene: input.scene.into_owned(), rows, leaves, outliers, log_size })
}

/// A voxelized scene with the importance of each leaf, for [`crate::encode_voxels`].
#[derive(Clone, Debug)]
pub struct VoxelScene {
    /// One Gaussian per leaf, at its centre.
    pub scene: Scene,
    /// The leaves, and their members among the Gaussians that were not left out before.
    pub voxels: Voxelization,
    /// Importance of each leaf.
    pub importance: Vec<f32>,
    /// Gaussians to be coded bit for bit; `None` if there are none.
    pub outliers: Option<Scene>,
}

/// Voxelizes and merges as [`encode`] does, for a caller that changes the merged Gaussians before they are
/// coded.
///
/// # Errors
/// As [`encode`].
pub fn prepare(
    scene: &Scene,
    importance: Option<&[f32]>,
    quality: f32,
    options: &PrepareOptions,
) -> Result<VoxelScene> {
    let mut input = Input::lossy(scene, importance, quality, options)?;
    let split = split_outliers(&input.scene, &input.survey)?;
    let outliers = input.take_out(split.as_ref())?;
    let TiledLeaves { voxels, importance: weights, .. } = input.voxelize(quality, options)?;
    let importance = voxels.sums(&weights);
    let weights = Importance::Given(weights);
    let scene = voxel::Merging::new(&input.scene, &voxels, Merge::Moments, &weights)?.scene();
    Ok(VoxelScene { scene, voxels, importance, outliers })
}

/// What is encoded, with what belongs to each Gaussian.
pub(super) struct Input<'a> {
    pub(super) scene: Cow<'a, Scene>,
    pub(super) importance: Option<Vec<f32>>,
    /// Where each Gaussian was that was not left out; `None` if all are here.
    kept: Option<Vec<usize>>,
    /// Gaussians that no rasterizer draws.
    transparent: usize,
    pub(super) survey: Survey,
}

impl<'a> Input<'a> {
    fn new(scene: &'a Scene, importance: Option<&[f32]>) -> Result<Self> {
        check_lengths(scene)?;
        if let Some(given) = importance {
            check_length("importances", given.len(), scene.len())?;
        }
        let survey = Survey::of(scene)?;
        let (scene, importance) = (Cow::Borrowed(scene), importance.map(<[f32]>::to_vec));
        Ok(Self { scene, importance, kept: None, transparent: 0, survey })
    }

    /// A scene without what no rasterizer draws and without the least important Gaussians.
    pub(super) fn lossy(
        scene: &'a Scene,
        importance: Option<&[f32]>,
        quality: f32,
        options: &PrepareOptions,
    ) -> Result<Self> {
        let mut input = Self::new(scene, importance)?;
        if let Some(drawn) = input.scene.drawn() {
            input.transparent = input.scene.len() - drawn.len();
            input.keep(drawn)?;
        }
        if let Some(seen) = input.importance.as_mut().filter(|_| !options.drop_unseen) {
            *seen = importance::with_unseen(&input.scene, seen, quality);
        }
        input.prune(options.prune)?;
        Ok(input)
    }

    /// Leaves out a fraction of the Gaussians, those of least importance.
    fn prune(&mut self, fraction: f64) -> Result<()> {
        if fraction == 0.0 {
            return Ok(());
        }
        let kept = match &self.importance {
            Some(importance) => prune(importance, fraction)?,
            None => prune(&importance::without_cameras(&self.scene), fraction)?,
        };
        self.keep(kept)
    }

    /// Leaves out all Gaussians but those at `indices`.
    fn keep(&mut self, indices: Vec<usize>) -> Result<()> {
        self.select(&indices)?;
        self.kept = Some(match &self.kept {
            Some(before) => indices.iter().map(|&i| before[i]).collect(),
            None => indices,
        });
        Ok(())
    }

    /// Keeps the Gaussians at `indices` only.
    fn select(&mut self, indices: &[usize]) -> Result<()> {
        self.scene = Cow::Owned(self.scene.select(indices));
        self.survey = Survey::of(&self.scene)?;
        if let Some(values) = &mut self.importance {
            *values = indices.iter().map(|&i| values[i]).collect();
        }
        Ok(())
    }

    /// Takes the outliers out, if there are any.
    pub(super) fn take_out(&mut self, split: Option<&TrimOutcome>) -> Result<Option<Scene>> {
        let Some(split) = split else { return Ok(None) };
        let outliers = self.scene.select(&split.outliers);
        self.select(&split.inside)?;
        Ok(Some(outliers))
    }

    /// The leaves, and the importance of each Gaussian.
    fn voxelize(&mut self, quality: f32, options: &PrepareOptions) -> Result<TiledLeaves> {
        let from = ImportanceFrom::of(self.importance.is_some(), options.drop_unseen);
        let cube = self.survey.cube();
        let depth = j_high(self.survey.median_log_scale(), &cube);
        let rules = TileRules { cube, depth, quality, from, leaves: options.leaves };
        tiled::voxelize(&self.scene, self.importance.take(), &rules)
    }

    /// A stream with the counts and the rows of all Gaussians of the input, from those of the ones that were kept.
    fn counted(&self, mut encoded: EncodedStream, all: usize, kept: usize) -> EncodedStream {
        encoded.transparent = self.transparent;
        encoded.pruned = all - self.transparent - kept;
        if let Some(indices) = &self.kept {
            let rows = std::mem::replace(&mut encoded.rows, vec![LEFT_OUT; all]);
            indices.iter().zip(rows).for_each(|(&i, row)| encoded.rows[i] = row);
        }
        encoded
    }
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
            sh: vec![[0.3; 3]; 64],
            ..Scene::default()
        };
        scene.means[63] = [3000.0, 0.0, 0.0];
        let prepared = prepare(&scene, None, 60.0, &PrepareOptions::default()).unwrap();
        assert_eq!(prepared.voxels.len(), 64);
        for (i, &member) in prepared.voxels.members().iter().enumerate() {
            for k in 0..3 {
                let error = prepared.scene.means[i][k] - scene.means[member as usize][k];
                assert!(error.abs() < 0.0092, "{error}: half the size of a Gaussian");
            }
        }
    }
}
