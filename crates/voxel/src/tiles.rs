//! [`Tiles`]: a scene cut into runs of octree cells that are small enough to be worked on alone.
//!
//! Each cell is the largest that holds at most so many Gaussians. A tile is a run of such cells in Morton
//! order, with at most that many Gaussians in all. It goes beyond the paper.
//!
//! *Invariant:* tiles depend on the Gaussians in each cell, not on the order of the scene, and codes are only
//! counted, so they may come from anywhere.

use std::ops::Range;

/// Octree levels that one round of counting resolves.
const LEVELS: u8 = 4;

/// A scene cut into runs of octree cells.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Tiles {
    starts: Vec<u64>,
    counts: Vec<u64>,
}

impl Tiles {
    /// One tile of `count` Gaussians.
    #[must_use]
    pub fn one(count: u64) -> Self {
        Self { starts: vec![0], counts: vec![count] }
    }

    /// Tiles of at most `most` Gaussians. A cell at `depth` with more is a tile of its own.
    ///
    /// `visit` hands over the Morton codes of all Gaussians at `depth`, in any order and in pieces of any size.
    /// It is called once per round of four levels.
    ///
    /// # Errors
    /// Those of `visit`.
    pub fn cut<E>(
        depth: u8,
        most: u64,
        mut visit: impl FnMut(&mut dyn FnMut(&[u64])) -> Result<(), E>,
    ) -> Result<Self, E> {
        let mut cells = Vec::new();
        // Cells at `level` with more Gaussians than a tile holds, ascending.
        let mut open = vec![0u64];
        let mut level = 0;
        while !open.is_empty() {
            let levels = LEVELS.min(depth - level);
            let (shift, bits) = (3 * u32::from(depth - level - levels), 3 * u32::from(levels));
            let mut counts = vec![0u64; open.len() << bits];
            visit(&mut |codes| {
                for code in codes {
                    let cell = code >> shift;
                    if let Ok(number) = open.binary_search(&(cell >> bits)) {
                        counts[(number << bits) | (cell & ((1 << bits) - 1)) as usize] += 1;
                    }
                }
            })?;
            let mut next = Vec::new();
            for (&cell, counts) in open.iter().zip(counts.chunks_exact(1 << bits)) {
                let mut settle = |first: u64, count: u64, finest: bool| {
                    if finest && count > most && level + levels < depth {
                        next.push(first);
                    } else {
                        cells.push((first << shift, count));
                    }
                };
                divide(cell << bits, counts, most, &mut settle);
            }
            open = next;
            level += levels;
        }
        cells.sort_unstable();
        Ok(Self::grouped(&cells, most))
    }

    /// Joins consecutive cells, given by their first codes, as long as they fit a tile.
    fn grouped(cells: &[(u64, u64)], most: u64) -> Self {
        let mut tiles = Self { starts: vec![0], counts: vec![0] };
        for &(start, count) in cells {
            let last = tiles.counts.len() - 1;
            if tiles.counts[last] > 0 && tiles.counts[last] + count > most {
                tiles.starts.push(start);
                tiles.counts.push(count);
            } else {
                tiles.counts[last] += count;
            }
        }
        tiles
    }

    /// The number of tiles; at least 1.
    #[must_use]
    #[allow(clippy::len_without_is_empty, reason = "there is always a tile")]
    pub fn len(&self) -> usize {
        self.starts.len()
    }

    /// The first code of each tile.
    #[must_use]
    pub fn starts(&self) -> &[u64] {
        &self.starts
    }

    /// The Gaussians of each tile.
    #[must_use]
    pub fn counts(&self) -> &[u64] {
        &self.counts
    }

    /// The codes of a tile.
    #[must_use]
    pub fn codes(&self, tile: usize) -> Range<u64> {
        self.starts[tile]..self.starts.get(tile + 1).copied().unwrap_or(u64::MAX)
    }

    /// The tile of a code.
    #[must_use]
    pub fn of(&self, code: u64) -> usize {
        self.starts.partition_point(|&start| start <= code).saturating_sub(1)
    }
}

/// Hands the largest cells of at most `most` Gaussians to `settle`: first code, count, and whether it is a
/// finest cell. A finest cell may have more. `counts` are those of the finest cells, from code `first` on.
fn divide(first: u64, counts: &[u64], most: u64, settle: &mut impl FnMut(u64, u64, bool)) {
    let count = counts.iter().sum();
    if count == 0 {
        return;
    }
    if count <= most || counts.len() == 1 {
        settle(first, count, counts.len() == 1);
        return;
    }
    let child = counts.len() / 8;
    for (i, counts) in counts.chunks_exact(child).enumerate() {
        divide(first + (i * child) as u64, counts, most, settle);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::convert::Infallible;

    fn cut(depth: u8, most: u64, codes: &[u64]) -> Tiles {
        let visit = |take: &mut dyn FnMut(&[u64])| {
            codes.chunks(7).for_each(take);
            Ok::<(), Infallible>(())
        };
        Tiles::cut(depth, most, visit).unwrap()
    }

    /// A dense part at a corner, a line, and a point that many share.
    fn codes() -> Vec<u64> {
        let dense = (0..3000u64).map(|i| i * i % 5003);
        let line = (0..500u64).map(|i| i << 27);
        dense.chain(line).chain([77_777_777; 400]).collect()
    }

    #[test]
    fn tiles_hold_all_and_at_most_so_many() {
        let codes = codes();
        let tiles = cut(12, 300, &codes);
        assert!(tiles.len() > 10);
        for tile in 0..tiles.len() {
            let range = tiles.codes(tile);
            assert_eq!(range.start, tiles.starts()[tile]);
            let inside = codes.iter().filter(|c| range.contains(c)).count() as u64;
            assert_eq!(inside, tiles.counts()[tile]);
            assert!(inside <= 300 || (inside == 400 && tiles.of(77_777_777) == tile), "{inside}");
            assert!(inside > 0);
        }
        // Two neighbours fit no single tile.
        assert!(tiles.counts().windows(2).all(|w| w[0] + w[1] > 300));
        assert!(codes.iter().all(|&c| tiles.codes(tiles.of(c)).contains(&c)));
    }

    #[test]
    fn tiles_do_not_depend_on_the_order() {
        let mut codes = codes();
        let tiles = cut(12, 300, &codes);
        codes.sort_unstable_by_key(|c| c.wrapping_mul(0x9e37_79b9_7f4a_7c15));
        assert_eq!(cut(12, 300, &codes), tiles);
        assert_eq!(cut(12, 4000, &codes), Tiles::one(3900));
        assert_eq!(cut(12, 10, &[]), Tiles::one(0));
        assert_eq!(cut(0, 10, &[0; 30]), Tiles::one(30));
    }
}
