//! [`RateDistortion`]: bottom-up pruning that minimises distortion + lambda * bits.

use gpcc_lite::morton::{self, MAX_DEPTH};
use gs_model::Scene;
use rayon::prelude::*;

use crate::cost::CostModel;
use crate::cube::Cube;
use crate::error::Result;
use crate::importance::Importance;
use crate::order::{MortonOrder, cell_end};
use crate::record::{Record, Records};
use crate::stats::{Place, Stats};
use crate::strategy::{check, check_depths};
use crate::voxelize::{DROPPED, Voxelization};

/// Parameters of the rate-distortion strategy.
#[derive(Clone, Debug, PartialEq)]
pub struct RateDistortion {
    /// Distortion that one bit must save. Distortion is in units of the mean importance of a
    /// Gaussian, so one `lambda` means much the same in every scene; 1e-4 (fine) to 1e-1 (coarse).
    pub lambda: f64,
    /// Lowest leaf depth.
    pub j_low: u8,
    /// Highest leaf depth.
    pub j_high: u8,
    /// What leaves and divisions cost.
    pub cost: CostModel,
    /// What each Gaussian counts.
    pub importance: Importance,
    /// Displacements count per `area^size_exponent`; see the crate's results page.
    pub size_exponent: f64,
    /// Weight of the change of covariance against displacement; 1 is the W2 distance.
    pub shape: f64,
    /// Weight of the squared difference of DC colours inside a leaf.
    pub colour: f64,
    /// Distortion of leaving a Gaussian out, per unit of its importance; `None` keeps all.
    /// Gaussians that cost more bits than they are worth then get no leaf, see
    /// [`Voxelization::dropped`].
    pub drop: Option<f64>,
}

impl RateDistortion {
    /// Plain settings over depths 0 to 16: opacity times area, nothing dropped.
    ///
    /// [`RateDistortion::seen`] and [`RateDistortion::unseen`] are measured to do better.
    #[must_use]
    pub fn new(lambda: f64) -> Self {
        Self {
            lambda,
            j_low: 0,
            j_high: 16,
            cost: CostModel::default(),
            importance: Importance::OpacityArea,
            size_exponent: 1.0,
            shape: 1.0,
            colour: 1.0,
            drop: None,
        }
    }

    /// The best known settings for an encoder that has the training cameras; depths 0 to 18.
    ///
    /// `importance` is one entry per Gaussian: the rasterizer's sum of squared blending weights
    /// (alpha T) over pixels and training views. Gaussians that are worth less
    /// than their bits are dropped.
    #[must_use]
    pub fn seen(lambda: f64, importance: Vec<f32>) -> Self {
        Self {
            j_high: 18,
            importance: Importance::Given(importance),
            size_exponent: 0.75,
            drop: Some(10.0),
            ..Self::new(lambda)
        }
    }

    /// The best known settings for an encoder that has no cameras; depths 0 to 18.
    ///
    /// Trained Gaussians are larger the farther they are from the cameras, so the size exponent
    /// above 1 stands in for the distance.
    #[must_use]
    pub fn unseen(lambda: f64) -> Self {
        Self { j_high: 18, size_exponent: 1.5, shape: 0.3, ..Self::new(lambda) }
    }

    /// Checks every parameter.
    ///
    /// # Errors
    /// [`Error`](crate::Error) names the first one out of range.
    pub fn validate(&self) -> Result<()> {
        check_depths(self.j_low, self.j_high)?;
        check("lambda", self.lambda, 0.0, f64::MAX, "0 upwards")?;
        check("size_exponent", self.size_exponent, -2.0, 2.0, "-2 to 2")?;
        check("shape", self.shape, 0.0, f64::MAX, "0 upwards")?;
        check("drop", self.drop.unwrap_or(0.0), 0.0, f64::MAX, "0 upwards")?;
        check("colour", self.colour, 0.0, f64::MAX, "0 upwards")?;
        check("cost.gaussian", self.cost.gaussian, 0.0, f64::MAX, "0 upwards")?;
        check("cost.stop", self.cost.stop, 0.0, f64::MAX, "0 upwards")?;
        check("cost.go_on", self.cost.go_on, 0.0, f64::MAX, "0 upwards")?;
        for bits in self.cost.occupancy {
            check("cost.occupancy", bits, 0.0, f64::MAX, "0 upwards")?;
        }
        Ok(())
    }
}

/// What a [`rate_distortion`] run did.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RateDistortionReport {
    /// Cells whose division was decided.
    pub decided: u64,
    /// Of these, cells whose subtrees were not looked at because no division could pay.
    pub skipped: u64,
    /// Minimised sum of distortion and lambda times bits.
    pub cost: f64,
}

/// As [`voxelize`](crate::voxelize) with [`Strategy::RateDistortion`](crate::Strategy), and
/// with a report.
///
/// # Errors
/// As [`voxelize`](crate::voxelize).
pub fn rate_distortion(
    scene: &Scene,
    cube: &Cube,
    options: &RateDistortion,
) -> Result<(Voxelization, RateDistortionReport)> {
    options.validate()?;
    cube.validate()?;
    let order = MortonOrder::of(scene, cube, options.j_high)?;
    let records = Records::of(scene, &options.importance, options.size_exponent)?;
    let mut depths = vec![0u8; order.codes.len()];
    let mut report = RateDistortionReport::default();
    if !order.codes.is_empty() {
        let cells = std::array::from_fn(|depth| cube.cell(depth as u8));
        let pruning = Pruning { cube, cells, options, records: &records };
        let best = pruning.run(&order, &mut depths);
        report =
            RateDistortionReport { decided: best.decided, skipped: best.skipped, cost: best.cost };
    }
    drop(records);
    let voxelization = Voxelization::from_depths(*cube, options.j_high, order, |i| depths[i]);
    Ok((voxelization, report))
}

/// Cells of at most this many Gaussians are solved by one thread, in its second-level cache.
/// Fixed, so that no sum depends on the threads.
const BLOCK: usize = 2048;

/// Cells of at most this many Gaussians sum their statistics from the members, before the
/// children are looked at; so a cell that cannot gain by division skips its subtree.
const SMALL: usize = 24;

struct Pruning<'a> {
    cube: &'a Cube,
    /// Sides of the cells of every depth.
    cells: [f64; MAX_DEPTH as usize + 1],
    options: &'a RateDistortion,
    records: &'a Records,
}

/// The best pruning below a cell.
#[derive(Clone, Copy, Default)]
struct Best {
    /// Distortion + lambda * bits.
    cost: f64,
    /// Every Gaussian in the cell is dropped: the cell is not occupied.
    empty: bool,
    decided: u64,
    skipped: u64,
}

impl Best {
    /// Adds what a child costs, but not its statistics.
    fn add(&mut self, child: &Self) {
        self.cost += child.cost;
        self.empty &= child.empty;
        self.decided += child.decided;
        self.skipped += child.skipped;
    }
}

/// Codes and records of the Gaussians of a cell.
#[derive(Clone, Copy)]
struct Cell<'a> {
    codes: &'a [u64],
    records: &'a [Record],
}

/// A cell of few Gaussians with the statistics of each, relative to `base`.
#[derive(Clone, Copy)]
struct Small<'a> {
    codes: &'a [u64],
    records: &'a [Record],
    stats: &'a [Stats],
    base: [f64; 3],
}

/// What a thread keeps from block to block, to allocate it once.
#[derive(Default)]
struct Scratch {
    records: Vec<Record>,
    stats: Vec<Stats>,
}

/// A cell that one thread solves.
struct Block<'a> {
    depth: u8,
    codes: &'a [u64],
    members: &'a [u32],
    depths: &'a mut [u8],
}

impl Pruning<'_> {
    /// Finds the best pruning and writes the leaf depth of each Gaussian.
    fn run(&self, order: &MortonOrder, depths: &mut [u8]) -> Best {
        let mut blocks = Vec::new();
        self.divide(&order.codes, &order.members, 0, depths, &mut blocks);
        let solved: Vec<(Best, Stats)> = blocks
            .into_par_iter()
            .map_init(Scratch::default, |scratch, block| self.solve_block(scratch, block))
            .collect();
        let mut solved = solved.into_iter();
        let centre = self.centre(order.codes[0], 0);
        self.combine(&order.codes, centre, 0, depths, &mut solved).0
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

    fn solve_block(&self, scratch: &mut Scratch, block: Block<'_>) -> (Best, Stats) {
        let Block { depth, codes, members, depths } = block;
        if codes.len() > BLOCK {
            // That many in one finest cell.
            let mut sum = Stats::default();
            let centre = self.centre(codes[0], depth);
            for &i in members {
                let record = self.records.get(i);
                sum.add(&Stats::of(&record, self.from(&record, centre)));
            }
            let best = Best { cost: f64::INFINITY, empty: true, decided: 1, ..Best::default() };
            return (
                self.leaf_or(
                    best,
                    sum.place.importance,
                    self.leaf_cost(&sum, depth),
                    depth,
                    depths,
                ),
                sum,
            );
        }
        // Together, so that the cache misses overlap.
        let Scratch { records, stats } = scratch;
        records.clear();
        records.extend(members.iter().map(|&i| self.records.get(i)));
        self.solve(Cell { codes, records }, self.centre(codes[0], depth), depth, depths, stats)
    }

    /// Solves the cells above the blocks, whose results come in Morton order.
    fn combine(
        &self,
        codes: &[u64],
        centre: [f64; 3],
        depth: u8,
        depths: &mut [u8],
        blocks: &mut impl Iterator<Item = (Best, Stats)>,
    ) -> (Best, Stats) {
        if self.is_block(codes, depth) {
            // There are as many results as blocks.
            return blocks.next().unwrap_or_default();
        }
        self.combine_children(codes, centre, depth, depths, |codes, centre, depths| {
            self.combine(codes, centre, depth + 1, depths, blocks)
        })
    }

    /// Finds the best pruning of the cell at `depth` that holds all of `codes`, at most
    /// [`BLOCK`]. The statistics are relative to the cell's centre.
    fn solve(
        &self,
        cell: Cell<'_>,
        centre: [f64; 3],
        depth: u8,
        depths: &mut [u8],
        scratch: &mut Vec<Stats>,
    ) -> (Best, Stats) {
        let Cell { codes, records } = cell;
        if codes.len() > SMALL && depth < self.options.j_high {
            let mut at = 0;
            return self.combine_children(codes, centre, depth, depths, |codes, centre, depths| {
                let records = &records[at..at + codes.len()];
                at += codes.len();
                self.solve(Cell { codes, records }, centre, depth + 1, depths, scratch)
            });
        }
        scratch.clear();
        scratch.extend(records.iter().map(|r| Stats::of(r, self.from(r, centre))));
        let small = Small { codes, records, stats: scratch, base: centre };
        let sum = small.sum();
        (self.solve_small(small, &sum.place, centre, depth, depths), sum)
    }

    /// A cell whose children are solved one by one, by `child`.
    fn combine_children(
        &self,
        codes: &[u64],
        centre: [f64; 3],
        depth: u8,
        depths: &mut [u8],
        mut child: impl FnMut(&[u64], [f64; 3], &mut [u8]) -> (Best, Stats),
    ) -> (Best, Stats) {
        let mut best = Best { empty: true, decided: 1, ..Best::default() };
        let mut sum = Stats::default();
        let (mut start, mut occupied) = (0, 0);
        while start < codes.len() {
            let end = cell_end(codes, start, self.options.j_high, depth + 1);
            let from = self.child(centre, codes[start], depth);
            let (solved, stats) = child(&codes[start..end], from, &mut depths[start..end]);
            sum.add(&stats.moved(std::array::from_fn(|k| centre[k] - from[k])));
            occupied += usize::from(!solved.empty);
            best.add(&solved);
            start = end;
        }
        best.cost += self.division(occupied, depth);
        let leaf = self.leaf_cost(&sum, depth);
        (self.leaf_or(best, sum.place.importance, leaf, depth, depths), sum)
    }

    /// A cell of few Gaussians, whose statistics are at hand: all sums refer to `cell.base`,
    /// and a cell that cannot gain by division is not looked into. `place` is that of the cell.
    fn solve_small(
        &self,
        cell: Small<'_>,
        place: &Place,
        centre: [f64; 3],
        depth: u8,
        depths: &mut [u8],
    ) -> Best {
        let o = self.options;
        if cell.codes.len() == 1 {
            return self.solve_one(&cell, centre, depth, depths);
        }
        let mut best = Best { empty: true, decided: 1, ..Best::default() };
        // What a leaf costs for its place alone mostly rules it out; the rest is summed only
        // where it does not.
        let floor = place.displacement(std::array::from_fn(|k| centre[k] - cell.base[k]))
            + self.leaf_rate(depth);
        let mut leaf = None;
        // Any division that leaves something costs at least this, had it no distortion at all;
        // one that drops everything costs as much as dropping it here.
        let bound = o.lambda * (o.cost.go_on + o.cost.occupancy[0] + o.cost.gaussian);
        if depth == o.j_high || (depth >= o.j_low && floor <= bound) {
            let cost = floor + self.mixing(&cell.sum());
            if depth == o.j_high || cost <= bound {
                best.skipped = u64::from(depth < o.j_high);
                best.cost = f64::INFINITY;
                return self.leaf_or(best, place.importance, cost, depth, depths);
            }
            leaf = Some(cost);
        }
        let shift = 3 * u32::from(o.j_high - depth - 1);
        let (mut start, mut occupied) = (0, 0);
        while start < cell.codes.len() {
            let code = cell.codes[start] >> shift;
            let mut end = start + 1;
            while end < cell.codes.len() && cell.codes[end] >> shift == code {
                end += 1;
            }
            let part = cell.part(start..end);
            // An only child has the place of its parent.
            let own = if end - start == cell.codes.len() { *place } else { part.place() };
            let centre = self.child(centre, part.codes[0], depth);
            let child = self.solve_small(part, &own, centre, depth + 1, &mut depths[start..end]);
            occupied += usize::from(!child.empty);
            best.add(&child);
            start = end;
        }
        best.cost += self.division(occupied, depth);
        let leaf = match leaf {
            Some(cost) => cost,
            None if depth >= o.j_low && floor <= best.cost => floor + self.mixing(&cell.sum()),
            None => f64::INFINITY,
        };
        self.leaf_or(best, place.importance, leaf, depth, depths)
    }

    /// A cell of one Gaussian: every depth below is tried, none is visited.
    fn solve_one(&self, cell: &Small<'_>, centre: [f64; 3], depth: u8, depths: &mut [u8]) -> Best {
        let o = self.options;
        let place = &cell.stats[0].place;
        let code = cell.codes[0];
        let first = depth.max(o.j_low);
        let centre = if first == depth { centre } else { self.centre(code, first) };
        let offset = self.cube.offset(cell.records[0].mean);
        // From the centre of the cell to the mean.
        let mut from: [f64; 3] = std::array::from_fn(|k| offset[k] - centre[k]);
        let mut rate = f64::from(first - depth) * o.lambda * o.cost.occupancy[0];
        let deeper = o.lambda * (o.cost.occupancy[0] + o.cost.go_on);
        let gaussian = o.lambda * o.cost.gaussian;
        let flagged = o.lambda * (o.cost.stop + o.cost.gaussian);
        let (mut cost, mut at) = (f64::INFINITY, o.j_high);
        for d in first..=o.j_high {
            let square = from[0] * from[0] + from[1] * from[1] + from[2] * from[2];
            let leaf = if d < o.j_high { flagged } else { gaussian };
            let here = place.weight * square + rate + leaf;
            if here < cost {
                (cost, at) = (here, d);
            }
            // Deeper leaves cost more bits than all that is left to save.
            if d == o.j_high || rate + o.lambda * o.cost.occupancy[0] + gaussian >= cost {
                break;
            }
            rate += deeper;
            let step = self.step(code, d);
            (0..3).for_each(|k| from[k] -= step[k]);
        }
        depths.fill(at);
        let skipped = u64::from(at < o.j_high);
        self.or_drop(Best { cost, empty: false, decided: 1, skipped }, place.importance, depths)
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

    /// Cost of one leaf; `stats` relative to its centre.
    fn leaf_cost(&self, stats: &Stats, depth: u8) -> f64 {
        stats.place.displacement([0.0; 3]) + self.leaf_rate(depth) + self.mixing(stats)
    }

    /// Distortion of giving all members one shape and one colour.
    fn mixing(&self, stats: &Stats) -> f64 {
        self.options.shape * stats.shape() + self.options.colour * stats.features()
    }

    fn leaf_rate(&self, depth: u8) -> f64 {
        let o = self.options;
        let flag = if depth < o.j_high { o.cost.stop } else { 0.0 };
        o.lambda * (flag + o.cost.gaussian)
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

impl Small<'_> {
    fn part(&self, range: std::ops::Range<usize>) -> Self {
        Self {
            codes: &self.codes[range.clone()],
            records: &self.records[range.clone()],
            stats: &self.stats[range],
            base: self.base,
        }
    }

    fn place(&self) -> Place {
        let mut sum = self.stats[0].place;
        for stats in &self.stats[1..] {
            sum.add(&stats.place);
        }
        sum
    }

    fn sum(&self) -> Stats {
        let mut sum = self.stats[0];
        for stats in &self.stats[1..] {
            sum.add(stats);
        }
        sum
    }
}
