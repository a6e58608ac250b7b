//! The codebook as its users see it: validity of codewords, exact assignment, determinism.

use gs_model::math::{axes_product, rotation};
use proptest::prelude::*;
use vq::{Codebook, Covariance, Error, MAX_CODEWORDS, MIN_LOG_SCALE, default_sensitivity};

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

/// The square root of a covariance.
fn root(q: [f32; 4], log_scales: [f32; 3]) -> [f64; 6] {
    axes_product(&rotation(q), log_scales.map(|l| libm::exp(f64::from(l))))
}

/// Squared Frobenius norm of the difference.
fn distance(a: [f64; 6], b: [f64; 6]) -> f64 {
    let square = |k: usize| (a[k] - b[k]) * (a[k] - b[k]);
    (0..6).map(|k| if k < 3 { 1.0 } else { 2.0 } * square(k)).sum()
}

fn distances(codebook: &Codebook, covariance: &Covariance) -> Vec<f64> {
    let own = root(covariance.quaternion(), covariance.log_scales());
    let codeword = |i| {
        let (q, log_scales) = codebook.decode(i).unwrap();
        root(q, log_scales)
    };
    (0..codebook.len() as u32).map(|i| distance(own, codeword(i))).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn every_codeword_is_a_covariance_and_comes_back(
        n in 1usize..600, k in 1usize..200, seed: u64,
    ) {
        let (covariances, sensitivities) = cloud(n, seed);
        let codebook = Codebook::train(&covariances, &sensitivities, k).unwrap();
        prop_assert!((1..=k).contains(&codebook.len()));
        for index in 0..codebook.len() as u32 {
            let (q, s) = codebook.decode(index).unwrap();
            let norm: f64 = q.iter().map(|&c| f64::from(c) * f64::from(c)).sum();
            prop_assert!((norm - 1.0).abs() < 1e-6, "{q:?}");
            prop_assert!(s.iter().all(|&l| (MIN_LOG_SCALE..=0.0).contains(&l)), "{s:?}");
            // Half a step of log-scale.
            let trace: f64 = s.iter().map(|&l| libm::exp(2.0 * f64::from(l))).sum();
            prop_assert!((trace - 1.0).abs() <= 1.2 / 32.0);
        }
        prop_assert_eq!(Codebook::from_integers(&codebook.integers()), Ok(codebook));
    }

    #[test]
    fn assignment_is_the_scan_over_all_codewords(n in 2usize..300, k in 1usize..150, seed: u64) {
        let (covariances, sensitivities) = cloud(n, seed);
        let codebook = Codebook::train(&covariances, &sensitivities, k).unwrap();
        for (covariance, index) in covariances.iter().zip(codebook.assign(&covariances)) {
            let all = distances(&codebook, covariance);
            let best = all.iter().copied().fold(f64::INFINITY, f64::min);
            // The search is exact in single precision.
            prop_assert!(all[index as usize] <= best + 1e-6);
        }
    }
}

#[test]
fn any_number_of_threads_gives_the_same_codebook() {
    let (covariances, sensitivities) = cloud(30_000, 4);
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let codebook = Codebook::train(&covariances, &sensitivities, 512).unwrap();
            (codebook.integers(), codebook.assign(&covariances))
        })
    };
    let one = run(1);
    assert_eq!(one, run(2));
    assert_eq!(one, run(8));
}

/// The same integers on every machine: FNV-1a of what a known cloud trains.
#[test]
fn training_has_one_result() {
    let (covariances, sensitivities) = cloud(5000, 6);
    let codebook = Codebook::train(&covariances, &sensitivities, 200).unwrap();
    let indices = codebook.assign(&covariances);
    let integers = codebook.integers().into_iter().flatten();
    let hash = integers
        .chain(indices.iter().map(|&i| i as i32))
        .flat_map(i32::to_le_bytes)
        .fold(0xcbf2_9ce4_8422_2325u64, |h, b| (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3));
    assert_eq!(hash, 11_594_004_756_417_774_917);
}

#[test]
fn distortion_falls_with_more_codewords() {
    let (covariances, sensitivities) = cloud(8000, 12);
    let mut last = f64::INFINITY;
    for k in [16, 64, 256, 1024] {
        let codebook = Codebook::train(&covariances, &sensitivities, k).unwrap();
        let indices = codebook.assign(&covariances);
        let error = |i: usize| distances(&codebook, &covariances[i])[indices[i] as usize];
        let some = (0..8000).step_by(10);
        let distortion: f64 = some.map(|i| f64::from(sensitivities[i]) * error(i)).sum();
        assert!(distortion < 0.75 * last, "{k}: {distortion} {last}");
        last = distortion;
    }
}

#[test]
fn the_sensitive_are_represented_best() {
    let (covariances, mut sensitivities) = cloud(2000, 9);
    sensitivities[500..520].fill(1000.0);
    let codebook = Codebook::train(&covariances, &sensitivities, 64).unwrap();
    let indices = codebook.assign(&covariances);
    let mean = |range: std::ops::Range<usize>| {
        let error = |i: usize| distances(&codebook, &covariances[i])[indices[i] as usize];
        range.clone().map(error).sum::<f64>() / range.len() as f64
    };
    assert!(10.0 * mean(500..520) < mean(0..500), "{} {}", mean(500..520), mean(0..500));
}

#[test]
fn degenerate_data_and_bad_arguments() {
    let one = Covariance::split([1.0, 0.0, 0.0, 0.0], [0.0, -1.0, -2.0]).unwrap().0;
    let same = vec![one; 100];
    let codebook = Codebook::train(&same, &[0.0; 100], 256).unwrap();
    assert_eq!(codebook.len(), 1, "one distinct covariance, one codeword");
    assert_eq!(codebook.assign(&same), vec![0; 100]);
    assert!(matches!(codebook.decode(1), Err(Error::BadIndex { index: 1, length: 1 })));

    let train = |c: &[Covariance], s: &[f32], k| Codebook::train(c, s, k).err();
    assert_eq!(train(&[], &[], 4), Some(Error::BadCount { count: 0 }));
    assert!(matches!(train(&same, &[1.0; 99], 4), Some(Error::LengthMismatch { .. })));
    let mut s = [1.0; 100];
    s[7] = -1.0;
    assert_eq!(train(&same, &s, 4), Some(Error::BadSensitivity { index: 7, value: -1.0 }));
    s[7] = f32::NAN;
    assert!(matches!(train(&same, &s, 4), Some(Error::BadSensitivity { index: 7, .. })));
    for count in [0, MAX_CODEWORDS + 1] {
        assert_eq!(train(&same, &[1.0; 100], count), Some(Error::BadCodewords { count }));
    }
    assert_eq!(Codebook::from_integers(&[]), Err(Error::BadCodewords { count: 0 }));
}
