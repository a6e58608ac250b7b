//! The transform of many channels at once. It works on the means of nodes, not on their low-pass
//! values.
//!
//! A row holds the channels of a leaf. During the transform, the mean of a node is in the row of
//! the node's first leaf, and the difference of the means of a merge's two children is in the row
//! of the right child's first leaf. The high-pass value of RAHT is that difference times `sqrt(w1
//! w2 / w)`. Means do not grow with the number of leaves, so single precision is enough, and where
//! the difference is zero, the inverse is a copy.
//!
//! Every operation is rounded to single precision in the order written: the decoder's bits are the
//! same on every machine.

use super::RahtPlan;
use crate::error::Result;

/// Four channels of a row.
pub(crate) type Lanes = [f32; LANES];
/// Channels that are worked on side by side.
pub(crate) const LANES: usize = 4;

/// The values of a group of channels, leaf by leaf. One `Rows` can serve many groups, which saves
/// the time that the system needs for fresh memory.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Rows {
    leaves: usize,
    channels: usize,
    /// Row after row, each padded to whole [`Lanes`].
    pub(crate) lanes: Vec<Lanes>,
}

impl Rows {
    /// Rows of zeros.
    #[must_use]
    pub fn new(leaves: usize, channels: usize) -> Self {
        let mut rows = Self::default();
        rows.resize(leaves, channels);
        rows
    }

    /// Changes the size. The values are unspecified afterwards.
    pub fn resize(&mut self, leaves: usize, channels: usize) {
        (self.leaves, self.channels) = (leaves, channels);
        let len = leaves * self.width();
        if len > self.lanes.capacity() {
            // The old memory goes first, so that it can be part of the new.
            self.lanes = Vec::new();
            // Zeroed pages come from the system, and cost nothing until they are written.
            self.lanes = vec![[0.0; LANES]; len];
        } else {
            self.lanes.resize(len, [0.0; LANES]);
        }
    }

    /// Adds a multiple of other rows of this size.
    pub fn add(&mut self, factor: f32, other: &Self) {
        let other = other.lanes.as_flattened();
        self.lanes.as_flattened_mut().iter_mut().zip(other).for_each(|(v, o)| *v += factor * o);
    }

    /// Number of leaves.
    #[must_use]
    pub fn leaves(&self) -> usize {
        self.leaves
    }

    /// Number of channels.
    #[must_use]
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// [`Lanes`] of a row.
    pub(crate) fn width(&self) -> usize {
        self.channels.div_ceil(LANES)
    }

    /// The values of a leaf, padded.
    #[inline]
    pub(crate) fn lanes_of(&self, leaf: usize) -> &[Lanes] {
        let width = self.width();
        &self.lanes[leaf * width..(leaf + 1) * width]
    }

    /// The values of a leaf, padded.
    #[inline]
    pub(crate) fn lanes_of_mut(&mut self, leaf: usize) -> &mut [Lanes] {
        let width = self.width();
        &mut self.lanes[leaf * width..(leaf + 1) * width]
    }

    /// The values of a leaf.
    #[inline]
    #[must_use]
    pub fn row(&self, leaf: usize) -> &[f32] {
        &self.lanes_of(leaf).as_flattened()[..self.channels]
    }

    /// The values of a leaf.
    #[inline]
    pub fn row_mut(&mut self, leaf: usize) -> &mut [f32] {
        let channels = self.channels;
        &mut self.lanes_of_mut(leaf).as_flattened_mut()[..channels]
    }
}

/// Turns values into the mean of all, in the row of leaf 0, and the differences of all merges.
///
/// # Errors
/// If there is not one row per leaf of the plan.
pub fn forward(plan: &RahtPlan, rows: &mut Rows) -> Result<()> {
    plan.check(rows.leaves)?;
    let width = rows.width();
    for merge in (0..plan.left.len()).rev() {
        let (left, right, share) = split(plan, merge, &mut rows.lanes, width);
        for (left, right) in left.iter_mut().zip(right) {
            for i in 0..LANES {
                let d = right[i] - left[i];
                left[i] += d * share;
                right[i] = d;
            }
        }
    }
    Ok(())
}

/// Undoes [`forward`] up to rounding.
///
/// # Errors
/// If there is not one row per leaf of the plan.
pub fn inverse(plan: &RahtPlan, rows: &mut Rows) -> Result<()> {
    plan.check(rows.leaves)?;
    let width = rows.width();
    for merge in 0..plan.left.len() {
        let (left, right, share) = split(plan, merge, &mut rows.lanes, width);
        for (left, right) in left.iter_mut().zip(right) {
            let difference = *right;
            undo(left, right, difference, share);
        }
    }
    Ok(())
}

/// The means of a merge's children from the node's mean, in `left`, and the difference.
#[inline(always)]
pub(crate) fn undo(left: &mut Lanes, right: &mut Lanes, difference: Lanes, share: f32) {
    // Lane by lane in one expression each, which become vector instructions.
    let mean: Lanes = std::array::from_fn(|i| left[i] - difference[i] * share);
    *left = mean;
    *right = std::array::from_fn(|i| mean[i] + difference[i]);
}

/// The rows of a merge's children, and the share of the right one.
#[inline(always)]
pub(crate) fn split<'a>(
    plan: &RahtPlan,
    merge: usize,
    lanes: &'a mut [Lanes],
    width: usize,
) -> (&'a mut [Lanes], &'a mut [Lanes], f32) {
    let (l, r) = (plan.left[merge] as usize * width, plan.right[merge] as usize * width);
    let (left, right) = lanes.split_at_mut(r);
    (&mut left[l..l + width], &mut right[..width], plan.share[merge])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn more_rows_take_no_more_memory_than_they_need_and_fewer_keep_it() {
        let mut rows = Rows::new(10, 4);
        rows.resize(11, 4);
        assert_eq!(rows.lanes.capacity(), 11);
        rows.resize(2, 4);
        assert_eq!((rows.lanes.len(), rows.lanes.capacity()), (2, 11));
    }
}
