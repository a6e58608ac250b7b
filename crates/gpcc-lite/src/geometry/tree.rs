//! One traversal of the tree for both directions.

use crate::error::{Error, Result};
use crate::hood::{CENTRE, Hood, NONE, child_hood};
use crate::leaf::Leaf;
use crate::mix::{Mixer, stretch};
use crate::model::Bit;
use crate::range::BinaryCoder;

/// Where the tree comes from.
#[derive(Clone, Copy)]
pub(super) enum Source<'a> {
    /// The encoder's leaves.
    Leaves(&'a [Leaf]),
    /// The stream being decoded.
    Stream,
}

/// Memory of the occupancy counters.
const LIMIT: u32 = 255;

/// All adaptive state of a geometry stream.
pub(super) struct Models {
    mixed: bool,
    stop: Vec<Bit>,
    tail_stop: Vec<Bit>,
    single: Vec<Bit>,
    near: Vec<Bit>,
    shape: Vec<Bit>,
    mixers: Vec<Mixer<2>>,
}

impl Models {
    pub(super) fn new(mixed: bool) -> Self {
        Self {
            mixed,
            stop: vec![Bit::default(); 32 * 4],
            tail_stop: vec![Bit::default(); 32],
            single: vec![Bit::default(); 32 * 16],
            near: vec![Bit::default(); 1 << 17],
            shape: vec![Bit::default(); 256 * 16],
            mixers: vec![Mixer::new(80_000); 8 * 4],
        }
    }
}

/// The nodes of one level that are still in the tree, plus the singles that left it.
pub(super) struct Tree<'a> {
    source: Source<'a>,
    j_high: u8,
    code: Vec<u64>,
    /// Encoder only: range of leaves under each node.
    range: Vec<[u32; 2]>,
    hood: Vec<Hood>,
    tails: Vec<u64>,
    /// Encoder only: the leaf each tail leads to.
    tail_leaf: Vec<u32>,
    done: Vec<Leaf>,
}

impl<'a> Tree<'a> {
    pub(super) fn new(source: Source<'a>, j_high: u8) -> Self {
        let mut root = [NONE; 27];
        root[CENTRE] = 0;
        let range = match source {
            Source::Leaves(l) => vec![[0, l.len() as u32]],
            Source::Stream => Vec::new(),
        };
        Self {
            source,
            j_high,
            code: vec![0],
            range,
            hood: vec![root],
            tails: Vec::new(),
            tail_leaf: Vec::new(),
            done: Vec::new(),
        }
    }

    /// Codes the step from `depth` to `depth + 1`; `path` codes three bits of a single's path.
    pub(super) fn level<C: BinaryCoder>(
        &mut self,
        depth: u8,
        models: &mut Models,
        coder: &mut C,
        path: &mut impl FnMut(u32) -> u32,
        limit: usize,
    ) -> Result<()> {
        let shift = 3 * (self.j_high - depth - 1);
        let nodes = self.code.len();
        let old_tails = self.tails.len();
        let mut mask = vec![0u8; nodes];
        let mut first = vec![0u32; nodes];
        let mut code = Vec::with_capacity(nodes);
        let mut range = Vec::new();
        for at in 0..nodes {
            let mut bounds = [0u32; 9];
            let mut truth = 0u8;
            let mut one = false;
            let mut stops = false;
            if let Source::Leaves(leaves) = self.source {
                let [lo, hi] = self.range[at];
                one = hi - lo == 1;
                stops = one && leaves[lo as usize].depth == depth;
                if !one {
                    truth = split(leaves, lo, hi, shift, &mut bounds);
                }
            }
            let hood = &self.hood[at];
            if models.mixed {
                let ctx = usize::from(depth) * 4 + (neighbours(hood).min(3) as usize);
                if models.stop[ctx].code(coder, stops, LIMIT) {
                    self.done.push(Leaf { morton: self.code[at] << (shift + 3), depth });
                    continue;
                }
            }
            let ctx = usize::from(depth) * 16 + (neighbours(hood).min(15) as usize);
            if models.single[ctx].code(coder, one, LIMIT) {
                self.tails.push(self.code[at]);
                if C::ENCODING {
                    self.tail_leaf.push(self.range[at][0]);
                }
                continue;
            }
            let cells = cells_around(hood, &mask, at);
            let occupancy = code_occupancy(coder, models, &cells, truth, neighbours(hood));
            mask[at] = occupancy;
            first[at] = code.len() as u32;
            for c in 0..8 {
                if occupancy >> c & 1 == 1 {
                    code.push((self.code[at] << 3) | c as u64);
                    if C::ENCODING {
                        range.push([bounds[c], bounds[c + 1]]);
                    }
                }
            }
            if code.len() + self.tails.len() + self.done.len() > limit || coder.exhausted() {
                return Err(Error::Corrupt { what: "more cells than points", offset: 0 });
            }
        }
        let mut hood = Vec::with_capacity(code.len());
        for at in 0..nodes {
            for c in 0..8 {
                if mask[at] >> c & 1 == 1 {
                    hood.push(child_hood(&self.hood[at], c, &mask, &first));
                }
            }
        }
        (self.code, self.range, self.hood) = (code, range, hood);
        self.step_tails(depth, old_tails, models, coder, path);
        Ok(())
    }

    fn step_tails<C: BinaryCoder>(
        &mut self,
        depth: u8,
        old_tails: usize,
        models: &mut Models,
        coder: &mut C,
        path: &mut impl FnMut(u32) -> u32,
    ) {
        let shift = 3 * (self.j_high - depth - 1);
        let mut kept = 0;
        for i in 0..self.tails.len() {
            let mut truth = 0;
            let mut stops = false;
            if let Source::Leaves(leaves) = self.source {
                let leaf = leaves[self.tail_leaf[i] as usize];
                truth = (leaf.morton >> shift) as u32 & 7;
                stops = leaf.depth == depth;
            }
            let may_stop = models.mixed && i < old_tails;
            if may_stop && models.tail_stop[usize::from(depth)].code(coder, stops, LIMIT) {
                self.done.push(Leaf { morton: self.tails[i] << (shift + 3), depth });
                continue;
            }
            self.tails[kept] = (self.tails[i] << 3) | u64::from(path(truth));
            if C::ENCODING {
                self.tail_leaf[kept] = self.tail_leaf[i];
            }
            kept += 1;
        }
        self.tails.truncate(kept);
        if C::ENCODING {
            self.tail_leaf.truncate(kept);
        }
    }

    /// The leaves, cut at depth `target`, the level last coded.
    pub(super) fn finish(self, target: u8) -> Vec<Leaf> {
        let cut = 3 * (self.j_high - target);
        let mut leaves = self.done;
        for l in &mut leaves {
            l.morton >>= cut;
        }
        let deepest = self.code.iter().chain(&self.tails);
        leaves.extend(deepest.map(|&morton| Leaf { morton, depth: target }));
        leaves.sort();
        leaves
    }
}

/// Boundaries of the eight children in `leaves[lo..hi]`, and which of them are not empty.
fn split(leaves: &[Leaf], lo: u32, hi: u32, shift: u8, bounds: &mut [u32; 9]) -> u8 {
    let mut mask = 0;
    let mut at = lo;
    bounds[0] = lo;
    for c in 0..8u32 {
        let child = |i: u32| (leaves[i as usize].morton >> shift) as u32 & 7;
        if hi - at > 32 {
            let tail = &leaves[at as usize..hi as usize];
            at += tail.partition_point(|l| (l.morton >> shift) as u32 & 7 <= c) as u32;
        } else {
            while at < hi && child(at) == c {
                at += 1;
            }
        }
        bounds[c as usize + 1] = at;
        if at > bounds[c as usize] {
            mask |= 1 << c;
        }
    }
    mask
}

/// Number of occupied face neighbours.
fn neighbours(hood: &Hood) -> u32 {
    [4, 10, 12, 14, 16, 22].iter().filter(|&&n| hood[n] != NONE).count() as u32
}

/// The 4x4x4 cells, of the size of a child, around and in a node.
struct Cells {
    /// Inside an occupied node of this level.
    present: u64,
    /// Inside a node whose occupancy is known.
    coded: u64,
    /// Known to be occupied.
    occupied: u64,
}

/// Bit of cell `(x, y, z)`, each 0 to 3.
const fn cell(x: usize, y: usize, z: usize) -> u32 {
    (16 * x + 4 * y + z) as u32
}

/// For neighbour `n`: its children that touch the node, as `(cell, child)` pairs.
const TOUCHING: [[(u8, u8); 4]; 27] = {
    let mut t = [[(255u8, 0u8); 4]; 27];
    let mut n = 0;
    while n < 27 {
        let d = [n / 9, n / 3 % 3, n % 3];
        let mut count = 0;
        let mut c = 0;
        while c < 8 && n != 13 {
            let b = [c >> 2 & 1, c >> 1 & 1, c & 1];
            let mut at = 0;
            let mut touches = true;
            let mut k = 0;
            while k < 3 {
                // Cells -2..3 along an axis; the node is 0 and 1; kept: -1..2.
                let x = 2 * d[k] + b[k];
                if x < 1 || x > 4 {
                    touches = false;
                } else {
                    at = at * 4 + x - 1;
                }
                k += 1;
            }
            if touches {
                t[n][count] = (at as u8, c as u8);
                count += 1;
            }
            c += 1;
        }
        n += 1;
    }
    t
};

fn cells_around(hood: &Hood, mask: &[u8], at: usize) -> Cells {
    let mut cells = Cells { present: 0, coded: 0, occupied: 0 };
    for (n, touching) in TOUCHING.iter().enumerate() {
        let i = hood[n];
        if i == NONE || n == CENTRE {
            continue;
        }
        let coded = (i as usize) < at;
        let m = mask[i as usize];
        for &(cell, child) in touching {
            if cell == 255 {
                break;
            }
            cells.present |= 1 << cell;
            cells.coded |= u64::from(coded) << cell;
            cells.occupied |= u64::from(m >> child & 1) << cell;
        }
    }
    cells
}

/// The seven cells outside the node that touch child `c` at its corner: faces, edges, corner.
const OUTSIDE: [[u32; 7]; 8] = {
    let mut t = [[0u32; 7]; 8];
    let mut c = 0;
    while c < 8 {
        let b = [c >> 2 & 1, c >> 1 & 1, c & 1];
        let order = [4, 2, 1, 6, 5, 3, 7];
        let mut i = 0;
        while i < 7 {
            let mut xyz = [0usize; 3];
            let mut k = 0;
            while k < 3 {
                let out = order[i] >> (2 - k) & 1;
                xyz[k] = if out == 1 { if b[k] == 1 { 3 } else { 0 } } else { b[k] + 1 };
                k += 1;
            }
            t[c][i] = cell(xyz[0], xyz[1], xyz[2]);
            i += 1;
        }
        c += 1;
    }
    t
};

fn code_occupancy<C: BinaryCoder>(
    coder: &mut C,
    models: &mut Models,
    cells: &Cells,
    truth: u8,
    faces: u32,
) -> u8 {
    let mut occupancy = 0u8;
    for c in 0..8usize {
        // The last child of an otherwise empty node must be there.
        if c == 7 && occupancy == 0 {
            return 0x80;
        }
        let mut near = 0usize;
        if cells.present != 0 {
            for &o in &OUTSIDE[c] {
                let present = (cells.present >> o & 1) as usize;
                let known = (cells.coded >> o & 1) as usize;
                let occupied = (cells.occupied >> o & 1) as usize;
                near = near * 4 + present * (1 + known * (1 + occupied));
            }
        }
        let so_far = (occupancy.count_ones() as usize).min(3);
        let near = &mut models.near[near * 8 + so_far * 2];
        let shape = (1usize << c) | (occupancy as usize & ((1 << c) - 1));
        let shape = &mut models.shape[shape * 16 + faces as usize];
        let inputs = [stretch(near.p1()), stretch(shape.p1())];
        let mixer = &mut models.mixers[c * 4 + so_far];
        let p1 = mixer.mix(&inputs);
        let bit = coder.code(p1, truth >> c & 1 == 1);
        mixer.update(&inputs, p1, bit, 6);
        near.update(bit, LIMIT);
        shape.update(bit, LIMIT);
        occupancy |= u8::from(bit) << c;
    }
    occupancy
}
