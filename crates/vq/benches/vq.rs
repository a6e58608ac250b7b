//! Time against distortion of codebooks with 256 to 65,536 codewords, and of the exact search
//! against a scan.
//!
//! `cargo bench -p vq` prints the distortions first (they do not vary from run to run), then
//! criterion's times. The covariances are those of the fox scene in Morton order if
//! `../shared/scenes/fox` is there, else synthetic ones: the first line says which.

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use vq::{Codebook, Covariance, Metric, Options, default_sensitivity};

const SIZES: [usize; 5] = [256, 1024, 4096, 16384, 65536];

struct Data {
    covariances: Vec<Covariance>,
    sensitivities: Vec<f32>,
}

fn data() -> Data {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/scenes/fox/point_cloud.ply");
    match gs_model::ply::read(path) {
        Ok((scene, _)) => {
            println!("covariances: fox, {} Gaussians in Morton order", scene.len());
            of_scene(&scene)
        }
        Err(_) => {
            println!("SKIPPED: no {path}; covariances: 120,000 synthetic ones");
            synthetic(120_000)
        }
    }
}

fn of_scene(scene: &gs_model::Scene) -> Data {
    let low = scene.means.iter().fold([f32::INFINITY; 3], |l, m| [0, 1, 2].map(|k| l[k].min(m[k])));
    let high =
        scene.means.iter().fold([f32::NEG_INFINITY; 3], |h, m| [0, 1, 2].map(|k| h[k].max(m[k])));
    let side = (0..3).map(|k| high[k] - low[k]).fold(f32::MIN_POSITIVE, f32::max);
    let key = |m: &[f32; 3]| {
        let cell = [0, 1, 2].map(|k| ((m[k] - low[k]) / side * 65535.0) as u64);
        (0..16).fold(0u64, |key, bit| {
            (0..3).fold(key, |key, k| key | ((cell[k] >> bit) & 1) << (3 * bit + 2 - k))
        })
    };
    let mut order: Vec<usize> = (0..scene.len()).collect();
    order.sort_by_key(|&i| key(&scene.means[i]));
    let covariances = order
        .iter()
        .map(|&i| Covariance::split(scene.rotations[i], scene.log_scales[i]).unwrap().0)
        .collect();
    let opacity = |logit: f32| 1.0 / (1.0 + libm::expf(-logit));
    let sensitivities = order
        .iter()
        .map(|&i| default_sensitivity(opacity(scene.opacity_logits[i]), scene.log_scales[i]))
        .collect();
    Data { covariances, sensitivities }
}

fn synthetic(n: usize) -> Data {
    let mut state = 1u64;
    let mut unit = move || {
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1u64 << 24) as f32
    };
    let mut data = Data { covariances: Vec::new(), sensitivities: Vec::new() };
    for _ in 0..n {
        let q = [0; 4].map(|_: i32| unit() + unit() - 1.0);
        let s = [-3.0 + unit(), -4.0 + 2.0 * unit(), -7.0 + 3.0 * unit()];
        data.covariances.push(Covariance::split(q, s).unwrap().0);
        data.sensitivities.push(default_sensitivity(unit(), s));
    }
    data
}

fn distortion_table(data: &Data) {
    println!("{:>7} {:>10} {:>10} {:>8} {:>8}", "K", "weighted", "mean", "largest", "entropy");
    for k in SIZES {
        let options = Options::with_codewords(k);
        let codebook = Codebook::train(&data.covariances, &data.sensitivities, &options).unwrap();
        let indices = codebook.assign(&data.covariances);
        let d = codebook.distortion(&data.covariances, &data.sensitivities, &indices).unwrap();
        println!(
            "{:>7} {:>10.3e} {:>10.3e} {:>8.4} {:>8.3}",
            codebook.len(),
            d.weighted_mean,
            d.mean,
            d.largest,
            d.index_entropy,
        );
    }
}

fn train(c: &mut Criterion, data: &Data) {
    let mut group = c.benchmark_group("train");
    group.sample_size(10).throughput(Throughput::Elements(data.covariances.len() as u64));
    for k in SIZES {
        group.bench_function(BenchmarkId::from_parameter(k), |b| {
            let options = Options::with_codewords(k);
            b.iter(|| Codebook::train(&data.covariances, &data.sensitivities, &options).unwrap());
        });
    }
}

fn assign(c: &mut Criterion, data: &Data) {
    let mut group = c.benchmark_group("assign");
    group.sample_size(10);
    for k in SIZES {
        let mut options = Options::with_codewords(k);
        options.full_iterations = 1;
        let codebook = Codebook::train(&data.covariances, &data.sensitivities, &options).unwrap();
        codebook.assign(&data.covariances[..1]);
        group.throughput(Throughput::Elements(data.covariances.len() as u64));
        group.bench_function(BenchmarkId::new("tree", k), |b| {
            b.iter(|| codebook.assign(black_box(&data.covariances)));
        });
        // The scan compares entries of covariances: the same work as for any metric. It takes a
        // twentieth of the data on one thread: compare elements per second.
        let some = &data.covariances[..data.covariances.len() / 20];
        let codewords: Vec<[f32; 6]> = (0..codebook.len() as u32)
            .map(|i| codebook.covariance(i).unwrap().entries().map(|e| e as f32))
            .collect();
        group.throughput(Throughput::Elements(some.len() as u64));
        group.bench_function(BenchmarkId::new("scan", k), |b| {
            b.iter(|| some.iter().map(|x| scan(&codewords, x)).sum::<usize>());
        });
    }
}

/// Nearest codeword by looking at all of them.
fn scan(codewords: &[[f32; 6]], x: &Covariance) -> usize {
    const TWICE: [f32; 6] = [1.0, 2.0, 2.0, 1.0, 2.0, 1.0];
    let x = x.entries().map(|e| e as f32);
    let mut best = (0, f32::INFINITY);
    for (id, c) in codewords.iter().enumerate() {
        let d: f32 = (0..6).map(|k| TWICE[k] * (x[k] - c[k]) * (x[k] - c[k])).sum();
        if d < best.1 {
            best = (id, d);
        }
    }
    best.0
}

fn split(c: &mut Criterion) {
    let input: Vec<([f32; 4], [f32; 3])> =
        synthetic(100_000).covariances.iter().map(|c| (c.quaternion(), c.log_scales())).collect();
    let mut group = c.benchmark_group("split");
    group.sample_size(20).throughput(Throughput::Elements(input.len() as u64));
    group.bench_function("covariance and size", |b| {
        b.iter(|| {
            let logs = input.iter().map(|g| Covariance::split(g.0, g.1).unwrap().1);
            logs.fold(0.0f32, f32::max)
        });
    });
}

fn all(c: &mut Criterion) {
    let data = data();
    if std::env::args().any(|a| a == "--bench") {
        distortion_table(&data);
        println!("metric of the table: {:?}", Metric::default());
    }
    split(c);
    train(c, &data);
    assign(c, &data);
}

criterion_group!(benches, all);
criterion_main!(benches);
