//! [`Plan`]: all that the tiles of a scene must know of the whole. With it each tile is encoded alone, anywhere, and
//! [`crate::join`] makes the stream that [`crate::encode`] makes of the scene in memory, byte for byte.
//!
//! A plan is made in three passes over the Gaussians: a [`Survey`], then [`Plan::new`] counts Morton codes,
//! then [`Plan::measure`] looks at a sample of the tiles.

use super::Aim;
use super::check::check_length;
use super::encode::{CodingChoice, encode_source};
use super::encoded::{CoarseCells, EncodedStream};
use super::lod;
use super::options::{CodeOptions, EncodeOptions, ImportanceFrom, Leaves};
use super::outliers::suffices;
use super::source::{GaussianSource, Whole};
use super::strategy::j_high;
use super::survey::Survey;
use super::tiled::{Mean, TILE, TileRules, sample};
use super::warning::EncodeWarning;
use crate::error::{Error, Result};
use crate::head::Steps;
use crate::importance::{self, UnseenUnit};
use gpcc_lite::Cube;
use gs_model::Scene;
use serde::{Deserialize, Serialize};
use std::ops::Range;
use voxel::{Importance, Tiles, WeightSums};

/// What the caller of [`Plan::new`] chooses.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Choices {
    /// From 0 (smallest) to 100 (best).
    pub quality: f32,
    /// Where importances come from.
    pub importance: ImportanceFrom,
    /// How leaves are coded.
    pub code: CodeOptions,
}

impl Choices {
    /// The choices of an aim. `by_cameras` tells whether importances will come from cameras.
    ///
    /// # Errors
    /// [`Error::NotAtScale`] names what needs the whole scene in memory.
    pub fn of(aim: Aim, options: &EncodeOptions, by_cameras: bool) -> Result<Self> {
        let EncodeOptions { prepare, code } = *options;
        let option = match aim {
            Aim::Bytes(_) => "a target size",
            Aim::Alike { .. } => "a target PSNR or SSIMULACRA2",
            Aim::MaxError(_) => "a bound on the errors",
            Aim::Lossless => "lossless coding",
            Aim::Quality(_) if prepare.prune > 0.0 => "pruning",
            Aim::Quality(_) if prepare.leaves != Leaves::RateDistortion => "another voxelization",
            Aim::Quality(quality) => {
                let importance = ImportanceFrom::of(by_cameras, prepare.drop_unseen);
                return Ok(Self { quality, importance, code });
            }
        };
        Err(Error::NotAtScale { option })
    }
}

/// What the tiles of a scene must know of the whole.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Plan {
    choices: Choices,
    count: u64,
    sh_degree: u8,
    antialiased: bool,
    origin: [f64; 3],
    /// Of the cube.
    corner: [f64; 3],
    side: f64,
    depth: u8,
    coarse_cells: Option<CoarseCells>,
    /// First Morton codes of the tiles, at `depth`, and their Gaussians.
    tile_starts: Vec<u64>,
    tile_counts: Vec<u64>,
    /// Of the sample: sums that scale weights, and the mean importance of leaves.
    sample_count: u64,
    sample_importance: f64,
    sample_geometry: f64,
    mean_importance: f64,
    unseen: UnseenUnit,
}

impl Plan {
    /// A plan that lacks what the sample says. `visit` hands over the means of all Gaussians, in any order and in
    /// pieces of any size; it is called once for every four levels of the octree.
    ///
    /// # Errors
    /// [`Error::TooWide`]; [`Error::Option`] for choices out of range; those of `visit`.
    pub fn new<E: From<Error>>(
        survey: &Survey,
        choices: Choices,
        mut visit: impl FnMut(&mut dyn FnMut(&[[f32; 3]])) -> std::result::Result<(), E>,
    ) -> std::result::Result<Self, E> {
        Steps::of_quality(choices.quality)?;
        let (cube, median) = (survey.cube(), survey.median_log_scale());
        if median.is_some_and(|m| !suffices(m, &cube)) {
            return Err(Error::TooWide { side: cube.side }.into());
        }
        let depth = j_high(median, &cube);
        let tiles = if survey.count() <= TILE {
            Tiles::one(survey.count())
        } else {
            Tiles::cut(depth, TILE, |take| {
                let mut failed = None;
                visit(&mut |means| match voxel::morton_codes(means, &cube, depth) {
                    Ok(codes) => take(&codes),
                    Err(e) => failed = Some(Error::from(e)),
                })?;
                failed.map_or(Ok(()), |e| Err(E::from(e)))
            })?
        };
        Ok(Self {
            choices,
            count: survey.count(),
            sh_degree: survey.sh_degree(),
            antialiased: survey.antialiased,
            origin: survey.origin,
            corner: cube.origin,
            side: cube.side,
            depth,
            coarse_cells: survey.coarse_cells(),
            tile_starts: tiles.starts().to_vec(),
            tile_counts: tiles.counts().to_vec(),
            sample_count: 0,
            sample_importance: 0.0,
            sample_geometry: 0.0,
            mean_importance: 0.0,
            unseen: UnseenUnit::default(),
        })
    }

    /// Tiles whose Gaussians stand for all, ascending.
    #[must_use]
    pub fn sample(&self) -> Vec<usize> {
        sample(self.tile_starts.len())
    }

    /// Finishes the plan. `scene` gives the Gaussians of a tile of [`Plan::sample`], in the order of the input; it is
    /// called two or three times for each. `seen` gives their visibility, the sums of squared
    /// blending weights over cameras; it is called once for each, unless importances are guessed. SH coefficients above DC do not matter.
    ///
    /// # Errors
    /// Those of `scene` and `seen`; [`Error::Length`] if a tile has another number of Gaussians than were
    /// counted, or `seen` gives another number.
    pub fn measure<E: From<Error>>(
        &mut self,
        mut scene: impl FnMut(usize) -> std::result::Result<Scene, E>,
        mut seen: impl FnMut(&Scene) -> std::result::Result<Vec<f32>, E>,
    ) -> std::result::Result<(), E> {
        let rules = self.rules();
        let mut sums = WeightSums::default();
        let sample = self.sample();
        let mut weights = vec![Vec::new(); sample.len()];
        if self.choices.importance != ImportanceFrom::Guess {
            for (&tile, weights) in sample.iter().zip(&mut weights) {
                let scene = scene(tile)?;
                *weights = seen(&scene)?;
                self.unseen.add(weights, &importance::without_cameras(&scene));
            }
        }
        let mut importances = Vec::new();
        for (&tile, seen) in sample.iter().zip(weights) {
            let scene = scene(tile)?;
            self.check(tile, &scene)?;
            let importance = self.importance(&scene, &seen)?;
            sums.add(&rules.sums(&scene, &importance)?);
            importances.push(importance);
        }
        self.sample_count = sums.count;
        self.sample_importance = sums.importance;
        self.sample_geometry = sums.geometry;
        let mut mean = Mean::default();
        for (tile, importance) in sample.into_iter().zip(importances) {
            let voxels = rules.leaves(&scene(tile)?, &importance, &self.codes(tile), Some(sums))?;
            mean.add(&Mean::of(&voxels.sums(&importance)));
        }
        self.mean_importance = mean.value();
        Ok(())
    }

    /// Guesses importances from now on, whatever cameras see. [`Plan::measure`] must follow.
    pub fn forget_cameras(&mut self) {
        (self.choices.importance, self.unseen) = (ImportanceFrom::Guess, UnseenUnit::default());
    }

    /// The choices that it was made for.
    #[must_use]
    pub fn choices(&self) -> Choices {
        self.choices
    }

    /// Encodes a tile from its Gaussians, in the order of the input, and from what cameras see of them: a stream of its
    /// own, for [`crate::join`]. `seen` is empty if importances are guessed.
    ///
    /// # Errors
    /// [`Error::Length`] if these are not the Gaussians of the tile, or `seen` has another number; otherwise
    /// as [`crate::encode`].
    pub fn encode(&self, tile: usize, scene: &Scene, seen: &[f32]) -> Result<EncodedStream> {
        self.check(tile, scene)?;
        self.encode_range(&self.codes(tile), scene, seen)
    }

    /// Importances of some Gaussians.
    fn importance(&self, scene: &Scene, seen: &[f32]) -> Result<Vec<f32>> {
        if self.choices.importance != ImportanceFrom::Guess {
            check_length("importances", seen.len(), scene.len())?;
        }
        Ok(match self.choices.importance {
            ImportanceFrom::Guess => importance::without_cameras(scene),
            ImportanceFrom::Cameras => {
                let guess = importance::without_cameras(scene);
                self.unseen.fill(seen, &guess, self.choices.quality)
            }
            ImportanceFrom::CamerasAlone => seen.to_vec(),
        })
    }

    /// The stream of a part without tiles.
    ///
    /// # Errors
    /// As [`Plan::encode`].
    pub fn encode_nothing(&self) -> Result<EncodedStream> {
        self.encode_range(&(0..u64::MAX), &self.empty_scene(), &[])
    }

    fn encode_range(
        &self,
        codes: &Range<u64>,
        scene: &Scene,
        seen: &[f32],
    ) -> Result<EncodedStream> {
        let importance = self.importance(scene, seen)?;
        let sums = WeightSums {
            count: self.sample_count,
            importance: self.sample_importance,
            geometry: self.sample_geometry,
        };
        let voxels = self.rules().leaves(scene, &importance, codes, Some(sums))?;
        let Choices { quality, code, .. } = &self.choices;
        let several = self.tile_starts.len() > 1;
        let tile = [(0, codes.clone())];
        let whole = Whole {
            tiles: lod::LodTiles::new(&tile, several, self.count, code),
            mean_importance: self.mean_importance,
            sh_degree: Some(self.sh_degree),
        };
        let source = GaussianSource {
            scene,
            voxels: &voxels,
            weights: &Importance::Given(importance),
            merged: false,
            whole: Some(whole),
        };
        encode_source(&source, None, CodingChoice::new(&Steps::of_quality(*quality)?, code))
    }

    /// The tile of each Gaussian, from their means.
    ///
    /// # Errors
    /// [`Error::Voxel`] if a mean was not there when the plan was made.
    pub fn tiles_of(&self, means: &[[f32; 3]]) -> Result<Vec<u32>> {
        let codes = voxel::morton_codes(means, &self.rules().cube, self.depth)?;
        let tile = |code| self.tile_starts.partition_point(|&start| start <= code) as u32 - 1;
        Ok(codes.into_iter().map(tile).collect())
    }

    /// Gaussians.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.count
    }

    /// The Gaussians of each tile.
    #[must_use]
    pub fn tile_counts(&self) -> &[u64] {
        &self.tile_counts
    }

    /// The highest SH degree that is coded.
    #[must_use]
    pub fn sh_degree(&self) -> u8 {
        self.sh_degree
    }

    /// A scene without Gaussians that is antialiased if all are, and has their origin.
    #[must_use]
    pub fn empty_scene(&self) -> Scene {
        let &Self { sh_degree, antialiased, origin, .. } = self;
        Scene { sh_degree, antialiased, origin, ..Scene::default() }
    }

    /// What the user of the stream should know.
    #[must_use]
    pub fn warning(&self) -> Option<EncodeWarning> {
        self.coarse_cells.map(EncodeWarning::CoarseCells)
    }

    /// The tiles of part `k` of `n`, with `k` from 0: each part has about as many Gaussians, some may have none.
    #[must_use]
    pub fn part(&self, k: u64, n: u64) -> Range<usize> {
        let before = |sum: &mut u64, count: &u64| {
            *sum += count;
            Some(*sum - count)
        };
        let starts: Vec<u64> = self.tile_counts.iter().scan(0, before).collect();
        let first = |k: u64| {
            let wanted = (u128::from(self.count) * u128::from(k)).div_ceil(u128::from(n.max(1)));
            if k >= n { starts.len() } else { starts.partition_point(|&s| u128::from(s) < wanted) }
        };
        first(k)..first(k + 1)
    }

    fn rules(&self) -> TileRules {
        let cube = Cube { origin: self.corner, side: self.side };
        let Choices { quality, importance: from, .. } = self.choices;
        TileRules { cube, depth: self.depth, quality, from, leaves: Leaves::RateDistortion }
    }

    fn codes(&self, tile: usize) -> Range<u64> {
        let end = self.tile_starts.get(tile + 1).copied().unwrap_or(u64::MAX);
        self.tile_starts[tile]..end
    }

    fn check(&self, tile: usize, scene: &Scene) -> Result<()> {
        let wanted = self.tile_counts.get(tile).copied().unwrap_or_default() as usize;
        check_length("Gaussians of the tile", scene.len(), wanted)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::encoder::options::MaxError;

    #[test]
    fn a_plan_refuses_what_needs_the_whole_scene() {
        let bounds = MaxError::all(1.0);
        let mut options = EncodeOptions::default();
        for aim in [Aim::Bytes(1), Aim::Lossless, Aim::MaxError(bounds)] {
            let refused = Choices::of(aim, &options, false);
            assert!(matches!(refused, Err(Error::NotAtScale { .. })));
        }
        options.code.for_web();
        let choices = Choices::of(Aim::Quality(70.0), &options, true).unwrap();
        assert_eq!((choices.quality, choices.code), (70.0, options.code));
        assert_eq!(choices.importance, ImportanceFrom::Cameras);
        options.prepare.prune = 0.1;
        let refused = Choices::of(Aim::Quality(70.0), &options, true);
        assert!(matches!(refused, Err(Error::NotAtScale { option: "pruning" })));
    }

    #[test]
    fn parts_are_all_tiles_once() {
        let mut survey = Survey::new(0);
        survey.add(&testing::trained_like(50, 0, &mut testing::Rng::seeded(1)));
        let (importance, code) = (ImportanceFrom::Guess, CodeOptions::default());
        let choices = Choices { quality: 50.0, importance, code };
        let mut plan = Plan::new::<Error>(&survey, choices, |_| Ok(())).unwrap();
        plan.tile_counts = vec![5, 10, 3, 12, 20];
        for n in 1..9 {
            let mut next = 0;
            for k in 0..n {
                let part = plan.part(k, n);
                assert_eq!(part.start, next);
                next = part.end;
            }
            assert_eq!(next, 5);
        }
        assert_eq!(plan.part(1, 2), 4..5);
    }
}
