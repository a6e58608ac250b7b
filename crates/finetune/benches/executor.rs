//! `blend` and `blend_adjoint` in pair evaluations per second, and whole steps.
//!
//! `cargo bench -p finetune --features gpu --bench executor`
#![allow(missing_docs, reason = "criterion's macros")]

use std::time::{Duration, Instant};

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use finetune::probe::Probe;
use finetune::{FineTune, FineTuneOptions, Image, RenderOptions, TrainView, render};
use gs_model::{Camera, Scene};

#[path = "../tests/common/mod.rs"]
mod common;

/// The scene of the target: 100,000 Gaussians, SH degree 3, 480x320.
fn setup() -> (Scene, Camera, Image) {
    let mut r = common::Rng(1);
    let mut scene = Scene { sh_degree: 3, ..Scene::default() };
    for _ in 0..100_000 {
        let z = r.range(2.0, 10.0);
        let (x, y) = (z * r.range(-0.6, 0.6), z * r.range(-0.42, 0.42));
        scene.means.push([x as f32, y as f32, z as f32]);
        scene.rotations.push([0; 4].map(|_| r.f(-1.0, 1.0)));
        // Log-normal sizes.
        let mut log_scale = || {
            let sum: f64 = (0..6).map(|_| r.range(-1.0, 1.0)).sum();
            (-3.9 + 0.35 * sum) as f32
        };
        scene.log_scales.push([log_scale(), log_scale(), log_scale()]);
        scene.opacity_logits.push(r.f(-3.0, 3.0));
        for k in 0..16 {
            let a = if k == 0 { 1.5 } else { 0.1 };
            scene.sh.push([0; 3].map(|_| r.f(-a, a)));
        }
    }
    let camera = Camera {
        name: "bench".into(),
        width: 480,
        height: 320,
        fx: 400.0,
        fy: 400.0,
        cx: 240.0,
        cy: 160.0,
        rotation: glam::DMat3::IDENTITY,
        translation: glam::DVec3::ZERO,
    };
    let photo = render(&scene, &camera, &RenderOptions::default());
    scene.sh.iter_mut().flatten().for_each(|v| *v += r.f(-0.1, 0.1));
    (scene, camera, photo)
}

fn pool(threads: usize) -> rayon::ThreadPool {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a thread pool")
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
            b.iter_custom(|n| {
                let options = FineTuneOptions { steps: n, ..FineTuneOptions::default() };
                let run = FineTune::new(scene.clone(), views(), options).expect("valid input");
                let started = Instant::now();
                pool.install(|| run.run(|_| {})).expect("no file is involved");
                started.elapsed()
            });
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

/// Processor seconds of this process so far, all threads; Linux only.
fn cpu_seconds() -> Option<f64> {
    let stat = std::fs::read_to_string("/proc/self/stat").ok()?;
    let fields: Vec<&str> = stat.rsplit(") ").next()?.split(' ').collect();
    let ticks = |i: usize| fields.get(i)?.parse::<f64>().ok();
    // utime and stime, in hundredths of a second.
    Some((ticks(11)? + ticks(12)?) / 100.0)
}

/// The same in processor time, which other processes on the machine do not disturb.
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
    let options = FineTuneOptions { steps: 10, ..FineTuneOptions::default() };
    measure("ten whole steps, rust (pairs do not apply)", &mut || {
        let run = FineTune::new(scene.clone(), views(), options.clone()).expect("valid input");
        one.install(|| run.run(|_| {})).expect("no file is involved");
    });
    #[cfg(feature = "gpu")]
    measure("eleven whole steps, wgsl (pairs do not apply)", &mut || {
        let _ = finetune::probe::software_steps(&scene, views(), 10);
    });
}

criterion_group!(benches, processor_time, pairs, steps);
criterion_main!(benches);
