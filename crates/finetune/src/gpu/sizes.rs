//! Names and sizes of the device's buffers.

use crate::shaders::{BLOCKS, RADIX_BLOCK, SCAN_BLOCK};

/// Losses that the device keeps before the host has to fetch them.
pub(crate) const LOSS_RING: usize = 256;

/// Sizes that the buffers are made for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Sizes {
    /// Gaussians.
    pub(crate) count: usize,
    /// SH coefficients of each.
    pub(crate) sh_len: usize,
    /// Slots: (Gaussian, tile) pairs.
    pub(crate) capacity: usize,
    /// Tiles of the largest view.
    pub(crate) tiles: usize,
    /// Pixels of the largest view.
    pub(crate) pixels: usize,
}

impl Sizes {
    fn blocks(n: usize) -> usize {
        n.div_ceil(RADIX_BLOCK as usize).max(1)
    }

    pub(crate) fn depth_blocks(&self) -> usize {
        Self::blocks(self.count)
    }

    pub(crate) fn tile_blocks(&self) -> usize {
        Self::blocks(self.capacity)
    }

    /// Every buffer by name, with its length in 32-bit words.
    pub(super) fn buffers(&self) -> Vec<(&'static str, usize)> {
        let Self { count: n, sh_len: k, capacity, tiles, pixels } = *self;
        let mut list = vec![
            ("means", 3 * n),
            ("geo", 8 * n),
            ("geo_m", 8 * n),
            ("geo_v", 8 * n),
            ("sh", 3 * k * n),
            ("sh_m", 3 * k * n),
            ("sh_v", 3 * k * n),
            ("splats", 12 * n),
            ("boxes", 4 * n),
            ("keys", n),
            ("counts", n),
            ("depth_keys_a", n),
            ("depth_keys_b", n),
            ("order_a", n),
            ("order", n),
            ("starts", n + 1),
            ("state", 4),
            ("slot_tiles", capacity),
            ("slot_ids", capacity),
            ("tile_keys_a", capacity),
            ("tile_keys_b", capacity),
            ("tile_slots_a", capacity),
            ("tile_slots_b", capacity),
            ("depth_histogram", 16 * self.depth_blocks()),
            ("tile_histogram", 16 * self.tile_blocks()),
            ("ids", capacity),
            ("list_positions", capacity),
            // `reaching` reads up to one word beyond the last byte.
            ("hits", capacity.div_ceil(4) + 2),
            ("offsets", tiles + 1),
            ("pixels", 1024 * tiles),
            ("last", BLOCKS as usize * tiles),
            ("gradient", 768 * tiles),
            ("records", 7 * capacity),
            ("sums", 7 * n + 1),
            ("moments", 15 * pixels),
            ("partials", 18 * pixels),
            ("values", 6 * pixels),
            ("losses", 2 * LOSS_RING),
            ("block_sums", 2 * (3 * pixels).div_ceil(4096)),
        ];
        for (name, length) in self.scans() {
            for (level, words) in scan_lengths(length).into_iter().enumerate() {
                list.push((SCAN_TOTALS[name as usize][level], words.div_ceil(SCAN_BLOCK as usize)));
            }
        }
        list
    }

    /// The arrays that are scanned, and their lengths.
    pub(crate) fn scans(&self) -> [(Scan, usize); 3] {
        [
            (Scan::Starts, self.count + 1),
            (Scan::DepthHistogram, 16 * self.depth_blocks()),
            (Scan::TileHistogram, 16 * self.tile_blocks()),
        ]
    }
}

/// An array that is scanned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Scan {
    Starts,
    DepthHistogram,
    TileHistogram,
}

/// Levels of a scan: 1024^4 values are more than a buffer can hold.
const LEVELS: usize = 4;
pub(super) const SCAN_TOTALS: [[&str; LEVELS]; 3] = [
    ["starts_1", "starts_2", "starts_3", "starts_4"],
    ["depth_histogram_1", "depth_histogram_2", "depth_histogram_3", "depth_histogram_4"],
    ["tile_histogram_1", "tile_histogram_2", "tile_histogram_3", "tile_histogram_4"],
];
pub(super) const SCANNED: [&str; 3] = ["starts", "depth_histogram", "tile_histogram"];

/// Lengths of the arrays that the levels of a scan of `length` values work on.
pub(super) fn scan_lengths(mut length: usize) -> Vec<usize> {
    let mut out = vec![length];
    while length > SCAN_BLOCK as usize && out.len() < LEVELS {
        length = length.div_ceil(SCAN_BLOCK as usize);
        out.push(length);
    }
    out
}
