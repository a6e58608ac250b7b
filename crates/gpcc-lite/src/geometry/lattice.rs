//! Clouds born on a lattice: coordinates along an axis repeat all over the scene.
//!
//! Positions that were quantised once (SPZ, SOG, compressed PLY) and voxelized again fall on few
//! of the coordinates of each axis. A counter per axis and coordinate prefix learns which.

use crate::leaf::Leaf;
use crate::model::{Bit, table};
use crate::morton;
use crate::range::BinaryCoder;

/// Levels below this one share no counters: 2^16 prefixes per axis are enough.
const DEEPEST: u32 = 16;
/// Memory of the counters.
const LIMIT: u32 = 255;
/// Bits per decision (in 1/256) that the finest levels must save on average.
const WORTH: u64 = 13;

/// Counters of one axis.
const SLOTS: usize = 1 << (DEEPEST + 1);

#[inline]
fn slot(level: u32, coordinate: u32) -> usize {
    let level = level.min(DEEPEST);
    ((1 << level) + (coordinate & ((1 << level) - 1)) as usize) & (SLOTS - 1)
}

/// Counters by axis and coordinate prefix: of "this child is occupied" and of the next bit of a
/// single's path.
pub(super) struct Lattice {
    occupied: [Box<[Bit; SLOTS]>; 3],
    path: [Box<[Bit; SLOTS]>; 3],
}

impl Lattice {
    pub(super) fn new() -> Self {
        let tables = || [table(), table(), table()];
        Self { occupied: tables(), path: tables() }
    }

    /// The counters for a child at `level` with coordinates `xyz` there.
    #[inline]
    pub(super) fn counters(&mut self, level: u32, [x, y, z]: [u32; 3]) -> [&mut Bit; 3] {
        let [a, b, c] = &mut self.occupied;
        [&mut a[slot(level, x)], &mut b[slot(level, y)], &mut c[slot(level, z)]]
    }

    /// Codes the child of a single at `level - 1` with Morton code `code`.
    pub(super) fn path<C: BinaryCoder>(
        &mut self,
        coder: &mut C,
        level: u32,
        code: u64,
        truth: u32,
    ) -> u32 {
        if level > DEEPEST {
            return coder.code_raw(truth, 3);
        }
        let xyz = morton::decode(code);
        let mut child = 0;
        for (k, &x) in xyz.iter().enumerate() {
            let bit = &mut self.path[k][slot(level - 1, x)];
            let one = bit.code(coder, truth >> (2 - k) & 1 == 1, LIMIT);
            child = child << 1 | u32::from(one);
        }
        child
    }
}

/// True if the finest three levels of the coordinates are far from equally likely.
///
/// A leaf says nothing below its own depth: the low bits of its corner are zeros that nobody codes,
/// and leaves of different depths would look like a lattice.
pub(super) fn detect(leaves: &[Leaf], j_high: u8) -> bool {
    let depth = j_high.min(DEEPEST as u8);
    if depth < 4 || leaves.len() < 256 {
        return false;
    }
    let mut saved = 0i64;
    let mut decisions = 0u64;
    let levels = [depth - 2, depth - 1, depth];
    let mut counts = levels.map(|level| [0; 3].map(|_: u32| vec![0u32; 1 << level]));
    for l in leaves {
        // Those of the coarser levels follow below.
        let Some(at) = levels.iter().rposition(|&level| l.depth >= level) else { continue };
        let xyz = morton::decode(l.morton);
        for (count, x) in counts[at].iter_mut().zip(xyz) {
            count[(x >> (j_high - levels[at])) as usize] += 1;
        }
        decisions += 3 * (at as u64 + 1);
    }
    for at in (1..levels.len()).rev() {
        let (coarser, finer) = counts.split_at_mut(at);
        for (coarse, fine) in coarser[at - 1].iter_mut().zip(&finer[0]) {
            for (sum, pair) in coarse.iter_mut().zip(fine.chunks_exact(2)) {
                *sum += pair[0] + pair[1];
            }
        }
    }
    let few: Vec<u64> = (0..1024).map(log2).collect();
    let log2 = |n: u64| few.get(n as usize).copied().unwrap_or_else(|| log2(n));
    for counts in counts {
        for pair in counts.iter().flat_map(|count| count.chunks_exact(2)) {
            let (a, b) = (u64::from(pair[0]), u64::from(pair[1]));
            if a + b > 0 {
                // Entropy, and what learning one probability costs.
                let whole = log2(a + b);
                let parts = a * log2(a) + b * log2(b);
                let cost = (a + b) * whole - parts + whole / 2 + 256;
                saved += (256 * (a + b)) as i64 - cost as i64;
            }
        }
    }
    saved > 0 && saved as u64 > WORTH * decisions
}

/// `256 log2(n)`, 0 for 0.
fn log2(n: u64) -> u64 {
    if n == 0 {
        return 0;
    }
    let whole = n.ilog2();
    // Eight squarings give eight bits of the fraction.
    let mut x = (u128::from(n) << 32) >> whole;
    let mut bits = u64::from(whole);
    for _ in 0..8 {
        x = (x * x) >> 32;
        bits <<= 1;
        if x >= 2 << 32 {
            bits |= 1;
            x >>= 1;
        }
    }
    bits
}
