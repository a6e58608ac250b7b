//! A tree over the centres, whose planes are drawn at random: a point meets those centres that are on its side of all of
//! them, which are likely to be near.

use std::ops::Range;

use crate::rng::SplitMix64;
use crate::{LANES, dot};

/// Most centres in a leaf.
const LEAF: usize = 64;

/// The nearest centre so far.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Hit {
    pub(crate) id: u32,
    /// Squared distance.
    pub(crate) cost: f32,
}

struct Node<const D: usize> {
    /// A point whose product with it is less than `threshold` is in the first child, which follows the node.
    direction: [f32; D],
    threshold: f32,
    /// Index of the second child; 0 for a leaf.
    second: u32,
    /// The blocks of a leaf.
    blocks: Range<usize>,
}

/// A tree of centres.
pub(crate) struct Tree<const D: usize> {
    nodes: Vec<Node<D>>,
    blocks: Vec<Block<D>>,
}

/// Centres of a leaf, side by side; unused lanes lie at infinity.
struct Block<const D: usize> {
    position: [[f32; LANES]; D],
    id: [u32; LANES],
}

impl<const D: usize> Tree<D> {
    pub(crate) fn new(centres: &[[f32; D]], rng: &mut SplitMix64) -> Self {
        let mut ids: Vec<u32> = (0..centres.len() as u32).collect();
        let mut tree = Self { nodes: Vec::new(), blocks: Vec::new() };
        tree.build(centres, &mut ids, rng);
        tree
    }

    fn build(&mut self, centres: &[[f32; D]], ids: &mut [u32], rng: &mut SplitMix64) {
        let (at, first) = (self.nodes.len(), self.blocks.len());
        let node = Node { direction: [0.0; D], threshold: 0.0, second: 0, blocks: first..first };
        self.nodes.push(node);
        if ids.len() <= LEAF {
            // Of equally near centres the first is taken.
            ids.sort_unstable();
            self.blocks.extend(ids.chunks(LANES).map(|ids| Block::of(centres, ids)));
            self.nodes[at].blocks.end = self.blocks.len();
            return;
        }
        // Half of the centres on each side of a plane between two of them. Sorted, their order does not depend on how
        // the halves were found.
        ids.sort_unstable();
        let [a, b] = [(); 2].map(|()| &centres[ids[rng.below(ids.len())] as usize]);
        let direction = std::array::from_fn(|k| a[k] - b[k]);
        let mut along: Vec<(f32, u32)> =
            ids.iter().map(|&id| (dot(&direction, &centres[id as usize]), id)).collect();
        let middle = ids.len() / 2;
        along.select_nth_unstable_by(middle, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        self.nodes[at].direction = direction;
        self.nodes[at].threshold = along[middle].0;
        ids.iter_mut().zip(along).for_each(|(id, (_, sorted))| *id = sorted);
        let (low, high) = ids.split_at_mut(middle);
        self.build(centres, low, rng);
        self.nodes[at].second = self.nodes.len() as u32;
        self.build(centres, high, rng);
    }

    /// Replaces `hit` by the nearest centre in the leaf of a point, if that is nearer.
    #[inline(always)]
    pub(crate) fn improve(&self, point: &[f32; D], hit: &mut Hit) {
        let mut at = 0;
        while self.nodes[at].second != 0 {
            let node = &self.nodes[at];
            let is_low = dot(&node.direction, point) < node.threshold;
            at = if is_low { at + 1 } else { node.second as usize };
        }
        for block in &self.blocks[self.nodes[at].blocks.clone()] {
            let costs = block.squared_distances(point);
            for lane in 0..LANES {
                if costs[lane] < hit.cost {
                    *hit = Hit { id: block.id[lane], cost: costs[lane] };
                }
            }
        }
    }
}

impl<const D: usize> Block<D> {
    fn of(centres: &[[f32; D]], ids: &[u32]) -> Self {
        let mut block = Self { position: [[f32::INFINITY; LANES]; D], id: [u32::MAX; LANES] };
        for (lane, &id) in ids.iter().enumerate() {
            block.id[lane] = id;
            for k in 0..D {
                block.position[k][lane] = centres[id as usize][k];
            }
        }
        block
    }

    #[inline(always)]
    fn squared_distances(&self, point: &[f32; D]) -> [f32; LANES] {
        let mut sums = [0.0f32; LANES];
        for k in 0..D {
            for lane in 0..LANES {
                let d = point[k] - self.position[k][lane];
                sums[lane] += d * d;
            }
        }
        sums
    }
}
