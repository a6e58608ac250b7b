//! Coding order and nearest coded neighbours.
//!
//! Points near in Morton order are candidates for the nearest, so the search takes a fixed time per
//! point. The invariant that decoders rely on: every neighbour is before its point in coding order.

use crate::leaf::Leaf;
use crate::morton;
use crate::octree::Octree;

/// Neighbours kept per point.
pub const MAX_NEIGHBOURS: usize = 12;
/// Number of candidates before a point in Morton order.
const BEFORE: usize = 32;
/// Number of candidates after it.
const AFTER: usize = 16;
/// Points of one level of detail per point of the next coarser one.
const STRIDE_LOG2: u32 = 2;

/// Coding order (coarse to fine by Morton stride `4^m`) and nearest coded neighbours.
#[derive(Clone, Debug)]
pub struct Neighbours {
    order: Vec<u32>,
    /// Neighbours in coding order, `MAX_NEIGHBOURS` per point, nearest first.
    index: Vec<u32>,
    /// Squared distances in half-cells, saturating.
    distance: Vec<u32>,
    count: Vec<u8>,
    /// First point (in coding order) of each level of detail, then their number.
    levels: Vec<u32>,
}

impl Neighbours {
    /// Orders the leaves of an octree and finds each one's neighbours among all that precede it.
    #[must_use]
    pub fn new(tree: &Octree) -> Self {
        let leaves = tree.leaves();
        let n = leaves.len();
        let centre = |l: &Leaf| {
            let size = 1i32 << (tree.depth() - l.depth);
            morton::decode(l.morton).map(|v| 2 * v as i32 + size)
        };
        let position: Vec<[i32; 3]> = leaves.iter().map(centre).collect();
        let mut this = Self {
            order: Vec::with_capacity(n),
            index: vec![0; n * MAX_NEIGHBOURS],
            distance: vec![0; n * MAX_NEIGHBOURS],
            count: vec![0; n],
            levels: vec![0],
        };
        let mut coarsest = 0;
        while 1usize << (STRIDE_LOG2 * (coarsest + 1)) < n {
            coarsest += 1;
        }
        for level in (0..=coarsest).rev() {
            let stride = 1usize << (STRIDE_LOG2 * level);
            let coarser = (level < coarsest).then_some(stride << STRIDE_LOG2);
            let new = |i: &usize| coarser.is_none_or(|coarser| !i.is_multiple_of(coarser));
            for i in (0..n).step_by(stride).filter(new) {
                this.search(&position, i, stride, coarser);
            }
            this.levels.push(this.order.len() as u32);
        }
        this
    }

    /// Looks for the neighbours of leaf `i` among multiples of `before` below it, and of `after` from it on.
    fn search(&mut self, position: &[[i32; 3]], i: usize, before: usize, after: Option<usize>) {
        let at = self.order.len();
        self.order.push(i as u32);
        let base = at * MAX_NEIGHBOURS;
        let best_i = &mut self.index[base..base + MAX_NEIGHBOURS];
        let best_d = &mut self.distance[base..base + MAX_NEIGHBOURS];
        let mut kept = 0usize;
        let centre = position[i];
        let mut consider = |j: usize| {
            let p = position[j];
            let mut d = 0u64;
            for k in 0..3 {
                let e = i64::from(p[k] - centre[k]).unsigned_abs();
                d += e * e;
            }
            let d = d.min(u64::from(u32::MAX)) as u32;
            if kept == MAX_NEIGHBOURS && d >= best_d[kept - 1] {
                return;
            }
            let mut slot = kept.min(MAX_NEIGHBOURS - 1);
            kept = (kept + 1).min(MAX_NEIGHBOURS);
            while slot > 0 && best_d[slot - 1] > d {
                best_d[slot] = best_d[slot - 1];
                best_i[slot] = best_i[slot - 1];
                slot -= 1;
            }
            best_d[slot] = d;
            best_i[slot] = j as u32;
        };
        if i > 0 {
            let last = (i - 1) / before;
            for t in 0..=last.min(BEFORE - 1) {
                consider((last - t) * before);
            }
        }
        if let Some(after) = after {
            let all = (i.div_ceil(after) * after..position.len()).step_by(after);
            all.take(AFTER).for_each(consider);
        }
        self.count[at] = kept as u8;
    }

    /// Number of points.
    #[must_use]
    pub fn len(&self) -> usize {
        self.order.len()
    }

    /// True for no points.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.order.is_empty()
    }

    /// Leaf indices in coding order.
    #[must_use]
    pub fn order(&self) -> &[u32] {
        &self.order
    }

    /// First point (in coding order) of each level of detail, coarse to fine, then [`Self::len`].
    #[must_use]
    pub fn levels(&self) -> &[u32] {
        &self.levels
    }

    /// Leaf indices and squared distances (in half-cells) of the neighbours of the `at`-th point
    /// in coding order, nearest first; all of them precede it.
    #[must_use]
    pub fn of(&self, at: usize) -> (&[u32], &[u32]) {
        let range = at * MAX_NEIGHBOURS..at * MAX_NEIGHBOURS + usize::from(self.count[at]);
        (&self.index[range.clone()], &self.distance[range])
    }
}
