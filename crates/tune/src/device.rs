//! The loop on a graphics adapter.
//!
//! Latents, scene, moments and derivatives stay on the device; the host reads losses. Every
//! [`FITTED`](crate::codec_loop::FITTED) steps it fetches the latents: fitting the predictions and counting
//! the bytes is work of the encoder, and so is the stream at the end.

use finetune::latents::{Chunk, Codec, Leaf, Merge, ShPrediction};
use finetune::latents::{LatentExecutor, LatentState, LatentStep};
use finetune::optimiser::Moments;
use finetune::{Adapter, ViewGradients, ViewLoss};
use gs_model::Scene;
use gsvx::latents::{Latents, Transform};

use crate::error::Result;

/// Latents on a device.
pub(crate) struct Device {
    executor: LatentExecutor,
    /// The device has newer values than the host.
    ahead: bool,
    /// The last that was fetched.
    loss: ViewLoss,
}

impl Device {
    /// `scene` holds the leaves, then Gaussians that do not move; `loss` is that of one of the views.
    pub(crate) fn new(
        adapter: Adapter,
        views: &ViewGradients,
        scene: &Scene,
        latents: &Latents,
        moments: &Moments,
        loss: ViewLoss,
    ) -> Result<Self> {
        let mut executor = views.on_device(adapter, scene, &codec(latents))?;
        let (values, first, second) =
            (latents.values().to_vec(), moments.first.clone(), moments.second.clone());
        executor.set_state(&LatentState { values, moments: [first, second] })?;
        Ok(Self { executor, ahead: false, loss })
    }

    /// Fetches values and moments if the device has newer ones.
    pub(crate) fn fetch(&mut self, latents: &mut Latents, moments: &mut Moments) -> Result<()> {
        if !std::mem::take(&mut self.ahead) {
            return Ok(());
        }
        self.loss = self.executor.losses()?.pop().unwrap_or(self.loss);
        let LatentState { values, moments: [first, second] } = self.executor.state()?;
        *latents.values_mut() = values;
        (moments.first, moments.second) = (first, second);
        Ok(())
    }

    /// Tells the device the steps and the predictions of the last fit.
    pub(crate) fn update(&mut self, latents: &Latents) -> Result<()> {
        Ok(self.executor.update(&codec(latents))?)
    }

    /// One step. The loss is the last that was fetched.
    pub(crate) fn step(&mut self, step: &LatentStep) -> Result<ViewLoss> {
        self.executor.step(step)?;
        self.ahead = true;
        Ok(self.loss)
    }
}

/// What the device needs to know of the codec.
pub(crate) fn codec(latents: &Latents) -> Codec {
    let transforms: Vec<Transform<'_>> = latents.transforms().collect();
    let (merges, levels) = merges(&transforms);
    let mut codec = Codec {
        sh_degree: latents.sh_degree(),
        steps: latents.steps_of_unit_weight(),
        lambda: latents.lambda(),
        merges,
        levels,
        ..Codec::default()
    };
    for t in &transforms {
        let plan = t.plan;
        let (first, number) = (codec.leaves.len() as u32, codec.chunks.len() as u16);
        let leaves = plan.leaves().iter().zip(t.classes).enumerate();
        codec.leaves.extend(leaves.map(|(i, (leaf, &class))| Leaf {
            depth: leaf.depth,
            class,
            chunk: number,
            weight: plan.weight_of_leaf(i) as f32,
        }));
        codec.chunks.push(Chunk {
            first,
            root_of_weight: plan.root_of_weight() as f32,
            opacity: t.opacity,
            size: t.size,
            sh: t.sh.clone().map(|p| p.map(|(log_run, factors)| ShPrediction { log_run, factors })),
        });
    }
    codec
}

/// The merges of all chunks, level by level, and the first of each level.
fn merges(transforms: &[Transform<'_>]) -> (Vec<Merge>, Vec<u32>) {
    let plans: Vec<_> = transforms.iter().map(|t| t.plan).collect();
    let depth = plans.iter().map(|p| p.levels().len()).max().unwrap_or(1);
    // By chunk and coefficient: the number of the merge, plus one.
    let mut numbers: Vec<Vec<u32>> = plans.iter().map(|p| vec![0; p.len().max(1)]).collect();
    let (mut merges, mut levels) = (Vec::new(), vec![0]);
    for level in 1..depth {
        let mut first_leaf = 0;
        for (plan, numbers) in plans.iter().zip(&mut numbers) {
            let range = plan.levels().get(level - 1).zip(plan.levels().get(level));
            for k in range.map_or(0..0, |(&a, &b)| a as usize..b as usize) {
                let m = plan.merge(k);
                merges.push(Merge {
                    left: m.left + first_leaf,
                    right: m.right + first_leaf,
                    parent: numbers[m.parent as usize],
                    share: m.share,
                    scale: m.scale,
                    noise_gain: m.noise_gain,
                });
                numbers[k] = merges.len() as u32;
            }
            first_leaf += plan.len() as u32;
        }
        levels.push(merges.len() as u32);
    }
    (merges, levels)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::codec_loop::CodecLoop;
    use crate::options::{Options, Target};
    use crate::plan::Plan;
    use crate::stage;
    use crate::views::Views;
    use finetune::{Image, TrainView};
    use gs_model::{dataset, ply};
    use std::path::Path;

    const PLAN: Plan =
        Plan { quality: 58.0, fraction: 0.5, rounds: 1, round_steps: 0, loop_steps: 100 };

    /// A loop on every `every`th Gaussian of the room, and six of its views; `None` without an adapter.
    fn room(every: usize) -> Option<(CodecLoop, CodecLoop, Views)> {
        let room = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/room");
        let model = ply::read(room.join("point_cloud.ply")).unwrap().0;
        let kept: Vec<usize> = (0..model.len()).step_by(every).collect();
        let scene = model.select(&kept);
        let load = |view: gs_model::View| {
            let photo = image::open(&view.image_path).unwrap().to_rgb8();
            let (width, height) = photo.dimensions();
            let photo = Image::from_rgb8(width, height, photo.as_raw()).unwrap();
            TrainView { camera: view.camera.scaled_to(width, height).unwrap(), photo }
        };
        let views = dataset::open_views(room).unwrap().1.into_iter().take(6).map(load).collect();
        let options = Options::new(Target::Quality(PLAN.quality));
        let mut views = Views::new(&scene, views, options.seed).unwrap();
        let on_host = stage::codec_loop(&PLAN, &views, &scene).unwrap();
        let mut on_device = stage::codec_loop(&PLAN, &views, &scene).unwrap();
        match on_device.place(Adapter::Software, &mut views.gradients) {
            Ok(()) => Some((on_host, on_device, views)),
            Err(crate::Error::Finetune(e @ finetune::Error::NoAdapter { .. })) => {
                println!("SKIPPED: {e}; install mesa-vulkan-drivers to compare with the device");
                None
            }
            Err(e) => panic!("{e}"),
        }
    }

    /// Share of the values that differ by more than `tolerance` times `1 + |b|`.
    fn differing(a: &[f32], b: &[f32], tolerance: f32) -> f64 {
        assert_eq!(a.len(), b.len());
        let far = a.iter().zip(b).filter(|(a, b)| (*a - *b).abs() > tolerance * (1.0 + b.abs()));
        far.count() as f64 / a.len() as f64
    }

    #[test]
    fn the_codec_on_the_device_is_that_of_the_encoder() {
        let Some((mut host, mut device, mut views)) = room(3) else { return };
        host.step(&mut views.gradients, 2).unwrap();
        device.step(&mut views.gradients, 2).unwrap();
        let Some(on_device) = &mut device.device else { panic!("no device") };
        let mut scene = host.scene.clone();
        on_device.executor.scene(&mut scene).unwrap();
        // Rounding may move a coefficient over the edge of a step; its leaves then differ.
        let pairs = [
            ("opacity", differing(&scene.opacity_logits, &host.scene.opacity_logits, 1e-3)),
            (
                "log-scales",
                differing(
                    scene.log_scales.as_flattened(),
                    host.scene.log_scales.as_flattened(),
                    1e-3,
                ),
            ),
            ("SH", differing(scene.sh.as_flattened(), host.scene.sh.as_flattened(), 1e-3)),
        ];
        for (name, share) in pairs {
            println!("{name}: {share}");
            assert!(share < 0.01, "{name}: {share} of the values differ");
        }
        let prices = on_device.executor.bit_prices(&codec(&host.latents)).unwrap();
        let largest = host.prices().iter().fold(0.0f32, |m, p| m.max(p.abs()));
        let scaled = |p: &[f32]| p.iter().map(|p| p / largest * 100.0).collect::<Vec<_>>();
        let share = differing(&scaled(&prices), &scaled(host.prices()), 1e-3);
        assert!(share < 0.01, "{share} of the prices differ");
    }

    #[test]
    fn both_executors_move_the_values_alike() {
        let Some((mut host, mut device, mut views)) = room(3) else { return };
        let before = host.latents.values().to_vec();
        let mut losses = Vec::new();
        for step in 0..50 {
            losses.push(host.step(&mut views.gradients, step).unwrap());
            device.step(&mut views.gradients, step).unwrap();
        }
        host.settle().unwrap();
        device.settle().unwrap();
        let (a, b) = (host.latents.values(), device.latents.values());
        let distance = |a: &[f32], b: &[f32]| {
            a.iter().zip(b).map(|(a, b)| f64::from(a - b) * f64::from(a - b)).sum::<f64>().sqrt()
        };
        let (apart, moved) = (distance(a, b), distance(a, &before));
        println!("moved {moved}, apart {apart}; {} and {} bytes", host.bytes, device.bytes);
        assert!(moved > 0.1 && apart < 0.1 * moved, "moved {moved}, apart {apart}");
        assert!((host.bytes as f64 / device.bytes as f64 - 1.0).abs() < 0.005);
        let (a, b) = (views.aside(&host.scene).1, views.aside(&device.scene).1);
        assert!((a - b).abs() < 0.02, "{a} and {b} dB");
    }
}
