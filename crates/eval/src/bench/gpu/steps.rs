//! Steps at a random scene, in both executors.

use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use finetune::optimiser::SceneOptimiser;
use finetune::{
    Adapter, LearningRates, Loss, Photo, RenderOptions, TrainView, ViewGradients, render,
};
use gs_model::{Camera, Scene};
use serde::{Deserialize, Serialize};

/// Steps are counted for so long.
const MEASURED: Duration = Duration::from_secs(10);
/// Steps that are submitted together.
const BATCH: u64 = 5;

/// What is drawn.
#[derive(Clone, Copy)]
pub(super) struct Shot {
    pub(super) gaussians: usize,
    /// Pixels of a side of the view.
    pub(super) side: u32,
}

impl Shot {
    /// The scene, and the view, whose photo shows other colours.
    fn make(self) -> (Scene, TrainView) {
        let mut scene = testing::trained_like(self.gaussians, 3, &mut testing::Rng::seeded(1));
        // More Gaussians are smaller in proportion, so that they cover the same surfaces.
        let smaller = (self.gaussians as f32 / 2e4).max(1.0).ln() / 2.0;
        scene.log_scales.as_flattened_mut().iter_mut().for_each(|s| *s -= smaller);
        let (eye, target, up) = ([3.0, 0.5, -5.0], [3.0, 0.0, 0.0], [0.0, -1.0, 0.0]);
        let camera =
            Camera::looking_at("a".into(), eye, target, up, [self.side; 2], self.side.into());
        let photo = Photo::from(&render(&scene, &camera, &RenderOptions::default()));
        scene.sh.as_flattened_mut().iter_mut().step_by(5).for_each(|v| *v += 0.1);
        (scene, TrainView { camera, photo })
    }
}

/// What was measured at one size.
#[derive(Serialize, Deserialize)]
pub(super) struct Figures {
    pub(super) steps_per_second: f64,
    /// One step.
    pub(super) cpu_steps_per_second: f64,
    /// Relative difference of the losses of the first step.
    pub(super) loss_apart: f64,
    /// Largest difference of Adam's first moments after it, over the largest moment.
    pub(super) moments_apart: f64,
    /// Both between two steps in Rust, the second with depths moved by a unit in the last place.
    pub(super) by_order: [f64; 2],
    pub(super) device_mb: f64,
}

/// Measures one size.
pub(super) fn measure(adapter: Adapter, shot: Shot) -> Result<Figures> {
    let (scene, view) = shot.make();
    let mut views = ViewGradients::new(vec![view], Loss::MSE, &RenderOptions::default())?;
    let start = || SceneOptimiser::new(scene.clone(), LearningRates::default(), 0.0);
    let (mut host, mut fetched) = (start(), start());
    let mut device = views.scene_on_device(adapter, &host)?;
    // Compiles the kernels, and makes room.
    device.step(0, 1, 1.0)?;
    let loss = device.losses()?.pop().context("no loss")?;
    device.fetch(&mut fetched)?;
    let (mut number, started) = (1, Instant::now());
    while started.elapsed() < MEASURED {
        for _ in 0..BATCH {
            number += 1;
            device.step(0, number, 1.0)?;
        }
        device.losses()?;
    }
    let steps_per_second = (number - 1) as f64 / started.elapsed().as_secs_f64();
    let started = Instant::now();
    let wanted = host.step(&mut views, 0, 1, 1.0);
    let cpu_steps_per_second = started.elapsed().as_secs_f64().recip();
    let apart = |loss: f64, moments: &[f32]| {
        let pairs = || moments.iter().zip(&host.moments.first);
        let largest = pairs().fold(0.0f32, |most, (_, m)| most.max(m.abs()));
        let apart = pairs().fold(0.0f32, |most, (a, b)| most.max((a - b).abs()));
        [(loss / wanted.loss - 1.0).abs(), f64::from(apart / largest)]
    };
    let [loss_apart, moments_apart] = apart(loss.loss, &fetched.moments.first);
    let mut moved = scene.clone();
    let mut r = testing::Rng::seeded(9);
    // The camera looks along z, from a distance of about 5.
    moved.means.iter_mut().for_each(|mean| mean[2] += 4.8e-7 * r.signed().signum());
    let mut moved = SceneOptimiser::new(moved, LearningRates::default(), 0.0);
    let moved_loss = moved.step(&mut views, 0, 1, 1.0);
    let by_order = apart(moved_loss.loss, &moved.moments.first);
    Ok(Figures {
        steps_per_second,
        cpu_steps_per_second,
        loss_apart,
        moments_apart,
        by_order,
        device_mb: device.bytes() as f64 / 1e6,
    })
}

/// Writes scene and photo as arrays of f32 for the script.
pub(super) fn write_arrays(shot: Shot, dir: &Path) -> Result<()> {
    let (scene, view) = shot.make();
    let camera = &view.camera;
    let photo = view.photo.image().rgb;
    let mut pose = [0.0f32; 12];
    let rows = camera.rotation.transpose();
    for (k, row) in [rows.x_axis, rows.y_axis, rows.z_axis].into_iter().enumerate() {
        let values = [row.x, row.y, row.z, camera.translation[k]].map(|v| v as f32);
        pose[4 * k..4 * k + 4].copy_from_slice(&values);
    }
    let lens = [camera.fx, camera.fy, camera.cx, camera.cy].map(|v| v as f32);
    for (name, array) in [
        ("means", scene.means.as_flattened()),
        ("quats", scene.rotations.as_flattened()),
        ("scales", scene.log_scales.as_flattened()),
        ("opacities", &scene.opacity_logits),
        ("sh", scene.sh.as_flattened()),
        ("photo", &photo),
        ("pose", &pose),
        ("lens", &lens),
    ] {
        let bytes: Vec<u8> = array.iter().flat_map(|v| v.to_le_bytes()).collect();
        std::fs::write(dir.join(name), bytes).with_context(|| format!("write {name}"))?;
    }
    Ok(())
}
