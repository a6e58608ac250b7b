//! Decoded values, leaf by leaf.

use crate::context::{CHUNK, chunk_sizes};
use crate::raht::Lanes;

/// The values of a group of channels, leaf by leaf. Its memory serves one group after another: what
/// is fresh costs an interrupt per page.
#[derive(Clone, Debug, Default)]
pub struct Rows {
    leaves: usize,
    /// Channels of each chunk.
    sizes: Vec<usize>,
    /// The chunks of one leaf after those of another.
    pub(super) lanes: Vec<Lanes>,
}

/// Leaves whose values are changed at a time.
const CHANGED: usize = 32;

impl Rows {
    /// Of lanes that are there.
    pub(super) fn of(lanes: Vec<Lanes>, leaves: usize, channels: usize) -> Self {
        Self { leaves, sizes: chunk_sizes(channels), lanes }
    }

    /// Makes room; what the rows hold then is anything.
    pub(super) fn resize(&mut self, leaves: usize, channels: usize) {
        self.leaves = leaves;
        self.sizes = chunk_sizes(channels);
        let len = leaves * self.sizes.len();
        if len > self.lanes.capacity() {
            // Zeros of the system, untouched until they are written.
            self.lanes = vec![[0.0; CHUNK]; len];
        } else {
            self.lanes.resize(len, [0.0; CHUNK]);
        }
    }

    /// Number of leaves.
    #[must_use]
    pub fn leaves(&self) -> usize {
        self.leaves
    }

    /// Number of channels.
    #[must_use]
    pub fn channels(&self) -> usize {
        self.sizes.iter().sum()
    }

    /// Changes the values of all leaves, a few at a time: `some(first, values)` gets
    /// [`Rows::channels`] for each.
    pub fn change(&mut self, mut some: impl FnMut(usize, &mut [f32])) {
        let width = self.sizes.len().max(1);
        let mut values = vec![0.0; CHANGED * self.channels()];
        for first in (0..self.leaves).step_by(CHANGED) {
            let leaves = CHANGED.min(self.leaves - first);
            let values = &mut values[..leaves * self.channels()];
            self.copy(first, values);
            some(first, values);
            let mut at = 0;
            for row in self.lanes[first * width..].chunks_exact_mut(width).take(leaves) {
                for (lanes, &size) in row.iter_mut().zip(&self.sizes) {
                    // As in `copy`; what a chunk has too much is nobody's.
                    match values[at..].first_chunk::<CHUNK>() {
                        Some(whole) => *lanes = *whole,
                        None => lanes[..size].copy_from_slice(&values[at..at + size]),
                    }
                    at += size;
                }
            }
        }
    }

    /// Copies the values of the leaves from `first` on, [`Rows::channels`] for each, as many as
    /// `out` has room for or there are.
    pub fn copy(&self, first: usize, out: &mut [f32]) {
        let width = self.sizes.len();
        let mut at = 0;
        for row in self.lanes[first * width..].chunks_exact(width.max(1)) {
            for (lanes, &size) in row.iter().zip(&self.sizes) {
                // Whole chunks are one store; the next goes over what they have too much.
                if let Some(out) = out[at..].first_chunk_mut::<CHUNK>() {
                    *out = *lanes;
                } else if let Some(out) = out[at..].get_mut(..size) {
                    out.copy_from_slice(&lanes[..size]);
                } else {
                    return;
                }
                at += size;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_those_of_the_chunks() {
        let mut rows = Rows::default();
        for channels in [7, 1, 21, 6, 3, 0] {
            rows.resize(9, channels);
            let sizes = rows.sizes.clone();
            let mut next = 0.0;
            for row in rows.lanes.chunks_exact_mut(sizes.len().max(1)) {
                for (lanes, &size) in row.iter_mut().zip(&sizes) {
                    *lanes = [-1.0; CHUNK];
                    lanes[..size].fill_with(|| {
                        next += 1.0;
                        next
                    });
                }
            }
            for (first, n) in [(0, 9), (0, 1), (3, 2), (8, 1), (8, 4), (9, 1)] {
                let mut out = vec![0.0; n * channels];
                rows.copy(first, &mut out);
                for (i, v) in out.iter().enumerate() {
                    let at = first * channels + i;
                    let want = if at < 9 * channels { at as f32 + 1.0 } else { 0.0 };
                    // Beyond the last leaf nothing is promised.
                    assert!(at >= 9 * channels || *v == want, "{channels} {first} {i}");
                }
            }
        }
    }

    #[test]
    fn changed_values_are_copied_back() {
        let mut rows = Rows::default();
        for (leaves, channels) in [(7, 1), (CHANGED, 15), (2 * CHANGED + 1, 21), (0, 3)] {
            rows.resize(leaves, channels);
            let mut seen = 0;
            rows.change(|first, values| {
                assert_eq!(first * channels, seen);
                seen += values.len();
                values.iter_mut().zip(first * channels..).for_each(|(v, at)| *v = at as f32);
            });
            assert_eq!(seen, leaves * channels);
            rows.change(|_, values| values.iter_mut().for_each(|v| *v += 0.5));
            let mut values = vec![0.0; leaves * channels];
            rows.copy(0, &mut values);
            for (at, v) in values.iter().enumerate() {
                assert_eq!(*v, at as f32 + 0.5);
            }
        }
    }
}
