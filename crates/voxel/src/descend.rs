//! Occupied cells of the octree, and top-down division by a rule that decides one of them at a time: the form of
//! the paper's criteria (section 3.2.2).

use rayon::prelude::*;
use std::ops::Range;

use crate::order::cell_end;

/// An occupied cell: its Gaussians, in Morton order. A member is an index into the scene (`u32`),
/// or what a strategy needs of the Gaussian.
pub(crate) struct OccupiedCell<'a, M> {
    /// Morton codes at `j_high`.
    pub(crate) codes: &'a [u64],
    /// One member for each code.
    pub(crate) members: &'a [M],
}

/// The occupied children of a cell in Morton order, each with the part of `depths` that belongs
/// to it.
pub(crate) struct ChildCells<'a, 'd, M> {
    rest: OccupiedCell<'a, M>,
    depths: &'d mut [u8],
    child_depth: u8,
    j_high: u8,
}

impl<'a, M> OccupiedCell<'a, M> {
    /// The children, at `child_depth`. `depths` has one entry per member.
    pub(crate) fn children<'d>(
        &self,
        depths: &'d mut [u8],
        child_depth: u8,
        j_high: u8,
    ) -> ChildCells<'a, 'd, M> {
        let rest = OccupiedCell { codes: self.codes, members: self.members };
        ChildCells { rest, depths, child_depth, j_high }
    }
}

impl<'a, 'd, M> Iterator for ChildCells<'a, 'd, M> {
    type Item = (OccupiedCell<'a, M>, &'d mut [u8]);

    fn next(&mut self) -> Option<Self::Item> {
        let OccupiedCell { codes, members } = self.rest;
        if codes.is_empty() {
            return None;
        }
        let end = cell_end(codes, 0, self.j_high, self.child_depth);
        let (depths, rest) = std::mem::take(&mut self.depths).split_at_mut(end);
        self.depths = rest;
        self.rest = OccupiedCell { codes: &codes[end..], members: &members[end..] };
        Some((OccupiedCell { codes: &codes[..end], members: &members[..end] }, depths))
    }
}

/// Depth of the leaf of every Gaussian of the root.
///
/// A voxel at `j_low` to `j_high - 1` is divided if `splits` returns true for it and its depth.
pub(crate) fn depths<M: Sync>(
    root: &OccupiedCell<'_, M>,
    j_low: u8,
    j_high: u8,
    splits: impl Fn(&OccupiedCell<'_, M>, u8) -> bool + Sync,
) -> Vec<u8> {
    let mut depths = vec![0; root.codes.len()];
    // Voxels at j_low are independent of each other.
    let voxels: Vec<_> = root.children(&mut depths, j_low, j_high).collect();
    let voxels = voxels.into_par_iter().with_min_len(64);
    voxels.for_each(|(voxel, depths)| divide(&voxel, j_low, j_high, depths, &splits));
    depths
}

/// Decides one voxel and the voxels below it.
fn divide<M>(
    voxel: &OccupiedCell<'_, M>,
    depth: u8,
    j_high: u8,
    depths: &mut [u8],
    splits: &impl Fn(&OccupiedCell<'_, M>, u8) -> bool,
) {
    if let [leaf] = depths {
        // One Gaussian: every voxel below holds it alone.
        *leaf = (depth..j_high).find(|&d| !splits(voxel, d)).unwrap_or(j_high);
    } else if depth == j_high || !splits(voxel, depth) {
        depths.fill(depth);
    } else {
        for (child, depths) in voxel.children(depths, depth + 1, j_high) {
            divide(&child, depth + 1, j_high, depths, splits);
        }
    }
}

/// Hands the largest cells below `cell` whose codes are all in `codes` to `solve`, with their depths and the depths of
/// their Gaussians.
pub(crate) fn inside<M>(
    cell: OccupiedCell<'_, M>,
    codes: &Range<u64>,
    depth: u8,
    j_high: u8,
    depths: &mut [u8],
    solve: &impl Fn(OccupiedCell<'_, M>, u8, &mut [u8]),
) {
    let Some(&code) = cell.codes.first() else { return };
    let below = (1u64 << (3 * u32::from(j_high - depth))) - 1;
    if codes.start <= code & !below && code | below < codes.end {
        return solve(cell, depth, depths);
    }
    for (child, depths) in cell.children(depths, depth + 1, j_high) {
        inside(child, codes, depth + 1, j_high, depths, solve);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::RefCell;

    /// Beside a loop over all cells: those that a range of codes holds and whose parents it does not hold.
    #[test]
    fn a_range_is_cut_into_the_largest_cells() {
        const J: u8 = 3;
        let cell = |code: u64, depth: u8| {
            let below = 1u64 << (3 * (J - depth));
            code / below * below..(code / below + 1) * below
        };
        let ranges = (0..512).step_by(7).flat_map(|a| (a..=512).step_by(9).map(move |b| a..b));
        for range in ranges {
            let codes: Vec<u64> = range.clone().step_by(5).collect();
            let holds = |cell: Range<u64>| range.start <= cell.start && cell.end <= range.end;
            let largest = |code| (0..=J).find(|&d| holds(cell(code, d))).unwrap();
            let mut want: Vec<_> =
                codes.iter().map(|&c| (cell(c, largest(c)).start, largest(c))).collect();
            want.dedup();
            let root = OccupiedCell { codes: &codes, members: &codes };
            let got = RefCell::new(Vec::new());
            let solve = |found: OccupiedCell<'_, u64>, depth, _: &mut [u8]| {
                got.borrow_mut().push((cell(found.codes[0], depth).start, depth));
            };
            inside(root, &range, 0, J, &mut vec![0; codes.len()], &solve);
            assert_eq!(got.into_inner(), want, "{range:?}");
        }
    }
}
