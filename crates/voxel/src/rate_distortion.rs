//! [`RateDistortion`]: bottom-up pruning that minimises distortion + lambda * bits.

use gpcc_lite::{Leaf, morton};
use gs_model::Scene;
use rayon::prelude::*;

use crate::cost::CostModel;
use crate::cube::Cube;
use crate::error::Result;
use crate::importance::{Importance, weights};
use crate::order::{MortonOrder, cell_end};
use crate::stats::{Raw, Stats, Weights};
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
    let weights = weights(scene, &options.importance, options.size_exponent)?;
    let mut depths = vec![0u8; order.codes.len()];
    let mut report = RateDistortionReport::default();
    if !order.codes.is_empty() {
        let pruning = Pruning { scene, cube, options, weights: &weights };
        let (best, _) = pruning.solve(&order.codes, &order.members, 0, &mut depths);
        report =
            RateDistortionReport { decided: best.decided, skipped: best.skipped, cost: best.cost };
    }
    let voxelization = Voxelization::from_depths(*cube, options.j_high, order, |i| depths[i]);
    Ok((voxelization, report))
}

/// Cells of more Gaussians than this solve their children in parallel.
const PARALLEL: usize = 8192;

/// Cells of at most this many Gaussians sum their statistics from the members, before the
/// children are looked at; so a cell that cannot gain by division skips its subtree.
const SMALL: usize = 24;

/// Codes and members of a cell, and where its leaf depths go.
type Task<'a> = (&'a [u64], &'a [u32], &'a mut [u8]);

struct Pruning<'a> {
    scene: &'a Scene,
    cube: &'a Cube,
    options: &'a RateDistortion,
    weights: &'a [Weights],
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

/// A cell of few Gaussians with the statistics of each, relative to `base`.
#[derive(Clone, Copy)]
struct Small<'a> {
    codes: &'a [u64],
    members: &'a [u32],
    stats: &'a [Stats],
    base: [f64; 3],
}

impl Small<'_> {
    fn part(&self, range: std::ops::Range<usize>) -> Self {
        Self {
            codes: &self.codes[range.clone()],
            members: &self.members[range.clone()],
            stats: &self.stats[range],
            base: self.base,
        }
    }
}

impl Pruning<'_> {
    /// Finds the best pruning of the cell at `depth` that holds all of `codes` and writes the
    /// leaf depth of each Gaussian. The statistics are relative to the cell's centre.
    fn solve(&self, codes: &[u64], members: &[u32], depth: u8, depths: &mut [u8]) -> (Best, Stats) {
        let mut sum = Stats::default();
        let centre = self.centre(codes[0], depth);
        if members.len() <= SMALL {
            let mut raw = [Raw::default(); SMALL];
            for (raw, &i) in raw.iter_mut().zip(members) {
                *raw = Raw::of(self.scene, self.weights, i as usize);
            }
            let mut stats = [Stats::default(); SMALL];
            for (stats, raw) in stats.iter_mut().zip(&raw[..members.len()]) {
                *stats = Stats::of(raw, self.from(raw.mean, centre));
                sum.add(stats);
            }
            let cell = Small { codes, members, stats: &stats[..members.len()], base: centre };
            return (self.solve_small(cell, depth, depths), sum);
        }
        let o = self.options;
        let mut best = Best { empty: true, decided: 1, ..Best::default() };
        if depth == o.j_high {
            // More than SMALL Gaussians in one finest cell.
            for &i in members {
                let raw = Raw::of(self.scene, self.weights, i as usize);
                sum.add(&Stats::of(&raw, self.from(raw.mean, centre)));
            }
            best.cost = f64::INFINITY;
        } else {
            let mut occupied = 0;
            for (child, stats) in self.solve_children(codes, members, depth, depths) {
                sum.add(&stats);
                occupied += usize::from(!child.empty);
                best.add(&child);
            }
            best.cost += self.division(occupied, depth);
        }
        (self.leaf_or(best, &sum, self.leaf_cost(&sum, [0.0; 3], depth), depth, depths), sum)
    }

    /// The occupied children of a cell, solved; statistics relative to the cell's centre. In parallel where that pays; always combined in Morton order.
    fn solve_children(
        &self,
        codes: &[u64],
        members: &[u32],
        depth: u8,
        depths: &mut [u8],
    ) -> Vec<(Best, Stats)> {
        let centre = self.centre(codes[0], depth);
        let mut tasks: Vec<Task<'_>> = Vec::with_capacity(8);
        let (mut start, mut rest) = (0, depths);
        while start < codes.len() {
            let end = cell_end(codes, start, self.options.j_high, depth + 1);
            let (head, tail) = std::mem::take(&mut rest).split_at_mut(end - start);
            tasks.push((&codes[start..end], &members[start..end], head));
            (start, rest) = (end, tail);
        }
        let solve = |(codes, members, depths): &mut Task<'_>| {
            let (best, stats) = self.solve(codes, members, depth + 1, depths);
            let child = self.centre(codes[0], depth + 1);
            (best, stats.moved(std::array::from_fn(|k| centre[k] - child[k])))
        };
        if codes.len() > PARALLEL {
            tasks.par_iter_mut().map(solve).collect()
        } else {
            tasks.iter_mut().map(solve).collect()
        }
    }

    /// As [`Pruning::solve`] for few Gaussians, whose statistics are at hand: all sums refer to
    /// `cell.base`, and a cell that cannot gain by division is not looked into.
    fn solve_small(&self, cell: Small<'_>, depth: u8, depths: &mut [u8]) -> Best {
        let o = self.options;
        if cell.members.len() == 1 {
            return self.solve_one(&cell, depth, depths);
        }
        let mut best = Best { empty: true, decided: 1, ..Best::default() };
        let mut sum = Stats::default();
        for stats in cell.stats {
            sum.add(stats);
        }
        let centre = self.centre(cell.codes[0], depth);
        let from_base = std::array::from_fn(|k| centre[k] - cell.base[k]);
        let leaf = self.leaf_cost(&sum, from_base, depth);
        // Any division that leaves something costs at least this, had it no distortion at all;
        // one that drops everything costs as much as dropping it here.
        let bound = o.lambda * (o.cost.go_on + o.cost.occupancy[0] + o.cost.gaussian);
        if depth == o.j_high || (depth >= o.j_low && leaf <= bound) {
            best.skipped = u64::from(depth < o.j_high);
            best.cost = f64::INFINITY;
            return self.leaf_or(best, &sum, leaf, depth, depths);
        }
        let (mut start, mut occupied) = (0, 0);
        while start < cell.codes.len() {
            let end = cell_end(cell.codes, start, o.j_high, depth + 1);
            let child = self.solve_small(cell.part(start..end), depth + 1, &mut depths[start..end]);
            occupied += usize::from(!child.empty);
            best.add(&child);
            start = end;
        }
        best.cost += self.division(occupied, depth);
        self.leaf_or(best, &sum, leaf, depth, depths)
    }

    /// A cell of one Gaussian: every depth below is tried, none is visited.
    fn solve_one(&self, cell: &Small<'_>, depth: u8, depths: &mut [u8]) -> Best {
        let o = self.options;
        let (stats, i) = (&cell.stats[0], cell.members[0] as usize);
        let offset = self.cube.offset(self.scene.means[i]);
        let index = morton::decode(cell.codes[0]);
        let mut bits = 0.0;
        let (mut cost, mut at) = (f64::INFINITY, o.j_high);
        for d in depth..=o.j_high {
            let flag = d >= o.j_low && d < o.j_high;
            if d >= o.j_low {
                let side = self.cube.cell(d);
                let square: f64 = (0..3)
                    .map(|k| (f64::from(index[k] >> (o.j_high - d)) + 0.5) * side - offset[k])
                    .map(|x| x * x)
                    .sum();
                let stop = if flag { o.cost.stop } else { 0.0 };
                let here = stats.weight * square + o.lambda * (bits + stop + o.cost.gaussian);
                if here < cost {
                    (cost, at) = (here, d);
                }
                // Deeper leaves cost more bits than all that is left to save.
                if o.lambda * (bits + o.cost.occupancy[0] + o.cost.gaussian) >= cost {
                    break;
                }
            }
            bits += o.cost.occupancy[0] + if flag { o.cost.go_on } else { 0.0 };
        }
        depths.fill(at);
        let skipped = u64::from(at < o.j_high);
        self.or_drop(Best { cost, empty: false, decided: 1, skipped }, stats, depths)
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
        stats: &Stats,
        leaf: f64,
        depth: u8,
        depths: &mut [u8],
    ) -> Best {
        // Equal costs: the leaf, which codes faster.
        if depth >= self.options.j_low && leaf <= best.cost {
            (best.cost, best.empty) = (leaf, false);
            depths.fill(depth);
        }
        self.or_drop(best, stats, depths)
    }

    /// Drops every Gaussian of the cell if that costs less.
    fn or_drop(&self, mut best: Best, stats: &Stats, depths: &mut [u8]) -> Best {
        if let Some(drop) = self.options.drop {
            let cost = drop * stats.importance();
            if cost < best.cost {
                (best.cost, best.empty) = (cost, true);
                depths.fill(DROPPED);
            }
        }
        best
    }

    /// Cost of one leaf at `centre`, relative like `stats`.
    fn leaf_cost(&self, stats: &Stats, centre: [f64; 3], depth: u8) -> f64 {
        let o = self.options;
        let distortion =
            stats.displacement(centre) + o.shape * stats.shape() + o.colour * stats.features();
        let flag = if depth < o.j_high { o.cost.stop } else { 0.0 };
        distortion + o.lambda * (flag + o.cost.gaussian)
    }

    /// A mean relative to `centre`.
    fn from(&self, mean: [f32; 3], centre: [f64; 3]) -> [f64; 3] {
        let offset = self.cube.offset(mean);
        std::array::from_fn(|k| offset[k] - centre[k])
    }

    /// Centre of a cell relative to the cube's origin.
    fn centre(&self, code: u64, depth: u8) -> [f64; 3] {
        let shift = 3 * u32::from(self.options.j_high - depth);
        let leaf = Leaf { morton: code >> shift << shift, depth };
        self.cube.centre_offset(leaf, self.options.j_high)
    }
}
