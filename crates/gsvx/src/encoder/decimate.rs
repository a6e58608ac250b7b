//! [`decimate`]: a scene of fewer Gaussians, without coding.
//!
//! Cells of an octree separate neighbours that lie on both sides of a face. So there are several rounds, each with another
//! cube, and each merges what costs least. A round finds by search how much distortion a Gaussian must save.

use super::check::about_input;
use super::options::{ImportanceFrom, PrepareOptions};
use super::outliers::split_outliers;
use super::prepare::Input;
use super::strategy::rate_distortion;
use crate::error::{Error, Result};
use gpcc_lite::Cube;
use gpcc_lite::morton::MAX_DEPTH;
use gs_model::Scene;
use std::ops::Range;
use voxel::{CostModel, Importance, Merge, Merging, Place, RateDistortion, Strategy, Voxelization};

/// Rounds that halve a scene. On three models 8 rounds are 1.2 to 2.4 dB better than one; 16 are another 0.2 dB better.
const ROUNDS_PER_HALF: f64 = 8.0;
/// Some rules of the encoder depend on the quality. Here it is this one.
const QUALITY: f32 = 50.0;
/// The search of a round ends when one of its two octrees is off by at most this part of the Gaussians that the round
/// removes. Leaves of both then make up the number.
const SLACK: usize = 16;
/// Greatest exponent of the weight of a Gaussian.
const MOST_EXPONENT: f64 = 900.0;

/// Merges a scene to at most so many Gaussians, and as near to that as its leaves allow. A Gaussian that is not merged
/// stays as it is; their order changes. What no rasterizer draws is left out. A scene that has no more stays unchanged.
///
/// `importance` is as for [`crate::encode`]. With it, what shows least may be left out too.
///
/// # Errors
/// As [`crate::encode`]; [`Error::Option`] if `most` is 0.
pub fn decimate(scene: &Scene, importance: Option<&[f32]>, most: usize) -> Result<Scene> {
    if most == 0 {
        let (option, range) = ("number of Gaussians", "at least 1");
        return Err(Error::Option { option, value: 0.0, range });
    }
    if scene.len() <= most {
        return Ok(scene.clone());
    }
    merged(scene, importance, most).map_err(|error| about_input(error, scene, scene.sh_degree))
}

fn merged(scene: &Scene, importance: Option<&[f32]>, most: usize) -> Result<Scene> {
    let mut input = Input::lossy(scene, importance, QUALITY, &PrepareOptions::default())?;
    let split = split_outliers(&input.scene, &input.survey)?;
    let outliers = input.take_out(split.filter(|s| s.outliers.len() < most).as_ref())?;
    let most = most - outliers.as_ref().map_or(0, Scene::len);
    let from = ImportanceFrom::of(input.importance.is_some(), false);
    let guess = || crate::importance::without_cameras(&input.scene);
    let importance = input.importance.take().unwrap_or_else(guess);
    let mut left = WeightedScene { scene: input.scene.into_owned(), importance };
    let all = left.scene.len() as f64;
    let rounds = (ROUNDS_PER_HALF * libm::log2(all / most as f64)).ceil().max(1.0) as usize;
    let mut exponent = 0.0;
    for round in 1..=rounds {
        let share = libm::pow(most as f64 / all, round as f64 / rounds as f64);
        let target = if round == rounds { most } else { (all * share) as usize };
        if left.scene.len() > target {
            left = Round::new(&left, round, from)?.to(target.max(1), &mut exponent)?;
        }
    }
    outliers.iter().for_each(|outliers| left.scene.append(outliers));
    Ok(left.scene)
}

/// Gaussians, and the importance of each.
struct WeightedScene {
    scene: Scene,
    importance: Vec<f32>,
}

/// One round.
struct Round<'a> {
    of: &'a WeightedScene,
    cube: Cube,
    strategy: RateDistortion,
    weights: Importance,
}

impl<'a> Round<'a> {
    fn new(of: &'a WeightedScene, round: usize, from: ImportanceFrom) -> Result<Self> {
        let cube = voxel::cube_of(&of.scene.means)?;
        // Multiples of irrational numbers: no two rounds have common faces.
        let shift = [0.618_034, 0.754_878, 0.569_840].map(|x| (x * round as f64).fract());
        let origin = std::array::from_fn(|k| cube.origin[k] - shift[k] * cube.side);
        let (size_exponent, drop) = match from {
            ImportanceFrom::Guess => (1.25, None),
            _ => (1.0, Some(15.0)),
        };
        let strategy = RateDistortion {
            j_high: MAX_DEPTH,
            // Each Gaussian costs the same, wherever it is.
            cost: CostModel { gaussian: 1.0, occupancy: [0.0; 8], stop: 0.0, go_on: 0.0 },
            place: Place::MemberMean,
            size_exponent,
            drop,
            shape: 0.3,
            colour: 3.0,
            ..rate_distortion(QUALITY, &of.importance, from)?
        };
        let weights = Importance::Given(of.importance.clone());
        Ok(Self { of, cube: Cube { origin, side: 2.0 * cube.side }, strategy, weights })
    }

    /// Merges to at most so many. `exponent` is that of the weight of a Gaussian, as the last round found it.
    fn to(mut self, most: usize, exponent: &mut f64) -> Result<WeightedScene> {
        let (mut fine, mut coarse) = self.search(most, exponent)?;
        if coarse.is_empty() {
            // The last of them would be left out.
            self.strategy.drop = None;
            (fine, coarse) = self.search(most, exponent)?;
        }
        let (finer, coarser) = seam(&fine, &coarse, most);
        let mut left = self.merge(&fine, finer)?;
        let rest = self.merge(&coarse, coarser)?;
        left.scene.append(&rest.scene);
        left.importance.extend(rest.importance);
        Ok(left)
    }

    /// Leaves that are more than `most`, or none, and leaves that are not.
    fn search(&mut self, most: usize, exponent: &mut f64) -> Result<(Voxelization, Voxelization)> {
        let slack = (self.of.scene.len() - most) / SLACK;
        let (mut low, mut high) = (-MOST_EXPONENT, MOST_EXPONENT);
        let (mut fine, mut coarse) = (Voxelization::default(), Voxelization::default());
        let mut step = 1.0;
        let mut at = *exponent;
        while high - low > 1e-9 && high > -MOST_EXPONENT && low < MOST_EXPONENT {
            self.strategy.lambda = libm::exp2(at);
            let strategy = Strategy::RateDistortion(self.strategy.clone());
            let leaves = voxel::voxelize(&self.of.scene, &self.cube, &strategy)?;
            if leaves.len() > most {
                (low, fine) = (at, leaves);
            } else {
                (high, coarse) = (at, leaves);
            }
            let between = low > -MOST_EXPONENT && high < MOST_EXPONENT;
            if between && (fine.len() - most).min(most - coarse.len()) <= slack {
                break;
            }
            at = if between {
                let [few, wanted, many] =
                    [coarse.len(), most, fine.len()].map(|n| libm::log(n.max(1) as f64));
                low + (high - low) * ((many - wanted) / (many - few)).clamp(0.1, 0.9)
            } else {
                step *= 2.0;
                let next = if low > -MOST_EXPONENT { at + step } else { at - step };
                next.clamp(-MOST_EXPONENT, MOST_EXPONENT)
            };
        }
        *exponent = at;
        Ok((fine, coarse))
    }

    /// One Gaussian for each of some leaves.
    fn merge(&self, leaves: &Voxelization, some: Range<usize>) -> Result<WeightedScene> {
        let first: Vec<u32> = (some.start as u32..=some.end as u32).collect();
        let leaves = match leaves.is_empty() {
            true => Voxelization::default(),
            false => leaves.regrouped(leaves.octree().part(some), &first),
        };
        let merging = Merging::new(&self.of.scene, &leaves, Merge::Moments, &self.weights)?;
        let importance = leaves.sums(&self.of.importance);
        Ok(WeightedScene { scene: merging.at(Place::MemberMean).scene(), importance })
    }
}

/// Where coarse leaves can follow fine ones in Morton order, so that there are at most `most`, and as many as possible.
/// Best prunings nest: a coarse leaf holds whole fine ones.
fn seam(fine: &Voxelization, coarse: &Voxelization, most: usize) -> (Range<usize>, Range<usize>) {
    let (depth, ends) = (fine.octree().depth(), coarse.len());
    let (fine, coarse) = (fine.octree().leaves(), coarse.octree().leaves());
    let fits = |&from: &usize| {
        let start = coarse[from].morton;
        let before = fine.partition_point(|leaf| leaf.morton < start);
        let last = before.checked_sub(1).map(|i| fine[i]);
        let end = last.map_or(0, |leaf| leaf.morton + (1 << (3 * (depth - leaf.depth))));
        (before + ends - from <= most && end <= start).then_some((0..before, from..ends))
    };
    (0..ends).rev().find_map(|from| fits(&from)).unwrap_or((0..0, 0..ends))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scene(n: usize) -> Scene {
        testing::trained_like(n, 1, &mut testing::Rng::seeded(7))
    }

    #[test]
    fn a_scene_gets_the_number_that_is_asked_for() {
        let scene = scene(3000);
        let importance: Vec<f32> = (0..3000).map(|i| (i % 7) as f32).collect();
        for most in [1, 2, 17, 1000, 2900, 2999] {
            for importance in [None, Some(&importance[..])] {
                let made = decimate(&scene, importance, most).unwrap();
                let least = most - most / 50 - usize::from(most > 1);
                assert!((least.max(1)..=most).contains(&made.len()), "{most}: {}", made.len());
                assert_eq!(made.sh_degree, 1);
            }
        }
        assert_eq!(decimate(&scene, None, 3000).unwrap(), scene);
        assert!(matches!(decimate(&scene, None, 0), Err(Error::Option { .. })));
    }

    #[test]
    fn a_gaussian_that_is_not_merged_keeps_its_place() {
        let scene = scene(500);
        let made = decimate(&scene, None, 480).unwrap();
        let kept = made.means.iter().filter(|mean| scene.means.contains(mean)).count();
        assert!(kept >= 440, "{kept}");
    }

    #[test]
    fn a_grid_of_equal_gaussians_does_not_fall_to_an_eighth() {
        let n = 4096;
        let scene = Scene {
            means: (0..n).map(|i| [i % 16, i / 16 % 16, i / 256].map(|x| x as f32)).collect(),
            rotations: vec![[1.0, 0.0, 0.0, 0.0]; n],
            log_scales: vec![[-1.0; 3]; n],
            opacity_logits: vec![1.0; n],
            sh: vec![[0.5; 3]; n],
            ..Scene::default()
        };
        let made = decimate(&scene, None, 3000).unwrap();
        assert!((2900..=3000).contains(&made.len()), "{}", made.len());
    }

    #[test]
    fn a_far_floater_leaves_small_gaussians_apart() {
        let mut scene = scene(400);
        scene.means[0] = [1e9, 0.0, 0.0];
        let made = decimate(&scene, None, 300).unwrap();
        assert!((290..=300).contains(&made.len()), "{}", made.len());
        assert!(made.means.contains(&[1e9, 0.0, 0.0]));
    }
}
