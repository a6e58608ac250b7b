//! The loop on a graphics adapter.
//!
//! Latents, scene, moments and derivatives stay on the device; the host reads losses. Every
//! [`FITTED`](crate::codec_loop::FITTED) steps it fetches the latents: fitting the predictions and counting
//! the bytes is work of the encoder, and so is the stream at the end.

use finetune::kernels::{KernelLoop, KernelStep};
use finetune::optimiser::AdamMoments;
use finetune::{Adapter, ViewGradients, ViewLoss};
use gs_model::Scene;
use gsvx::latents::Latents;

use crate::error::Result;
use crate::program::{fitted, fixed, pages, program, uniform};

/// Latents on a device.
pub(crate) struct Device {
    kernels: KernelLoop,
    /// Leaves of a page, at most.
    most: usize,
    /// Values of each page.
    values: Vec<usize>,
    /// The device has newer values than the host.
    ahead: bool,
    /// The last that was fetched.
    loss: ViewLoss,
}

impl Device {
    /// On an adapter, in pages of at most `most` leaves. `scene` holds the leaves, then Gaussians that do not move;
    /// `loss` is that of one of the views.
    pub(crate) fn new(
        (adapter, most): (Adapter, usize),
        views: &ViewGradients,
        scene: &Scene,
        latents: &Latents,
        moments: &AdamMoments,
        loss: ViewLoss,
    ) -> Result<Self> {
        let pages = pages(latents, most);
        let mut kernels = views.with_kernels(adapter, scene, &program(latents, &pages))?;
        let mut values = Vec::new();
        let mut first = 0;
        for (k, page) in pages.iter().enumerate() {
            let (merges, leaves, weights) = fixed(page);
            kernels.write("merges", k, &merges)?;
            kernels.write("leaf_words", k, &leaves)?;
            kernels.write("leaf_weights", k, &weights)?;
            let of_page = first..first + leaves.len() * latents.channels();
            first = of_page.end;
            values.push(of_page.len());
            kernels.write("latents", k, &latents.values()[of_page.clone()])?;
            kernels.write("first_moments", k, &moments.first[of_page.clone()])?;
            kernels.write("second_moments", k, &moments.second[of_page])?;
        }
        let mut this = Self { kernels, most, values, ahead: false, loss };
        this.update(latents)?;
        Ok(this)
    }

    /// Fetches values and moments if the device has newer ones.
    pub(crate) fn fetch(&mut self, latents: &mut Latents, moments: &mut AdamMoments) -> Result<()> {
        if !std::mem::take(&mut self.ahead) {
            return Ok(());
        }
        self.loss = self.kernels.losses()?.pop().unwrap_or(self.loss);
        moments.first = self.read("first_moments")?;
        moments.second = self.read("second_moments")?;
        *latents.values_mut() = self.read("latents")?;
        Ok(())
    }

    /// A buffer with an entry per value, of all pages.
    fn read(&mut self, buffer: &str) -> Result<Vec<f32>> {
        let mut all = Vec::new();
        for (page, &n) in self.values.iter().enumerate() {
            all.extend(self.kernels.read::<f32>(buffer, page, n)?);
        }
        Ok(all)
    }

    /// Tells the device the steps and the predictions of the last fit.
    pub(crate) fn update(&mut self, latents: &Latents) -> Result<()> {
        for (k, page) in pages(latents, self.most).iter().enumerate() {
            let (chunks, factors) = fitted(page);
            self.kernels.set_uniform(k, &uniform(latents, page))?;
            self.kernels.write("chunks", k, &chunks)?;
            self.kernels.write("sh_factors", k, &factors)?;
        }
        Ok(())
    }

    /// One step. The loss is the last that was fetched.
    pub(crate) fn step(&mut self, step: &KernelStep) -> Result<ViewLoss> {
        self.kernels.step(step)?;
        self.ahead = true;
        Ok(self.loss)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::codec_loop::{CodecLoop, LoopLeaves};
    use crate::options::{Target, TuneOptions};
    use crate::plan::TunePlan;
    use crate::stage;
    use crate::targets::Targets;
    use crate::views::Views;
    use finetune::kernels::PAGE_GAUSSIANS;
    use gs_model::{dataset, ply};
    use std::num::NonZeroUsize;

    const PLAN: TunePlan =
        TunePlan { quality: 58.0, fraction: 0.5, rounds: 1, round_steps: 0, loop_steps: 100 };

    /// A loop on every `every`th Gaussian of the room, and six of its views; `None` without an adapter.
    fn room(every: usize) -> Option<(CodecLoop, CodecLoop, Views)> {
        let room = testing::fixture("room");
        let model = ply::read(room.join("point_cloud.ply")).unwrap().0;
        let kept: Vec<usize> = (0..model.len()).step_by(every).collect();
        let scene = model.select(&kept);
        let load = |view: gs_model::View| crate::photo(&view.camera, &view.image_path).unwrap();
        let photos = dataset::open_views(room).unwrap().into_iter().take(6).map(load).collect();
        let mut options = TuneOptions::new(Target::Quality(PLAN.quality));
        options.drop_unseen = true;
        let mut views =
            Views::look(&scene, Targets::Photos(photos), &options, |_, _| ()).unwrap().views;
        let goal = options.goal();
        let on_host = *stage::codec_loop(&PLAN, goal, &mut views, &scene).unwrap();
        let mut on_device = *stage::codec_loop(&PLAN, goal, &mut views, &scene).unwrap();
        match on_device.place((Adapter::Software, PAGE_GAUSSIANS), &mut views.gradients) {
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
        let scene = on_device.kernels.scene(host.scene.clone()).unwrap();
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
        let n = host.latents.values().len();
        let mut prices = on_device.read("bit_prices").unwrap();
        assert_eq!(prices.len(), n);
        let whole = pages(&host.latents, usize::MAX);
        let weights = whole.iter().flat_map(|page| fixed(page).2);
        let rows = prices.chunks_exact_mut(host.latents.channels());
        for (row, weight) in rows.zip(weights) {
            row.iter_mut().for_each(|p| *p *= weight);
        }
        let largest = host.prices.iter().fold(0.0f32, |m, p| m.max(p.abs()));
        let scaled = |p: &[f32]| p.iter().map(|p| p / largest * 100.0).collect::<Vec<_>>();
        let share = differing(&scaled(&prices), &scaled(&host.prices), 1e-3);
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
        let (a, b) = (views.at_aside(&host.scene).1, views.at_aside(&device.scene).1);
        assert!((a - b).abs() < 0.02, "{a} and {b} dB");
    }

    #[test]
    fn both_executors_prune_alike() {
        let Some((_, CodecLoop { scene, .. }, mut views)) = room(3) else { return };
        let sums =
            |views: &mut Views| (views.removal(&scene).unwrap(), views.importance(&scene).unwrap());
        let (by_host, importance) = sums(&mut views);
        views.summed.adapter = Some(Adapter::Software);
        let (by_device, also) = sums(&mut views);
        assert!(by_device.effects != by_host.effects, "the adapter was not asked");
        let scaled = |v: &[f32]| {
            let mean = v.iter().filter(|v| **v < f32::MAX).sum::<f32>() / v.len() as f32;
            v.iter().map(|v| v / mean).collect::<Vec<_>>()
        };
        for (name, a, b) in [
            ("effects", &by_device.effects, &by_host.effects),
            ("squared weights", &by_device.squared, &by_host.squared),
            ("importances", &also, &importance),
        ] {
            let share = differing(&scaled(a), &scaled(b), 1e-3);
            println!("{name}: {share}");
            assert!(share < 0.001, "{name}: {share} of the values differ");
        }
        let kept = |effects: &[f32]| gsvx::prune(effects, 0.5).unwrap();
        let (a, b) = (kept(&by_device.effects), kept(&by_host.effects));
        let common = a.iter().filter(|i| b.binary_search(i).is_ok()).count();
        assert!(common as f64 > 0.999 * b.len() as f64, "{common} of {}", b.len());
    }

    /// The same values in chunks of 100 leaves.
    fn in_small_chunks(state: &CodecLoop, views: &Views) -> CodecLoop {
        let LoopLeaves { octree, importance, outliers } = &state.leaves;
        let chunk_leaves = NonZeroUsize::new(100).unwrap();
        let options = gsvx::CodeOptions { chunk_leaves, ..Default::default() };
        let (empty, values) = (state.latents.empty_scene(), state.latents.values().to_vec());
        let steps = crate::plan::steps(PLAN.quality).unwrap();
        let latents = Latents::with_values(octree, importance, steps, &options, &empty, values);
        let (octree, importance) = (octree.clone(), importance.clone());
        let leaves = LoopLeaves { octree, importance, outliers: outliers.clone() };
        CodecLoop::new(&PLAN, views.pixels(), leaves, latents.unwrap())
    }

    #[test]
    fn pages_do_not_change_a_bit() {
        let Some((host, _, mut views)) = room(3) else { return };
        let mut run = |most: usize| {
            let mut state = in_small_chunks(&host, &views);
            state.place((Adapter::Software, most), &mut views.gradients).unwrap();
            let pages = pages(&state.latents, most).len();
            for step in 0..50 {
                state.step(&mut views.gradients, step).unwrap();
            }
            state.settle().unwrap();
            (pages, state.latents.values().to_vec(), state.bytes)
        };
        let (whole, paged) = (run(PAGE_GAUSSIANS), run(350));
        assert!(whole.0 == 1 && paged.0 > 2, "{} pages", paged.0);
        assert!(whole.1 == paged.1 && whole.2 == paged.2);
        assert!(whole.1 != host.latents.values());
    }
}
