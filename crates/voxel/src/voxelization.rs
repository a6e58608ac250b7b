//! [`Voxelization`]: the leaves of a pruned octree and the Gaussians in each.
//!
//! *Invariant:* every Gaussian is a member of exactly one leaf, or dropped; leaves ascend in Morton
//! code and none contains another.

use gpcc_lite::{Cube, Leaf, Octree};
use rayon::prelude::*;

use crate::error::Result;
use crate::order::{CHUNK, MortonOrder, morton_codes};

/// The leaves of a pruned octree and the Gaussians in each.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Voxelization {
    octree: Octree,
    /// As many ascending offsets into `members` as there are leaves, and one.
    pub(crate) member_offsets: Vec<u32>,
    pub(crate) members: Vec<u32>,
    dropped: Vec<u32>,
}

/// What a strategy decides.
pub(crate) struct PrunedOctree {
    pub(crate) cube: Cube,
    pub(crate) j_high: u8,
    pub(crate) order: MortonOrder,
    /// Depth of the leaf of each Gaussian of `order`, or [`DROPPED`]; the same for all Gaussians of one leaf.
    pub(crate) depths: Vec<u8>,
}

/// The depth of Gaussians without a leaf.
pub(crate) const DROPPED: u8 = u8::MAX;

impl Voxelization {
    /// No leaf yet: [`Voxelization::append`] adds them.
    ///
    /// # Errors
    /// [`Error::Octree`](crate::Error::Octree) for a depth above 21.
    pub fn empty(cube: Cube, depth: u8) -> Result<Self> {
        Ok(Self::one_each(Octree::new(cube, depth, Vec::new())?))
    }

    /// Gaussian `i` is in leaf `i`, alone.
    #[must_use]
    pub fn one_each(octree: Octree) -> Self {
        let n = octree.len() as u32;
        Self {
            octree,
            member_offsets: (0..=n).collect(),
            members: (0..n).collect(),
            dropped: Vec::new(),
        }
    }

    /// The leaves.
    #[must_use]
    pub fn octree(&self) -> &Octree {
        &self.octree
    }

    /// Number of leaves.
    #[must_use]
    pub fn len(&self) -> usize {
        self.octree.len()
    }

    /// True if there is no leaf.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.octree.is_empty()
    }

    /// Indices into the scene, each at most once, grouped by leaf. Inside a leaf they are in Morton
    /// order at the depth of the octree; ties ascend.
    #[must_use]
    pub fn members(&self) -> &[u32] {
        &self.members
    }

    /// The Gaussians in leaf `i`.
    #[must_use]
    pub fn members_of(&self, i: usize) -> &[u32] {
        &self.members[self.member_offsets[i] as usize..self.member_offsets[i + 1] as usize]
    }

    /// Gaussians without a leaf, in Morton order. Only
    /// [`RateDistortion::drop`](crate::RateDistortion::drop) leaves Gaussians out.
    #[must_use]
    pub fn dropped(&self) -> &[u32] {
        &self.dropped
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
    ///
    /// # Errors
    /// [`Error::Octree`](crate::Error::Octree) if they do not follow those so far.
    pub fn append(&mut self, tile: &Self, numbers: &[u32]) -> Result<()> {
        let first = self.members.len() as u32;
        let number = |&i: &u32| numbers[i as usize];
        self.octree.append(&tile.octree)?;
        self.member_offsets.pop();
        self.member_offsets.extend(tile.member_offsets.iter().map(|o| first + o));
        self.members.extend(tile.members.iter().map(number));
        self.dropped.extend(tile.dropped.iter().map(number));
        Ok(())
    }

    /// Gaussians of some leaves in the leaves of another octree: its leaf `i` holds what the leaves
    /// `first[i]..first[i + 1]` hold.
    ///
    /// # Panics
    /// If `first` does not ascend from leaf to leaf, or is not as long as `octree` and one.
    #[must_use]
    pub fn regrouped(&self, octree: Octree, first: &[u32]) -> Self {
        assert_eq!(first.len(), octree.len() + 1, "one leaf more than the octree has");
        let offset = |leaf: u32| self.member_offsets[leaf as usize];
        let (start, end) = (offset(first[0]), offset(first[octree.len()]));
        Self {
            octree,
            member_offsets: first.iter().map(|&leaf| offset(leaf) - start).collect(),
            members: self.members[start as usize..end as usize].to_vec(),
            dropped: Vec::new(),
        }
    }

    /// The same with each leaf whose members are to be `apart` cut into leaves of those whose cells differ at the greatest
    /// depth. `means` are those of the scene.
    ///
    /// # Errors
    /// As [`crate::morton_codes`].
    pub fn split(&self, means: &[[f32; 3]], apart: impl Fn(&[u32]) -> bool) -> Result<Self> {
        let depth = self.octree.depth();
        let codes = morton_codes(means, &self.octree.cube(), depth)?;
        let mut out = Self::empty(self.octree.cube(), depth)?;
        let mut leaves = Vec::with_capacity(self.len());
        out.member_offsets.clear();
        for (i, &leaf) in self.octree.leaves().iter().enumerate() {
            let members = self.members_of(i);
            let start = out.members.len() as u32;
            out.members.extend(members);
            if !apart(members) {
                leaves.push(leaf);
                out.member_offsets.push(start);
                continue;
            }
            let code = |m: usize| codes[members[m] as usize];
            let firsts: Vec<usize> =
                (0..members.len()).filter(|&m| m == 0 || code(m) != code(m - 1)).collect();
            // The depth from which two cells differ.
            let from = |a: u64, b: u64| depth - ((a ^ b).ilog2() / 3) as u8;
            for (k, &m) in firsts.iter().enumerate() {
                let before = k.checked_sub(1).map(|k| from(code(firsts[k]), code(m)));
                let behind = firsts.get(k + 1).map(|&next| from(code(m), code(next)));
                let own = leaf.depth.max(before.unwrap_or(0)).max(behind.unwrap_or(0));
                let morton = code(m) >> (3 * (depth - own)) << (3 * (depth - own));
                leaves.push(Leaf { morton, depth: own });
                out.member_offsets.push(start + m as u32);
            }
        }
        out.member_offsets.push(out.members.len() as u32);
        out.octree = Octree::new(self.octree.cube(), depth, leaves)?;
        out.dropped.clone_from(&self.dropped);
        Ok(out)
    }

    /// Cuts the sorted Gaussians into leaves.
    pub(crate) fn of(pruned: PrunedOctree) -> Result<Self> {
        let PrunedOctree { cube, j_high, order, mut depths } = pruned;
        // The leaf of a Gaussian is that of its code, not of its mean: the authors' code moves
        // Gaussians before it voxelizes them.
        let MortonOrder { mut codes, mut members } = order;
        let mut dropped = Vec::new();
        if depths.contains(&DROPPED) {
            let mut kept = positions(depths.len(), |i| depths[i] != DROPPED);
            let mut others = positions(depths.len(), |i| depths[i] == DROPPED);
            kept.pop();
            others.pop();
            dropped = others.par_iter().map(|&i| members[i as usize]).collect();
            members = kept.par_iter().map(|&i| members[i as usize]).collect();
            codes = kept.par_iter().map(|&i| codes[i as usize]).collect::<Vec<_>>().into();
            depths = kept.par_iter().map(|&i| depths[i as usize]).collect();
        }
        let shift = |depth: u8| 3 * u32::from(j_high - depth);
        // Whether a leaf starts at a Gaussian depends on the one before it only, so the loop over
        // the Gaussians is parallel.
        let member_offsets = positions(codes.len(), |i| {
            i == 0
                || (depths[i - 1] != depths[i])
                    | ((codes[i] ^ codes[i - 1]) >> shift(depths[i]) != 0)
        });
        let starts = &member_offsets[..member_offsets.len() - 1];
        let leaf = |&i: &u32| Leaf::of(codes[i as usize], depths[i as usize], j_high);
        let octree = Octree::new(cube, j_high, starts.par_iter().map(leaf).collect())?;
        Ok(Self { octree, member_offsets, members, dropped })
    }
}

/// Ascending indices below `len` for which `wanted` holds, then `len` itself.
fn positions(len: usize, wanted: impl Fn(usize) -> bool + Sync) -> Vec<u32> {
    let all = (0..len).into_par_iter().with_min_len(CHUNK).filter(|&i| wanted(i));
    all.chain(rayon::iter::once(len)).map(|i| i as u32).collect()
}
