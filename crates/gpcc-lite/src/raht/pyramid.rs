//! The octree levels above the leaves, with who touches whom.

use crate::hood::{CENTRE, Hood, NONE, child_hood};
use crate::leaf::Leaf;
use crate::raht::{Plan, inverse_root};

/// One neighbour of a block.
#[derive(Clone, Copy, Debug)]
pub(super) struct Link {
    /// Its index among the nodes of the level.
    pub(super) node: u32,
    /// Its place in the 3x3x3 neighbourhood.
    pub(super) place: u8,
}

/// Nodes of one depth, in Morton order.
///
/// A node that holds one leaf and touches nobody is not split further: nothing below it is
/// predicted, and nobody is predicted from it.
#[derive(Clone, Debug, Default)]
pub(super) struct Level {
    /// First leaf of each node.
    pub(super) first: Vec<u32>,
    /// `1 / sqrt(weight)` of each node.
    pub(super) inverse_root: Vec<u32>,
    /// Occupied children of each node; 0 if it is not split.
    pub(super) mask: Vec<u8>,
    /// Index of the first child in the next level.
    pub(super) child: Vec<u32>,
    /// Per block (node with two children or more): end of its links.
    pub(super) link_end: Vec<u32>,
    /// Neighbours of the blocks, in order.
    pub(super) links: Vec<Link>,
}

/// All levels, root first.
#[derive(Clone, Debug)]
pub(super) struct Pyramid {
    pub(super) levels: Vec<Level>,
}

impl Pyramid {
    pub(super) fn new(plan: &Plan) -> Self {
        let (leaves, j_high): (&[Leaf], u8) = (&plan.leaves, plan.j_high);
        let roots = |first: &[u32], end: &[u32]| -> Vec<u32> {
            first.iter().zip(end).map(|(&a, &b)| inverse_root(plan.weight_of(a, b))).collect()
        };
        let mut levels = Vec::with_capacity(usize::from(j_high) + 1);
        let mut root = [NONE; 27];
        root[CENTRE] = 0;
        let mut hood: Vec<Hood> = if leaves.is_empty() { Vec::new() } else { vec![root] };
        let mut first: Vec<u32> = vec![0; hood.len()];
        let mut end: Vec<u32> = vec![leaves.len() as u32; hood.len()];
        for depth in 0..j_high {
            let shift = 3 * (j_high - depth - 1);
            let inverse_root = roots(&first, &end);
            let mut level = Level { first, inverse_root, ..Level::default() };
            let nodes = level.first.len();
            level.mask.reserve(nodes);
            level.child.reserve(nodes);
            let mut next_first = Vec::with_capacity(nodes);
            let mut next_end = Vec::with_capacity(nodes);
            for at in 0..nodes {
                let (lo, hi) = (level.first[at], end[at]);
                level.child.push(next_first.len() as u32);
                if hi - lo == 1
                    && (leaves[lo as usize].depth <= depth
                        || hood[at].iter().filter(|&&n| n != NONE).count() == 1)
                {
                    level.mask.push(0);
                    continue;
                }
                let mut mask = 0u8;
                let mut start = lo;
                while start < hi {
                    let c = (leaves[start as usize].morton >> shift) as u32 & 7;
                    let same = |l: &Leaf| (l.morton >> shift) as u32 & 7 == c;
                    let run = &leaves[start as usize..hi as usize];
                    let len = if run.len() > 32 {
                        run.partition_point(same)
                    } else {
                        run.iter().take_while(|l| same(l)).count()
                    };
                    mask |= 1 << c;
                    next_first.push(start);
                    start += len as u32;
                    next_end.push(start);
                }
                level.mask.push(mask);
                if mask.count_ones() > 1 {
                    for (place, &node) in hood[at].iter().enumerate() {
                        if node != NONE && place != CENTRE {
                            level.links.push(Link { node, place: place as u8 });
                        }
                    }
                    level.link_end.push(level.links.len() as u32);
                }
            }
            let mut next_hood = Vec::with_capacity(next_first.len());
            for at in 0..nodes {
                for c in 0..8 {
                    if level.mask[at] >> c & 1 == 1 {
                        next_hood.push(child_hood(&hood[at], c, &level.mask, &level.child));
                    }
                }
            }
            hood = next_hood;
            end = next_end;
            first = next_first;
            levels.push(level);
        }
        let inverse_root = roots(&first, &end);
        levels.push(Level { first, inverse_root, ..Level::default() });
        Self { levels }
    }
}
