//! Voxelization tile by tile, so that a scene larger than memory, or one that many machines share, is voxelized as
//! one in memory is.
//!
//! Importances are guessed among the Gaussians of a tile, and no leaf reaches beyond one. A scene of at most
//! [`TILE`] Gaussians is one tile. What scales importances is summed over a sample of the tiles.
//!
//! Invariant: what becomes of a tile follows from its own Gaussians, the [`TileRules`] and the sums.

use super::options::{ImportanceFrom, Leaves};
use super::strategy::rate_distortion;
use crate::error::Result;
use crate::importance;
use gpcc_lite::Cube;
use gs_model::Scene;
use rayon::prelude::*;
use std::borrow::Cow;
use std::convert::Infallible;
use std::ops::Range;
use voxel::{RateDistortion, Strategy, Tiles, Voxelization, WeightSums, voxelize_tile};

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
    pub(crate) from: ImportanceFrom,
    pub(crate) leaves: Leaves,
}

/// A voxelized scene.
pub(crate) struct TiledLeaves {
    pub(crate) voxels: Voxelization,
    /// Of each Gaussian.
    pub(crate) importance: Vec<f32>,
    /// `None` without tiles.
    pub(crate) shared: Option<TileRun>,
}

/// What the tiles of a voxelized scene share.
pub(crate) struct TileRun {
    /// The first leaf of each tile, and its codes.
    pub(crate) tiles: Vec<(usize, Range<u64>)>,
    /// Mean importance of leaves.
    pub(crate) mean_importance: f64,
}

impl TileRules {
    fn strategy(&self, importance: &[f32]) -> Result<RateDistortion> {
        let strategy = rate_distortion(self.quality, importance, self.from)?;
        Ok(RateDistortion { j_high: self.depth, ..strategy })
    }

    /// What scales the weights of a tile.
    pub(crate) fn sums(&self, tile: &Scene, importance: &[f32]) -> Result<WeightSums> {
        Ok(WeightSums::of(tile, &self.strategy(importance)?)?)
    }

    /// The leaves of a tile, which has these codes. Without `sums`, those of the tile itself scale its weights.
    pub(crate) fn leaves(
        &self,
        tile: &Scene,
        importance: &[f32],
        codes: &Range<u64>,
        sums: Option<WeightSums>,
    ) -> Result<Voxelization> {
        let strategy = match self.leaves {
            Leaves::RateDistortion => Strategy::RateDistortion(self.strategy(importance)?),
            Leaves::Uniform { depth } => Strategy::Uniform { depth },
            Leaves::Paper { j_low, j_high } => Strategy::paper(j_low, j_high),
        };
        Ok(voxelize_tile(tile, &self.cube, &strategy, codes, sums)?)
    }

    /// Whether a scene is never cut: the paper's strategies do not know tiles.
    fn whole(&self) -> bool {
        self.leaves != Leaves::RateDistortion
    }
}

/// The leaves of a scene in memory.
pub(crate) fn voxelize(
    scene: &Scene,
    given: Option<Vec<f32>>,
    rules: &TileRules,
) -> Result<TiledLeaves> {
    let cut = TiledScene::new(scene, rules)?;
    let importance = given.unwrap_or_else(|| cut.guessed());
    cut.voxelize(importance, rules)
}

/// A scene in memory, cut into tiles.
struct TiledScene<'a> {
    scene: &'a Scene,
    tiles: Tiles,
    /// The Gaussians of each tile, ascending; empty if there is one tile.
    members: Vec<Vec<u32>>,
}

impl<'a> TiledScene<'a> {
    fn new(scene: &'a Scene, rules: &TileRules) -> Result<Self> {
        let gaussians = scene.len() as u64;
        if rules.whole() || gaussians <= TILE {
            return Ok(Self { scene, tiles: Tiles::one(gaussians), members: Vec::new() });
        }
        let codes = voxel::morton_codes(&scene.means, &rules.cube, rules.depth)?;
        let visit = |take: &mut dyn FnMut(&[u64])| {
            take(&codes);
            Ok::<(), Infallible>(())
        };
        let Ok(tiles) = Tiles::cut(rules.depth, TILE, visit);
        let mut members: Vec<Vec<u32>> =
            tiles.counts().iter().map(|&n| Vec::with_capacity(n as usize)).collect();
        (0..).zip(&codes).for_each(|(i, &code)| members[tiles.of(code)].push(i));
        Ok(Self { scene, tiles, members })
    }

    /// What voxelization needs of the Gaussians of a tile: all but SH coefficients above DC.
    fn part(&self, tile: usize) -> Cow<'a, Scene> {
        let scene = self.scene;
        let Some(members) = self.members.get(tile) else { return Cow::Borrowed(scene) };
        let of = || members.iter().map(|&i| i as usize);
        let sh_len = scene.sh_len();
        Cow::Owned(Scene {
            means: of().map(|i| scene.means[i]).collect(),
            rotations: of().map(|i| scene.rotations[i]).collect(),
            log_scales: of().map(|i| scene.log_scales[i]).collect(),
            opacity_logits: of().map(|i| scene.opacity_logits[i]).collect(),
            sh: of().map(|i| scene.sh[i * sh_len]).collect(),
            ..scene.emptied(0)
        })
    }

    /// The values of the Gaussians of a tile.
    fn values<'v>(&self, tile: usize, values: &'v [f32]) -> Cow<'v, [f32]> {
        match self.members.get(tile) {
            Some(members) => members.iter().map(|&i| values[i as usize]).collect(),
            None => Cow::Borrowed(values),
        }
    }

    /// Importances without cameras.
    fn guessed(&self) -> Vec<f32> {
        let guess = |tile| importance::without_cameras(&self.part(tile));
        let mut of_tiles: Vec<_> = (0..self.tiles.len()).into_par_iter().map(guess).collect();
        if self.members.is_empty() {
            return of_tiles.pop().unwrap_or_default();
        }
        let mut all = vec![0.0; self.scene.len()];
        for (values, members) in of_tiles.iter().zip(&self.members) {
            members.iter().zip(values).for_each(|(&i, &value)| all[i as usize] = value);
        }
        all
    }

    /// The leaves of all tiles.
    fn voxelize(&self, importance: Vec<f32>, rules: &TileRules) -> Result<TiledLeaves> {
        let sampled = if rules.whole() { Vec::new() } else { sample(self.tiles.len()) };
        let sums = |&t: &usize| rules.sums(&self.part(t), &self.values(t, &importance));
        let sums: Vec<Result<WeightSums>> = sampled.par_iter().map(sums).collect();
        let mut sum = None;
        for of_one in sums {
            sum.get_or_insert_with(WeightSums::default).add(&of_one?);
        }
        let leaves = |t: usize| {
            let values = self.values(t, &importance);
            rules.leaves(&self.part(t), &values, &self.tiles.codes(t), sum)
        };
        let mut voxelized: Vec<_> = (0..self.tiles.len()).into_par_iter().map(leaves).collect();
        if self.members.is_empty() {
            let voxels = voxelized.remove(0)?;
            let mean_importance = Mean::of(&voxels.sums(&importance)).value();
            let shared = TileRun { tiles: vec![(0, self.tiles.codes(0))], mean_importance };
            return Ok(TiledLeaves { voxels, importance, shared: sum.map(|_| shared) });
        }
        let mut voxels = Voxelization::empty(rules.cube, rules.depth)?;
        let (mut tiles, mut mean) = (Vec::new(), Mean::default());
        for (t, tile) in voxelized.into_iter().enumerate() {
            let tile = tile?;
            if sampled.contains(&t) {
                mean.add(&Mean::of(&tile.sums(&self.values(t, &importance))));
            }
            tiles.push((voxels.len(), self.tiles.codes(t)));
            voxels.append(&tile, &self.members[t])?;
        }
        let shared = TileRun { tiles, mean_importance: mean.value() };
        Ok(TiledLeaves { voxels, importance, shared: Some(shared) })
    }
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
