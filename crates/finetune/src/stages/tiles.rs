//! Stages `emit`, `sort_tile` and `ranges`: which splats each tile blends, near to far.

use rayon::prelude::*;

use super::project::{RenderView, Splat, TileBox};
use super::*;

/// Per-tile lists of splats.
#[derive(Default)]
pub(crate) struct TileLists {
    /// Start of each tile's list in `ids`; one entry more than there are tiles.
    pub(crate) offsets: Vec<u32>,
    /// Places of splats, tile by tile in row-major order, near to far within a tile.
    pub(crate) ids: Vec<u32>,
}

impl TileLists {
    pub(crate) fn of(&self, tile: usize) -> &[u32] {
        &self.ids[self.offsets[tile] as usize..self.offsets[tile + 1] as usize]
    }

    /// Splits an array with one entry per slot into one slice per tile.
    pub(crate) fn split_mut<'a, T>(&self, mut slots: &'a mut [T]) -> Vec<&'a mut [T]> {
        let mut out = Vec::with_capacity(self.offsets.len());
        for w in self.offsets.windows(2) {
            let (head, tail) = slots.split_at_mut((w[1] - w[0]) as usize);
            out.push(head);
            slots = tail;
        }
        out
    }
}

/// Splats of a part of the depth order.
const PART: usize = 1 << 16;
/// Splats that are loaded together.
pub(crate) const BATCH: usize = 32;

/// Copies the entries of a batch. They lie far apart in memory, and each read waits long for it. Reads without work
/// between them wait at the same time.
#[inline(always)]
pub(crate) fn load<'a, T: Copy>(all: &[T], ids: &[u32], out: &'a mut [T; BATCH]) -> &'a [T] {
    let out = &mut out[..ids.len()];
    out.iter_mut().zip(ids).for_each(|(entry, &id)| *entry = all[id as usize]);
    out
}

/// Whether the splat reaches a pixel centre of tile (tx, ty).
#[inline]
pub(crate) fn touches(view: &RenderView, s: &Splat, tx: u32, ty: u32) -> bool {
    if view.reference {
        return true;
    }
    let edge = (TILE - 1) as f32;
    let dx1 = s.x - ((tx * TILE) as f32 + 0.5);
    let dy1 = s.y - ((ty * TILE) as f32 + 0.5);
    let least = least_sigma(s.p, s.q, s.r, dx1 - edge, dx1, dy1 - edge, dy1);
    least <= s.cut
}

/// Builds the lists from the depth order: first one list per row of tiles, in parts of the order, then a counting sort
/// of each row's list into tiles.
pub(crate) fn tile_lists(
    view: &RenderView,
    splats: &[Splat],
    boxes: &[TileBox],
    order: &[u32],
    out: &mut TileLists,
) {
    let rows = view.tiles_y as usize;
    let columns = view.tiles_x as usize;
    let by_row = |part: &[u32]| {
        let mut by_row: Vec<Vec<u32>> = vec![Vec::new(); rows];
        let mut loaded = [TileBox::default(); BATCH];
        for batch in part.chunks(BATCH) {
            for (&i, b) in batch.iter().zip(load(boxes, batch, &mut loaded)) {
                by_row[b.y0 as usize..b.y1 as usize].iter_mut().for_each(|list| list.push(i));
            }
        }
        by_row
    };
    let parts: Vec<_> = order.par_chunks(PART).map(by_row).collect();
    let sorted: Vec<(Vec<u32>, Vec<u32>)> = (0..rows)
        .into_par_iter()
        .map(|ty| {
            let row = || parts.iter().map(|part| &part[ty]);
            let mut pairs = Vec::with_capacity(2 * row().map(Vec::len).sum::<usize>());
            let mut counts = vec![0u32; columns];
            let mut loaded = ([TileBox::default(); BATCH], [Splat::default(); BATCH]);
            for batch in row().flat_map(|list| list.chunks(BATCH)) {
                let boxes = load(boxes, batch, &mut loaded.0);
                let splats = load(splats, batch, &mut loaded.1);
                for ((&i, b), s) in batch.iter().zip(boxes).zip(splats) {
                    for tx in (b.x0..b.x1).filter(|&tx| touches(view, s, tx, ty as u32)) {
                        counts[tx as usize] += 1;
                        pairs.push((tx, i));
                    }
                }
            }
            let mut next = vec![0u32; columns];
            let mut sum = 0;
            for (n, &c) in next.iter_mut().zip(&counts) {
                *n = sum;
                sum += c;
            }
            let mut ids = vec![0u32; pairs.len()];
            for (tx, i) in pairs {
                let slot = &mut next[tx as usize];
                ids[*slot as usize] = i;
                *slot += 1;
            }
            (counts, ids)
        })
        .collect();
    out.offsets.clear();
    out.ids.clear();
    let mut sum = 0;
    out.offsets.push(0);
    for (counts, ids) in &sorted {
        for &c in counts {
            sum += c;
            out.offsets.push(sum);
        }
        out.ids.extend_from_slice(ids);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::options::RenderOptions;
    use gs_model::Camera;

    #[test]
    fn a_tile_is_skipped_only_if_the_splat_reaches_none_of_its_pixel_centres() {
        let camera = Camera::looking_at(
            "a".into(),
            [0.0; 3],
            [0.0, 0.0, 1.0],
            [0.0, -1.0, 0.0],
            [64; 2],
            60.0,
        );
        let view = RenderView::new(&camera, &RenderOptions::default());
        let mut rng = testing::Rng::seeded(3);
        let mut unit = || rng.range_f32(0.0, 1.0);
        let mut skipped = 0;
        for _ in 0..2000 {
            let (x, y, cut) = (64.0 * unit(), 64.0 * unit(), 5.0 * unit());
            let (p, q, r) = (unit(), unit() - 0.5, unit());
            let s = Splat { x, y, p, q, r, cut, ..Splat::default() };
            for (tx, ty) in (0..4).flat_map(|tx| (0..4).map(move |ty| (tx, ty))) {
                if touches(&view, &s, tx, ty) {
                    continue;
                }
                skipped += 1;
                let pixels = (0..TILE * TILE).map(|i| (tx * TILE + i % TILE, ty * TILE + i / TILE));
                for (u, v) in pixels {
                    let (dx, dy) = (x - (u as f32 + 0.5), y - (v as f32 + 0.5));
                    let sigma = (p * dx + q * dy) * (p * dx + q * dy) + r * dy * r * dy;
                    assert!(sigma > cut * (1.0 - 1e-5), "{s:?}: pixel {u}, {v} of a skipped tile");
                }
            }
        }
        assert!(skipped > 1000);
    }
}
