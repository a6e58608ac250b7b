//! Every coder gives back what it was given.

use gpcc_lite::attribute::{self, Options};
use gpcc_lite::coeffs::{self, Mode};
use gpcc_lite::predict::{
    Lifting, Neighbours, decode_lifting, decode_lossless, encode_lifting, encode_lossless,
};
use gpcc_lite::quant::Step;
use gpcc_lite::raht::Plan;
use gpcc_lite::{Leaf, Limits, geometry, rlgr};
use proptest::prelude::*;

mod common;
use common::{any_leaves, channel, shapes};

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn geometry_is_lossless((leaves, j) in any_leaves()) {
        for encode in [geometry::encode, geometry::encode_fast] {
            let bytes = encode(&leaves, j).unwrap();
            let back = geometry::decode(&bytes, &Limits { max_points: leaves.len() }).unwrap();
            prop_assert_eq!(&back.leaves, &leaves);
            prop_assert_eq!(back.j_high, j);
        }
    }

    #[test]
    fn level_of_detail_is_the_tree_cut((leaves, j) in any_leaves(), d in 0u8..=21) {
        let bytes = geometry::encode(&leaves, j).unwrap();
        let back = geometry::decode_lod(&bytes, d, &Limits { max_points: leaves.len() }).unwrap();
        let target = d.min(j);
        let mut want: Vec<Leaf> = leaves
            .iter()
            .map(|l| Leaf { morton: l.morton >> (3 * (j - target)), depth: l.depth.min(target) })
            .collect();
        want.dedup();
        prop_assert_eq!(back.leaves, want);
        prop_assert_eq!(back.j_high, target);
    }

    #[test]
    fn coefficients_are_lossless((leaves, j) in any_leaves(), seed: u64, kinds in prop::collection::vec(any::<u8>(), 0..10)) {
        let plan = Plan::new(&leaves, j).unwrap();
        let channels: Vec<Vec<i32>> = kinds.iter().map(|&k| channel(leaves.len(), seed, k)).collect();
        let refs: Vec<&[i32]> = channels.iter().map(Vec::as_slice).collect();
        for mode in [Mode::Range, Mode::Symbols, Mode::Rlgr, Mode::RlgrMalvar] {
            let bytes = coeffs::encode(&plan, &refs, mode).unwrap();
            prop_assert!(bytes.len() <= 1 + 4 * leaves.len() * channels.len());
            prop_assert_eq!(&coeffs::decode(&plan, &bytes, channels.len()).unwrap(), &channels);
        }
    }

    #[test]
    fn lossless_prediction_is_lossless((leaves, j) in any_leaves(), seed: u64, kinds in prop::collection::vec(any::<u8>(), 0..4)) {
        let near = Neighbours::new(&leaves, j).unwrap();
        let channels: Vec<Vec<i32>> = kinds.iter().map(|&k| channel(leaves.len(), seed, k)).collect();
        let refs: Vec<&[i32]> = channels.iter().map(Vec::as_slice).collect();
        let bytes = encode_lossless(&near, &refs).unwrap();
        prop_assert_eq!(decode_lossless(&near, &bytes, channels.len()).unwrap(), channels);
    }

    #[test]
    fn attribute_decoder_agrees_with_encoder((leaves, j) in any_leaves(), seed: u64, kind: u8, qp in 4u8..52, channels in 1usize..10) {
        let plan = Plan::new(&leaves, j).unwrap();
        let c = channel(leaves.len(), seed, kind);
        let (refs, steps) = (vec![c.as_slice(); channels], vec![Step::from_qp(qp); channels]);
        let coded = attribute::encode(&plan, &refs, &steps, &Options::default()).unwrap();
        let back = attribute::decode(&plan, &coded.bytes, channels).unwrap();
        prop_assert_eq!(&back, &coded.reconstruction);
    }

    #[test]
    fn raht_fixed_inverts((leaves, j) in any_leaves(), seed: u64, kind: u8) {
        let plan = Plan::new(&leaves, j).unwrap();
        let c = channel(leaves.len(), seed, kind);
        let mut v: Vec<i64> = c.iter().map(|&v| i64::from(v) << 12).collect();
        let before: f64 = v.iter().map(|&x| (x as f64) * (x as f64)).sum();
        plan.forward_fixed(&mut v).unwrap();
        let after: f64 = v.iter().map(|&x| (x as f64) * (x as f64)).sum();
        prop_assert!((before.sqrt() - after.sqrt()).abs() <= 1e-8 * before.sqrt() + 1e3);
        plan.inverse_fixed(&mut v).unwrap();
        // The factors have 30 bits: relative to the greatest value, 63 merges of 2^-30 each.
        let scale = c.iter().map(|v| v.unsigned_abs()).max().unwrap_or(0) as f64;
        for (a, b) in v.iter().zip(&c) {
            let e = (*a as f64 / 4096.0 - f64::from(*b)).abs();
            prop_assert!(e < 0.02 + scale * 1e-7, "{} {} {}", a, b, e);
        }
    }

    #[test]
    fn rlgr_is_lossless(values in prop::collection::vec(prop_oneof![Just(0i32), -3i32..3, any::<i32>(), Just(i32::MIN)], 0..400)) {
        for p in [rlgr::Params::MALVAR, rlgr::Params::REMOTE_FX, rlgr::Params::STEADY] {
            let bytes = rlgr::encode(&values, &p);
            prop_assert_eq!(&rlgr::decode(&bytes, values.len(), &p).unwrap(), &values);
        }
    }

    #[test]
    fn lifting_inverts_exactly((leaves, j) in any_leaves(), seed: u64, kind: u8) {
        let near = Neighbours::coarser(&leaves, j).unwrap();
        let lift = Lifting::new(&near);
        let c: Vec<i64> = channel(leaves.len(), seed, kind).iter().map(|&v| i64::from(v) << 12).collect();
        let mut v = c.clone();
        lift.forward(&mut v).unwrap();
        lift.inverse(&mut v).unwrap();
        prop_assert_eq!(v, c);
    }

    #[test]
    fn lifting_with_small_steps_is_nearly_lossless((leaves, j) in any_leaves(), seed: u64) {
        let near = Neighbours::coarser(&leaves, j).unwrap();
        let lift = Lifting::new(&near);
        let c = channel(leaves.len(), seed, 1);
        let bytes = encode_lifting(&lift, &[&c], &[Step::new(0.05)]).unwrap();
        let back = decode_lifting(&lift, &bytes, 1).unwrap();
        for (a, b) in back[0].iter().zip(&c) {
            prop_assert!((a - b).abs() <= 1, "{} {}", a, b);
        }
    }

    #[test]
    fn weighted_raht_inverts((leaves, j) in any_leaves(), seed: u64, kind in 0u8..2) {
        let weights: Vec<u32> = (0..leaves.len()).map(|i| 1 + (seed.rotate_left(i as u32) % 1000) as u32).collect();
        let plan = Plan::with_weights(&leaves, j, &weights).unwrap();
        let c = channel(leaves.len(), seed, kind);
        let mut v: Vec<i64> = c.iter().map(|&v| i64::from(v) << 12).collect();
        plan.forward_fixed(&mut v).unwrap();
        plan.inverse_fixed(&mut v).unwrap();
        for (a, b) in v.iter().zip(&c) {
            prop_assert!((*a as f64 / 4096.0 - f64::from(*b)).abs() < 0.05);
        }
        let coded = attribute::encode(&plan, &[&c], &[Step::from_qp(16)], &Options::default()).unwrap();
        prop_assert_eq!(attribute::decode(&plan, &coded.bytes, 1).unwrap(), coded.reconstruction);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(100))]

    /// The transform is orthonormal in the weights: the weighted squared error of the values is
    /// that of the coefficients, each of which is off by half a step and a shift at most.
    #[test]
    fn errors_are_those_of_the_coefficients((leaves, j) in any_leaves(), seed: u64, kind in 0u8..2, qp in 4u8..40, channels in 1usize..10, prediction: bool, centres: bool, mode in 0usize..3) {
        let n = leaves.len();
        let weights: Vec<u32> = (0..n).map(|i| 1 + (seed.rotate_left(i as u32) % 1000) as u32).collect();
        let plan = Plan::with_weights(&leaves, j, &weights).unwrap();
        let c: Vec<Vec<i32>> = (0..channels).map(|k| channel(n, seed ^ k as u64, kind)).collect();
        let step = Step::from_qp(qp);
        let mode = [Mode::Range, Mode::Symbols, Mode::Rlgr][mode];
        let o = Options { mode, lambda: 0, prediction, centres, ..Options::default() };
        let fill = |i: usize, row: &mut [f32]| {
            row.iter_mut().zip(&c).for_each(|(v, c)| *v = c[i] as f32);
        };
        let coded = attribute::encode_with(&plan, &vec![step; channels], &o, fill).unwrap();
        let bytes = coded.bytes;
        let mut told = vec![0.0; channels];
        let mut errors = vec![0.0; channels];
        let mut points = 0;
        let read = attribute::decode_with(&plan, &bytes, channels, |i, row| {
            coded.reconstruction.copy(i, &mut told);
            assert_eq!(told, row, "the encoder knows what a decoder reads");
            for ((e, v), c) in errors.iter_mut().zip(row).zip(&c) {
                let d = f64::from(*v) - f64::from(c[i]);
                *e += f64::from(weights[i]) * d * d;
            }
            points += 1;
        });
        prop_assert_eq!((read.unwrap(), points), (channels, n));
        let total: f64 = weights.iter().map(|&w| f64::from(w)).sum();
        for (e, c) in errors.iter().zip(&c) {
            let scale = c.iter().map(|v| f64::from(v.unsigned_abs())).fold(0.0, f64::max);
            let slack = 1e-5 * scale;
            let bound = n as f64 * step.value() * step.value() + total * slack * slack;
            prop_assert!(*e <= bound, "{} {}", e, bound);
        }
    }
}

/// Everything on every odd shape.
#[test]
fn shapes_survive_every_coder() {
    for (name, leaves, j) in shapes() {
        let limits = Limits { max_points: leaves.len() };
        let bytes = geometry::encode(&leaves, j).unwrap();
        assert_eq!(geometry::decode(&bytes, &limits).unwrap().leaves, leaves, "{name}");
        let plan = Plan::new(&leaves, j).unwrap();
        let near = Neighbours::new(&leaves, j).unwrap();
        for kind in 0..4 {
            let c = channel(leaves.len(), 99, kind);
            let d = channel(leaves.len(), 7, kind);
            let bytes = encode_lossless(&near, &[&c, &d]).unwrap();
            assert_eq!(
                decode_lossless(&near, &bytes, 2).unwrap(),
                [c.clone(), d.clone()],
                "{name}"
            );
            for mode in [Mode::Range, Mode::Symbols, Mode::Rlgr] {
                for prediction in [false, true] {
                    let o = Options { mode, prediction, ..Options::default() };
                    let steps = [Step::from_qp(22); 4];
                    let coded = attribute::encode(&plan, &[&c, &d, &c, &d], &steps, &o).unwrap();
                    let back = attribute::decode(&plan, &coded.bytes, 4).unwrap();
                    assert_eq!(back, coded.reconstruction, "{name} {kind} {mode:?}");
                    let o = Options { by_means: true, ..o };
                    let coded = attribute::encode(&plan, &[&c], &steps[..1], &o).unwrap();
                    let back = attribute::decode(&plan, &coded.bytes, 1).unwrap();
                    assert_eq!(back, coded.reconstruction, "{name} {kind} {mode:?} alone");
                }
            }
        }
    }
}

/// Where nodes have the mean that a quarter of all values have, their children have it too: a
/// channel coded by means takes fewer bytes.
#[test]
fn values_at_a_bound_are_cheap() {
    let leaves: Vec<Leaf> = (0..8000u64).map(|i| Leaf { morton: i * 9, depth: 8 }).collect();
    let plan = Plan::new(&leaves, 8).unwrap();
    let noise = channel(leaves.len(), 3, 1);
    let c: Vec<i32> = (0..leaves.len())
        .map(|i| if i / 64 % 4 == 0 { 20 } else { 20 + noise[i].rem_euclid(200) })
        .collect();
    let o = Options { prediction: false, by_means: true, ..Options::default() };
    let steps = [Step::from_qp(28); 2];
    let alone = attribute::encode(&plan, &[&c], &steps[..1], &o).unwrap();
    let o = Options { by_means: false, ..o };
    let without = attribute::encode(&plan, &[&c], &steps[..1], &o).unwrap();
    let squares = |v: &[i32]| -> i64 {
        v.iter().zip(&c).map(|(a, b)| i64::from(a - b) * i64::from(a - b)).sum()
    };
    let (a, b) = (squares(&alone.reconstruction[0]), squares(&without.reconstruction[0]));
    let (bytes, more) = (alone.bytes.len(), without.bytes.len());
    assert!(a * 100 < b * 103 && bytes * 100 < more * 97, "{bytes} {more}, {a} {b}");
    assert_eq!(attribute::decode(&plan, &alone.bytes, 1).unwrap(), alone.reconstruction);
}

/// A constant costs next to nothing and comes back exactly.
#[test]
fn constants_are_almost_free() {
    let (_, leaves, j) = shapes().pop().unwrap();
    let plan = Plan::new(&leaves, j).unwrap();
    let c = vec![200; leaves.len()];
    let coded = attribute::encode(&plan, &[&c], &[Step::from_qp(16)], &Options::default()).unwrap();
    assert!(coded.bytes.len() < 40, "{}", coded.bytes.len());
    assert_eq!(coded.reconstruction[0], c);
}

#[test]
fn bytes_do_not_depend_on_threads() {
    let leaves: Vec<Leaf> = (0..2000u64).map(|i| Leaf { morton: i * i * 7, depth: 9 }).collect();
    let near = Neighbours::new(&leaves, 9).unwrap();
    let channels: Vec<Vec<i32>> = (0..6).map(|k| channel(leaves.len(), 5, k)).collect();
    let refs: Vec<&[i32]> = channels.iter().map(Vec::as_slice).collect();
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| encode_lossless(&near, &refs).unwrap())
    };
    assert_eq!(run(1), run(2));
    assert_eq!(run(1), run(8));
}

/// Eight-bit values stored in sixteen bits: the palette must find them.
#[test]
fn gaps_are_closed_by_a_palette() {
    let leaves: Vec<Leaf> = (0..4000u64).map(|i| Leaf { morton: i, depth: 4 }).collect();
    let leaves = &leaves[..4000];
    let near = Neighbours::new(leaves, 4).unwrap();
    let narrow: Vec<i32> = channel(4000, 3, 1).iter().map(|v| v.rem_euclid(60)).collect();
    let wide: Vec<i32> = narrow.iter().map(|v| v * 1021 - 30_000).collect();
    let a = encode_lossless(&near, &[&narrow]).unwrap().len();
    let b = encode_lossless(&near, &[&wide]).unwrap();
    assert!(b.len() < a + 200, "{} {a}", b.len());
    assert_eq!(decode_lossless(&near, &b, 1).unwrap()[0], wide);
}
