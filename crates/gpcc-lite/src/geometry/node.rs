//! [`NodeContext`]: what encoder and decoder know of a node.

/// Memory of the decisions' models, in observations.
pub(super) const LIMIT: u32 = 255;

/// What is known of a node before its children are coded.
#[derive(Clone, Copy, Debug)]
pub(super) struct NodeContext {
    pub(super) depth: u8,
    /// Its Morton code at its depth.
    pub(super) code: u64,
    /// Number of children of the parent.
    pub(super) siblings: u8,
    /// The occupied cells around it.
    pub(super) window: u64,
    /// Least number of children that it can have: two at the last level, since it has two leaves or
    /// more.
    pub(super) least: u8,
}

impl NodeContext {
    /// Whether it is known that two leaves or more lie below: the only child of a parent with
    /// several.
    #[inline]
    pub(super) fn splits(&self) -> bool {
        self.siblings == 1 && self.depth > 0
    }
}
