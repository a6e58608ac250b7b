//! The state of the dynamic programme: what a cell is, and what is known of it once solved.

use crate::distortion::Moments;
use crate::order::cell_end;

/// An occupied cell: its Gaussians, in Morton order. A member is an index into the scene (`u32`),
/// or a [`Record`](crate::record::Record).
pub(super) struct Cell<'a, M> {
    /// Morton codes at `j_high`.
    pub(super) codes: &'a [u64],
    /// As many members.
    pub(super) members: &'a [M],
}

/// The best pruning of a cell, and what its parent needs to know of it.
#[derive(Clone, Copy)]
pub(super) struct Solved {
    /// Least distortion plus lambda times bits of everything in the cell.
    pub(super) cost: f64,
    /// The best pruning drops every Gaussian, so the octree does not occupy the cell.
    pub(super) empty: bool,
    /// Centre of the cell, relative to the cube's origin.
    pub(super) centre: [f64; 3],
    /// Of all Gaussians in the cell; means are relative to `centre`.
    pub(super) moments: Moments,
    pub(super) tally: Tally,
}

/// Numbers for the report.
#[derive(Clone, Copy, Default)]
pub(super) struct Tally {
    /// Cells whose division was decided.
    pub(super) decided: u64,
    /// Of these, cells whose subtrees were not visited.
    pub(super) skipped: u64,
}

impl Tally {
    pub(super) fn add(&mut self, other: Self) {
        self.decided += other.decided;
        self.skipped += other.skipped;
    }
}

/// The occupied children of a cell in Morton order, each with the part of `depths` that belongs
/// to it.
pub(super) struct Children<'a, 'd, M> {
    rest: Cell<'a, M>,
    depths: &'d mut [u8],
    child_depth: u8,
    j_high: u8,
}

impl<'a, M> Cell<'a, M> {
    /// The children, at `child_depth`. `depths` has one entry per member.
    pub(super) fn children<'d>(
        self,
        depths: &'d mut [u8],
        child_depth: u8,
        j_high: u8,
    ) -> Children<'a, 'd, M> {
        Children { rest: self, depths, child_depth, j_high }
    }
}

impl<'a, 'd, M> Iterator for Children<'a, 'd, M> {
    type Item = (Cell<'a, M>, &'d mut [u8]);

    fn next(&mut self) -> Option<Self::Item> {
        let Cell { codes, members } = self.rest;
        if codes.is_empty() {
            return None;
        }
        let end = cell_end(codes, 0, self.j_high, self.child_depth);
        let (depths, rest) = std::mem::take(&mut self.depths).split_at_mut(end);
        self.depths = rest;
        self.rest = Cell { codes: &codes[end..], members: &members[end..] };
        Some((Cell { codes: &codes[..end], members: &members[..end] }, depths))
    }
}
