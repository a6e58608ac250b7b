//! Every stage between a model in memory and a stream: `cargo bench -p gsvx`.
//!
//! The model is fox if `../shared/scenes/fox` is there, else the fixture room: the first line says
//! which. Throughput is in Gaussians of the model; the copy of the model gives the scale.
#![allow(missing_docs, reason = "criterion_group! makes undocumented functions")]

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use gsvx::{CodeOptions, DEFAULT_QUALITY, DecodeOptions, PrepareOptions, Steps};

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

fn codec(c: &mut Criterion) {
    let scene = model();
    let steps = Steps::of_quality(DEFAULT_QUALITY).expect("a quality");
    let prepare = || {
        let options = PrepareOptions::default();
        gsvx::prepare(black_box(&scene), None, DEFAULT_QUALITY, &options).expect("a valid scene")
    };
    let mut g = c.benchmark_group("codec");
    g.sample_size(10).throughput(Throughput::Elements(scene.len() as u64));
    g.bench_function("yardstick: copy of the model", |b| b.iter(|| black_box(&scene).clone()));
    g.bench_function("prepare", |b| b.iter(prepare));
    let gsvx::VoxelScene { scene: merged, voxels, importance, .. } = prepare();
    let default = CodeOptions::default();
    let lod = CodeOptions { lod: true, ..default };
    let mut base = DecodeOptions::default();
    base.max_sh_degree = 0;
    for (name, options) in [("default", &default), ("lod", &lod)] {
        let encode = || {
            let (merged, octree) = (black_box(&merged), voxels.octree());
            gsvx::encode_voxels(merged, octree, None, Some(&importance), &steps, options)
        };
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
