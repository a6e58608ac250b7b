//! A second decoder of geometry, written from the documentation: every neighbour searched for in
//! sorted maps, every weight computed where it is used.

mod common;

use std::collections::BTreeMap;

use common::{any_leaves, shapes};
use gpcc_lite::coder::{Coder, Decoder};
use gpcc_lite::geometry::{self, Layout};
use gpcc_lite::model::{Bit, Symbols};
use gpcc_lite::{Leaf, morton};
use proptest::prelude::*;

/// Elias gamma.
fn gamma(coder: &mut Decoder<'_>) -> u32 {
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

/// Sixteenths of an octave, linear within an octave.
fn log(v: i64) -> i64 {
    let l = i64::from(v.ilog2());
    16 * l + 16 * v / (1 << l) - 16
}

/// All 26 offsets.
fn offsets() -> impl Iterator<Item = [i64; 3]> {
    (0..27).map(|p| [p / 9 - 1, p / 3 % 3 - 1, p % 3 - 1]).filter(|o| *o != [0; 3])
}

/// What is known of the nodes of a level: nothing of those not coded yet, then their children, none
/// of a single leaf.
type Known = BTreeMap<u64, Option<u8>>;

/// Neighbours of a node with their offsets.
fn neighbours(code: u64, depth: u8, known: &Known) -> Vec<([i64; 3], Option<u8>)> {
    let state = |o| Some((o, *known.get(&beside(code, depth, o)?)?));
    offsets().filter_map(state).collect()
}

/// Density at a child of a node.
fn density(near: &[([i64; 3], Option<u8>)], child: usize) -> i64 {
    let power = |v: [i64; 3]| v.iter().map(|x| x * x).sum::<i64>().pow(2);
    let mut sum = 0;
    for &(e, mask) in near {
        let centre = [0, 1, 2].map(|k| 4 * e[k] + 1 - 2 * cell(child)[k]);
        match mask {
            None => sum += 131_072 / power(centre),
            Some(0) => sum += 65_536 / power(centre),
            Some(mask) => {
                for q in (0..8).filter(|q| mask >> q & 1 == 1) {
                    let v = [0, 1, 2].map(|k| 2 * e[k] + cell(q)[k] - cell(child)[k]);
                    sum += 4096 / power(v);
                }
            }
        }
    }
    sum
}

/// Classes of a child's share in the density at all children, and of the sum.
fn classes(near: &[([i64; 3], Option<u8>)], child: usize) -> (usize, usize) {
    let total: i64 = (0..8).map(|c| density(near, c)).sum();
    if total == 0 {
        return (0, 0);
    }
    let share = match density(near, child) {
        0 => 1,
        own => (3 * (log(own) - log(total) + 96)).div_euclid(16).clamp(0, 18) + 1,
    };
    (share as usize, ((3 * (log(total) - 128).max(0) / 32).min(14) + 1) as usize)
}

struct Reference<'a> {
    coder: Decoder<'a>,
    j: u8,
    layout: Layout,
    bits: BTreeMap<(&'static str, usize), Bit>,
    levels: BTreeMap<usize, Symbols>,
    /// Depths of the last two single leaves found at each depth.
    last: BTreeMap<u8, [u8; 2]>,
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
    fn single(&mut self, code: u64, depth: u8, near: &[([i64; 3], Option<u8>)]) {
        let most = self.j - depth;
        let levels = if self.layout.mixed_depths {
            let [a, b] = *self.last.entry(depth).or_insert([depth; 2]);
            let expected = usize::from(a - depth + b - depth).min(31);
            let model = self.levels.entry(4 * expected + near.len().min(3));
            let model = model.or_insert_with(|| Symbols::geometric(64 * expected as u32, 2));
            let mut levels = self.coder.symbol(model, 0) as u32;
            if levels == 15 {
                levels += gamma(&mut self.coder);
            }
            self.last.insert(depth, [depth + levels as u8, a]);
            levels as u8
        } else {
            most
        };
        let mut code = code;
        for step in 0..levels {
            let mut child = 0;
            for k in 0..3 {
                if self.layout.planes {
                    let [low, high] = *self.slab(code, depth + step, k);
                    let bit = u64::from(self.bit("slab", 8 * low + high));
                    self.learn(code, depth + step, k, &[(bit as usize) << (2 - k)]);
                    child = 2 * child + bit;
                    continue;
                }
                let side = |v: i64| near.iter().filter(|(o, _)| o[k] == v).count();
                let (low, high) = (side(-1), side(1));
                let lean = high.abs_diff(low);
                let bit = if step > 0 || lean < 2 {
                    self.coder.bits(0, 1) == 1
                } else {
                    self.bit("half", 32 * lean + near.len()) == (high > low)
                };
                child = 2 * child + u64::from(bit);
            }
            code = 8 * code + child;
        }
        let depth = depth + levels;
        self.leaves.push(Leaf { morton: code << (3 * (self.j - depth)), depth });
    }

    /// The children of a node with several leaves.
    fn children(
        &mut self,
        (code, depth): (u64, u8),
        near: &[([i64; 3], Option<u8>)],
        least: usize,
    ) -> u8 {
        let (mut mask, mut count) = (0u8, 0usize);
        for c in 0..8usize {
            let forced = count < least && 8 - c == least - count;
            let (share, total) = classes(near, c);
            let fit = if self.layout.planes { self.fit(code, depth, c) } else { 0 };
            let context = ((32 * fit + share) * 16 + total) * 4 + count.min(3);
            if forced || self.bit("child", context) {
                mask |= 1 << c;
                count += 1;
            }
        }
        if self.layout.planes {
            let found: Vec<usize> = (0..8).filter(|c| mask >> c & 1 == 1).collect();
            (0..3).for_each(|axis| self.learn(code, depth, axis, &found));
        }
        mask
    }

    /// Nodes, each with the number of its parent's children, become those of the next level.
    fn level(&mut self, depth: u8, nodes: &[(u64, usize)]) -> Vec<(u64, usize)> {
        let mut known: Known = nodes.iter().map(|n| (n.0, None)).collect();
        let mut below = Vec::new();
        for &(code, siblings) in nodes {
            let near = neighbours(code, depth, &known);
            let is_face = |o: &[i64; 3]| o.iter().filter(|v| **v != 0).count() == 1;
            let faces = near.iter().filter(|(o, _)| is_face(o)).count();
            if siblings > 1 || depth == 0 {
                let context = (near.len().min(15) * 8 + faces) * 8 + siblings - 1;
                if self.bit("single", context) {
                    known.insert(code, Some(0));
                    self.single(code, depth, &near);
                    continue;
                }
            }
            let mask = self.children((code, depth), &near, if depth + 1 == self.j { 2 } else { 1 });
            known.insert(code, Some(mask));
            let children = (0..8).filter(|c| mask >> c & 1 == 1);
            below.extend(children.map(|c| (code * 8 + c, mask.count_ones() as usize)));
        }
        below
    }
}

/// Decodes a whole stream that an encoder wrote.
fn decode(bytes: &[u8]) -> (Vec<Leaf>, u8) {
    let (j, layout) = (bytes[0], Layout::from_byte(bytes[1]).unwrap());
    let (mut points, mut at) = (0, 1);
    loop {
        at += 1;
        points |= usize::from(bytes[at] & 127) << (7 * (at - 2));
        if bytes[at] < 128 {
            break;
        }
    }
    let mut reference = Reference {
        coder: Decoder::new(&bytes[at + 1..]).unwrap(),
        j,
        layout,
        bits: BTreeMap::new(),
        levels: BTreeMap::new(),
        last: BTreeMap::new(),
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
    fn a_second_decoder_agrees((leaves, j) in any_leaves()) {
        let (back, depth) = decode(&geometry::encode(&leaves, j).unwrap());
        prop_assert_eq!(&back, &leaves);
        prop_assert_eq!(depth, j);
    }
}

#[test]
fn a_second_decoder_agrees_on_shapes() {
    for (name, leaves, j) in shapes() {
        assert_eq!(decode(&geometry::encode(&leaves, j).unwrap()).0, leaves, "{name}");
    }
}

/// Points near a surface, so that nodes have many neighbours and single leaves lean towards them.
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
    assert_eq!(decode(&geometry::encode(&leaves, 8).unwrap()), (leaves, 8));
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
        assert!(Layout::of(&leaves, 9).unwrap().planes, "{name}");
        let bytes = geometry::encode(&leaves, 9).unwrap();
        let mut without = gpcc_lite::coder::Encoder::default();
        geometry::encode_leaves(&mut without, &leaves, 9, Layout::default()).unwrap();
        assert!(bytes.len() * 10 < without.finish().len() * 9, "{name}");
        assert_eq!(decode(&bytes), (leaves, 9), "{name}");
    }
}
