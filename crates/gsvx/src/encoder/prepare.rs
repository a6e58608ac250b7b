//! From a trained model to a stream: outliers, voxelization, merging, coding.

use super::bounded;
use super::check::{about_input, check_length, check_lengths};
use super::encode::encode_source;
use super::encoded::{Encoded, LEFT_OUT};
use super::exact::all_exact;
use super::lod;
use super::options::{EncodeOptions, MaxError};
use super::outliers::split_outliers;
use super::source::{GaussianSource, Whole};
use super::strategy::j_high;
use super::survey::Survey;
use super::tiled::{self, TileRules, Tiled};
use crate::error::{Error, Result};
use crate::importance;
use gs_model::Scene;
use std::borrow::Cow;
use voxel::{Importance, Merge, Trimmed, Voxelization};

/// Encodes a trained model, in three steps:
///
/// 1. It leaves out what no rasterizer draws ([`gs_model::LEAST_DRAWN_LOGIT`]), unless errors are bounded, and what
///    [`EncodeOptions::prune`] says.
/// 2. It codes outliers bit for bit. These are Gaussians so far away that the octree of 21 levels would be too
///    coarse for all others. Most scenes have none.
/// 3. It voxelizes, merges and codes all others as the quality asks. With [`EncodeOptions::max_error`] it merges
///    nothing.
///
/// # Errors
/// [`Error::Voxel`] for what voxelization refuses, [`Error::Length`] if the importances in
/// `options` are not one per Gaussian, [`Error::Option`] for options out of range,
/// [`Error::NonFinite`], [`Error::ZeroRotation`] and [`Error::TooLarge`] for values that lossy coding cannot hold.
/// They count the Gaussians of `scene`.
pub fn encode(scene: &Scene, options: &EncodeOptions) -> Result<Encoded> {
    encode_input(scene, options).map_err(|error| about_input(error, scene, options.max_sh_degree))
}

fn encode_input(scene: &Scene, options: &EncodeOptions) -> Result<Encoded> {
    let mut input = Input::new(scene, options)?;
    let (transparent, count) = (input.transparent, input.scene.len());
    let outliers = split_outliers(&input.scene, &input.survey)?;
    let encoded = match &options.max_error {
        None => encode_leaves(&mut input, outliers, options)?,
        Some(bounds) => {
            if input.scene.sh_degree > options.max_sh_degree {
                input.scene.to_mut().cut_sh(options.max_sh_degree);
            }
            let outliers = outliers.map_or(Vec::new(), |split| split.outliers);
            let max_error = Some(MaxError { mean: 0.0, opacity: 0.0, shape: 0.0, sh: 0.0 });
            match bounded::encode(&input.scene, &outliers, bounds, options)? {
                Some(encoded) => encoded,
                None => Encoded { max_error, ..all_exact(&input.scene, false)? },
            }
        }
    };
    let rows = encoded.rows.map(|rows| input.rows(&rows, scene.len()));
    let pruned = scene.len() - transparent - count;
    Ok(Encoded { transparent, pruned, rows, ..encoded })
}

/// Voxelization and coding.
fn encode_leaves(
    input: &mut Input<'_>,
    split: Option<Trimmed>,
    options: &EncodeOptions,
) -> Result<Encoded> {
    let outliers = input.take_out(split.as_ref())?;
    let Tiled { voxels, importance, shared } = input.voxelize(options)?;
    let gaussians = input.scene.len() as u64;
    let whole = shared.as_ref().map(|shared| Whole {
        tiles: lod::LodTiles::new(&shared.tiles, shared.tiles.len() > 1, gaussians, options),
        mean_importance: shared.mean_importance,
        sh_degree: None,
    });
    let source = GaussianSource {
        scene: &input.scene,
        voxels: &voxels,
        weights: &Importance::Given(importance),
        merged: false,
        whole,
    };
    let encoded = encode_source(&source, outliers.as_ref(), options)?;
    let leaves = encoded.index.header.count as u32;
    let rows = match (&split, encoded.rows) {
        (Some(split), Some(rows)) => Some(split.rows(&rows, leaves - split.outliers.len() as u32)),
        (_, rows) => rows,
    };
    Ok(Encoded { coarse_cells: input.survey.coarse_cells(), rows, ..encoded })
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
    let split = split_outliers(&input.scene, &input.survey)?;
    let outliers = input.take_out(split.as_ref())?;
    let Tiled { voxels, importance: weights, .. } = input.voxelize(options)?;
    let importance = voxels.sums(&weights);
    let weights = Importance::Given(weights);
    let scene = voxel::Merging::new(&input.scene, &voxels, Merge::Moments, &weights)?.scene();
    Ok(Prepared { scene, voxels, importance, outliers })
}

/// What is encoded, with what belongs to each Gaussian.
struct Input<'a> {
    scene: Cow<'a, Scene>,
    importance: Option<Vec<f32>>,
    /// Where each Gaussian was that was not left out; `None` if all are here.
    kept: Option<Vec<usize>>,
    /// Gaussians that no rasterizer draws.
    transparent: usize,
    survey: Survey,
}

impl<'a> Input<'a> {
    /// A scene without what no rasterizer draws and without the least important Gaussians.
    fn new(scene: &'a Scene, options: &EncodeOptions) -> Result<Self> {
        check_lengths(scene)?;
        if let Some(given) = &options.importance {
            check_length("importances", given.len(), scene.len())?;
        }
        let survey = Survey::of(scene)?;
        let importance = options.importance.clone();
        let scene = Cow::Borrowed(scene);
        let mut input = Self { scene, importance, kept: None, transparent: 0, survey };
        let drawn = if options.max_error.is_none() { input.scene.drawn() } else { None };
        if let Some(drawn) = drawn {
            input.transparent = input.scene.len() - drawn.len();
            input.keep(drawn)?;
        }
        if let Some(seen) = input.importance.as_mut().filter(|_| !options.drop_unseen) {
            *seen = importance::with_unseen(&input.scene, seen, options.quality);
        }
        if options.prune != 0.0 {
            let kept = match &input.importance {
                Some(importance) => prune(importance, options.prune)?,
                None => prune(&importance::without_cameras(&input.scene), options.prune)?,
            };
            input.keep(kept)?;
        }
        Ok(input)
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
    fn take_out(&mut self, split: Option<&Trimmed>) -> Result<Option<Scene>> {
        let Some(split) = split else { return Ok(None) };
        let outliers = self.scene.select(&split.outliers);
        self.select(&split.inside)?;
        Ok(Some(outliers))
    }

    /// The leaves, and the importance of each Gaussian.
    fn voxelize(&mut self, options: &EncodeOptions) -> Result<Tiled> {
        let seen = options.seen(self.importance.is_some());
        let cube = self.survey.cube();
        let depth = j_high(self.survey.median_log_scale(), &cube);
        let &EncodeOptions { quality, leaves, .. } = options;
        let rules = TileRules { cube, depth, quality, seen, leaves };
        tiled::voxelize(&self.scene, self.importance.take(), &rules)
    }

    /// The rows of all Gaussians, from those of the ones that were kept.
    fn rows(&self, rows: &[u32], len: usize) -> Vec<u32> {
        let Some(kept) = &self.kept else { return rows.to_vec() };
        let mut all = vec![LEFT_OUT; len];
        kept.iter().zip(rows).for_each(|(&i, &row)| all[i] = row);
        all
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
        let prepared = prepare(&scene, &EncodeOptions::from_quality(60.0).unwrap()).unwrap();
        assert_eq!(prepared.voxels.len(), 64);
        for (i, &member) in prepared.voxels.members().iter().enumerate() {
            for k in 0..3 {
                let error = prepared.scene.means[i][k] - scene.means[member as usize][k];
                assert!(error.abs() < 0.0092, "{error}: half the size of a Gaussian");
            }
        }
    }
}
