//! Bounds on errors: every decoded Gaussian is one of the model's, within the bounds.
#![cfg(feature = "encode")]

mod common;

use common::{room, scene, trained_scene};
use gs_model::Scene;
use gsvx::covariance::coordinates;
use gsvx::{Aim, EncodeOptions, EncodedStream, Encoder, Error, Kind, MaxError, decode};
use proptest::prelude::*;

fn bounded(scene: &Scene, bounds: MaxError) -> EncodedStream {
    Encoder::new(Aim::MaxError(bounds)).encode(scene, None).unwrap().encoded
}

/// Whether Gaussian `k` of `b` may stand for Gaussian `i` of `a`.
fn within(a: &Scene, i: usize, b: &Scene, k: usize, bounds: &MaxError) -> bool {
    // What rounding the measured error to f32 hides.
    let at_most = |error: f64, bound: f32| error <= f64::from(bound) * (1.0 + 1e-6);
    let distance = |p: &[f32], q: &[f32]| {
        let differences = p.iter().zip(q).map(|(x, y)| f64::from(*x) - f64::from(*y));
        differences.map(|d| d * d).sum::<f64>().sqrt()
    };
    let longest = a.log_scales[i].iter().copied().fold(f32::NEG_INFINITY, f32::max);
    let alpha = |logit: f32| 1.0 / (1.0 + libm::exp(-f64::from(logit)));
    let shape = |s: &Scene, j: usize| coordinates(s.rotations[j], s.log_scales[j]);
    let sh = |s: &Scene, j: usize, c: usize| s.sh_of(j).get(c).copied().unwrap_or_default();
    let coefficients = a.sh_len().max(b.sh_len());
    let mean = distance(&a.means[i], &b.means[k]);
    (mean == 0.0 || at_most(mean / libm::exp(f64::from(longest)), bounds.mean))
        && at_most((alpha(a.opacity_logits[i]) - alpha(b.opacity_logits[k])).abs(), bounds.opacity)
        && at_most(distance(&shape(a, i), &shape(b, k)), bounds.shape)
        && (0..coefficients).all(|c| {
            let (x, y) = (sh(a, i, c), sh(b, k, c));
            (0..3).all(|rgb| at_most((f64::from(x[rgb]) - f64::from(y[rgb])).abs(), bounds.sh))
        })
}

/// Finds for every Gaussian of `a` one of `b` of its own, within the bounds. Returns how many have none.
fn unmatched(a: &Scene, b: &Scene, bounds: &MaxError) -> usize {
    let mut by_x: Vec<usize> = (0..b.len()).collect();
    by_x.sort_by(|&p, &q| b.means[p][0].total_cmp(&b.means[q][0]));
    let edges: Vec<Vec<usize>> = (0..a.len())
        .map(|i| {
            let longest = a.log_scales[i].iter().copied().fold(f32::NEG_INFINITY, f32::max);
            let reach = f64::from(bounds.mean) * libm::exp(f64::from(longest)) * (1.0 + 1e-6);
            let x = f64::from(a.means[i][0]);
            let from = by_x.partition_point(|&k| f64::from(b.means[k][0]) < x - reach);
            let near = by_x[from..].iter().take_while(|&&k| f64::from(b.means[k][0]) <= x + reach);
            near.copied().filter(|&k| within(a, i, b, k, bounds)).collect()
        })
        .collect();
    let mut taken: Vec<Option<usize>> = vec![None; b.len()];
    (0..a.len()).filter(|&i| !augment(i, &edges, &mut taken, &mut Vec::new())).count()
}

/// Finds a partner for Gaussian `i` along an augmenting path of the bipartite matching.
fn augment(
    i: usize,
    edges: &[Vec<usize>],
    taken: &mut [Option<usize>],
    tried: &mut Vec<usize>,
) -> bool {
    for &k in &edges[i] {
        if tried.contains(&k) {
            continue;
        }
        tried.push(k);
        if taken[k].is_none_or(|other| augment(other, edges, taken, tried)) {
            taken[k] = Some(i);
            return true;
        }
    }
    false
}

fn check(scene: &Scene, bounds: MaxError) -> EncodedStream {
    let encoded = bounded(scene, bounds);
    let decoded = decode(&encoded.bytes).unwrap();
    assert_eq!(decoded.len(), scene.len(), "nothing is merged, nothing is left out");
    assert_eq!(unmatched(scene, &decoded, &bounds), 0, "{bounds:?}");
    // The reported errors hold too.
    let told = encoded.max_error.expect("errors have been measured");
    assert!(told.mean <= bounds.mean && told.opacity <= bounds.opacity);
    assert!(told.shape <= bounds.shape && told.sh <= bounds.sh);
    assert_eq!(unmatched(scene, &decoded, &told), 0, "{told:?}");
    encoded
}

fn exact(encoded: &EncodedStream) -> u64 {
    let chunks = encoded.index.chunks.iter();
    chunks.filter(|c| c.kind == Kind::Exact).map(|c| c.count).sum()
}

fn bound() -> impl Strategy<Value = f32> {
    (-10.0f32..-1.0).prop_map(libm::exp2f)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn every_gaussian_is_within_random_bounds(
        n in 1usize..300,
        degree in 0u8..=3,
        seed in 0u64..1000,
        mean in bound(),
        opacity in bound(),
        shape in bound(),
        sh in bound(),
        twins in 0usize..4,
    ) {
        let mut scene = scene(n, degree, seed);
        // Gaussians at one place, some of them equal.
        for t in 0..twins.min(n) {
            let (from, to) = (t % n, n - 1 - t);
            scene.means[to] = scene.means[from];
        }
        check(&scene, MaxError { mean, opacity, shape, sh });
    }
}

#[test]
fn bounds_are_kept_where_quality_100_breaks_them() {
    let scene = room();
    let best = gsvx::encode(&scene, None, 100.0, &EncodeOptions::default()).unwrap();
    let decoded = decode(&best.bytes).unwrap();
    let loose = MaxError { mean: 1.0, opacity: 0.05, shape: 0.5, sh: 0.2 };
    assert!(unmatched(&scene, &decoded, &loose) > 0, "the best quality has no bounds");
    let mut last = 0;
    for error in [0.1, 0.01, 0.001] {
        let encoded = check(&scene, MaxError::all(error));
        assert!(encoded.bytes.len() > last, "{error}");
        last = encoded.bytes.len();
        let share = exact(&encoded) as f64 / scene.len() as f64;
        assert!(error < 0.01 || share < 0.03, "{error}: {share} of the Gaussians are exact");
    }
    let lossless = gsvx::encode_lossless(&scene, false).unwrap();
    assert!(last < lossless.bytes.len());
}

#[test]
fn a_trained_scene_keeps_its_bounds() {
    let bounds = MaxError { mean: 0.02, opacity: 0.01, shape: 0.03, sh: 0.01 };
    check(&testing::leica(), bounds);
    if let Some(fox) = trained_scene("scenes/fox/point_cloud.ply") {
        check(&fox, bounds);
    }
}

#[test]
fn scenes_that_no_octree_holds_are_exact() {
    let tight = MaxError::all(1e-6);
    check(&scene(0, 0, 1), tight);
    for n in [1, 2, 40] {
        // All at one place.
        let mut one = scene(n, 1, 5);
        one.means = vec![[3.0, -2.0, 0.5]; n];
        let encoded = check(&one, MaxError::all(0.01));
        assert!(exact(&encoded) + 1 >= n as u64);
        check(&one, tight);
    }
    // Points without size, and Gaussians so far apart that a cube has no cells for them.
    let mut wide = scene(60, 0, 6);
    wide.log_scales[7] = [-300.0; 3];
    wide.means[9] = [1e20, 0.0, -1e20];
    wide.opacity_logits[11] = 60.0;
    wide.opacity_logits[12] = -60.0;
    check(&wide, MaxError::all(0.01));
    check(&wide, MaxError { opacity: 1e-5, ..MaxError::all(0.5) });
}

#[test]
fn a_bound_that_no_number_holds_is_refused() {
    for bad in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        let aim = Aim::MaxError(MaxError { shape: bad, ..MaxError::all(0.01) });
        let error = Encoder::new(aim).encode(&scene(3, 0, 1), None).unwrap_err();
        assert!(matches!(error, Error::Option { option: "bound on the shape", .. }), "{error}");
    }
}

#[test]
fn other_options_keep_their_meaning() {
    let scene = scene(900, 3, 2);
    let encode = || {
        let mut encoder = Encoder::new(Aim::MaxError(MaxError::all(0.01)));
        (encoder.options.code.max_sh_degree, encoder.options.code.lod) = (1, true);
        encoder.encode(&scene, None).unwrap().encoded
    };
    let encoded = encode();
    let mut less = scene.clone();
    less.cut_sh(1);
    let decoded = decode(&encoded.bytes).unwrap();
    assert_eq!(decoded.sh_degree, 1);
    assert!(encoded.index.coarsest_lod() > 0);
    assert_eq!(unmatched(&less, &decoded, &MaxError::all(0.01)), 0);
    // The same bytes for any number of threads.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
    assert_eq!(pool.install(encode), encoded);
}
