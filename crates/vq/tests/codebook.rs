//! The codebook as its users see it: validity of codewords, exact assignment, determinism.

use proptest::prelude::*;
use vq::{Codebook, Covariance, Error, Keep, Metric, Options, default_sensitivity};

/// A cloud of covariances around a few shapes, with sensitivities, from a seed.
fn cloud(n: usize, seed: u64) -> (Vec<Covariance>, Vec<f32>) {
    let mut state = seed;
    let mut unit = move || {
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((state >> 40) as f32) / (1u64 << 24) as f32
    };
    let mut covariances = Vec::new();
    let mut sensitivities = Vec::new();
    for _ in 0..n {
        let kind = (unit() * 3.0) as usize;
        let base = [[1.0, 0.1, 0.0, 0.3], [0.2, 1.0, -0.5, 0.0], [0.5, 0.5, 0.5, -0.5]][kind];
        let q = base.map(|c| c + 0.3 * (unit() - 0.5));
        let s = [-3.0 + unit(), -4.0 + 2.0 * unit(), -7.0 + 3.0 * unit()];
        covariances.push(Covariance::split(q, s).unwrap().0);
        sensitivities.push(default_sensitivity(unit(), s));
    }
    (covariances, sensitivities)
}

fn eigenvalues([xx, xy, xz, yy, yz, zz]: [f64; 6]) -> Vec<f64> {
    let m = nalgebra::Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
    m.symmetric_eigenvalues().iter().copied().collect()
}

fn options(codewords: usize, metric: Metric) -> Options {
    let mut options = Options::with_codewords(codewords);
    options.metric = metric;
    options
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn every_codeword_is_a_covariance(
        n in 1usize..600, k in 1usize..200, seed: u64, square_root: bool, share in 0.0f64..0.2,
    ) {
        let (covariances, sensitivities) = cloud(n, seed);
        let metric = if square_root { Metric::SquareRoot } else { Metric::Covariance };
        let mut options = options(k, metric);
        options.keep = Keep::Share(share);
        let codebook = Codebook::train(&covariances, &sensitivities, &options).unwrap();
        prop_assert!(!codebook.is_empty() && codebook.len() <= k + n);
        for index in 0..codebook.len() as u32 {
            let (q, s) = codebook.decode(index).unwrap();
            let norm: f64 = q.iter().map(|&c| f64::from(c) * f64::from(c)).sum();
            prop_assert!((norm - 1.0).abs() < 1e-6, "{q:?}");
            prop_assert!(s.iter().all(|&l| (vq::MIN_LOG_SCALE..=0.0).contains(&l)), "{s:?}");
            let e = codebook.covariance(index).unwrap().entries();
            prop_assert!((e[0] + e[3] + e[5] - 1.0).abs() <= codebook.trace_tolerance());
            prop_assert!(eigenvalues(e).iter().all(|&v| v > -1e-12));
        }
        let decoded: Vec<_> = (0..codebook.len() as u32).map(|i| codebook.decode(i).unwrap()).collect();
        prop_assert_eq!(decoded, codebook.decode_all());
    }

    /// What a stream stores is within the stated bits, and is all that a decoder needs.
    #[test]
    fn integers_stand_for_the_codewords(
        n in 1usize..300, k in 1usize..100, seed: u64, rotation in 4u8..=14, log_scale in 2u8..=10,
    ) {
        let (covariances, sensitivities) = cloud(n, seed);
        let mut options = options(k, Metric::SquareRoot);
        (options.rotation_bits, options.log_scale_bits) = (rotation, log_scale);
        let codebook = Codebook::train(&covariances, &sensitivities, &options).unwrap();
        let (rotation_bits, log_scale_bits, integers) = codebook.integers();
        prop_assert_eq!((rotation_bits, log_scale_bits), (rotation, log_scale));
        prop_assert_eq!(integers.len(), codebook.len());
        let top = (1 << (rotation - 1)) - 1;
        // tan 11.25 degrees over the greatest integer.
        let step = 0.198_912_367_379_658 / f64::from(top);
        for (index, integers) in integers.into_iter().enumerate() {
            let [x, y, z, a, b, c] = integers;
            prop_assert!([x, y, z].iter().all(|v| v.abs() <= top));
            prop_assert!([a, b, c].iter().all(|v| (0..=16 << log_scale).contains(v)));
            let p = [x, y, z].map(|v| f64::from(v) * step);
            let square = p[0] * p[0] + p[1] * p[1] + p[2] * p[2];
            let inverse = 1.0 / (1.0 + square);
            let twice = 2.0 * inverse;
            let want = [(1.0 - square) * inverse, p[0] * twice, p[1] * twice, p[2] * twice];
            let (q, s) = codebook.decode(index as u32).unwrap();
            prop_assert_eq!(q, want.map(|v| v as f32));
            prop_assert_eq!(s, [a, b, c].map(|v| 0.0 - v as f32 / (1u32 << log_scale) as f32));
        }
    }

    #[test]
    fn assignment_is_the_scan_over_all_codewords(n in 2usize..300, k in 1usize..150, seed: u64) {
        let (covariances, sensitivities) = cloud(n, seed);
        for metric in [Metric::Covariance, Metric::SquareRoot] {
            let options = options(k, metric);
            let codebook = Codebook::train(&covariances, &sensitivities, &options).unwrap();
            let indices = codebook.assign(&covariances);
            for (covariance, &index) in covariances.iter().zip(&indices) {
                let distance = |i: u32| {
                    let one = std::slice::from_ref(covariance);
                    codebook.distortion(one, &[1.0], &[i]).unwrap().mean
                };
                let best = (0..codebook.len() as u32)
                    .min_by(|&a, &b| distance(a).total_cmp(&distance(b)).then(a.cmp(&b)));
                prop_assert_eq!(Some(index), best);
            }
        }
    }
}

#[test]
fn any_number_of_threads_gives_the_same_codebook() {
    // Several chunks, a seeding sample and mini-batches are all in play.
    let (covariances, sensitivities) = cloud(30_000, 4);
    let mut options = options(512, Metric::Covariance);
    options.training_sample = 20_000;
    options.seeding_sample = 5000;
    options.batch_size = 9000;
    options.full_iterations = 3;
    options.keep = Keep::Share(0.01);
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let codebook = Codebook::train(&covariances, &sensitivities, &options).unwrap();
            let indices = codebook.assign(&covariances);
            let distortion = codebook.distortion(&covariances, &sensitivities, &indices).unwrap();
            (codebook.integers(), indices, distortion)
        })
    };
    let one = run(1);
    assert_eq!(one, run(2));
    assert_eq!(one, run(8));
    options.seed = 1;
    let other = Codebook::train(&covariances, &sensitivities, &options).unwrap();
    assert_ne!(one.0, other.integers(), "the seed matters");
}

/// The same integers on every machine: FNV-1a of what a known cloud trains.
#[test]
fn training_has_one_result() {
    let (covariances, sensitivities) = cloud(5000, 6);
    let hashes = [Metric::Covariance, Metric::SquareRoot].map(|metric| {
        let mut options = options(200, metric);
        options.keep = Keep::Share(0.01);
        let codebook = Codebook::train(&covariances, &sensitivities, &options).unwrap();
        let indices = codebook.assign(&covariances);
        let integers = codebook.integers().2.into_iter().flatten();
        integers
            .chain(indices.iter().map(|&i| i as i32))
            .flat_map(i32::to_le_bytes)
            .fold(0xcbf2_9ce4_8422_2325u64, |h, b| {
                (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3)
            })
    });
    assert_eq!(hashes, [8_669_400_669_402_146_218, 7_196_304_459_034_904_536]);
}

#[test]
fn kept_covariances_come_back_at_stored_precision() {
    let (covariances, mut sensitivities) = cloud(2000, 9);
    let important: Vec<usize> = (0..2000).step_by(100).collect();
    important.iter().for_each(|&i| sensitivities[i] = 1000.0);
    let mut options = options(16, Metric::Covariance);
    options.keep = Keep::Above(999.0);
    options.rotation_bits = 14;
    options.log_scale_bits = 10;
    let (codebook, report) =
        Codebook::train_with_report(&covariances, &sensitivities, &options).unwrap();
    assert_eq!(report.kept, important.len());
    let kept: Vec<Covariance> = important.iter().map(|&i| covariances[i]).collect();
    let indices = codebook.assign(&kept);
    let at_kept = codebook.distortion(&kept, &vec![1.0; kept.len()], &indices).unwrap();
    assert!(at_kept.largest < 1e-5, "{at_kept:?}");
    let indices = codebook.assign(&covariances);
    let overall = codebook.distortion(&covariances, &sensitivities, &indices).unwrap();
    assert!(overall.mean > 100.0 * at_kept.mean);
}

#[test]
fn distortion_falls_with_more_codewords_and_over_iterations() {
    let (covariances, sensitivities) = cloud(8000, 12);
    for metric in [Metric::Covariance, Metric::SquareRoot] {
        let mut last = f64::INFINITY;
        for k in [16, 64, 256, 1024] {
            let mut options = options(k, metric);
            options.rotation_bits = 12;
            options.log_scale_bits = 10;
            let (codebook, report) =
                Codebook::train_with_report(&covariances, &sensitivities, &options).unwrap();
            for pair in report.weighted_distortion.windows(2) {
                assert!(pair[1] <= pair[0] * (1.0 + 1e-6), "{:?}", report.weighted_distortion);
            }
            let indices = codebook.assign(&covariances);
            let distortion = codebook.distortion(&covariances, &sensitivities, &indices).unwrap();
            // The stored integers cost little on top of the trained centres.
            let trained = report.weighted_distortion.last().copied().unwrap();
            assert!(
                distortion.weighted_mean < 1.1 * trained + 1e-6,
                "{k}: {distortion:?} {trained}"
            );
            assert!(distortion.weighted_mean < 0.75 * last, "{k}: {distortion:?} {last}");
            last = distortion.weighted_mean;
        }
    }
}

#[test]
fn degenerate_data_and_bad_arguments() {
    let one = Covariance::split([1.0, 0.0, 0.0, 0.0], [0.0, -1.0, -2.0]).unwrap().0;
    let same = vec![one; 100];
    let codebook = Codebook::train(&same, &[0.0; 100], &Options::with_codewords(256)).unwrap();
    assert_eq!(codebook.len(), 1, "one distinct covariance, one codeword");
    assert_eq!(codebook.assign(&same), vec![0; 100]);

    let train = |c: &[Covariance], s: &[f32], o: &Options| Codebook::train(c, s, o).err();
    let o = Options::default();
    assert_eq!(train(&[], &[], &o), Some(Error::BadCount { count: 0 }));
    assert!(matches!(train(&same, &[1.0; 99], &o), Some(Error::LengthMismatch { .. })));
    let mut s = [1.0; 100];
    s[7] = -1.0;
    assert_eq!(train(&same, &s, &o), Some(Error::BadSensitivity { index: 7, value: -1.0 }));
    s[7] = f32::NAN;
    assert!(matches!(train(&same, &s, &o), Some(Error::BadSensitivity { index: 7, .. })));
    let mut bad = Options::with_codewords(0);
    assert!(matches!(train(&same, &[1.0; 100], &bad), Some(Error::TooManyCodewords { count: 0 })));
    bad.codewords = vq::MAX_CODEWORDS + 1;
    assert!(matches!(train(&same, &[1.0; 100], &bad), Some(Error::TooManyCodewords { .. })));
    assert!(matches!(codebook.decode(1), Err(Error::BadIndex { index: 1, length: 1 })));
    assert!(codebook.distortion(&same, &[1.0; 100], &[1; 100]).is_err());
    // Everything kept: nothing to cluster.
    let (all, _) = cloud(50, 2);
    let mut keep = Options::with_codewords(4);
    keep.keep = Keep::Above(0.5);
    assert!(Codebook::train(&all, &[1.0; 50], &keep).unwrap().len() > 40);
}

/// docs/accuracy.md: for every shape and every codeword, the distance of the roots of their
/// covariances is within this bound, and the standard deviation in no direction differs by more.
#[test]
fn no_codeword_is_further_than_the_bound() {
    let needle = |q: [f32; 4]| Covariance::split(q, [0.0, -9.0, -9.0]).unwrap().0;
    let half = std::f32::consts::FRAC_1_SQRT_2;
    let axes = [[1.0, 0.0, 0.0, 0.0], [half, 0.0, 0.0, half], [half, 0.0, half, 0.0]];
    let mut shapes = cloud(500, 3).0;
    shapes.extend(axes.map(needle));
    shapes.push(Covariance::split([1.0; 4], [0.0, 0.0, -20.0]).unwrap().0);
    shapes.push(Covariance::split([1.0; 4], [0.0; 3]).unwrap().0);
    let mut keep = options(64, Metric::SquareRoot);
    keep.keep = Keep::Above(0.9);
    let mut sensitivities = vec![0.1; shapes.len()];
    sensitivities[500..].fill(1.0);
    let book = Codebook::train(&shapes, &sensitivities, &keep).unwrap();
    let bound = 2.0 + book.trace_tolerance();
    assert!(bound <= 2.04, "docs/accuracy.md says 2.04, not {bound}");
    let deviation = |e: [f64; 6], u: [f64; 3]| {
        let [xx, xy, xz, yy, yz, zz] = e;
        let [x, y, z] = u;
        let v = xx * x * x + yy * y * y + zz * z * z;
        (v + 2.0 * (xy * x * y + xz * x * z + yz * y * z)).max(0.0).sqrt()
    };
    let mut worst = 0.0f64;
    for shape in &shapes {
        for index in 0..book.len() as u32 {
            let fit = book.distortion(&[*shape], &[1.0], &[index]).unwrap();
            let square = fit.mean;
            assert!(square <= bound, "{shape:?}, codeword {index}: {square}");
            worst = worst.max(square);
            let codeword = book.covariance(index).unwrap();
            let d = square.sqrt() + 1e-3;
            for u in [[1.0, 0.0, 0.0], [0.0, 0.6, 0.8], [0.48, 0.6, 0.64]] {
                let (a, b) = (deviation(shape.entries(), u), deviation(codeword.entries(), u));
                assert!((a - b).abs() <= d, "{shape:?}, codeword {index}: {a} {b}");
            }
        }
    }
    assert!(worst > 1.95, "needles at right angles should come near the bound: {worst}");
}
