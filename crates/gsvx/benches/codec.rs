//! Every stage between a model in memory and a stream: `cargo bench -p gsvx`.
//!
//! The model is fox if `../shared/scenes/fox` is there, else the fixture room: the first line says
//! which. Throughput is in Gaussians of the model; the copy of the model gives the scale.
#![allow(missing_docs, reason = "criterion_group! makes undocumented functions")]

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use gsvx::{DecodeOptions, EncodeOptions};

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

fn with(change: impl FnOnce(&mut EncodeOptions)) -> EncodeOptions {
    let mut options = EncodeOptions::default();
    change(&mut options);
    options
}

fn codec(c: &mut Criterion) {
    let scene = model();
    let default = EncodeOptions::default();
    let prepare = || gsvx::prepare(black_box(&scene), &default).expect("a valid scene");
    let mut g = c.benchmark_group("codec");
    g.sample_size(10).throughput(Throughput::Elements(scene.len() as u64));
    g.bench_function("yardstick: copy of the model", |b| b.iter(|| black_box(&scene).clone()));
    g.bench_function("prepare", |b| b.iter(prepare));
    let gsvx::Prepared { scene: merged, voxels, importance, .. } = prepare();
    let default = with(|o| o.importance = Some(importance));
    let mut lod = default.clone();
    lod.lod = true;
    let mut base = DecodeOptions::default();
    base.max_sh_degree = 0;
    for (name, options) in [("default", &default), ("lod", &lod)] {
        let encode = || gsvx::encode_voxels(black_box(&merged), voxels.octree(), None, options);
        let coded = encode().expect("a valid scene").bytes;
        g.bench_function(format!("encode, {name}"), |b| b.iter(encode));
        g.bench_function(format!("decode, {name}"), |b| b.iter(|| gsvx::decode(black_box(&coded))));
        g.bench_function(format!("decode, {name}, SH degree 0"), |b| {
            b.iter(|| gsvx::decode_with(black_box(&coded), &base));
        });
    }
    let exact = || gsvx::encode_lossless(black_box(&scene), false);
    let coded = exact().expect("a scene").bytes;
    g.bench_function("encode, lossless", |b| b.iter(exact));
    g.bench_function("decode, lossless", |b| b.iter(|| gsvx::decode(black_box(&coded))));
    g.finish();
}

criterion_group!(benches, codec);
criterion_main!(benches);
