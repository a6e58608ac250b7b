//! [`OccupiedCell`]: an occupied cell of the octree, and its children.

use crate::order::cell_end;

/// An occupied cell: its Gaussians, in Morton order. A member is an index into the scene (`u32`),
/// or what a strategy needs of the Gaussian.
pub(crate) struct OccupiedCell<'a, M> {
    /// Morton codes at `j_high`.
    pub(crate) codes: &'a [u64],
    /// As many members.
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
