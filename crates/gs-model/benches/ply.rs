//! Throughput of the PLY reader and writer on a model of SH degree 3, bytes of the file per second.

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use gs_model::{Scene, ply};

/// `n` Gaussians of degree 3 with plausible numbers.
fn scene(n: usize) -> Scene {
    let mut state = 1u64;
    let mut next = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (state >> 40) as f32 / (1 << 23) as f32 - 1.0
    };
    let mut triples = |n: usize| (0..n).map(|_| [next(), next(), next()]).collect::<Vec<_>>();
    Scene {
        means: triples(n),
        rotations: vec![[1.0, 0.1, 0.2, 0.3]; n],
        log_scales: triples(n),
        opacity_logits: vec![0.5; n],
        sh_degree: 3,
        sh: triples(16 * n),
        ..Scene::default()
    }
}

/// The same file with its rows as text.
fn ascii(scene: &Scene) -> Vec<u8> {
    let mut binary = Vec::new();
    ply::write_to(&mut binary, scene).expect("a valid scene");
    let end = binary.windows(11).position(|w| w == b"end_header\n").expect("a header") + 11;
    let header = String::from_utf8_lossy(&binary[..end]).replace("binary_little_endian", "ascii");
    let mut text = header.into_bytes();
    for row in binary[end..].chunks(4 * 62) {
        for number in row.chunks(4) {
            let value = f32::from_le_bytes([number[0], number[1], number[2], number[3]]);
            text.extend(format!("{value} ").bytes());
        }
        text.push(b'\n');
    }
    text
}

fn bench(c: &mut Criterion) {
    let scene = scene(100_000);
    let mut binary = Vec::new();
    ply::write_to(&mut binary, &scene).expect("a valid scene");
    let text = ascii(&scene);

    let mut group = c.benchmark_group("ply");
    group.sample_size(10);
    group.throughput(Throughput::Bytes(binary.len() as u64));
    group.bench_function("read binary", |b| b.iter(|| ply::read_bytes(black_box(&binary))));
    let mut out = Vec::with_capacity(binary.len());
    group.bench_function("write binary", |b| {
        b.iter(|| {
            out.clear();
            ply::write_to(&mut out, black_box(&scene))
        });
    });
    // The least that any reader does: read every byte once and store it.
    group.bench_function("copy", |b| b.iter(|| black_box(&binary).clone()));
    group.throughput(Throughput::Bytes(text.len() as u64));
    group.bench_function("read ascii", |b| b.iter(|| ply::read_bytes(black_box(&text))));
    group.finish();
}

criterion_group!(benches, bench);
criterion_main!(benches);
