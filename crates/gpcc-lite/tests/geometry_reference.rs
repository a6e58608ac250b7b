//! A second decoder of geometry, written from the documentation: every neighbour is searched for in a
//! sorted set.

mod common;

use std::collections::{BTreeMap, BTreeSet};

use common::{any_octree, shapes};
use gpcc_lite::coder::{Coder, RansDecoder};
use gpcc_lite::geometry;
use gpcc_lite::model::{Bit, Symbols};
use gpcc_lite::{Leaf, Octree, morton};
use proptest::prelude::*;

/// Elias gamma.
fn gamma(coder: &mut RansDecoder<'_>) -> u32 {
    let mut zeros = 0;
    while zeros < 32 && coder.bits(0, 1) == 0 {
        zeros += 1;
    }
    (1 << zeros) + coder.bits(0, zeros) - 1
}

/// `(x, y, z)` of a child number.
fn cell(c: usize) -> [i64; 3] {
    [c as i64 >> 2 & 1, c as i64 >> 1 & 1, c as i64 & 1]
}

/// The cell at `offset` of a node, if there is one.
fn beside(code: u64, depth: u8, offset: [i64; 3]) -> Option<u64> {
    let here = morton::decode(code);
    let there: Vec<i64> = (0..3).map(|k| i64::from(here[k]) + offset[k]).collect();
    let inside = there.iter().all(|&v| (0..1 << depth).contains(&v));
    inside.then(|| morton::encode([0, 1, 2].map(|k| there[k] as u32)))
}

/// All 26 offsets.
fn offsets() -> impl Iterator<Item = [i64; 3]> {
    (0..27).map(|p| [p / 9 - 1, p / 3 % 3 - 1, p % 3 - 1]).filter(|o| *o != [0; 3])
}

/// Offsets of the neighbours of a node, which is one of `nodes`.
fn neighbours(code: u64, depth: u8, nodes: &BTreeSet<u64>) -> Vec<[i64; 3]> {
    let exists = |o: &[i64; 3]| beside(code, depth, *o).is_some_and(|code| nodes.contains(&code));
    offsets().filter(exists).collect()
}

/// How many of the neighbours touch a child.
fn touching(near: &[[i64; 3]], child: usize) -> usize {
    let touches = |e: &&[i64; 3]| (0..3).all(|k| [0, 2 * cell(child)[k] - 1].contains(&e[k]));
    near.iter().filter(touches).count()
}

struct Reference<'a> {
    coder: RansDecoder<'a>,
    j: u8,
    slabs_kept: bool,
    bits: BTreeMap<(&'static str, usize), Bit>,
    levels: BTreeMap<usize, Symbols>,
    /// Counts of the low and the high half, by depth, axis and index of the slab.
    slabs: BTreeMap<(u8, usize, u32), [usize; 2]>,
    leaves: Vec<Leaf>,
}

impl Reference<'_> {
    fn bit(&mut self, table: &'static str, at: usize) -> bool {
        self.bits.entry((table, at)).or_default().code(&mut self.coder, false, 255)
    }

    /// The counts of the slab that a cell is in.
    fn slab(&mut self, code: u64, depth: u8, axis: usize) -> &mut [usize; 2] {
        self.slabs.entry((depth, axis, morton::decode(code)[axis] % 4096)).or_default()
    }

    /// Learns which children of a cell are occupied.
    fn learn(&mut self, code: u64, depth: u8, axis: usize, children: &[usize]) {
        let counts = self.slab(code, depth, axis);
        for half in 0..2 {
            if children.iter().any(|c| c >> (2 - axis) & 1 == half) {
                counts[half] = (counts[half] + 1).min(7);
            } else {
                counts[half] = counts[half].div_ceil(2);
            }
        }
    }

    /// How well a child fits the slabs of its cell.
    fn fit(&mut self, code: u64, depth: u8, child: usize) -> usize {
        (0..3)
            .map(|axis| {
                let counts = *self.slab(code, depth, axis);
                let half = child >> (2 - axis) & 1;
                match (counts[half], counts[1 - half]) {
                    (0, 1..) => 1,
                    (1.., 0) => 4,
                    _ => 0,
                }
            })
            .sum()
    }

    /// The single leaf below a node.
    fn single(&mut self, code: u64, depth: u8) {
        let model = self.levels.entry(depth.into());
        let model = model.or_insert_with(|| Symbols::geometric(512, 2));
        let mut levels = self.coder.symbol(model, 0) as u8;
        if levels == 15 {
            levels += gamma(&mut self.coder) as u8;
        }
        let mut code = code;
        for step in 0..levels {
            let mut child = 0;
            for k in 0..3 {
                if self.slabs_kept {
                    let [low, high] = *self.slab(code, depth + step, k);
                    let bit = u64::from(self.bit("slab", 8 * low + high));
                    self.learn(code, depth + step, k, &[(bit as usize) << (2 - k)]);
                    child = 2 * child + bit;
                    continue;
                }
                let bit = self.coder.bits(0, 1);
                child = 2 * child + u64::from(bit);
            }
            code = 8 * code + child;
        }
        let depth = depth + levels;
        self.leaves.push(Leaf { morton: code << (3 * (self.j - depth)), depth });
    }

    /// The children of a node with several leaves.
    fn children(&mut self, code: u64, depth: u8, near: &[[i64; 3]], least: usize) -> u8 {
        let (mut mask, mut count) = (0u8, 0usize);
        for c in 0..8usize {
            let forced = count < least && 8 - c == least - count;
            let beside = [1, 2, 4].iter().filter(|&&b| mask >> (c ^ b) & 1 == 1).count();
            let fit = if self.slabs_kept { self.fit(code, depth, c) } else { 0 };
            let known = 4 * (4 * (8 * touching(near, c) + c) + beside) + count.min(3);
            let context = 1024 * fit + known;
            if forced || self.bit("child", context) {
                mask |= 1 << c;
                count += 1;
            }
        }
        if self.slabs_kept {
            let found: Vec<usize> = (0..8).filter(|c| mask >> c & 1 == 1).collect();
            (0..3).for_each(|axis| self.learn(code, depth, axis, &found));
        }
        mask
    }

    /// Nodes, each with the number of its parent's children, become those of the next level.
    fn level(&mut self, depth: u8, nodes: &[(u64, usize)]) -> Vec<(u64, usize)> {
        let all: BTreeSet<u64> = nodes.iter().map(|n| n.0).collect();
        let mut below = Vec::new();
        for &(code, siblings) in nodes {
            let near = neighbours(code, depth, &all);
            if (siblings > 1 || depth == 0) && self.bit("single", near.len()) {
                self.single(code, depth);
                continue;
            }
            let mask = self.children(code, depth, &near, if depth + 1 == self.j { 2 } else { 1 });
            let children = (0..8).filter(|c| mask >> c & 1 == 1);
            below.extend(children.map(|c| (code * 8 + c, mask.count_ones() as usize)));
        }
        below
    }
}

/// Decodes a whole stream that an encoder wrote.
fn decode(bytes: &[u8]) -> (Vec<Leaf>, u8) {
    let (j, slabs_kept) = (bytes[0], bytes[1] == 1);
    let (mut points, mut at) = (0, 1);
    loop {
        at += 1;
        points |= usize::from(bytes[at] & 127) << (7 * (at - 2));
        if bytes[at] < 128 {
            break;
        }
    }
    let mut reference = Reference {
        coder: RansDecoder::new(&bytes[at + 1..]).unwrap(),
        j,
        slabs_kept,
        bits: BTreeMap::new(),
        levels: BTreeMap::new(),
        slabs: BTreeMap::new(),
        leaves: Vec::new(),
    };
    let mut nodes = if points > 0 { vec![(0, 1)] } else { Vec::new() };
    for depth in 0..j {
        nodes = reference.level(depth, &nodes);
    }
    let mut leaves = reference.leaves;
    leaves.extend(nodes.iter().map(|n| Leaf { morton: n.0, depth: j }));
    leaves.sort();
    assert_eq!(leaves.len(), points);
    reference.coder.finish().unwrap();
    (leaves, j)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    #[test]
    fn a_second_decoder_agrees(tree in any_octree()) {
        let (back, depth) = decode(&geometry::encode(&tree).unwrap());
        prop_assert_eq!(&back, tree.leaves());
        prop_assert_eq!(depth, tree.depth());
    }
}

#[test]
fn a_second_decoder_agrees_on_shapes() {
    for (name, tree) in shapes() {
        assert_eq!(decode(&geometry::encode(&tree).unwrap()).0, tree.leaves(), "{name}");
    }
}

/// Points near a surface, so that nodes have many neighbours.
#[test]
fn a_second_decoder_agrees_on_a_surface() {
    let mut s = 9u32;
    let mut next = |n: u32| {
        s = s.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (s >> 8) % n
    };
    let mut leaves: Vec<Leaf> = (0..3000)
        .map(|_| {
            let (x, y) = (next(256), next(256));
            Leaf { morton: morton::encode([x, y, (x * x + y) / 512 + next(3)]), depth: 8 }
        })
        .collect();
    leaves.sort();
    leaves.dedup();
    let tree = Octree::of_points(8, leaves.clone()).unwrap();
    assert_eq!(decode(&geometry::encode(&tree).unwrap()), (leaves, 8));
}

/// Walls, and points on a lattice whose pitch is no power of two: the encoder uses slabs, and saves
/// bytes by them.
#[test]
fn a_second_decoder_agrees_on_planes() {
    let mut s = 5u32;
    let mut next = |n: u32| {
        s = s.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (s >> 8) % n
    };
    let mut walls = Vec::new();
    let mut lattice = Vec::new();
    for i in 0..4000 {
        let (a, b) = (next(1 << 9), next(1 << 9));
        walls.push([[a, b, 100], [333, a, b], [a, 17, b]][i % 3]);
        lattice.push([0; 3].map(|_| next(40) * 37 / 3));
    }
    for (name, points) in [("walls", walls), ("lattice", lattice)] {
        let leaf = |p: &[u32; 3]| Leaf { morton: morton::encode(*p), depth: 9 };
        let mut leaves: Vec<Leaf> = points.iter().map(leaf).collect();
        leaves.sort();
        leaves.dedup();
        let tree = Octree::of_points(9, leaves.clone()).unwrap();
        let bytes = geometry::encode(&tree).unwrap();
        assert_eq!(bytes[1], 1, "{name}");
        let mut without = gpcc_lite::coder::RansEncoder::default();
        geometry::encode_leaves(&mut without, &tree).unwrap();
        assert!(bytes.len() * 10 < without.finish().len() * 9, "{name}");
        assert_eq!(decode(&bytes), (leaves, 9), "{name}");
    }
}
