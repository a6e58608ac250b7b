//! Inputs shared by the tests.
#![allow(dead_code, unreachable_pub, reason = "each test file uses its own part")]

use gpcc_lite::raht::Rows;
use gpcc_lite::{Leaf, Octree, morton};
use proptest::prelude::*;

/// Leaves from arbitrary codes and depths: sorted, overlapping ones dropped.
pub fn octree_from(codes: &[(u64, u8)], tree_depth: u8) -> Octree {
    let mut cells: Vec<Leaf> = codes
        .iter()
        .map(|&(code, depth)| {
            let depth = depth % (tree_depth + 1);
            let cut = 3 * (tree_depth - depth);
            let code = if tree_depth == 0 { 0 } else { code & ((1u64 << (3 * tree_depth)) - 1) };
            Leaf { morton: code >> cut << cut, depth }
        })
        .collect();
    cells.sort();
    let mut end = 0u64;
    cells.retain(|l| {
        let keep = l.morton >= end;
        if keep {
            end = l.morton + (1u64 << (3 * (tree_depth - l.depth)));
        }
        keep
    });
    Octree::of_points(tree_depth, cells).expect("valid leaves")
}

/// Sparse and dense trees, uniform and mixed depths, 0, 1, 2 and more leaves.
pub fn any_octree() -> impl Strategy<Value = Octree> {
    let deep = (1u8..=21, prop::collection::vec((any::<u64>(), any::<u8>()), 0..300));
    let dense = (1u8..=4, prop::collection::vec((any::<u64>(), any::<u8>()), 0..900));
    prop_oneof![deep, dense, (Just(0u8), prop::collection::vec((Just(0u64), any::<u8>()), 0..3))]
        .prop_flat_map(|(j, codes)| (Just(j), Just(codes), any::<bool>()))
        .prop_map(|(j, codes, uniform)| {
            let codes: Vec<_> =
                codes.into_iter().map(|(c, d)| (c, if uniform { j } else { d })).collect();
            octree_from(&codes, j)
        })
}

/// Values of several kinds: constant, small, any, extremes.
pub fn channel(n: usize, seed: u64, kind: u8) -> Vec<i32> {
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

/// Rows of `channels` channels, each as [`channel`] makes them; extremes are large floats.
pub fn rows_of(leaves: usize, channels: usize, seed: u64, kind: u8) -> Rows {
    let mut rows = Rows::new(leaves, channels);
    for c in 0..channels {
        let values = channel(leaves, seed.wrapping_add(2 * c as u64), kind);
        (0..leaves).for_each(|i| rows.row_mut(i)[c] = values[i] as f32);
    }
    rows
}

/// `2^exponent`.
pub fn power_of_two(exponent: i32) -> f32 {
    f32::from_bits(((127 + exponent) as u32) << 23)
}

/// Weights from 1 to 4^11, most of them small; all 1 for every fourth seed.
pub fn any_weights(leaves: usize, seed: u64) -> Vec<u32> {
    let weight = |(i, v): (usize, &i32)| {
        if seed.is_multiple_of(4) { 1 } else { 1u32 << (2 * (v.unsigned_abs() as usize * i % 12)) }
    };
    channel(leaves, seed, 2).iter().enumerate().map(weight).collect()
}

/// Shapes that tests of point clouds forget: one line, one plane, a full cube, two points.
pub fn shapes() -> Vec<(&'static str, Octree)> {
    let tree = |points: Vec<[u32; 3]>, j: u8| {
        let mut l: Vec<Leaf> =
            points.into_iter().map(|p| Leaf { morton: morton::encode(p), depth: j }).collect();
        l.sort();
        l.dedup();
        Octree::of_points(j, l).expect("valid leaves")
    };
    let top = (1 << 21) - 1;
    let plane = (0..16).flat_map(|x| (0..16).map(move |y| [x, y, 5])).collect();
    let cube = (0..512).map(|i| [i >> 6, i >> 3 & 7, i & 7]).collect();
    vec![
        ("no point", tree(Vec::new(), 7)),
        ("root", tree(vec![[0; 3]], 0)),
        ("one point at depth 21", tree(vec![[top, 0, top]], 21)),
        ("two far corners at depth 21", tree(vec![[0, 0, 0], [top, top, top]], 21)),
        ("depth 1", tree(vec![[0, 0, 0], [1, 0, 1], [1, 1, 1]], 1)),
        ("line", tree((0..300).map(|x| [x, 7, 7]).collect(), 9)),
        ("plane", tree(plane, 6)),
        ("full cube", tree(cube, 3)),
    ]
}
