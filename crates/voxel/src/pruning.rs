//! [`Pruning`]: the cheapest pruning of the full octree, bottom-up.

use std::ops::Range;

use gpcc_lite::morton::{self, MAX_DEPTH};
use rayon::prelude::*;

use crate::cube::Cube;
use crate::order::{MortonOrder, cell_end};
use crate::rate_distortion::{RateDistortion, RateDistortionReport};
use crate::record::{Record, Records, View};
use crate::stats::{Look, Place};
use crate::voxelize::DROPPED;

/// Cells of at most this many Gaussians are solved by one thread, in its second-level cache.
/// Fixed, so that no sum depends on the threads.
const BLOCK: usize = 2048;

/// Cells of at most this many Gaussians sum their statistics from the members, before the
/// children are looked at; so a cell that cannot gain by division skips its subtree.
const SMALL: usize = 24;

/// A run of the rate-distortion strategy.
pub(crate) struct Pruning<'a> {
    cube: &'a Cube,
    /// Sides of the cells of every depth.
    cells: [f64; MAX_DEPTH as usize + 1],
    options: &'a RateDistortion,
    records: View<'a>,
    bits: Bits,
}

/// Costs of the octree above and in a leaf of one Gaussian: lambda times bits.
#[derive(Clone, Copy)]
struct Bits {
    /// Of a cell that may be a leaf and has one child.
    deeper: f64,
    /// Of a leaf at the highest depth,
    gaussian: f64,
    /// ... and of one above it.
    flagged: f64,
    /// Of a cell of one child that may not be a leaf.
    only_child: f64,
}

/// The best pruning below a cell.
#[derive(Clone, Copy, Default)]
struct Best {
    /// Distortion + lambda * bits.
    cost: f64,
    /// Every Gaussian in the cell is dropped: the cell is not occupied.
    empty: bool,
}

/// As in the report.
#[derive(Clone, Copy, Default)]
struct Tally {
    decided: u64,
    skipped: u64,
}

/// The Gaussians of a cell.
#[derive(Clone, Copy)]
struct Cell<'a> {
    codes: &'a [u64],
    members: &'a [u32],
    records: &'a [Record],
}

/// A cell of few Gaussians with the place of each, relative to `base`.
#[derive(Clone, Copy)]
struct Small<'a> {
    cell: Cell<'a>,
    places: &'a [Place],
    base: [f64; 3],
    /// Index of the first one in the cell in which `base` was chosen.
    at: usize,
}

/// Looks of the Gaussians of a small cell, as far as they were asked for: most cells are no
/// leaves for their places alone. And what was done so far in the block.
#[derive(Default)]
struct Work {
    looks: [Look; SMALL],
    /// A bit for each that is known.
    known: u32,
    tally: Tally,
}

/// What a thread keeps from block to block, to allocate it once.
#[derive(Default)]
struct Scratch {
    records: Vec<Record>,
    places: Vec<Place>,
    work: Work,
}

/// What is known of a cell once it is solved.
#[derive(Clone, Copy, Default)]
struct Solved {
    best: Best,
    /// Relative to the cell's centre.
    place: Place,
    /// Only if a leaf there was not ruled out by its place.
    look: Option<Look>,
    /// Of a block.
    tally: Tally,
}

/// A cell that one thread solves.
struct Block<'a> {
    depth: u8,
    codes: &'a [u64],
    members: &'a [u32],
    depths: &'a mut [u8],
}

impl<'a> Pruning<'a> {
    pub(crate) fn new(cube: &'a Cube, options: &'a RateDistortion, records: &'a Records) -> Self {
        let (lambda, c) = (options.lambda, &options.cost);
        let bits = Bits {
            deeper: lambda * (c.occupancy[0] + c.go_on),
            gaussian: lambda * c.gaussian,
            flagged: lambda * (c.stop + c.gaussian),
            only_child: lambda * c.occupancy[0],
        };
        let cells = std::array::from_fn(|depth| cube.cell(depth as u8));
        Self { cube, cells, options, records: records.view(), bits }
    }

    /// Finds the best pruning: the leaf depth of each Gaussian of `order`, and what was done.
    pub(crate) fn run(&self, order: &MortonOrder) -> (Vec<u8>, RateDistortionReport) {
        let mut depths = vec![0u8; order.codes.len()];
        let report = if depths.is_empty() {
            RateDistortionReport::default()
        } else {
            self.solve_all(order, &mut depths)
        };
        (depths, report)
    }

    /// [`Pruning::run`] of a scene that is not empty.
    fn solve_all(&self, order: &MortonOrder, depths: &mut [u8]) -> RateDistortionReport {
        let mut blocks = Vec::new();
        self.divide(&order.codes, &order.members, 0, depths, &mut blocks);
        let solved: Vec<Solved> = blocks
            .into_par_iter()
            .map_init(Scratch::default, |scratch, block| self.solve_block(scratch, block))
            .collect();
        let mut report = RateDistortionReport::default();
        let mut solved = solved.into_iter().inspect(|block| {
            report.decided += block.tally.decided;
            report.skipped += block.tally.skipped;
        });
        let centre = self.centre(order.codes[0], 0);
        let mut above = 0;
        let root =
            self.combine(&order.codes, &order.members, centre, 0, depths, &mut solved, &mut above);
        report.decided += above;
        report.cost = root.best.cost;
        report
    }

    /// Cuts the octree into blocks: cells of at most [`BLOCK`] Gaussians, or of the last depth.
    fn divide<'b>(
        &self,
        codes: &'b [u64],
        members: &'b [u32],
        depth: u8,
        depths: &'b mut [u8],
        blocks: &mut Vec<Block<'b>>,
    ) {
        if self.is_block(codes, depth) {
            blocks.push(Block { depth, codes, members, depths });
            return;
        }
        let (mut start, mut rest) = (0, depths);
        while start < codes.len() {
            let end = cell_end(codes, start, self.options.j_high, depth + 1);
            let (head, tail) = rest.split_at_mut(end - start);
            self.divide(&codes[start..end], &members[start..end], depth + 1, head, blocks);
            (start, rest) = (end, tail);
        }
    }

    fn is_block(&self, codes: &[u64], depth: u8) -> bool {
        codes.len() <= BLOCK || depth == self.options.j_high
    }

    fn solve_block(&self, scratch: &mut Scratch, block: Block<'_>) -> Solved {
        let Block { depth, codes, members, depths } = block;
        let centre = self.centre(codes[0], depth);
        if codes.len() > BLOCK {
            // That many in one finest cell.
            let mut place = Place::default();
            for &i in members {
                let record = self.records.get(i);
                place.add(&Place::of(&record, self.from(&record, centre)));
            }
            let look = self.look(members);
            let best = Best { cost: f64::INFINITY, empty: true };
            let leaf = self.floor(&place, [0.0; 3], depth) + self.mixing(&look);
            let best = self.leaf_or(best, place.importance, leaf, depth, depths);
            let tally = Tally { decided: 1, skipped: 0 };
            return Solved { best, place, look: Some(look), tally };
        }
        // Together, so that the cache misses overlap.
        let Scratch { records, places, work } = scratch;
        records.clear();
        records.extend(members.iter().map(|&i| self.records.get(i)));
        work.tally = Tally::default();
        let cell = Cell { codes, members, records };
        let solved = if depth < self.options.j_low && self.options.drop.is_none() {
            self.solve_below(cell, depth, depths, places, work)
        } else {
            self.solve(cell, centre, depth, depths, places, work)
        };
        Solved { tally: work.tally, ..solved }
    }

    /// A cell above the lowest leaf depth of which nothing may be dropped: it must be divided
    /// down to there, and nobody asks where its Gaussians are.
    fn solve_below(
        &self,
        cell: Cell<'_>,
        depth: u8,
        depths: &mut [u8],
        places: &mut Vec<Place>,
        work: &mut Work,
    ) -> Solved {
        let &RateDistortion { j_low, j_high, .. } = self.options;
        let codes = cell.codes;
        // Children so far of the cells on the path to the current one.
        let mut children = [1; MAX_DEPTH as usize + 1];
        let close = |children: &mut [usize], below: u8| -> f64 {
            let path = below..j_low;
            path.map(|d| self.division(std::mem::replace(&mut children[usize::from(d)], 1), d))
                .sum()
        };
        let (mut cost, mut start) = (0.0, 0);
        while start < codes.len() {
            if start > 0 {
                let shared = self.shared_depth(codes[start - 1], codes[start]);
                cost += close(&mut children, shared + 1);
                children[usize::from(shared)] += 1;
            }
            let end = cell_end(codes, start, j_high, j_low);
            let centre = self.centre(codes[start], j_low);
            let depths = &mut depths[start..end];
            let best = if let [leaf] = depths {
                self.solve_alone(&cell, start, centre, j_low, leaf, &mut work.tally).0
            } else {
                self.solve(cell.part(start..end), centre, j_low, depths, places, work).best
            };
            cost += best.cost;
            start = end;
        }
        cost += close(&mut children, depth);
        Solved { best: Best { cost, empty: false }, ..Solved::default() }
    }

    /// Depth of the smallest cell that holds two codes.
    fn shared_depth(&self, a: u64, b: u64) -> u8 {
        let differing = u64::BITS - (a ^ b).leading_zeros();
        self.options.j_high - differing.div_ceil(3) as u8
    }

    /// Gaussian `i` of `cell`, alone in its own cell at `depth`; also its place.
    #[inline(always)]
    fn solve_alone(
        &self,
        cell: &Cell<'_>,
        i: usize,
        centre: [f64; 3],
        depth: u8,
        leaf: &mut u8,
        tally: &mut Tally,
    ) -> (Best, Place) {
        let (code, record) = (cell.codes[i], &cell.records[i]);
        let place = Place::of(record, self.from(record, centre));
        (self.solve_one(code, record, &place, centre, depth, leaf, tally), place)
    }

    /// Solves the cells above the blocks, whose results come in Morton order.
    fn combine(
        &self,
        codes: &[u64],
        members: &[u32],
        centre: [f64; 3],
        depth: u8,
        depths: &mut [u8],
        blocks: &mut impl Iterator<Item = Solved>,
        decided: &mut u64,
    ) -> Solved {
        if self.is_block(codes, depth) {
            // There are as many results as blocks.
            return blocks.next().unwrap_or_default();
        }
        *decided += u64::from(depth >= self.options.j_low || self.options.drop.is_some());
        self.combine_children(codes, members, centre, depth, depths, |range, centre, depths| {
            let (codes, members) = (&codes[range.clone()], &members[range]);
            self.combine(codes, members, centre, depth + 1, depths, blocks, decided)
        })
    }

    /// Finds the best pruning of the cell at `depth` that holds all of `cell`, at most
    /// [`BLOCK`].
    fn solve(
        &self,
        cell: Cell<'_>,
        centre: [f64; 3],
        depth: u8,
        depths: &mut [u8],
        places: &mut Vec<Place>,
        work: &mut Work,
    ) -> Solved {
        let Cell { codes, members, records } = cell;
        if codes.len() > SMALL && depth < self.options.j_high {
            work.tally.decided += 1;
            return self.combine_children(
                codes,
                members,
                centre,
                depth,
                depths,
                |range, centre, depths| {
                    if let [leaf] = depths {
                        let (at, tally) = (range.start, &mut work.tally);
                        let (best, place) =
                            self.solve_alone(&cell, at, centre, depth + 1, leaf, tally);
                        return Solved { best, place, ..Solved::default() };
                    }
                    self.solve(cell.part(range), centre, depth + 1, depths, places, work)
                },
            );
        }
        places.clear();
        places.extend(records.iter().map(|r| Place::of(r, self.from(r, centre))));
        work.known = 0;
        let small = Small { cell, places, base: centre, at: 0 };
        let place = small.place();
        let (best, look) = self.solve_small(small, &place, centre, depth, depths, work);
        Solved { best, place, look, tally: Tally::default() }
    }

    /// A cell whose children are solved one by one, by `child`, from their range of the cell's
    /// Gaussians.
    fn combine_children(
        &self,
        codes: &[u64],
        members: &[u32],
        centre: [f64; 3],
        depth: u8,
        depths: &mut [u8],
        mut child: impl FnMut(Range<usize>, [f64; 3], &mut [u8]) -> Solved,
    ) -> Solved {
        let mut best = Best { cost: 0.0, empty: true };
        let mut place = Place::default();
        // Sum of the looks of the children that know theirs, and ranges of those that do not.
        let mut known = Look::default();
        let (mut unknown, mut unknown_len) = ([(0, 0); 8], 0);
        let (mut start, mut occupied) = (0, 0);
        while start < codes.len() {
            let end = cell_end(codes, start, self.options.j_high, depth + 1);
            let from = self.child(centre, codes[start], depth);
            let solved = child(start..end, from, &mut depths[start..end]);
            place.add(&solved.place.moved(std::array::from_fn(|k| centre[k] - from[k])));
            match solved.look {
                Some(look) => known.add(&look),
                None => {
                    unknown[unknown_len] = (start, end);
                    unknown_len += 1;
                }
            }
            occupied += usize::from(!solved.best.empty);
            best.cost += solved.best.cost;
            start = end;
        }
        best.cost += self.division(occupied, depth);
        best.empty = occupied == 0;
        let floor = self.floor(&place, [0.0; 3], depth);
        let (mut look, mut leaf) = (None, f64::INFINITY);
        if depth >= self.options.j_low && floor <= best.cost {
            for &(start, end) in &unknown[..unknown_len] {
                known.add(&self.look(&members[start..end]));
            }
            leaf = floor + self.mixing(&known);
            look = Some(known);
        }
        let best = self.leaf_or(best, place.importance, leaf, depth, depths);
        Solved { best, place, look, tally: Tally::default() }
    }

    /// A cell of few Gaussians, whose places are at hand, relative to `small.base`; a cell that
    /// cannot gain by division is not looked into. `place` is that of the cell. Also gives the
    /// look of the cell if it was asked for.
    fn solve_small(
        &self,
        small: Small<'_>,
        place: &Place,
        centre: [f64; 3],
        depth: u8,
        depths: &mut [u8],
        work: &mut Work,
    ) -> (Best, Option<Look>) {
        let o = self.options;
        let codes = small.cell.codes;
        if let [leaf] = depths {
            return (self.solve_lone(small, centre, depth, leaf, work), None);
        }
        // Down to here all share one cell; cells of one child are not worth a call each.
        let shared = self.shared_depth(codes[0], codes[codes.len() - 1]);
        // Any division that leaves something costs at least this, had it no distortion at all;
        // one that drops everything costs as much as dropping it here.
        let bound = o.lambda * (o.cost.go_on + o.cost.occupancy[0] + o.cost.gaussian);
        let mut best = Best { cost: 0.0, empty: true };
        // What a leaf costs for its place alone mostly rules it out; looks are summed only
        // where it does not.
        let mut floors = [0.0; MAX_DEPTH as usize + 1];
        let (mut look, mut mixing) = (None, 0.0);
        let mut ask = |work: &mut Work| {
            if look.is_none() {
                let sum = self.look_of(&small, work);
                mixing = self.mixing(&sum);
                look = Some(sum);
            }
            mixing
        };
        let (mut at, mut centre) = (depth, centre);
        loop {
            work.tally.decided += 1;
            let offset = std::array::from_fn(|k| centre[k] - small.base[k]);
            let floor = self.floor(place, offset, at);
            floors[usize::from(at)] = floor;
            if at == o.j_high || (at >= o.j_low && floor <= bound) {
                let cost = floor + ask(work);
                if at == o.j_high || cost <= bound {
                    work.tally.skipped += u64::from(at < o.j_high);
                    best.cost = f64::INFINITY;
                    best = self.leaf_or(best, place.importance, cost, at, depths);
                    break;
                }
            }
            if at == shared {
                let occupied = self.solve_children(&mut best, small, centre, at, depths, work);
                best = self.or_leaf(best, occupied, place, floor, at, depths, || ask(work));
                break;
            }
            centre = self.child(centre, codes[0], at);
            at += 1;
        }
        while at > depth {
            at -= 1;
            let (occupied, floor) = (usize::from(!best.empty), floors[usize::from(at)]);
            best = self.or_leaf(best, occupied, place, floor, at, depths, || ask(work));
        }
        (best, look)
    }

    /// Solves the children of a small cell, adds up what they cost and counts those that are
    /// not empty.
    fn solve_children(
        &self,
        best: &mut Best,
        small: Small<'_>,
        centre: [f64; 3],
        depth: u8,
        depths: &mut [u8],
        work: &mut Work,
    ) -> usize {
        let codes = small.cell.codes;
        let shift = 3 * u32::from(self.options.j_high - depth - 1);
        let (mut start, mut occupied) = (0, 0);
        while start < codes.len() {
            let code = codes[start] >> shift;
            let mut end = start + 1;
            while end < codes.len() && codes[end] >> shift == code {
                end += 1;
            }
            let part = small.part(start..end);
            let centre = self.child(centre, codes[start], depth);
            let child = if end - start == 1 {
                self.solve_lone(part, centre, depth + 1, &mut depths[start], work)
            } else {
                let depths = &mut depths[start..end];
                self.solve_small(part, &part.place(), centre, depth + 1, depths, work).0
            };
            occupied += usize::from(!child.empty);
            best.cost += child.cost;
            start = end;
        }
        occupied
    }

    /// Adds to `best`, what the children cost, the division into `occupied` of them, and takes
    /// a leaf instead if that is cheaper. `mixing` is asked for only if `floor` does not rule the
    /// leaf out.
    fn or_leaf(
        &self,
        mut best: Best,
        occupied: usize,
        place: &Place,
        floor: f64,
        depth: u8,
        depths: &mut [u8],
        mixing: impl FnOnce() -> f64,
    ) -> Best {
        best.cost += self.division(occupied, depth);
        best.empty = occupied == 0;
        let leaf = if depth >= self.options.j_low && floor <= best.cost {
            floor + mixing()
        } else {
            f64::INFINITY
        };
        self.leaf_or(best, place.importance, leaf, depth, depths)
    }

    /// Look of a small cell.
    fn look_of(&self, small: &Small<'_>, work: &mut Work) -> Look {
        let Cell { members, records, .. } = small.cell;
        if members.len() > SMALL {
            // A finest cell, which is asked for once.
            return self.look(members);
        }
        for (i, record) in (small.at..).zip(records) {
            if work.known >> i & 1 == 0 {
                work.looks[i] = Look::of(record);
                work.known |= 1 << i;
            }
        }
        let mut sum = work.looks[small.at];
        work.looks[small.at + 1..small.at + members.len()].iter().for_each(|look| sum.add(look));
        sum
    }

    /// Look of a set of Gaussians.
    fn look(&self, members: &[u32]) -> Look {
        let mut sum = Look::default();
        for &i in members {
            sum.add(&Look::of(&self.records.get(i)));
        }
        sum
    }

    /// [`Pruning::solve_one`] of a small cell.
    #[inline(always)]
    fn solve_lone(
        &self,
        one: Small<'_>,
        centre: [f64; 3],
        depth: u8,
        leaf: &mut u8,
        work: &mut Work,
    ) -> Best {
        let (code, record) = (one.cell.codes[0], &one.cell.records[0]);
        self.solve_one(code, record, &one.places[0], centre, depth, leaf, &mut work.tally)
    }

    /// A cell of one Gaussian: every depth below is tried, none is visited.
    #[inline(always)]
    fn solve_one(
        &self,
        code: u64,
        record: &Record,
        place: &Place,
        centre: [f64; 3],
        depth: u8,
        leaf: &mut u8,
        tally: &mut Tally,
    ) -> Best {
        let Bits { deeper, gaussian, flagged, only_child } = self.bits;
        let j_high = self.options.j_high;
        let first = depth.max(self.options.j_low);
        let centre = if first == depth { centre } else { self.centre(code, first) };
        let offset = self.cube.offset(record.mean);
        // From the centre of the cell to the mean, but for the signs.
        let mut from: [f64; 3] = std::array::from_fn(|k| offset[k] - centre[k]);
        let mut rate = f64::from(first - depth) * only_child;
        let (mut cost, mut at, mut d) = (f64::INFINITY, j_high, first);
        loop {
            let square = from[0] * from[0] + from[1] * from[1] + from[2] * from[2];
            let bits = if d < j_high { flagged } else { gaussian };
            let here = place.weight * square + rate + bits;
            if here < cost {
                (cost, at) = (here, d);
            }
            // Deeper leaves cost more bits than all that is left to save.
            if d == j_high || rate + only_child + gaussian >= cost {
                break;
            }
            rate += deeper;
            d += 1;
            // The child on the side of the mean has its centre half its own side towards it.
            let half = 0.5 * self.cells[usize::from(d)];
            from = from.map(|x| x.abs() - half);
        }
        *leaf = at;
        tally.decided += 1;
        tally.skipped += u64::from(at < j_high);
        self.or_drop(Best { cost, empty: false }, place.importance, std::slice::from_mut(leaf))
    }

    /// Cost of dividing a cell into `occupied` children; a cell that turned out empty is not
    /// coded at all.
    fn division(&self, occupied: usize, depth: u8) -> f64 {
        let c = &self.options.cost;
        let go_on = if depth >= self.options.j_low { c.go_on } else { 0.0 };
        match occupied {
            0 => 0.0,
            n => self.options.lambda * (c.occupancy[n - 1] + go_on),
        }
    }

    /// The cheaper of a division and a leaf, if there may be one here, or of dropping all.
    fn leaf_or(
        &self,
        mut best: Best,
        importance: f64,
        leaf: f64,
        depth: u8,
        depths: &mut [u8],
    ) -> Best {
        // Equal costs: the leaf, which codes faster.
        if depth >= self.options.j_low && leaf <= best.cost {
            (best.cost, best.empty) = (leaf, false);
            depths.fill(depth);
        }
        self.or_drop(best, importance, depths)
    }

    /// Drops every Gaussian of the cell if that costs less.
    fn or_drop(&self, mut best: Best, importance: f64, depths: &mut [u8]) -> Best {
        if let Some(drop) = self.options.drop {
            let cost = drop * importance;
            if cost < best.cost {
                (best.cost, best.empty) = (cost, true);
                depths.fill(DROPPED);
            }
        }
        best
    }

    /// Cost of a leaf whose centre is at `offset` from the point that `place` refers to, but for
    /// [`Pruning::mixing`].
    fn floor(&self, place: &Place, offset: [f64; 3], depth: u8) -> f64 {
        place.displacement(offset) + self.leaf_rate(depth)
    }

    /// Distortion of giving all members one shape and one colour.
    fn mixing(&self, look: &Look) -> f64 {
        self.options.shape * look.shape() + self.options.colour * look.colours()
    }

    fn leaf_rate(&self, depth: u8) -> f64 {
        if depth < self.options.j_high { self.bits.flagged } else { self.bits.gaussian }
    }

    /// The mean of a Gaussian relative to `centre`.
    fn from(&self, record: &Record, centre: [f64; 3]) -> [f64; 3] {
        let offset = self.cube.offset(record.mean);
        std::array::from_fn(|k| offset[k] - centre[k])
    }

    /// From the centre of the cell at `depth` that holds `code` to that of its child: half a
    /// side of the child along each axis, up or down by a bit of the code.
    fn step(&self, code: u64, depth: u8) -> [f64; 3] {
        let half = (-0.5 * self.cells[usize::from(depth) + 1]).to_bits();
        // The bits of x, y and z that tell the children apart, as signs.
        let shift = 61 - 3 * u32::from(self.options.j_high - depth - 1);
        [0, 1, 2].map(|k| f64::from_bits(half ^ (code << (shift + k)) & (1 << 63)))
    }

    /// Centre of the child that holds `code`, of a cell with this centre. Exact for the cubes of
    /// [`Cube::of`].
    fn child(&self, centre: [f64; 3], code: u64, depth: u8) -> [f64; 3] {
        let step = self.step(code, depth);
        std::array::from_fn(|k| centre[k] + step[k])
    }

    /// Centre of a cell relative to the cube's origin; as `Cube::centre_offset`.
    fn centre(&self, code: u64, depth: u8) -> [f64; 3] {
        let shift = 3 * u32::from(self.options.j_high - depth);
        let side = self.cells[usize::from(depth)];
        morton::decode(code >> shift).map(|i| (f64::from(i) + 0.5) * side)
    }
}

impl Cell<'_> {
    fn part(&self, range: Range<usize>) -> Self {
        Self {
            codes: &self.codes[range.clone()],
            members: &self.members[range.clone()],
            records: &self.records[range],
        }
    }
}

impl Small<'_> {
    fn part(&self, range: Range<usize>) -> Self {
        let at = self.at + range.start;
        Self {
            cell: self.cell.part(range.clone()),
            places: &self.places[range],
            base: self.base,
            at,
        }
    }

    fn place(&self) -> Place {
        let mut sum = self.places[0];
        self.places[1..].iter().for_each(|place| sum.add(place));
        sum
    }
}
