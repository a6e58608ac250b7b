//! Whole steps of a fine-tune.
//!
//! `cargo bench -p finetune --features gpu --bench executor`
#![allow(missing_docs, reason = "criterion's macros")]

use std::time::{Duration, Instant};

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use finetune::optimiser::SceneOptimiser;
use finetune::{LearningRates, Loss, RenderOptions, TrainView, ViewGradients};
use gs_model::Scene;

#[path = "../tests/common/mod.rs"]
mod common;
#[path = "common/scene.rs"]
mod scene;
use scene::setup;

fn pool(threads: usize) -> rayon::ThreadPool {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a thread pool")
}

/// Makes `n` steps of fine-tune; returns the time, without that of the preparation.
fn fine_tune(scene: &Scene, views: Vec<TrainView>, n: u64, on: &rayon::ThreadPool) -> Duration {
    let views = ViewGradients::new(views, Loss::L1_SSIM, &RenderOptions::default());
    let mut views = views.expect("photos of their cameras' sizes");
    let mut run = SceneOptimiser::new(scene.clone(), LearningRates::default(), 0.0);
    on.install(|| {
        // The first step touches memory that later ones find warm.
        run.step(&mut views, 0, 1, 1.0);
        let started = Instant::now();
        (2..=n + 1).for_each(|step| _ = run.step(&mut views, step as usize, step, 1.0));
        started.elapsed()
    })
}

/// The same on the software adapter. The first step compiles the kernels.
#[cfg(feature = "gpu")]
fn on_device(scene: &Scene, views: Vec<TrainView>, n: u64) -> finetune::Result<Duration> {
    let views = ViewGradients::new(views, Loss::L1_SSIM, &RenderOptions::default())?;
    let from = SceneOptimiser::new(scene.clone(), LearningRates::default(), 0.0);
    let mut run = views.scene_on_device(finetune::Adapter::Software, &from)?;
    run.step(0, 1, 1.0)?;
    run.losses()?;
    let started = Instant::now();
    (2..=n + 1).try_for_each(|step| run.step(0, step, 1.0))?;
    run.losses()?;
    Ok(started.elapsed())
}

fn steps(c: &mut Criterion) {
    let (scene, camera, photo) = setup();
    let views = || vec![TrainView { camera: camera.clone(), photo: photo.clone() }];
    let mut group = c.benchmark_group("whole step, 100k Gaussians, SH 3, 480x320, L1 + SSIM");
    group.sample_size(10).measurement_time(Duration::from_secs(5));
    for threads in [1, 2] {
        let pool = pool(threads);
        group.bench_function(BenchmarkId::new("rust", threads), |b| {
            b.iter_custom(|n| fine_tune(&scene, views(), n, &pool));
        });
    }
    #[cfg(feature = "gpu")]
    group.bench_function("wgsl on a software adapter", |b| {
        b.iter_custom(|n| on_device(&scene, views(), n).unwrap_or(Duration::from_secs(1)));
    });
    group.finish();
}

/// The same views of larger scenes.
fn sizes(c: &mut Criterion) {
    let (scene, camera, photo) = setup();
    let mut group = c.benchmark_group("whole step, 100k Gaussians in view, SH 3, 480x320");
    group.sample_size(10).measurement_time(Duration::from_secs(5));
    for copies in [1, 10, 30] {
        // A model is in the order of its positions: those in view follow each other.
        let mut large = scene.clone();
        for _ in 1..copies {
            large.append(&scene);
        }
        large.means[scene.len()..].iter_mut().for_each(|mean| mean[2] -= 1000.0);
        // Views from several places: each shows some that the one before did not.
        let views = || {
            let moved = |k: u32| {
                let mut camera = camera.clone();
                camera.translation.x += f64::from(k);
                TrainView { camera, photo: photo.clone() }
            };
            (0..4).map(moved).collect()
        };
        group.bench_function(BenchmarkId::new("Gaussians", large.len()), |b| {
            b.iter_custom(|n| fine_tune(&large, views(), n, &pool(2)));
        });
    }
    group.finish();
}

criterion_group!(benches, steps, sizes);
criterion_main!(benches);
