//! Strategies and merging: `cargo bench -p gsvx-voxel`. Clusters of small Gaussians, as trainers make
//! them; the sort of as many integers gives the scale.
#![allow(missing_docs, reason = "criterion_group! makes undocumented functions")]

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use gs_model::Scene;
use voxel::{Merge, RateDistortion, Strategy, cube_of, merge, voxelize};

const N: usize = 100_000;

fn scene() -> Scene {
    let mut state = 1u64;
    let mut unit = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (state >> 40) as f32 / (1 << 23) as f32 - 1.0
    };
    let mut s = Scene::default();
    for i in 0..N {
        s.means.push([(i % 7) as f32 + 0.3 * unit(), unit() * unit(), 0.1 * unit()]);
        s.rotations.push([1.0, 0.3 * unit(), 0.3 * unit(), unit()]);
        s.log_scales.push([-6.0 + unit(), -6.0 + unit(), -7.0 + unit()]);
        s.opacity_logits.push(4.0 * unit());
        s.sh.push([unit(), unit(), unit()]);
    }
    s
}

fn strategies(c: &mut Criterion) {
    let scene = scene();
    let cube = cube_of(&scene.means).expect("finite means");
    let mut g = c.benchmark_group("voxelize");
    g.sample_size(10).throughput(Throughput::Elements(N as u64));
    g.bench_function("yardstick: sort_unstable of as many u64", |b| {
        let keys: Vec<u64> = scene.means.iter().map(|m| u64::from(m[0].to_bits()) << 7).collect();
        b.iter(|| {
            let mut keys = black_box(&keys).clone();
            keys.sort_unstable();
            keys
        });
    });
    for (name, strategy) in [
        ("uniform, depth 12", Strategy::Uniform { depth: 12 }),
        ("paper, 8 to 12", Strategy::paper(8, 12)),
        ("rate-distortion", Strategy::RateDistortion(RateDistortion::unseen(3e-3))),
    ] {
        g.bench_function(name, |b| b.iter(|| voxelize(black_box(&scene), &cube, &strategy)));
        let voxels = voxelize(&scene, &cube, &strategy).expect("a valid scene");
        g.bench_function(format!("merge, {name}"), |b| {
            b.iter(|| merge(black_box(&scene), &voxels, Merge::Moments));
        });
    }
    g.finish();
}

criterion_group!(benches, strategies);
criterion_main!(benches);
