//! [`RateDistortion`]: bottom-up pruning that minimises distortion + lambda * bits.

use gpcc_lite::Leaf;
use gs_model::Scene;
use rayon::prelude::*;

use crate::cost::CostModel;
use crate::cube::Cube;
use crate::error::Result;
use crate::importance::{Importance, weights};
use crate::order::{MortonOrder, cell_end};
use crate::stats::{Stats, Weights};
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
    /// `importance` is one entry per Gaussian: the rasterizer's saliency (sum of alpha T over
    /// pixels and training views) times the Gaussian's opacity. Gaussians that are worth less
    /// than their bits are dropped.
    #[must_use]
    pub fn seen(lambda: f64, importance: Vec<f32>) -> Self {
        Self {
            j_high: 18,
            importance: Importance::Given(importance),
            size_exponent: 0.75,
            shape: 0.3,
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
        let best = pruning.solve(&order.codes, &order.members, 0, &mut depths);
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
    /// Of all Gaussians in the cell, relative to the cell's centre.
    stats: Stats,
    /// Every Gaussian in the cell is dropped: the cell is not occupied.
    empty: bool,
    decided: u64,
    skipped: u64,
}

impl Pruning<'_> {
    /// Finds the best pruning of the cell at `depth` that holds all of `codes` and writes the
    /// leaf depth of each Gaussian.
    fn solve(&self, codes: &[u64], members: &[u32], depth: u8, depths: &mut [u8]) -> Best {
        let o = self.options;
        let centre = self.centre(codes[0], depth);
        if let &[only] = members {
            return self.solve_one(codes[0], only as usize, depth, centre, depths);
        }
        let may_stop = depth >= o.j_low;
        if depth == o.j_high || (may_stop && members.len() <= SMALL) {
            let mut stats = Stats::default();
            for &i in members {
                let i = i as usize;
                stats.add(&Stats::of(self.scene, i, self.from(i, centre), self.weights[i]));
            }
            let cost = self.leaf_cost(&stats, depth);
            // Any division costs at least this, had it no distortion at all.
            let bound = o.lambda * (o.cost.go_on + o.cost.occupancy[0] + o.cost.gaussian);
            // Dropping all of it is cheaper than any leaf; dropping a part still is a division.
            if depth == o.j_high || (cost <= bound && o.drop.is_none()) {
                depths.fill(depth);
                let skipped = u64::from(depth < o.j_high);
                let best = Best { cost, stats, empty: false, decided: 1, skipped };
                return self.or_drop(best, depths);
            }
        }
        let mut best = self.solve_children(codes, members, depth, depths, centre);
        best.decided += 1;
        if may_stop {
            // A cell that turned out empty is not coded at all.
            best.cost += if best.empty { 0.0 } else { o.lambda * o.cost.go_on };
            let leaf = self.leaf_cost(&best.stats, depth);
            // Equal costs: the leaf, which codes faster.
            if leaf <= best.cost {
                (best.cost, best.empty) = (leaf, false);
                depths.fill(depth);
            }
        }
        self.or_drop(best, depths)
    }

    fn solve_children(
        &self,
        codes: &[u64],
        members: &[u32],
        depth: u8,
        depths: &mut [u8],
        centre: [f64; 3],
    ) -> Best {
        let o = self.options;
        let mut tasks: [Option<Task<'_>>; 8] = [const { None }; 8];
        let (mut count, mut start, mut rest) = (0, 0, depths);
        while start < codes.len() {
            let end = cell_end(codes, start, o.j_high, depth + 1);
            let (head, tail) = std::mem::take(&mut rest).split_at_mut(end - start);
            tasks[count] = Some((&codes[start..end], &members[start..end], head));
            (count, start, rest) = (count + 1, end, tail);
        }
        let solve = |task: &mut Option<Task<'_>>| match task {
            Some((codes, members, depths)) => {
                let best = self.solve(codes, members, depth + 1, depths);
                let child = self.centre(codes[0], depth + 1);
                let shift = std::array::from_fn(|k| centre[k] - child[k]);
                Best { stats: best.stats.moved(shift), ..best }
            }
            None => Best::default(),
        };
        let children: [Best; 8] = if codes.len() > PARALLEL {
            let mut out = [Best::default(); 8];
            out.par_iter_mut().zip(&mut tasks).for_each(|(out, task)| *out = solve(task));
            out
        } else {
            tasks.each_mut().map(solve)
        };
        let children = &children[..count];
        let occupied = children.iter().filter(|child| !child.empty).count();
        let bits = if occupied > 0 { o.cost.occupancy[occupied - 1] } else { 0.0 };
        let mut sum = Best { cost: o.lambda * bits, empty: occupied == 0, ..Best::default() };
        for child in children {
            sum.cost += child.cost;
            sum.stats.add(&child.stats);
            sum.decided += child.decided;
            sum.skipped += child.skipped;
        }
        sum
    }

    /// A cell of one Gaussian: every depth below is tried, none is visited.
    fn solve_one(
        &self,
        code: u64,
        i: usize,
        depth: u8,
        centre: [f64; 3],
        depths: &mut [u8],
    ) -> Best {
        let o = self.options;
        let w = self.weights[i].geometry;
        let offset = self.cube.offset(self.scene.means[i]);
        let mut bits = 0.0;
        let (mut cost, mut at) = (f64::INFINITY, o.j_high);
        for d in depth..=o.j_high {
            let flag = d >= o.j_low && d < o.j_high;
            if d >= o.j_low {
                let c = self.centre(code, d);
                let square: f64 = (0..3).map(|k| (offset[k] - c[k]) * (offset[k] - c[k])).sum();
                let stop = if flag { o.cost.stop } else { 0.0 };
                let here = w * square + o.lambda * (bits + stop + o.cost.gaussian);
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
        let stats = Stats::of(self.scene, i, self.from(i, centre), self.weights[i]);
        let skipped = u64::from(at < o.j_high);
        self.or_drop(Best { cost, stats, empty: false, decided: 1, skipped }, depths)
    }

    /// Drops every Gaussian of the cell if that costs less.
    fn or_drop(&self, mut best: Best, depths: &mut [u8]) -> Best {
        if let Some(drop) = self.options.drop {
            let cost = drop * best.stats.importance();
            if cost < best.cost {
                (best.cost, best.empty) = (cost, true);
                depths.fill(DROPPED);
            }
        }
        best
    }

    fn leaf_cost(&self, stats: &Stats, depth: u8) -> f64 {
        let o = self.options;
        let distortion =
            stats.displacement([0.0; 3]) + o.shape * stats.shape() + o.colour * stats.features();
        let flag = if depth < o.j_high { o.cost.stop } else { 0.0 };
        distortion + o.lambda * (flag + o.cost.gaussian)
    }

    /// Mean of Gaussian `i` relative to `centre`.
    fn from(&self, i: usize, centre: [f64; 3]) -> [f64; 3] {
        let offset = self.cube.offset(self.scene.means[i]);
        std::array::from_fn(|k| offset[k] - centre[k])
    }

    /// Centre of a cell relative to the cube's origin.
    fn centre(&self, code: u64, depth: u8) -> [f64; 3] {
        let shift = 3 * u32::from(self.options.j_high - depth);
        let leaf = Leaf { morton: code >> shift << shift, depth };
        self.cube.centre_offset(leaf, self.options.j_high)
    }
}
