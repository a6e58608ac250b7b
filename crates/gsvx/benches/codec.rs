//! Every stage between a model in memory and a stream: `cargo bench -p gsvx`.
//!
//! The model is fox if `../shared/scenes/fox` is there, else the fixture room: the first line says
//! which. Throughput is in Gaussians of the model; the copy of the model gives the scale.
#![allow(missing_docs, reason = "criterion_group! makes undocumented functions")]

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use gsvx::{CovarianceMode, DecodeOptions, EncodeOptions, Entropy, Prepared};

fn model() -> gs_model::Scene {
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");
    let paths = ["../shared/scenes/fox/point_cloud.ply", "fixtures/room/point_cloud.ply"];
    for path in paths {
        if let Ok((scene, _)) = gs_model::ply::read(format!("{root}/{path}")) {
            println!("model: {path}, {} Gaussians", scene.len());
            return scene;
        }
    }
    panic!("neither {paths:?} can be read");
}

fn prepare(scene: &gs_model::Scene) -> Prepared {
    let quality = gsvx::DEFAULT_QUALITY;
    let strategy = |importance: &[f32], seen| gsvx::default_strategy(quality, importance, seen);
    gsvx::prepare(scene, strategy, None).expect("a valid scene")
}

fn codec(c: &mut Criterion) {
    let scene = model();
    let Prepared { scene: merged, voxels, importance } = prepare(&scene);
    let options = EncodeOptions { importance: Some(importance), ..Default::default() };
    let mut g = c.benchmark_group("codec");
    g.sample_size(10).throughput(Throughput::Elements(scene.len() as u64));
    g.bench_function("yardstick: copy of the model", |b| b.iter(|| black_box(&scene).clone()));
    g.bench_function("prepare", |b| b.iter(|| prepare(black_box(&scene))));
    let rlgr = EncodeOptions { entropy: Entropy::Fast, ..options.clone() };
    let book = EncodeOptions { covariance: CovarianceMode::Vq { bits: 12 }, ..options.clone() };
    for (name, options) in [("range", &options), ("rlgr", &rlgr), ("range, codebook", &book)] {
        let coded = gsvx::encode(&merged, &voxels, options).expect("a valid scene").bytes;
        g.bench_function(format!("encode, {name}"), |b| {
            b.iter(|| gsvx::encode(black_box(&merged), &voxels, options));
        });
        let all = DecodeOptions::default();
        g.bench_function(format!("decode, {name}"), |b| {
            b.iter(|| gsvx::decode(black_box(&coded), &all));
        });
        let base = DecodeOptions { max_sh_degree: 0, ..Default::default() };
        g.bench_function(format!("decode, {name}, SH degree 0"), |b| {
            b.iter(|| gsvx::decode(black_box(&coded), &base));
        });
    }
    let exact = gsvx::encode_lossless(&scene).expect("a valid scene").bytes;
    g.bench_function("encode, lossless", |b| b.iter(|| gsvx::encode_lossless(black_box(&scene))));
    g.bench_function("decode, lossless", |b| {
        b.iter(|| gsvx::decode(black_box(&exact), &DecodeOptions::default()));
    });
    g.finish();
}

criterion_group!(benches, codec);
criterion_main!(benches);
