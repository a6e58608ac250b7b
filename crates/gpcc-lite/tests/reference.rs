//! Slow, obvious forms of the tools, compared with the fast ones.

mod common;

use common::{any_leaves, channel};
use gpcc_lite::predict::{MAX_NEIGHBOURS, Neighbours};
use gpcc_lite::raht::Plan;
use gpcc_lite::range::{BinaryCoder, RangeDecoder, RangeEncoder};
use gpcc_lite::{Leaf, morton, rlgr};
use proptest::prelude::*;

/// RAHT as the paper writes it: bit by bit, neighbours with equal prefixes merge.
/// Returns the DC and, per leaf that starts a right half, its high-pass value.
fn raht(leaves: &[Leaf], weights: &[u32], values: &[f64]) -> (f64, Vec<f64>) {
    struct Node {
        code: u64,
        leaf: usize,
        weight: f64,
        value: f64,
    }
    let mut high = vec![0.0; leaves.len()];
    let mut nodes: Vec<Node> = (0..leaves.len())
        .map(|i| {
            let weight = f64::from(weights[i]);
            Node { code: leaves[i].morton, leaf: i, weight, value: values[i] * weight.sqrt() }
        })
        .collect();
    for _ in 0..63 {
        let mut merged: Vec<Node> = Vec::new();
        for n in nodes {
            let code = n.code >> 1;
            match merged.last_mut() {
                Some(l) if l.code == code => {
                    let (w1, w2) = (l.weight, n.weight);
                    let (a, b) = (l.value, n.value);
                    let root = (w1 + w2).sqrt();
                    high[n.leaf] = (w1.sqrt() * b - w2.sqrt() * a) / root;
                    l.value = (w1.sqrt() * a + w2.sqrt() * b) / root;
                    l.weight = w1 + w2;
                }
                _ => merged.push(Node { code, ..n }),
            }
        }
        nodes = merged;
    }
    (nodes.first().map_or(0.0, |n| n.value), high)
}

/// The inverse in fixed point, node by node from the root: `value` is the low-pass value of leaves
/// `lo..hi`, `high` holds a high-pass value per leaf that starts a right half.
fn raht_fixed_inverse(
    leaves: &[Leaf],
    weights: &[u32],
    high: &[i64],
    (lo, hi, value): (usize, usize, i64),
    out: &mut [i64],
) {
    if hi - lo == 1 {
        let root = (f64::from(weights[lo]).sqrt() * 65536.0) as i64;
        out[lo] = ((i128::from(value) << 16) / i128::from(root)) as i64;
        return;
    }
    let top = 63 - (leaves[lo].morton ^ leaves[hi - 1].morton).leading_zeros();
    let at = (lo..hi).find(|&i| leaves[i].morton >> top & 1 == 1).unwrap();
    let weight = |range: std::ops::Range<usize>| -> f64 {
        weights[range].iter().map(|&w| f64::from(w)).sum()
    };
    let (left, right) = (weight(lo..at), weight(at..hi));
    let factor = |w: f64| ((w / (left + right)).sqrt() * f64::from(1 << 30) + 0.5) as i128;
    let (c, s) = (factor(left), factor(right));
    let (a, b) = (i128::from(value), i128::from(high[at]));
    let round = |v: i128| ((v + (1 << 29)) >> 30) as i64;
    raht_fixed_inverse(leaves, weights, high, (lo, at, round(c * a - s * b)), out);
    raht_fixed_inverse(leaves, weights, high, (at, hi, round(s * a + c * b)), out);
}

/// RLGR on a list of bits, one step at a time.
fn rlgr_bits(values: &[i32], p: &rlgr::Params) -> Vec<u8> {
    let l = 1u32 << p.l_log2;
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
            *krp = (*krp + 32).min(p.k_rp_max);
            return;
        }
        (0..q).for_each(|_| bits.push(true));
        bits.push(false);
        put(bits, u64::from(u), k);
        *krp = match q {
            0 => krp.saturating_sub(2),
            1 => *krp,
            _ => (*krp + q).min(p.k_rp_max),
        };
    };
    let unsigned = |v: i32| if v < 0 { (!(v as u32)) * 2 + 1 } else { (v as u32) * 2 };
    let mut i = 0;
    while i < values.len() {
        let k = kp / l;
        if k == 0 {
            let u = unsigned(values[i]);
            rice(&mut bits, u, &mut krp);
            kp = if u == 0 { (kp + p.u0).min(p.k_p_max) } else { kp.saturating_sub(p.d0) };
            i += 1;
            continue;
        }
        let zeros = values[i..].iter().take(1 << k).take_while(|&&v| v == 0).count();
        if zeros == 1 << k || i + zeros == values.len() {
            bits.push(false);
            kp = (kp + p.u1).min(p.k_p_max);
            i += zeros;
        } else {
            bits.push(true);
            put(&mut bits, zeros as u64, k);
            rice(&mut bits, unsigned(values[i + zeros]) - 1, &mut krp);
            kp = kp.saturating_sub(p.d1);
            i += zeros + 1;
        }
    }
    let byte = |c: &[bool]| c.iter().enumerate().fold(0, |b, (i, &x)| b | u8::from(x) << (7 - i));
    bits.chunks(8).map(byte).collect()
}

#[allow(clippy::disallowed_methods, reason = "measures a stream, makes none")]
fn log2(x: f64) -> f64 {
    x.log2()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(100))]

    #[test]
    fn raht_agrees_with_the_paper((leaves, j) in any_leaves(), seed: u64, weighted: bool) {
        let n = leaves.len();
        let weights: Vec<u32> =
            (0..n).map(|i| if weighted { 1 + (seed.rotate_left(i as u32) & 255) as u32 } else { 1 }).collect();
        let plan = Plan::with_weights(&leaves, j, &weights).unwrap();
        let values = channel(n, seed, 1);
        let exact: Vec<f64> = values.iter().map(|&v| f64::from(v)).collect();
        let (dc, high) = raht(&leaves, &weights, &exact);
        let mut f64s = exact.clone();
        plan.forward_f64(&mut f64s).unwrap();
        let mut f32s: Vec<f32> = exact.iter().map(|&v| v as f32).collect();
        plan.forward_f32(&mut f32s).unwrap();
        let mut fixed: Vec<i64> = values.iter().map(|&v| i64::from(v) << 12).collect();
        plan.forward_fixed(&mut fixed).unwrap();
        for k in 0..n {
            let want = if k == 0 { dc } else { high[plan.split_leaf(k)] };
            let scale = 1.0 + want.abs();
            prop_assert!((f64s[k] - want).abs() < 1e-9 * scale, "{} {} {}", k, f64s[k], want);
            prop_assert!((f64::from(f32s[k]) - want).abs() < 2e-2 * scale);
            prop_assert!((fixed[k] as f64 / 4096.0 - want).abs() < 2e-3 * scale);
        }
        plan.inverse_f64(&mut f64s).unwrap();
        plan.inverse_f32(&mut f32s).unwrap();
        for i in 0..n {
            prop_assert!((f64s[i] - exact[i]).abs() < 1e-9);
            prop_assert!((f64::from(f32s[i]) - exact[i]).abs() < 1e-2);
        }
    }

    #[test]
    fn the_fixed_point_inverse_agrees_bit_by_bit((leaves, j) in any_leaves(), seed: u64, weighted: bool) {
        let n = leaves.len();
        let weights: Vec<u32> =
            (0..n).map(|i| if weighted { 1 + (seed.rotate_left(i as u32) & 255) as u32 } else { 1 }).collect();
        let plan = Plan::with_weights(&leaves, j, &weights).unwrap();
        // Any coefficients, not only those of a forward transform.
        let mut v: Vec<i64> = channel(n, seed, 2).iter().map(|&v| i64::from(v) << 4).collect();
        let mut want = vec![0; n];
        if n > 0 {
            let mut high = vec![0; n];
            (1..n).for_each(|k| high[plan.split_leaf(k)] = v[k]);
            raht_fixed_inverse(&leaves, &weights, &high, (0, n, v[0]), &mut want);
        }
        plan.inverse_fixed(&mut v).unwrap();
        prop_assert_eq!(v, want);
    }

    #[test]
    fn coefficients_run_coarse_to_fine((leaves, j) in any_leaves()) {
        let plan = Plan::new(&leaves, j).unwrap();
        let bit = |k: usize| {
            let r = plan.split_leaf(k);
            63 - (leaves[r - 1].morton ^ leaves[r].morton).leading_zeros()
        };
        for (depth, level) in plan.levels().windows(2).enumerate() {
            for k in level[0] as usize..level[1] as usize {
                prop_assert_eq!(bit(k) / 3, u32::from(j) - 1 - depth as u32);
                prop_assert_eq!(u32::from(plan.axes()[k - 1]), 2 - bit(k) % 3);
                let parent = plan.parent(k);
                prop_assert!(parent < k);
                prop_assert!(parent == 0 || bit(parent) > bit(k));
            }
        }
    }

    #[test]
    fn rlgr_agrees_bit_by_bit(values in prop::collection::vec(prop_oneof![Just(0i32), Just(0i32), -3i32..3, any::<i32>()], 0..300)) {
        for p in [rlgr::Params::MALVAR, rlgr::Params::REMOTE_FX, rlgr::Params::STEADY] {
            prop_assert_eq!(rlgr::encode(&values, &p), rlgr_bits(&values, &p));
        }
    }

    #[test]
    fn range_coder_keeps_its_promise(decisions in prop::collection::vec((1u32..=65535, any::<u16>(), any::<bool>()), 0..2000)) {
        // Each bit is drawn with its own probability, or adversarially.
        let bits: Vec<(u32, bool)> =
            decisions.iter().map(|&(p, r, bad)| (p, if bad { p < 32768 } else { u32::from(r) < p })).collect();
        let mut enc = RangeEncoder::new();
        let mut ideal = 0.0;
        for &(p, bit) in &bits {
            enc.code(p, bit);
            enc.code_raw_wide(p, 17);
            let q = f64::from(p) / 65536.0;
            ideal += 17.0 - log2(if bit { q } else { 1.0 - q });
        }
        let bytes = enc.finish();
        prop_assert!(bytes.len() as f64 * 8.0 <= ideal * 1.001 + 72.0, "{} {}", bytes.len() * 8, ideal);
        let mut dec = RangeDecoder::new(&bytes);
        for &(p, bit) in &bits {
            prop_assert_eq!(dec.code(p, false), bit);
            prop_assert_eq!(dec.code_raw_wide(0, 17), p);
        }
        prop_assert!(!dec.exhausted());
    }

    #[test]
    fn neighbours_agree_with_a_sorted_list((leaves, j) in any_leaves()) {
        let near = Neighbours::new(&leaves, j).unwrap();
        let mut seen = vec![false; leaves.len()];
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

/// The same numbers on every machine: FNV-1a of what a known cloud gives, both ways.
#[test]
fn the_fixed_point_transform_has_one_result() {
    let mut leaves: Vec<Leaf> =
        (0..5000u64).map(|i| Leaf { morton: i * i * 7919 % (1 << 36), depth: 12 }).collect();
    leaves.sort();
    leaves.dedup();
    let plan = Plan::new(&leaves, 12).unwrap();
    let mut v: Vec<i64> = channel(leaves.len(), 5, 2).iter().map(|&v| i64::from(v) << 12).collect();
    let hash = |v: &[i64]| {
        v.iter().flat_map(|v| v.to_le_bytes()).fold(0xcbf2_9ce4_8422_2325u64, |h, b| {
            (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3)
        })
    };
    plan.forward_fixed(&mut v).unwrap();
    let forward = hash(&v);
    plan.inverse_fixed(&mut v).unwrap();
    assert_eq!([forward, hash(&v)], [6_733_252_332_378_451_056, 8_960_399_526_822_270_822]);
}
