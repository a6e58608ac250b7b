//! A second decoder of geometry, written from `docs/bitstream-gpcc.md`: every neighbour searched for
//! in sorted maps, every weight computed where it is used.

mod common;

use std::collections::BTreeMap;

use common::{any_leaves, shapes};
use gpcc_lite::mix::{Mixer, stretch};
use gpcc_lite::model::Bit;
use gpcc_lite::range::{BinaryCoder, RangeDecoder};
use gpcc_lite::{Leaf, geometry, morton};
use proptest::prelude::*;

/// Counters by table and index, mixers by table and index.
#[derive(Default)]
struct State {
    counters: BTreeMap<(&'static str, usize), Bit>,
    pairs: BTreeMap<usize, Mixer<2>>,
    fives: BTreeMap<usize, Mixer<5>>,
    eights: BTreeMap<usize, Mixer<8>>,
    last: BTreeMap<(&'static str, u8), usize>,
}

impl State {
    fn bit(&mut self, coder: &mut RangeDecoder<'_>, table: &'static str, at: usize) -> bool {
        let counter = self.counters.entry((table, at)).or_default();
        let bit = coder.code(counter.p1(), false);
        counter.update(bit, 255);
        bit
    }

    fn mixed<const N: usize>(
        &mut self,
        coder: &mut RangeDecoder<'_>,
        mixer: &mut Mixer<N>,
        rate: i32,
        of: [(&'static str, usize); N],
    ) -> bool {
        let inputs = of.map(|key| stretch(self.counters.entry(key).or_default().p1()));
        let p1 = mixer.mix(&inputs);
        let bit = coder.code(p1, false);
        mixer.update(&inputs, p1, bit, rate);
        for key in of {
            self.counters.entry(key).or_default().update(bit, 255);
        }
        bit
    }

    fn stops(
        &mut self,
        coder: &mut RangeDecoder<'_>,
        table: &'static str,
        d: u8,
        x: usize,
    ) -> bool {
        let last = *self.last.entry((table, d)).or_default();
        let bit = self.bit(coder, table, (usize::from(d) * 16 + last) * 4 + x);
        self.last.insert((table, d), (last * 2 + usize::from(bit)) % 16);
        bit
    }
}

/// A byte string read bit by bit.
struct Raw<'a>(&'a [u8], usize);

impl Raw<'_> {
    fn get(&mut self, n: usize) -> u64 {
        let mut v = 0;
        for _ in 0..n {
            v = v << 1 | u64::from(self.0[self.1 / 8] >> (7 - self.1 % 8) & 1);
            self.1 += 1;
        }
        v
    }
}

fn varint(bytes: &[u8], at: &mut usize) -> usize {
    let (mut v, mut shift) = (0, 0);
    loop {
        let b = bytes[*at];
        *at += 1;
        v |= usize::from(b & 127) << shift;
        shift += 7;
        if b < 128 {
            return v;
        }
    }
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

fn log(v: i64) -> i64 {
    if v == 0 {
        return 0;
    }
    let l = i64::from(v.ilog2());
    16 * l + 16 * v / (1 << l) - 16
}

/// All 26 offsets.
fn around() -> impl Iterator<Item = [i64; 3]> {
    (0..27).map(|p| [p / 9 - 1, p / 3 % 3 - 1, p % 3 - 1]).filter(|o| *o != [0; 3])
}

/// A node before its decisions: its code, number of siblings and chain.
type Node = (u64, usize, usize);

/// What an earlier node of the level turned out to be: its children, none of a single.
type Known = BTreeMap<u64, Option<u8>>;

struct View<'a> {
    depth: u8,
    node: Node,
    known: &'a Known,
}

impl View<'_> {
    /// Neighbours with their offsets; `None` for those not coded yet.
    fn neighbours(&self) -> Vec<([i64; 3], Option<u8>)> {
        around()
            .filter_map(|o| {
                let code = beside(self.node.0, self.depth, o)?;
                let state = self.known.get(&code)?;
                Some((o, *state))
            })
            .collect()
    }

    /// The classes of a child's density: own, share, total.
    fn density(&self, child: usize) -> (usize, usize, usize) {
        let at = |c: usize| -> i64 {
            let power = |v: [i64; 3]| v.iter().map(|x| x * x).sum::<i64>().pow(2);
            let mut sum = 0;
            for (e, mask) in self.neighbours() {
                let centre = [0, 1, 2].map(|k| 4 * e[k] + 1 - 2 * cell(c)[k]);
                match mask {
                    None => sum += 131_072 / power(centre),
                    Some(0) => sum += 65_536 / power(centre),
                    Some(mask) => {
                        for q in (0..8).filter(|q| mask >> q & 1 == 1) {
                            let v = [0, 1, 2].map(|k| 2 * e[k] + cell(q)[k] - cell(c)[k]);
                            sum += 4096 / power(v);
                        }
                    }
                }
            }
            sum
        };
        let total: i64 = (0..8).map(at).sum();
        if total == 0 {
            return (0, 0, 0);
        }
        let (own, total) = (log(at(child)), log(total));
        let share = (3 * (own - total + 96)).div_euclid(16).clamp(0, 18) + 1;
        let sum = (3 * (total - 128).max(0) / 32).min(14) + 1;
        (((own / 4 - 20).clamp(0, 40) + 1) as usize, share as usize, sum as usize)
    }

    /// The states of the seven cells outside that touch a child.
    fn state(&self, child: usize) -> usize {
        let mut state = 0;
        for axes in [4usize, 2, 1, 6, 5, 3, 7] {
            let side = |k: usize| {
                if axes >> (2 - k) & 1 == 0 { 0 } else { 2 * cell(child)[k] - 1 }
            };
            let code = beside(self.node.0, self.depth, [side(0), side(1), side(2)]);
            let s = match code.and_then(|c| self.known.get(&c)) {
                None => 0,
                Some(None) => 1,
                Some(Some(mask)) if mask >> (child ^ axes) & 1 == 0 => 2,
                Some(Some(_)) => 3,
            };
            state = state * 4 + s;
        }
        state
    }
}

/// Decodes a whole stream that an encoder wrote.
fn decode(bytes: &[u8]) -> (Vec<Leaf>, u8) {
    assert_eq!(bytes[0], 2);
    let j = bytes[1] & 31;
    let (fast, lattice, mixed) =
        (bytes[1] >> 5 & 1 == 1, bytes[1] >> 6 & 1 == 1, bytes[1] >> 7 == 1);
    let mut at = 2;
    let points = varint(bytes, &mut at);
    let mut leaves = Vec::new();
    let mut s = State::default();
    let mut list: Vec<Node> = if points > 0 { vec![(0, 1, 0)] } else { Vec::new() };
    let mut tails: Vec<u64> = Vec::new();
    let mut depth = 0;
    while points > 0 && depth < j {
        let levels = bytes[at];
        at += 1;
        let (coded, raw) = (varint(bytes, &mut at), varint(bytes, &mut at));
        let mut coder = RangeDecoder::new(&bytes[at..at + coded]);
        let mut raw = Raw(&bytes[at + coded..at + coded + raw], 0);
        at += coded + raw.0.len();
        for _ in 0..levels {
            (list, tails) = level(
                &mut s,
                (&mut coder, &mut raw),
                (depth, j),
                (fast, lattice, mixed),
                (&list, &tails),
                &mut leaves,
            );
            depth += 1;
        }
    }
    leaves.extend(list.iter().map(|n| Leaf { morton: n.0, depth: j }));
    leaves.extend(tails.iter().map(|&morton| Leaf { morton, depth: j }));
    leaves.sort();
    assert_eq!((leaves.len(), at), (points, bytes.len()));
    (leaves, j)
}

/// Takes nodes and tails from one depth to the next.
fn level(
    s: &mut State,
    (coder, raw): (&mut RangeDecoder<'_>, &mut Raw<'_>),
    (d, j): (u8, u8),
    (fast, lattice, mixed): (bool, bool, bool),
    (list, tails): (&[Node], &[u64]),
    leaves: &mut Vec<Leaf>,
) -> (Vec<Node>, Vec<u64>) {
    let depth = usize::from(d);
    let leaf = |code: u64| Leaf { morton: code << (3 * (j - d)), depth: d };
    let mut known: Known = list.iter().map(|n| (n.0, None)).collect();
    let mut below = Vec::new();
    let (mut joined, mut stepped) = (Vec::new(), Vec::new());
    for &node in list {
        let (code, siblings, chain) = node;
        let view = View { depth: d, node, known: &known };
        let near = view.neighbours();
        let all = near.len();
        let faces = near.iter().filter(|(o, _)| o.iter().filter(|v| **v != 0).count() == 1).count();
        if siblings > 1 || d == 0 {
            let a = (all.min(15) * 8 + faces) * 8 + siblings - 1;
            let low = [[-1, 0, 0], [0, -1, 0], [0, 0, -1]];
            let masks: Vec<u8> =
                near.iter().filter(|(o, _)| low.contains(o)).map(|(_, m)| m.unwrap()).collect();
            let sum: i64 = masks
                .iter()
                .map(|m| if *m == 0 { 7 } else { 10 * i64::from(m.count_ones()) })
                .sum();
            let class = masks.len() * 16 + (3 * log(sum) / 32 - 3).clamp(0, 15) as usize;
            let b = 4 * class + siblings.min(4) - 1;
            let single = if fast {
                s.bit(coder, "around", a)
            } else {
                let mut mixer = s.pairs.remove(&depth).unwrap_or(Mixer::new(72_000));
                let bit = s.mixed(coder, &mut mixer, 2, [("around", a), ("below", b)]);
                s.pairs.insert(depth, mixer);
                bit
            };
            if single {
                known.insert(code, Some(0));
                if mixed && s.stops(coder, "stop", d, all.min(3)) {
                    leaves.push(leaf(code));
                } else if lattice {
                    stepped.push(code);
                } else {
                    let mut child = 0;
                    for k in 0..3 {
                        let side = |v: i64| near.iter().filter(|(o, _)| o[k] == v).count();
                        let (low, high) = (side(-1), side(1));
                        let lean = high.abs_diff(low);
                        let bit = if lean < 2 {
                            raw.get(1)
                        } else {
                            let more = s.bit(coder, "half", 32 * lean + all);
                            u64::from(more == (high > low))
                        };
                        child = child * 2 + bit;
                    }
                    joined.push(code * 8 + child);
                }
                continue;
            }
        }
        let least = if d + 1 == j { 2 } else { 1 };
        let (mut mask, mut count) = (0u8, 0usize);
        for c in 0..8usize {
            if count < least && 8 - c == least - count {
                mask |= 1 << c;
                count += 1;
                continue;
            }
            let so_far = count.min(3);
            let (own, share, total) = view.density(c);
            let both = ("both", (16 * share + total) * 4 + so_far);
            let shape = ((1usize << c | usize::from(mask)) * 4 + chain.min(3)) * 8 + faces;
            let five = [
                ("near", 4 * view.state(c) + so_far),
                ("shape", shape),
                ("own", 4 * own + so_far),
                ("share", (8 * share + c) * 8 + count),
                both,
            ];
            let select = 4 * c + so_far;
            let bit = if fast {
                s.bit(coder, both.0, both.1)
            } else if lattice {
                let l = (depth + 1).min(16);
                let v = morton::decode(code << 3 | c as u64).map(|v| v as usize % (1 << l));
                let [x, y, z] = [0, 1, 2].map(|k| ("lattice", (k << 17) + (1 << l) + v[k]));
                let [a, b, c, d, e] = five;
                let mut mixer = s.eights.remove(&select).unwrap_or(Mixer::new(100_000));
                let bit = s.mixed(coder, &mut mixer, 8, [a, b, c, d, e, x, y, z]);
                s.eights.insert(select, mixer);
                bit
            } else {
                let mut mixer = s.fives.remove(&select).unwrap_or(Mixer::new(75_000));
                let bit = s.mixed(coder, &mut mixer, 8, five);
                s.fives.insert(select, mixer);
                bit
            };
            mask |= u8::from(bit) << c;
            count += usize::from(bit);
        }
        known.insert(code, Some(mask));
        let chain = if count == 1 { chain + 1 } else { 0 };
        for c in (0..8).filter(|c| mask >> c & 1 == 1) {
            below.push((code * 8 + c, count, chain));
        }
    }
    let mut next = Vec::new();
    for (i, &code) in tails.iter().chain(&stepped).enumerate() {
        if mixed && i < tails.len() && s.stops(coder, "tail", d, 0) {
            leaves.push(leaf(code));
            continue;
        }
        let child = if !lattice {
            raw.get(3)
        } else if d < 16 {
            let v = morton::decode(code).map(|v| v as usize % (1 << depth));
            (0..3).fold(0, |child, k| {
                child * 2 + u64::from(s.bit(coder, "path", (k << 17) + (1 << depth) + v[k]))
            })
        } else {
            u64::from(coder.code_raw(0, 3))
        };
        next.push(code * 8 + child);
    }
    next.extend(joined);
    (below, next)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    #[test]
    fn a_second_decoder_agrees((leaves, j) in any_leaves()) {
        for encode in [geometry::encode, geometry::encode_fast] {
            let (back, depth) = decode(&encode(&leaves, j).unwrap());
            prop_assert_eq!(&back, &leaves);
            prop_assert_eq!(depth, j);
        }
    }
}

#[test]
fn a_second_decoder_agrees_on_shapes() {
    for (name, leaves, j) in shapes() {
        assert_eq!(decode(&geometry::encode(&leaves, j).unwrap()).0, leaves, "{name}");
    }
}

/// Enough points on a lattice for its contexts to be used, deeper than they go.
#[test]
fn a_second_decoder_agrees_on_a_lattice() {
    let mut s = 9u32;
    let mut next = || {
        s = s.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (s >> 26) << 12
    };
    let mut leaves: Vec<Leaf> = (0..600)
        .map(|_| Leaf { morton: morton::encode([next(), next(), next()]), depth: 18 })
        .collect();
    leaves.sort();
    leaves.dedup();
    let bytes = geometry::encode(&leaves, 18).unwrap();
    assert_eq!(bytes[1] >> 6, 1, "not taken for a lattice");
    assert_eq!(decode(&bytes), (leaves, 18));
}
