//! The transform as the paper writes it, in double precision, compared with the crate's.

mod common;

use common::{any_octree, any_weights, channel};
use gpcc_lite::Leaf;
use gpcc_lite::raht::{RahtPlan, Rows, forward, inverse};
use proptest::prelude::*;

/// RAHT bit by bit: neighbours with equal prefixes merge. Returns the DC and, for each leaf that
/// starts a right half, the high-pass value and the weights of both halves.
fn raht(leaves: &[Leaf], weights: &[u32], values: &[f64]) -> (f64, Vec<(f64, [f64; 2])>) {
    struct Node {
        code: u64,
        leaf: usize,
        weight: f64,
        value: f64,
    }
    let mut high = vec![(0.0, [0.0; 2]); leaves.len()];
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
                    high[n.leaf] = ((w1.sqrt() * b - w2.sqrt() * a) / root, [w1, w2]);
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

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn raht_agrees_with_the_paper(tree in any_octree(), seed: u64) {
        let n = tree.len();
        let weights = any_weights(n, seed);
        let plan = RahtPlan::new(tree.clone()).weighted(&weights).unwrap();
        let values: Vec<f64> = channel(n, seed, 1).iter().map(|&v| f64::from(v)).collect();
        let (dc, high) = raht(tree.leaves(), &weights, &values);
        let mut transformed = values.clone();
        plan.forward_f64(&mut transformed).unwrap();
        for k in 0..n {
            let want = if k == 0 { dc } else { high[plan.split_leaf(k)].0 };
            let (got, scale) = (transformed[k], 1.0 + want.abs());
            prop_assert!((got - want).abs() < 1e-8 * scale, "{k} {got} {want}");
            if k > 0 {
                prop_assert_eq!(plan.child_weights(k), high[plan.split_leaf(k)].1);
            }
        }
        plan.inverse_f64(&mut transformed).unwrap();
        for (got, want) in transformed.iter().zip(&values) {
            prop_assert!((got - want).abs() < 1e-8);
        }
    }

    /// The rows hold means and differences in single precision. A mean takes part in 63 merges at
    /// most, and each rounds it a few times by 2^-24 of the greatest value.
    #[test]
    fn rows_agree_with_double_precision(tree in any_octree(), seed: u64, channels in 1usize..8) {
        let n = tree.len();
        let weights = any_weights(n, seed);
        let plan = RahtPlan::new(tree.clone()).weighted(&weights).unwrap();
        let all: Vec<Vec<i32>> = (0..channels).map(|c| channel(n, seed ^ c as u64, 1)).collect();
        let mut rows = Rows::new(n, channels);
        for i in 0..n {
            (0..channels).for_each(|c| rows.row_mut(i)[c] = all[c][i] as f32);
        }
        let bound = 4.0 * 63.0 * 200.0 / f64::from(1 << 24);
        forward(&plan, &mut rows).unwrap();
        let total: f64 = weights.iter().map(|&w| f64::from(w)).sum();
        for c in 0..channels {
            let mut want: Vec<f64> = all[c].iter().map(|&v| f64::from(v)).collect();
            plan.forward_f64(&mut want).unwrap();
            for k in 0..n {
                // A coefficient is a mean or a difference of means times a factor of the weights.
                let (got, factor) = if k == 0 {
                    (rows.row(0)[c], total.sqrt())
                } else {
                    let [a, b] = plan.child_weights(k);
                    (rows.row(plan.split_leaf(k))[c], (a * b / (a + b)).sqrt())
                };
                let error = f64::from(got) - want[k] / factor;
                prop_assert!(error.abs() < bound, "{k}: {got} {}", want[k] / factor);
            }
        }
        inverse(&plan, &mut rows).unwrap();
        for i in 0..n {
            for c in 0..channels {
                prop_assert!((f64::from(rows.row(i)[c]) - f64::from(all[c][i])).abs() < bound);
            }
        }
    }

    /// What a merge says of itself is what the transform of one leaf after the other shows.
    #[test]
    fn factors_of_a_merge_are_those_of_the_transform(tree in any_octree(), seed: u64) {
        let n = tree.len();
        let plan = RahtPlan::new(tree.clone()).weighted(&any_weights(n, seed)).unwrap();
        let mut squares = vec![0.0; n];
        for leaf in 0..n {
            let mut response: Vec<f64> = (0..n).map(|i| f64::from(u8::from(i == leaf))).collect();
            plan.forward_f64(&mut response).unwrap();
            squares.iter_mut().zip(response).for_each(|(sum, r)| *sum += r * r);
        }
        for k in 1..n {
            let [a, b] = plan.child_weights(k);
            let wanted = [b / (a + b), ((a + b) / (a * b)).sqrt(), squares[k].sqrt()];
            let merge = plan.merge(k);
            for (got, want) in [merge.share, merge.scale, merge.noise_gain].into_iter().zip(wanted) {
                prop_assert!((f64::from(got) - want).abs() < 1e-5 * want, "{k}: {got} {want}");
            }
        }
    }

    #[test]
    fn coefficients_run_coarse_to_fine(tree in any_octree()) {
        let plan = RahtPlan::new(tree.clone());
        let (leaves, j) = (tree.leaves(), tree.depth());
        let bit = |k: usize| {
            let r = plan.split_leaf(k);
            63 - (leaves[r - 1].morton ^ leaves[r].morton).leading_zeros()
        };
        prop_assert_eq!(plan.levels().len(), 3 * usize::from(j) + 1);
        prop_assert_eq!(*plan.levels().last().unwrap() as usize, tree.len().max(1));
        for (level, range) in plan.levels().windows(2).enumerate() {
            let range = range[0] as usize..range[1] as usize;
            for k in range.clone() {
                prop_assert_eq!(bit(k), 3 * u32::from(j) - 1 - level as u32);
                prop_assert!(k == range.start || plan.split_leaf(k - 1) < plan.split_leaf(k));
                let parent = plan.parent(k);
                prop_assert!(parent < range.start, "the merge above is in a level before");
                prop_assert!(parent == 0 || bit(parent) > bit(k));
            }
        }
    }
}
