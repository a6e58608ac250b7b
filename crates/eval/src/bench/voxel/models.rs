//! The models and scenes that are measured.

use std::path::Path;

use anyhow::{Context, Result};
use finetune::TrainView;
use gs_model::{Camera, Scene, dataset::Dataset, ply};
use voxel::Cube;

use crate::measure;
use crate::progress::Bar;

/// A scene with photos.
pub(super) struct Study {
    pub(super) name: String,
    pub(super) scene: Scene,
    pub(super) cube: Cube,
    pub(super) views: Vec<TrainView>,
    dir: std::path::PathBuf,
    /// Sum of squared blending weights of each Gaussian over the training views.
    pub(super) seen: Vec<f32>,
    /// The uniform depth that all strategies are compared around.
    pub(super) depth: u8,
}

impl Study {
    pub(super) fn open(dir: &Path, name: &str) -> Result<Self> {
        let data = Dataset::open(dir)?;
        let (mut scene, _) = ply::read(&data.model_path)?;
        scene.drop_invalid();
        let views = measure::load(data.held_out())?;
        let cameras: Vec<Camera> = data.training().map(|v| v.camera.clone()).collect();
        let seen = finetune::saliency_per_view(&scene, &cameras).squared;
        let cube = voxel::cube_of(&scene.means)?;
        let depth = depth_of(&scene, &cube)?;
        Ok(Self { name: name.to_owned(), dir: dir.to_owned(), scene, cube, views, seen, depth })
    }

    /// The training views with their photos.
    pub(super) fn training(&self) -> Result<Vec<TrainView>> {
        let views = measure::load(Dataset::open(&self.dir)?.training())?;
        Ok(views.into_iter().map(|s| TrainView { camera: s.camera, photo: s.photo }).collect())
    }

    pub(super) fn psnr(&self, scene: &Scene) -> f64 {
        let bar = Bar::new(&self.name, self.views.len() as u64);
        let (score, _) = measure::score(scene, &self.views, &bar);
        bar.done();
        score.psnr_db
    }
}

/// The shallowest depth that keeps nine Gaussians in ten apart.
pub(super) fn depth_of(scene: &Scene, cube: &Cube) -> Result<u8> {
    for depth in 4..20 {
        let v = voxel::voxelize(scene, cube, &voxel::Strategy::Uniform { depth })?;
        if v.len() * 10 >= scene.len() * 9 {
            return Ok(depth);
        }
    }
    Ok(20)
}

/// Reads one PLY model, invalid Gaussians dropped.
pub(super) fn read(path: &Path) -> Result<Scene> {
    let (mut scene, _) = ply::read(path).with_context(|| path.display().to_string())?;
    scene.drop_invalid();
    Ok(scene)
}

/// `count` Gaussians: copies of the scene side by side in a cubic grid, the means of each copy
/// jittered by up to a tenth of the smallest scale of the Gaussian, so that no two copies
/// voxelize alike.
pub(super) fn replicated(scene: &Scene, cube: &Cube, count: usize) -> Scene {
    let copies = count.div_ceil(scene.len().max(1));
    let side = (1..).find(|s| s * s * s >= copies).unwrap_or(1);
    let indices: Vec<usize> = (0..copies).flat_map(|_| 0..scene.len()).take(count).collect();
    let mut out = scene.select(&indices);
    let mut state = 1u64;
    let mut random = || {
        // xorshift64*: only spread is needed, and the same on every machine.
        state ^= state >> 12;
        state ^= state << 25;
        state ^= state >> 27;
        (state.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 40) as f32 / 8_388_608.0 - 1.0
    };
    for (i, mean) in out.means.iter_mut().enumerate() {
        let copy = i / scene.len();
        let at = [copy % side, copy / side % side, copy / side / side];
        let least = out.log_scales[i].iter().copied().fold(f32::INFINITY, f32::min);
        let jitter = 0.1 * libm::expf(least);
        for k in 0..3 {
            mean[k] += at[k] as f32 * cube.side as f32 + jitter * random();
        }
    }
    out
}
