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
    let views = ViewGradients::new(views, Loss::default(), &RenderOptions::default());
    let mut views = views.expect("photos of their cameras' sizes");
    let mut run = SceneOptimiser::new(scene.clone(), LearningRates::default(), 0.0);
    let started = Instant::now();
    on.install(|| {
        for step in 1..=n {
            run.step(&mut views, 0, step, 1.0);
        }
    });
    started.elapsed()
}

/// The same on the software adapter. The first step compiles the kernels.
#[cfg(feature = "gpu")]
fn on_device(scene: &Scene, views: Vec<TrainView>, n: u64) -> finetune::Result<Duration> {
    let views = ViewGradients::new(views, Loss::default(), &RenderOptions::default())?;
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

criterion_group!(benches, steps);
criterion_main!(benches);
