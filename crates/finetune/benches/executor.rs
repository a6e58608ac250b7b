//! `blend` and `blend_adjoint` in pair evaluations per second, and whole steps.
//!
//! `cargo bench -p finetune --features gpu --bench executor`
#![allow(missing_docs, reason = "criterion's macros")]

use std::time::{Duration, Instant};

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use finetune::optimiser::SceneOptimiser;
use finetune::probe::Probe;
use finetune::{LearningRates, Loss, RenderOptions, TrainView, ViewGradients};
use gs_model::Scene;

#[path = "../tests/common/mod.rs"]
mod common;
#[path = "common/scene.rs"]
mod scene;
use scene::{cpu_seconds, setup};

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

fn pairs(c: &mut Criterion) {
    let (scene, camera, photo) = setup();
    let mut probe = Probe::new(&scene, &camera, &photo);
    let mut group = c.benchmark_group("blend and adjoint");
    group.sample_size(10).measurement_time(Duration::from_secs(5));
    group.throughput(Throughput::Elements(2 * probe.pairs()));
    group.bench_function("scalar reference", |b| b.iter(|| probe.scalar()));
    for threads in [1, 2] {
        let pool = pool(threads);
        group.bench_function(BenchmarkId::new("rust", threads), |b| {
            b.iter(|| {
                pool.install(|| {
                    probe.blend();
                    probe.blend_adjoint();
                });
            });
        });
    }
    #[cfg(feature = "gpu")]
    match probe.on_device() {
        Some(device) => {
            group.bench_function("wgsl on a software adapter", |b| b.iter(|| device.run()));
        }
        None => println!("SKIPPED: no adapter"),
    }
    group.finish();
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
        b.iter_custom(|n| {
            finetune::probe::software_steps(&scene, views(), n).unwrap_or(Duration::from_secs(1))
        });
    });
    group.finish();
}

/// The same in processor time, which other processes on the machine do not affect.
fn processor_time(_: &mut Criterion) {
    let (scene, camera, photo) = setup();
    let mut probe = Probe::new(&scene, &camera, &photo);
    let pairs = 2.0 * probe.pairs() as f64;
    let measure = |name: &str, work: &mut dyn FnMut()| {
        work();
        let Some(start) = cpu_seconds() else { return };
        let mut n = 0;
        let seconds = loop {
            work();
            n += 1;
            match cpu_seconds() {
                Some(now) if now - start < 2.0 => {}
                Some(now) => break (now - start) / f64::from(n),
                None => return,
            }
        };
        println!(
            "{name}: {:.1} ms of processor time, {:.0} M pairs/s",
            seconds * 1e3,
            pairs / seconds / 1e6
        );
    };
    println!("{:.1} M pairs forward and as many backward", pairs / 2e6);
    measure("scalar reference", &mut || probe.scalar());
    let one = pool(1);
    measure("rust, one thread", &mut || {
        one.install(|| {
            probe.blend();
            probe.blend_adjoint();
        });
    });
    measure("rust, blend alone", &mut || one.install(|| probe.blend()));
    measure("rust, adjoint alone", &mut || one.install(|| probe.blend_adjoint()));
    #[cfg(feature = "gpu")]
    if let Some(device) = probe.on_device() {
        measure("wgsl on a software adapter", &mut || device.run());
    }
    let views = || vec![TrainView { camera: camera.clone(), photo: photo.clone() }];
    measure("ten whole steps, rust (pairs do not apply)", &mut || {
        fine_tune(&scene, views(), 10, &one);
    });
    #[cfg(feature = "gpu")]
    measure("eleven whole steps, wgsl (pairs do not apply)", &mut || {
        let _ = finetune::probe::software_steps(&scene, views(), 10);
    });
}

criterion_group!(benches, processor_time, pairs, steps);
criterion_main!(benches);
