//! [`Voxelization`]: the leaves of a pruned octree and the Gaussians in each.
//!
//! *Invariant:* every Gaussian is a member of exactly one leaf, or dropped; leaves ascend in Morton
//! code and none contains another.

use gpcc_lite::Leaf;
use rayon::prelude::*;

use crate::cube::Cube;
use crate::order::MortonOrder;
use crate::parallel::CHUNK;

/// The leaves of a pruned octree and the Gaussians in each.
#[derive(Clone, Debug, PartialEq)]
pub struct Voxelization {
    /// The cube that the octree divides.
    pub cube: Cube,
    /// Depth of the finest possible leaf; Morton codes are at this depth.
    pub j_high: u8,
    /// Leaves, ascending in Morton code; none contains another.
    pub leaves: Vec<Leaf>,
    /// `leaves.len() + 1` ascending offsets into `members`.
    pub member_offsets: Vec<u32>,
    /// Indices into the scene, each at most once, grouped by leaf. Inside a leaf they are in Morton
    /// order at `j_high`; ties ascend.
    pub members: Vec<u32>,
    /// Gaussians without a leaf, in Morton order. Only
    /// [`RateDistortion::drop`](crate::RateDistortion::drop) leaves Gaussians out.
    pub dropped: Vec<u32>,
}

/// The depth of Gaussians without a leaf.
pub(crate) const DROPPED: u8 = u8::MAX;

impl Voxelization {
    /// Number of leaves.
    #[must_use]
    pub fn len(&self) -> usize {
        self.leaves.len()
    }

    /// True if there is no leaf.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.leaves.is_empty()
    }

    /// The Gaussians in leaf `i`.
    #[must_use]
    pub fn members_of(&self, i: usize) -> &[u32] {
        &self.members[self.member_offsets[i] as usize..self.member_offsets[i + 1] as usize]
    }

    /// The leaf of each of the `n` Gaussians of the scene; `u32::MAX` for those without.
    ///
    /// # Panics
    /// If the scene has more than `n` Gaussians.
    #[must_use]
    pub fn leaf_of_each(&self, n: usize) -> Vec<u32> {
        let mut leaves = vec![u32::MAX; n];
        for leaf in 0..self.len() {
            self.members_of(leaf).iter().for_each(|&i| leaves[i as usize] = leaf as u32);
        }
        leaves
    }

    /// For each leaf the sum of `values` over its members. `values` has one entry per Gaussian of the
    /// scene.
    #[must_use]
    pub fn sums(&self, values: &[f32]) -> Vec<f32> {
        let of = |i| self.members_of(i).iter().map(|&m| values[m as usize]).sum();
        (0..self.len()).map(of).collect()
    }

    /// Adds the leaves of the next tile of the same octree. `numbers` are the places of its Gaussians in the
    /// scene.
    pub fn append(&mut self, tile: &Self, numbers: &[u32]) {
        let first = self.members.len() as u32;
        let number = |&i: &u32| numbers[i as usize];
        self.leaves.extend(&tile.leaves);
        self.member_offsets.pop();
        self.member_offsets.extend(tile.member_offsets.iter().map(|o| first + o));
        self.members.extend(tile.members.iter().map(number));
        self.dropped.extend(tile.dropped.iter().map(number));
    }

    /// Centre of leaf `i` in world units: the mean of the merged Gaussian.
    #[must_use]
    pub fn centre(&self, i: usize) -> [f32; 3] {
        self.cube.leaf_centre(self.leaves[i], self.j_high)
    }

    /// Number of leaves at every depth, 0 to `j_high`.
    #[must_use]
    pub fn depth_histogram(&self) -> Vec<usize> {
        let mut counts = vec![0; usize::from(self.j_high) + 1];
        for leaf in &self.leaves {
            counts[usize::from(leaf.depth)] += 1;
        }
        counts
    }

    /// Cuts the sorted Gaussians into leaves. `depth_at(i)` is the depth of the leaf of the `i`-th
    /// Gaussian of `order`, or [`DROPPED`]. It is the same for all Gaussians of one leaf.
    pub(crate) fn from_depths(
        cube: Cube,
        j_high: u8,
        order: MortonOrder,
        depth_at: impl Fn(usize) -> u8 + Sync,
    ) -> Self {
        // The leaf of a Gaussian is that of its code, not of its mean: the authors' code moves
        // Gaussians before it voxelizes them.
        let MortonOrder { codes, members: sorted } = order;
        let codes = &codes[..];
        let shift = |depth: u8| 3 * u32::from(j_high - depth);
        // Whether a leaf starts at a Gaussian depends on the one before it only, so the loop over
        // the Gaussians is parallel.
        let starts_leaf = |i: usize| {
            let depth = depth_at(i);
            // No branch, because a processor could not predict it.
            i == 0 || (depth_at(i - 1) != depth) | ((codes[i] ^ codes[i - 1]) >> shift(depth) != 0)
        };
        let is_dropped = |i: usize| depth_at(i) == DROPPED;
        let leaf = |i: usize| {
            let depth = depth_at(i);
            Leaf { morton: codes[i] >> shift(depth) << shift(depth), depth }
        };
        let chunks = (0..codes.len().div_ceil(CHUNK)).into_par_iter();
        let range = |chunk: usize| chunk * CHUNK..codes.len().min((chunk + 1) * CHUNK);
        if !chunks.into_par_iter().any(|chunk| range(chunk).any(is_dropped)) {
            let member_offsets = positions(codes.len(), starts_leaf);
            let starts = &member_offsets[..member_offsets.len() - 1];
            let leaves = starts.par_iter().map(|&i| leaf(i as usize)).collect();
            return Self { cube, j_high, leaves, member_offsets, members: sorted, dropped: vec![] };
        }
        let members_at = |mut positions: Vec<u32>| -> (Vec<u32>, Vec<u32>) {
            positions.pop();
            let members = positions.par_iter().map(|&i| sorted[i as usize]).collect();
            (positions, members)
        };
        let (_, dropped) = members_at(positions(codes.len(), is_dropped));
        let (kept, members) = members_at(positions(codes.len(), |i| !is_dropped(i)));
        let member_offsets = positions(kept.len(), |j| starts_leaf(kept[j] as usize));
        let starts = &member_offsets[..member_offsets.len() - 1];
        let leaves = starts.par_iter().map(|&j| leaf(kept[j as usize] as usize)).collect();
        Self { cube, j_high, leaves, member_offsets, members, dropped }
    }
}

/// Ascending indices below `len` for which `wanted` holds, then `len` itself.
fn positions(len: usize, wanted: impl Fn(usize) -> bool + Sync) -> Vec<u32> {
    let range = |chunk: usize| chunk * CHUNK..len.min((chunk + 1) * CHUNK);
    let counts: Vec<usize> = (0..len.div_ceil(CHUNK))
        .into_par_iter()
        .map(|chunk| range(chunk).filter(|&i| wanted(i)).count())
        .collect();
    let mut out = vec![0u32; counts.iter().sum::<usize>() + 1];
    let mut parts = Vec::with_capacity(counts.len());
    let mut rest = out.as_mut_slice();
    for count in counts {
        let (head, tail) = rest.split_at_mut(count);
        parts.push(head);
        rest = tail;
    }
    rest.fill(len as u32);
    parts.into_par_iter().enumerate().for_each(|(chunk, part)| {
        // Each index is written where the next wanted one belongs, and overwritten if not wanted.
        let mut next = 0;
        for i in range(chunk) {
            if let Some(slot) = part.get_mut(next) {
                *slot = i as u32;
            }
            next += usize::from(wanted(i));
        }
    });
    out
}
