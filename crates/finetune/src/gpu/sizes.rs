//! Names and sizes of the device's buffers.

use crate::error::{Error, Result};
use crate::shaders::{GEO, RADIX_BLOCK, SCAN_BLOCK, TILE_LANES};

/// Losses that the device keeps before the host has to fetch them.
pub(crate) const LOSS_RING: usize = 256;

/// Gaussians of a page, at most: 59 floats of each are 118 MiB, and a binding has at most 128 MiB.
pub const PAGE_GAUSSIANS: usize = 1 << 19;

/// Words of a splat, and of the record of a slot.
const SPLAT: usize = 12;
const RECORD: usize = 9;

/// Sizes that the buffers are made for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Sizes {
    /// Gaussians of each page.
    pub(crate) pages: Vec<usize>,
    /// Whether Adam moves them here, so that they have moments.
    pub(crate) moments: bool,
    /// SH coefficients of each.
    pub(crate) sh_len: usize,
    /// Slots: (Gaussian, tile) pairs of a band.
    pub(crate) capacity: usize,
    /// Gaussians that a band shows.
    pub(crate) splats: usize,
    /// Tiles of the largest view.
    pub(crate) tiles: usize,
    /// Pixels of the largest view.
    pub(crate) pixels: usize,
}

/// Name of a buffer, with its length in 32-bit words on each page, or that of the only one.
pub(crate) type Lengths = (&'static str, Vec<usize>);

impl Sizes {
    fn blocks(n: usize) -> usize {
        n.div_ceil(RADIX_BLOCK as usize).max(1)
    }

    /// Gaussians.
    pub(crate) fn count(&self) -> usize {
        self.pages.iter().sum()
    }

    pub(crate) fn depth_blocks(&self) -> usize {
        Self::blocks(self.count())
    }

    pub(crate) fn tile_blocks(&self) -> usize {
        Self::blocks(self.capacity)
    }

    /// Refuses what no binding of `limit` bytes holds, whatever the pages and bands.
    pub(super) fn check(&self, limit: u64) -> Result<()> {
        let fits = |bytes: usize, each: u64| bytes as u64 <= limit / each;
        let refused = |what: String, most: u64, remedy: &str| {
            Err(Error::Gpu {
                reason: format!("{what}, at most {most} fit a binding of {limit} bytes: {remedy}"),
            })
        };
        let (n, pixels) = (self.count(), self.pixels);
        if !fits(n + 1, 4) {
            let most = limit / 4 - 1;
            return refused(format!("{n} Gaussians"), most, "use the CPU, or cut the scene");
        }
        let widest = 4 * MOMENTS as u64;
        if !fits(pixels, widest) {
            let remedy = "make the photos smaller, or use the CPU";
            return refused(format!("a view of {pixels} pixels"), limit / widest, remedy);
        }
        Ok(())
    }

    /// Slots and splats of a band, at most, with bindings of `limit` bytes.
    pub(super) fn most(limit: u64) -> [usize; 2] {
        [RECORD, SPLAT].map(|words| (limit / (4 * words as u64)) as usize)
    }

    /// Every buffer.
    pub(super) fn buffers(&self) -> Vec<Lengths> {
        let mut list = self.of_pages();
        let single = self.of_scene().into_iter().chain(self.of_slots()).chain(self.of_views());
        list.extend(single.map(|(name, words)| (name, vec![words])));
        for (name, length) in self.scans() {
            for (level, words) in scan_lengths(length).into_iter().enumerate() {
                let totals = SCAN_TOTALS[name as usize][level];
                list.push((totals, vec![words.div_ceil(SCAN_BLOCK as usize)]));
            }
        }
        list
    }

    fn of_pages(&self) -> Vec<Lengths> {
        let (geo, sh) = (GEO as usize, 3 * self.sh_len);
        let moments = usize::from(self.moments);
        let paged = |name, words: usize, more: usize| {
            (name, self.pages.iter().map(|n| words * n + more).collect())
        };
        vec![
            paged("geo", geo, 0),
            paged("geo_m", moments * geo, 0),
            paged("geo_v", moments * geo, 0),
            paged("sh", sh, 0),
            paged("sh_m", moments * sh, 0),
            paged("sh_v", moments * sh, 0),
            paged("page_splats", SPLAT, 0),
            paged("sums", RECORD, 1),
            paged("totals", 2, 1),
        ]
    }

    fn of_scene(&self) -> Vec<(&'static str, usize)> {
        let n = self.count();
        vec![
            ("keys", n),
            ("depth_keys_a", n),
            ("depth_keys_b", n),
            ("order_a", n),
            ("order", n),
            ("starts", n + 1),
            ("state", 8),
            ("splats", SPLAT * self.splats),
            ("depth_histogram", 16 * self.depth_blocks()),
        ]
    }

    fn of_slots(&self) -> Vec<(&'static str, usize)> {
        let capacity = self.capacity;
        vec![
            ("slot_tiles", capacity),
            ("slot_ids", capacity),
            ("tile_keys_a", capacity),
            ("tile_keys_b", capacity),
            ("tile_slots_a", capacity),
            ("tile_slots_b", capacity),
            ("tile_histogram", 16 * self.tile_blocks()),
            ("ids", capacity),
            ("list_positions", capacity),
            // `reaching` reads up to one word beyond the last byte.
            ("hits", capacity.div_ceil(4) + 2),
            ("records", RECORD * capacity),
        ]
    }

    fn of_views(&self) -> Vec<(&'static str, usize)> {
        let Self { tiles, pixels, .. } = *self;
        vec![
            ("offsets", tiles + 1),
            ("pixels", 1024 * tiles),
            ("last", TILE_LANES as usize * tiles),
            ("gradient", 768 * tiles),
            ("moments", MOMENTS * pixels),
            ("partials", 3 * pixels),
            ("values", 2 * pixels),
            ("losses", 2 * LOSS_RING),
            ("block_sums", 3 * 2 * pixels.div_ceil(4096)),
        ]
    }

    /// The arrays that are scanned, and their lengths.
    pub(crate) fn scans(&self) -> [(Scan, usize); 3] {
        [
            (Scan::Starts, self.count() + 1),
            (Scan::DepthHistogram, 16 * self.depth_blocks()),
            (Scan::TileHistogram, 16 * self.tile_blocks()),
        ]
    }
}

/// Planes that a colour channel has in the buffer `moments`.
const MOMENTS: usize = 5;

/// Lengths of pages for `n` Gaussians, of `most` but for the last.
pub(super) fn pages(n: usize, most: usize) -> impl Iterator<Item = usize> {
    (0..n).step_by(most).map(move |first| most.min(n - first))
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
