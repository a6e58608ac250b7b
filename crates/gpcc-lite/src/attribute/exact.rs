//! Values that an encoder keeps for a second pass.

use crate::coeffs::places;
use crate::context::{CHUNK, chunk_sizes};
use crate::raht::Lanes;

/// Rows without the channels that are not there: of one channel a quarter of them.
pub(super) struct Exact {
    channels: usize,
    values: Vec<f32>,
}

impl Exact {
    /// What rows of so many channels hold.
    pub(super) fn of(rows: &[Lanes], channels: usize) -> Self {
        let width = chunk_sizes(channels).len();
        let places: Vec<(usize, usize)> = places(channels).collect();
        let mut values = Vec::with_capacity(rows.len() / width.max(1) * channels);
        for row in rows.chunks_exact(width.max(1)) {
            values.extend(places.iter().map(|&(chunk, i)| row[chunk][i]));
        }
        Self { channels, values }
    }

    /// The rows.
    pub(super) fn rows(&self) -> Vec<Lanes> {
        let width = chunk_sizes(self.channels).len();
        let places: Vec<(usize, usize)> = places(self.channels).collect();
        let mut rows = vec![[0.0; CHUNK]; self.values.len() / self.channels.max(1) * width];
        let values = self.values.chunks_exact(self.channels.max(1));
        for (row, values) in rows.chunks_exact_mut(width.max(1)).zip(values) {
            for (&(chunk, i), &v) in places.iter().zip(values) {
                row[chunk][i] = v;
            }
        }
        rows
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_come_back() {
        for channels in [1, 3, 7, 21] {
            let width = chunk_sizes(channels).len();
            let mut rows = vec![[0.0; CHUNK]; 5 * width];
            for (at, row) in rows.chunks_exact_mut(width).enumerate() {
                for (n, (chunk, i)) in places(channels).enumerate() {
                    row[chunk][i] = (at * channels + n) as f32 - 3.5;
                }
            }
            let exact = Exact::of(&rows, channels);
            assert_eq!(exact.values.len(), 5 * channels);
            assert_eq!(exact.rows(), rows);
        }
        assert!(Exact::of(&[], 0).rows().is_empty());
    }
}
