//! Slow forms of RLGR and the neighbour search, compared with the fast ones.

mod common;

use common::any_octree;
use gpcc_lite::morton;
use gpcc_lite::paper::predict::{MAX_NEIGHBOURS, Neighbours};
use gpcc_lite::paper::rlgr;
use proptest::prelude::*;

/// RLGR on a list of bits, one step at a time.
fn rlgr_bits(values: &[i32]) -> Vec<u8> {
    let l = 8;
    let (mut kp, mut krp) = (0u32, 2 * l);
    let mut bits: Vec<bool> = Vec::new();
    let put = |bits: &mut Vec<bool>, v: u64, n: u32| {
        (0..n).rev().for_each(|i| bits.push(v >> i & 1 == 1));
    };
    let rice = |bits: &mut Vec<bool>, u: u32, krp: &mut u32| {
        let k = *krp / l;
        let q = u >> k;
        if q >= 32 {
            put(bits, u64::from(u32::MAX), 32);
            put(bits, u64::from(u), 32);
            *krp = (*krp + 32).min(192);
            return;
        }
        (0..q).for_each(|_| bits.push(true));
        bits.push(false);
        put(bits, u64::from(u), k);
        *krp = match q {
            0 => krp.saturating_sub(2),
            1 => *krp,
            _ => (*krp + q).min(192),
        };
    };
    let unsigned = |v: i32| if v < 0 { (!(v as u32)) * 2 + 1 } else { (v as u32) * 2 };
    let mut i = 0;
    while i < values.len() {
        let k = kp / l;
        if k == 0 {
            let u = unsigned(values[i]);
            rice(&mut bits, u, &mut krp);
            kp = if u == 0 { (kp + 3).min(80) } else { kp.saturating_sub(3) };
            i += 1;
            continue;
        }
        let zeros = values[i..].iter().take(1 << k).take_while(|&&v| v == 0).count();
        if zeros == 1 << k || i + zeros == values.len() {
            bits.push(false);
            kp = (kp + 4).min(80);
            i += zeros;
        } else {
            bits.push(true);
            put(&mut bits, zeros as u64, k);
            rice(&mut bits, unsigned(values[i + zeros]) - 1, &mut krp);
            kp = kp.saturating_sub(6);
            i += zeros + 1;
        }
    }
    let byte = |c: &[bool]| c.iter().enumerate().fold(0, |b, (i, &x)| b | u8::from(x) << (7 - i));
    bits.chunks(8).map(byte).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(100))]

    #[test]
    fn rlgr_agrees_bit_by_bit(values in prop::collection::vec(prop_oneof![Just(0i32), Just(0i32), -3i32..3, any::<i32>()], 0..300)) {
        prop_assert_eq!(rlgr::encode(&values), rlgr_bits(&values));
    }

    #[test]
    fn neighbours_agree_with_a_sorted_list(tree in any_octree()) {
        let near = Neighbours::new(&tree);
        let mut seen = vec![false; tree.len()];
        let (leaves, j) = (tree.leaves(), tree.depth());
        let centre = |i: usize| {
            let size = 1i64 << (j - leaves[i].depth);
            morton::decode(leaves[i].morton).map(|v| 2 * i64::from(v) + size)
        };
        for at in 0..near.len() {
            let i = near.order()[at] as usize;
            let (index, distance) = near.of(at);
            prop_assert!(index.len() <= MAX_NEIGHBOURS);
            for (&k, &d) in index.iter().zip(distance) {
                prop_assert!(seen[k as usize], "a neighbour must precede");
                let (a, b) = (centre(i), centre(k as usize));
                let want: i64 = (0..3).map(|k| (a[k] - b[k]).pow(2)).sum();
                prop_assert_eq!(i64::from(d), want.min(i64::from(u32::MAX)));
            }
            prop_assert!(distance.is_sorted());
            // In the finest level the predecessor in Morton order is always a candidate.
            if at >= near.levels()[near.levels().len() - 2] as usize && at > 0 && i > 0 {
                let (a, b) = (centre(i), centre(i - 1));
                let d: i64 = (0..3).map(|k| (a[k] - b[k]).pow(2)).sum();
                prop_assert!(i64::from(distance[0]) <= d);
            }
            seen[i] = true;
        }
        prop_assert!(seen.iter().all(|&s| s));
    }
}
