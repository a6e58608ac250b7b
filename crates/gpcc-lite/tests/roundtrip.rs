//! Every coder gives back what it was given.

use gpcc_lite::attribute::{self, Options};
use gpcc_lite::coeffs::{self, Mode};
use gpcc_lite::predict::{Neighbours, decode_lossless, encode_lossless};
use gpcc_lite::quant::Step;
use gpcc_lite::raht::Plan;
use gpcc_lite::{Leaf, Limits, geometry, rlgr};
use proptest::prelude::*;

/// Leaves from arbitrary codes and depths: sorted, overlapping ones dropped.
fn leaves_from(codes: &[(u64, u8)], j_high: u8) -> Vec<Leaf> {
    let mut cells: Vec<Leaf> = codes
        .iter()
        .map(|&(code, depth)| {
            let depth = depth % (j_high + 1);
            let cut = 3 * (j_high - depth);
            let code = if j_high == 0 { 0 } else { code & ((1u64 << (3 * j_high)) - 1) };
            Leaf { morton: code >> cut << cut, depth }
        })
        .collect();
    cells.sort();
    let mut end = 0u64;
    cells.retain(|l| {
        let keep = l.morton >= end;
        if keep {
            end = l.morton + (1u64 << (3 * (j_high - l.depth)));
        }
        keep
    });
    cells
}

fn any_leaves() -> impl Strategy<Value = (Vec<Leaf>, u8)> {
    let deep = (1u8..=21, prop::collection::vec((any::<u64>(), any::<u8>()), 0..300));
    let dense = (1u8..=4, prop::collection::vec((any::<u64>(), any::<u8>()), 0..900));
    prop_oneof![deep, dense, (Just(0u8), prop::collection::vec((Just(0u64), any::<u8>()), 0..3))]
        .prop_flat_map(|(j, codes)| (Just(j), Just(codes), any::<bool>()))
        .prop_map(|(j, codes, uniform)| {
            let codes: Vec<_> =
                codes.into_iter().map(|(c, d)| (c, if uniform { j } else { d })).collect();
            (leaves_from(&codes, j), j)
        })
}

fn channel(n: usize, seed: u64, kind: u8) -> Vec<i32> {
    let mut s = seed | 1;
    (0..n)
        .map(|_| {
            s ^= s << 13;
            s ^= s >> 7;
            s ^= s << 17;
            match kind % 4 {
                0 => 7,
                1 => (s as i32) % 200,
                2 => s as i32,
                _ => [i32::MIN, i32::MAX, 0][(s % 3) as usize],
            }
        })
        .collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn geometry_is_lossless((leaves, j) in any_leaves()) {
        let bytes = geometry::encode(&leaves, j).unwrap();
        let back = geometry::decode(&bytes, &Limits { max_points: leaves.len() }).unwrap();
        prop_assert_eq!(back.leaves, leaves);
        prop_assert_eq!(back.j_high, j);
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
    fn coefficients_are_lossless((leaves, j) in any_leaves(), seed: u64, kinds in prop::collection::vec(any::<u8>(), 0..4)) {
        let plan = Plan::new(&leaves, j).unwrap();
        let channels: Vec<Vec<i32>> = kinds.iter().map(|&k| channel(leaves.len(), seed, k)).collect();
        let refs: Vec<&[i32]> = channels.iter().map(Vec::as_slice).collect();
        for mode in [Mode::Range, Mode::Rlgr, Mode::RlgrMalvar] {
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
    fn attribute_decoder_agrees_with_encoder((leaves, j) in any_leaves(), seed: u64, kind: u8, qp in 4u8..52) {
        let plan = Plan::new(&leaves, j).unwrap();
        let c = channel(leaves.len(), seed, kind);
        let coded = attribute::encode(&plan, &[&c, &c], &[Step::from_qp(qp); 2], &Options::default()).unwrap();
        let back = attribute::decode(&plan, &coded.bytes, 2).unwrap();
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
        for p in [rlgr::Params::MALVAR, rlgr::Params::REMOTE_FX] {
            let bytes = rlgr::encode(&values, &p);
            prop_assert_eq!(&rlgr::decode(&bytes, values.len(), &p).unwrap(), &values);
        }
    }
}
