//! Every stage on a synthetic cloud: `cargo bench -p gpcc-lite`.
//!
//! `GPCC_POINTS` sets the number of points (default 100 000).
#![allow(missing_docs, reason = "criterion_group! makes undocumented functions")]

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use gpcc_lite::attribute::{self, Quantisation};
use gpcc_lite::coder::{RansDecoder, RansEncoder};
use gpcc_lite::paper::predict::{Neighbours, decode_lossless, encode_lossless};
use gpcc_lite::paper::rlgr;
use gpcc_lite::raht::{RahtPlan, Rows, forward, inverse};
use gpcc_lite::{Leaf, Limits, Octree, geometry, morton};

const J: u8 = 15;

/// A noisy sphere with a smooth colour.
fn cloud(n: usize) -> (Octree, Vec<Vec<i32>>) {
    let mut s = 0x9e37_79b9_7f4a_7c15u64;
    let mut next = || {
        s ^= s << 13;
        s ^= s >> 7;
        s ^= s << 17;
        (s >> 11) as f64 / (1u64 << 53) as f64 - 0.5
    };
    let mut points: Vec<(u64, [i32; 3])> = (0..n)
        .map(|_| {
            let v = [next(), next(), next()];
            let r = (v.iter().map(|x| x * x).sum::<f64>()).sqrt().max(1e-9);
            let p = v.map(|x| x / r * 0.4 + 0.5 + next() * 0.002);
            let code = morton::encode(p.map(|x| (x * f64::from(1 << J)) as u32));
            (code, p.map(|x| (x * 255.0 + next() * 20.0) as i32))
        })
        .collect();
    points.sort_unstable();
    points.dedup_by_key(|p| p.0);
    let leaves = points.iter().map(|p| Leaf { morton: p.0, depth: J }).collect();
    let tree = Octree::of_points(J, leaves).expect("valid leaves");
    (tree, (0..3).map(|c| points.iter().map(|p| p.1[c]).collect()).collect())
}

type Group<'a> = criterion::BenchmarkGroup<'a, criterion::measurement::WallTime>;

fn stages(c: &mut Criterion) {
    let n = std::env::var("GPCC_POINTS").ok().and_then(|v| v.parse().ok()).unwrap_or(100_000);
    let (tree, channels) = cloud(n);
    let random: Vec<u64> =
        tree.leaves().iter().map(|l| l.morton.wrapping_mul(0x9e37_79b9_7f4a_7c15)).collect();
    let mut g = c.benchmark_group("stages");
    g.sample_size(10);
    g.bench_function("yardstick: sort_unstable of as many u64", |b| {
        b.iter_batched(
            || random.clone(),
            |mut v| v.sort_unstable(),
            criterion::BatchSize::LargeInput,
        );
    });
    let bytes = geometry::encode(&tree).expect("valid leaves");
    let limits = Limits { max_points: tree.len() };
    g.bench_function("geometry encode", |b| b.iter(|| geometry::encode(&tree)));
    g.bench_function("geometry decode", |b| b.iter(|| geometry::decode(&bytes, &limits)));
    attributes(&mut g, &tree, &channels);
    tools(&mut g, &tree, &channels);
    g.finish();
}

fn attributes(g: &mut Group<'_>, tree: &Octree, channels: &[Vec<i32>]) {
    g.bench_function("RAHT plan", |b| b.iter(|| RahtPlan::new(tree.clone())));
    let plan = RahtPlan::new(tree.clone());
    let mut rows = Rows::new(tree.len(), channels.len());
    for i in 0..tree.len() {
        (0..channels.len()).for_each(|c| rows.row_mut(i)[c] = channels[c][i] as f32);
    }
    for (name, transform) in
        [("forward", forward as fn(&RahtPlan, &mut Rows) -> _), ("inverse", inverse)]
    {
        g.bench_function(format!("RAHT {name}, rows of three channels"), |b| {
            b.iter_batched_ref(
                || rows.clone(),
                |rows| transform(&plan, rows),
                criterion::BatchSize::LargeInput,
            );
        });
    }
    let exact: Vec<f64> = channels[0].iter().map(|&v| f64::from(v)).collect();
    g.bench_function("RAHT forward in double precision, one channel", |b| {
        b.iter(|| {
            let mut v = exact.clone();
            plan.forward_f64(&mut v).map(|()| v)
        });
    });
    let steps = [8.0; 3];
    let encode = |rows: &mut Rows| {
        let mut coder = RansEncoder::default();
        attribute::encode(&mut coder, &plan, &Quantisation::new(&steps), rows)
            .map(|_| coder.finish())
    };
    g.bench_function("attributes encode, three channels", |b| {
        b.iter_batched_ref(|| rows.clone(), encode, criterion::BatchSize::LargeInput);
    });
    let bytes = encode(&mut rows.clone()).expect("valid rows");
    g.bench_function("attributes decode, three channels", |b| {
        b.iter(|| attribute::decode(&mut RansDecoder::new(&bytes)?, &plan, &steps, &mut rows));
    });
}

fn tools(g: &mut Group<'_>, tree: &Octree, channels: &[Vec<i32>]) {
    let refs: Vec<&[i32]> = channels.iter().map(Vec::as_slice).collect();
    let levels: Vec<i32> = channels[0].iter().map(|v| (v - 128) / 8).collect();
    g.bench_function("RLGR encode, one channel", |b| b.iter(|| rlgr::encode(black_box(&levels))));
    let coded = rlgr::encode(&levels);
    g.bench_function("RLGR decode, one channel", |b| {
        b.iter(|| rlgr::decode(black_box(&coded), levels.len()));
    });
    g.bench_function("neighbours", |b| b.iter(|| Neighbours::new(tree)));
    let near = Neighbours::new(tree);
    let lossless = encode_lossless(&near, &refs).expect("valid channels");
    g.bench_function("lossless encode", |b| b.iter(|| encode_lossless(&near, &refs)));
    g.bench_function("lossless decode", |b| b.iter(|| decode_lossless(&near, &lossless, 3)));
}

criterion_group!(benches, stages);
criterion_main!(benches);
