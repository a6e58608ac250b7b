//! What a run does: views, voxelizations, qualities.

use anyhow::{Context, Result, bail, ensure};
use gs_model::{Camera, Scene};
use serde::Serialize;
use voxel::{Cube, Merge, Strategy};

use crate::progress::Bar;

/// Depths among which the uniform depth is chosen.
const DEPTHS: std::ops::RangeInclusive<u8> = 8..=18;
/// The uniform depth is the smallest at which the merged model renders like the original to
/// this many dB at training cameras: 10 dB above what trained models reach against photos, so
/// that voxelization is not what limits the curve.
const ENOUGH_DB: f64 = 40.0;
/// Training cameras used for that choice.
const CHOICE_VIEWS: usize = 3;

/// One curve to make.
#[derive(Clone, Debug)]
pub(crate) struct Config {
    /// "uniform" or "adaptive", used in file names.
    pub(crate) name: &'static str,
    /// Parameters in words.
    pub(crate) what: String,
    /// The voxelization.
    pub(crate) strategy: Strategy,
    /// The merge rule.
    pub(crate) merge: Merge,
}

/// Settings that the records of a configuration depend on.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct ConfigKey {
    strategy: String,
    merge: String,
}

impl Config {
    /// What identifies the configuration in a record's key.
    pub(crate) fn key(&self) -> ConfigKey {
        ConfigKey { strategy: format!("{:?}", self.strategy), merge: format!("{:?}", self.merge) }
    }
}

/// The two curves of a run.
pub(crate) fn configs(depth: u8, adaptive: Option<(u8, u8)>, merge: Merge) -> Vec<Config> {
    let (j_low, j_high) = adaptive.unwrap_or((depth.saturating_sub(1), depth + 2));
    vec![
        Config {
            name: "uniform",
            what: format!("uniform, J = {depth}"),
            strategy: Strategy::Uniform { depth },
            merge,
        },
        Config {
            name: "adaptive",
            what: format!("adaptive, J = {j_low} to {j_high}"),
            strategy: Strategy::paper(j_low, j_high),
            merge,
        },
    ]
}

/// `count` encoder qualities from low to high.
pub(crate) fn qualities(count: usize) -> Result<Vec<f32>> {
    const LOW: f32 = 20.0;
    const HIGH: f32 = 90.0;
    ensure!(count >= 2, "--rates must be at least 2, is {count}");
    Ok((0..count).map(|i| LOW + (HIGH - LOW) * i as f32 / (count - 1) as f32).collect())
}

/// `LOW:HIGH`.
pub(crate) fn parse_depths(text: &str) -> Result<(u8, u8)> {
    let (low, high) = text.split_once(':').context("expected LOW:HIGH, for example 9:14")?;
    let depth = |s: &str| s.parse::<u8>().with_context(|| format!("{s} is not a depth"));
    let (low, high) = (depth(low)?, depth(high)?);
    ensure!(low <= high && high <= 21, "depths must ascend and be at most 21: {low}:{high}");
    Ok((low, high))
}

/// Chooses the depth of the uniform octree.
pub(crate) fn choose_depth(scene: &Scene, cameras: &[&Camera], merge: Merge) -> Result<u8> {
    let step = cameras.len().div_ceil(CHOICE_VIEWS).max(1);
    let cameras: Vec<&Camera> = cameras.iter().copied().step_by(step).collect();
    if cameras.is_empty() {
        bail!("the scene has no training camera to choose the depth with: give --depth");
    }
    let options = finetune::RenderOptions::default();
    let bar = Bar::new("choose depth", DEPTHS.count() as u64);
    let originals: Vec<_> = cameras.iter().map(|c| finetune::render(scene, c, &options)).collect();
    let cube = Cube::of(&scene.means)?;
    for depth in DEPTHS {
        let voxels = voxel::voxelize(scene, &cube, &Strategy::Uniform { depth })?;
        let merged = voxel::merge(scene, &voxels, merge)?;
        let total: f64 = cameras
            .iter()
            .zip(&originals)
            .map(|(c, o)| finetune::metrics::psnr(&finetune::render(&merged, c, &options), o))
            .sum();
        bar.step(1);
        if total / cameras.len() as f64 >= ENOUGH_DB {
            bar.done();
            return Ok(depth);
        }
    }
    bar.done();
    Ok(*DEPTHS.end())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn qualities_span_the_range() {
        let q = qualities(5).unwrap();
        assert_eq!(q.len(), 5);
        assert!(q.windows(2).all(|w| w[0] < w[1]) && q[4] <= 100.0);
        assert!(qualities(1).is_err());
    }

    #[test]
    fn depths_parse() {
        assert_eq!(parse_depths("9:14").unwrap(), (9, 14));
        for bad in ["9", "9:x", "14:9", "9:22", ""] {
            assert!(parse_depths(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn the_chosen_depth_resolves_the_scene() {
        // Two Gaussians, two pixels apart: they must not fall into one voxel.
        let scene = Scene {
            means: vec![[0.0, 0.0, 0.0], [0.002, 0.0, 0.0], [1.0, 1.0, 1.0]],
            rotations: vec![[1.0, 0.0, 0.0, 0.0]; 3],
            log_scales: vec![[-7.0; 3]; 3],
            opacity_logits: vec![3.0; 3],
            sh_degree: 0,
            sh: vec![[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        };
        let camera = Camera {
            name: "a".into(),
            width: 32,
            height: 32,
            fx: 1000.0,
            fy: 1000.0,
            cx: 16.0,
            cy: 16.0,
            rotation: glam::DMat3::IDENTITY,
            translation: glam::DVec3::new(0.0, 0.0, 1.0),
        };
        let depth = choose_depth(&scene, &[&camera], Merge::Moments).unwrap();
        let cube = Cube::of(&scene.means).unwrap();
        let voxels = voxel::voxelize(&scene, &cube, &Strategy::Uniform { depth }).unwrap();
        assert_eq!(voxels.len(), 3, "depth {depth}");
    }
}
