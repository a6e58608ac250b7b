//! Voxelization tile by tile, so that a scene larger than memory, or one that many machines share, is voxelized as
//! one in memory is.
//!
//! Importances are guessed among the Gaussians of a tile, and no leaf reaches beyond one. A scene of at most
//! [`TILE`] Gaussians is one tile. What scales importances is summed over a sample of the tiles.
//!
//! Invariant: what becomes of a tile follows from its own Gaussians, the [`TileRules`] and the sums.

use crate::error::Result;
use crate::importance;
use crate::strategy::{Seen, rate_distortion};
use gpcc_lite::Cube;
use gs_model::Scene;
use rayon::prelude::*;
use std::borrow::Cow;
use std::convert::Infallible;
use std::ops::Range;
use voxel::{RateDistortion, Tiles, Voxelization, WeightSums, rate_distortion_of_tile};

/// Most Gaussians of a tile: enough for eight chunks.
pub(crate) const TILE: u64 = 1 << 18;
/// Tiles in the sample. Scenes of fewer are summed whole.
const SAMPLE: usize = 16;

/// The tiles of the sample, evenly spread over all.
pub(crate) fn sample(tiles: usize) -> Vec<usize> {
    let n = tiles.min(SAMPLE);
    (0..n).map(|i| (2 * i + 1) * tiles / (2 * n)).collect()
}

/// What decides the leaves of every tile.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TileRules {
    pub(crate) cube: Cube,
    /// Depth of the octree.
    pub(crate) depth: u8,
    pub(crate) quality: f32,
    pub(crate) seen: Seen,
}

/// A voxelized scene.
pub(crate) struct Tiled {
    pub(crate) voxels: Voxelization,
    /// Of each Gaussian.
    pub(crate) importance: Vec<f32>,
    /// `None` without tiles.
    pub(crate) shared: Option<Shared>,
}

/// What the tiles of a voxelized scene share.
pub(crate) struct Shared {
    /// The first leaf of each tile, and its codes.
    pub(crate) tiles: Vec<(usize, Range<u64>)>,
    /// Mean importance of leaves.
    pub(crate) mean_importance: f64,
}

impl TileRules {
    fn strategy(&self, importance: &[f32]) -> Result<RateDistortion> {
        let strategy = rate_distortion(self.quality, importance, self.seen)?;
        Ok(RateDistortion { j_high: self.depth, ..strategy })
    }

    /// What scales the weights of a tile.
    pub(crate) fn sums(&self, tile: &Scene, importance: &[f32]) -> Result<WeightSums> {
        Ok(WeightSums::of(tile, &self.strategy(importance)?)?)
    }

    /// The leaves of a tile, which has these codes.
    pub(crate) fn leaves(
        &self,
        tile: &Scene,
        importance: &[f32],
        codes: &Range<u64>,
        sums: WeightSums,
    ) -> Result<Voxelization> {
        let strategy = self.strategy(importance)?;
        Ok(rate_distortion_of_tile(tile, &self.cube, &strategy, codes, sums)?)
    }

    /// The leaves of a scene in memory.
    pub(crate) fn voxelize(&self, scene: &Scene, given: Option<Vec<f32>>) -> Result<Tiled> {
        let (tiles, members) = self.tiles(scene)?;
        let of_tile = |t: usize| part(scene, members.get(t));
        let sampled = sample(tiles.len());
        let mut importance = given.unwrap_or_default();
        if importance.is_empty() {
            let guess = |t| importance::without_cameras(&of_tile(t));
            let guessed: Vec<_> = (0..tiles.len()).into_par_iter().map(guess).collect();
            importance = scattered(guessed, &members, scene.len());
        }
        let of_members = |t: usize| match members.get(t) {
            Some(m) => Cow::Owned(m.iter().map(|&i| importance[i as usize]).collect()),
            None => Cow::Borrowed(&importance[..]),
        };
        let sums = sampled.par_iter().map(|&t| self.sums(&of_tile(t), &of_members(t)));
        let sums: Vec<Result<WeightSums>> = sums.collect();
        let mut sum = WeightSums::default();
        for of_one in sums {
            sum.add(&of_one?);
        }
        let leaves = |t: usize| self.leaves(&of_tile(t), &of_members(t), &tiles.codes(t), sum);
        let mut voxelized: Vec<_> = (0..tiles.len()).into_par_iter().map(leaves).collect();
        if members.is_empty() {
            let voxels = voxelized.remove(0)?;
            let mean_importance = Mean::of(&voxels.sums(&importance)).value();
            let shared = Shared { tiles: vec![(0, tiles.codes(0))], mean_importance };
            return Ok(Tiled { voxels, importance, shared: Some(shared) });
        }
        let mut voxels = Voxelization::empty(self.cube, self.depth)?;
        let (mut cuts, mut mean) = (Vec::new(), Mean::default());
        for (t, tile) in voxelized.into_iter().enumerate() {
            let tile = tile?;
            if sampled.contains(&t) {
                mean.add(&Mean::of(&tile.sums(&of_members(t))));
            }
            cuts.push((voxels.len(), tiles.codes(t)));
            voxels.append(&tile, &members[t])?;
        }
        let shared = Shared { tiles: cuts, mean_importance: mean.value() };
        Ok(Tiled { voxels, importance, shared: Some(shared) })
    }

    /// The tiles, and their Gaussians in ascending order; none of these for one tile.
    fn tiles(&self, scene: &Scene) -> Result<(Tiles, Vec<Vec<u32>>)> {
        if scene.len() as u64 <= TILE {
            return Ok((Tiles::one(scene.len() as u64), Vec::new()));
        }
        let codes = voxel::morton_codes(&scene.means, &self.cube, self.depth)?;
        let visit = |take: &mut dyn FnMut(&[u64])| {
            take(&codes);
            Ok::<(), Infallible>(())
        };
        let Ok(tiles) = Tiles::cut(self.depth, TILE, visit);
        let mut members: Vec<Vec<u32>> =
            tiles.counts().iter().map(|&n| Vec::with_capacity(n as usize)).collect();
        (0..).zip(&codes).for_each(|(i, &code)| members[tiles.of(code)].push(i));
        Ok((tiles, members))
    }
}

/// What voxelization needs of some Gaussians: all but SH coefficients above DC.
fn part<'a>(scene: &'a Scene, members: Option<&Vec<u32>>) -> Cow<'a, Scene> {
    let Some(members) = members else { return Cow::Borrowed(scene) };
    let of = || members.iter().map(|&i| i as usize);
    let sh_len = scene.sh_len();
    Cow::Owned(Scene {
        means: of().map(|i| scene.means[i]).collect(),
        rotations: of().map(|i| scene.rotations[i]).collect(),
        log_scales: of().map(|i| scene.log_scales[i]).collect(),
        opacity_logits: of().map(|i| scene.opacity_logits[i]).collect(),
        sh_degree: 0,
        sh: of().map(|i| scene.sh[i * sh_len]).collect(),
    })
}

/// Values of the Gaussians of tiles, in the order of the scene.
fn scattered(of_tiles: Vec<Vec<f32>>, members: &[Vec<u32>], len: usize) -> Vec<f32> {
    if members.is_empty() {
        return of_tiles.concat();
    }
    let mut all = vec![0.0; len];
    for (values, members) in of_tiles.iter().zip(members) {
        members.iter().zip(values).for_each(|(&i, &value)| all[i as usize] = value);
    }
    all
}

/// A mean that grows.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Mean {
    sum: f64,
    count: u64,
}

impl Mean {
    /// Of the importances of leaves.
    pub(crate) fn of(importance: &[f32]) -> Self {
        Self { sum: importance::sum(importance), count: importance.len() as u64 }
    }

    pub(crate) fn add(&mut self, other: &Self) {
        self.sum += other.sum;
        self.count += other.count;
    }

    pub(crate) fn value(&self) -> f64 {
        self.sum / self.count.max(1) as f64
    }
}
