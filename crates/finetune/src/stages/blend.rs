//! Stage `blend`: front-to-back blending, tile by tile.

use multiversion::multiversion;
use rayon::prelude::*;

use super::project::{RenderView, Splat};
use super::tiles::{BATCH, TileLists, load};
use super::*;

/// Pixels of a row of a tile: the vector width that the inner loops are written for.
pub(crate) const LANES: usize = TILE as usize;

/// State of a tile's pixels, row-major within the tile, before the background.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
pub(crate) struct TilePixels {
    pub(crate) red: [[f32; LANES]; LANES],
    pub(crate) green: [[f32; LANES]; LANES],
    pub(crate) blue: [[f32; LANES]; LANES],
    /// Transmittance; negative where blending stopped early.
    pub(crate) t: [[f32; LANES]; LANES],
}

impl TilePixels {
    pub(crate) const CLEAR: Self = Self {
        red: [[0.0; LANES]; LANES],
        green: [[0.0; LANES]; LANES],
        blue: [[0.0; LANES]; LANES],
        t: [[1.0; LANES]; LANES],
    };
}

/// A tile, and the splats that it blends, near to far.
#[derive(Clone, Copy)]
pub(crate) struct TileSplats<'a> {
    splats: &'a [Splat],
    pub(crate) ids: &'a [u32],
    /// First row of pixels.
    y0: u32,
    /// Centres of the columns.
    x: [f32; LANES],
    /// Columns and rows within the image.
    columns: usize,
    pub(crate) rows: usize,
}

impl<'a> TileSplats<'a> {
    pub(crate) fn new(
        view: &RenderView,
        splats: &'a [Splat],
        lists: &'a TileLists,
        tile: usize,
    ) -> Self {
        let (tx, ty) = view.tile_at(tile);
        let (x0, y0) = (tx * TILE, ty * TILE);
        let mut x = [0.0; LANES];
        x.iter_mut().zip(x0..).for_each(|(x, column)| *x = column as f32 + 0.5);
        Self {
            splats,
            ids: lists.of(tile),
            y0,
            x,
            columns: (view.width - x0).min(TILE) as usize,
            rows: (view.height - y0).min(TILE) as usize,
        }
    }

    /// Copies the splats of a batch.
    #[inline(always)]
    pub(crate) fn load<'b>(&self, batch: &[u32], out: &'b mut [Splat; BATCH]) -> &'b [Splat] {
        load(self.splats, batch, out)
    }

    /// The splat's offsets from the columns.
    #[inline(always)]
    pub(crate) fn dx(&self, s: &Splat) -> [f32; LANES] {
        self.x.map(|x| s.x - x)
    }

    /// Its offset from a row.
    #[inline(always)]
    pub(crate) fn dy(&self, s: &Splat, row: usize) -> f32 {
        s.y - ((self.y0 + row as u32) as f32 + 0.5)
    }

    /// The rows that the splat reaches.
    #[inline(always)]
    pub(crate) fn reached(&self, s: &Splat) -> std::ops::Range<usize> {
        let end = (s.row1 - self.y0.min(s.row1)).min(self.rows as u32);
        (s.row0.max(self.y0) - self.y0) as usize..end as usize
    }

    /// The transmittance before the first splat. Pixels beyond the image's edge begin as stopped.
    #[inline(always)]
    pub(crate) fn clear(&self) -> [[f32; LANES]; LANES] {
        let mut t = [[-1.0; LANES]; LANES];
        for row in &mut t[..self.rows] {
            row[..self.columns].fill(1.0);
        }
        t
    }
}

/// One splat on one row of pixels; `row` is transmittance and colour.
#[inline(always)]
fn blend_row<const WEIGHTS: bool>(
    s: &Splat,
    dx: &[f32; LANES],
    dy: f32,
    row: [&mut [f32; LANES]; 4],
    [weight, square]: &mut [[f32; LANES]; 2],
) {
    let [t, red, green, blue] = row;
    let qy = s.q * dy;
    let e1 = s.r * dy;
    for l in 0..LANES {
        let px = s.p * dx[l];
        let e0 = px + qy;
        let step = gate(e0, e1, s.cut, s.opacity, T_STOP, t[l]);
        t[l] = step.t;
        if WEIGHTS {
            weight[l] += step.w;
            let w2 = step.w * step.w;
            square[l] += w2;
        } else {
            let r = step.w * s.red;
            let g = step.w * s.green;
            let b = step.w * s.blue;
            red[l] += r;
            green[l] += g;
            blue[l] += b;
        }
    }
}

/// Number of pixels of a row that still blend. Integer arithmetic, so that it is vectorised.
#[inline(always)]
fn live(t: &[f32; LANES]) -> u32 {
    let mut n = 0;
    for v in t {
        n += 1 - (v.to_bits() >> 31);
    }
    n
}

/// Sum of 16 lanes, halves added to halves: the order of every sum over lanes.
#[inline(always)]
pub(crate) fn sum_lanes(v: &[f32; LANES]) -> f32 {
    let mut s = *v;
    let mut half = LANES / 2;
    while half > 0 {
        for l in 0..half {
            s[l] += s[l + half];
        }
        half /= 2;
    }
    s[0]
}

/// Which rows of a tile still blend. False if none does. It is tested once a batch. Within a batch, a stopped pixel stays
/// as it is because its transmittance is negative.
#[inline(always)]
pub(crate) fn still_live<'a>(rows: &mut [bool], t: impl Iterator<Item = &'a [f32; LANES]>) -> bool {
    let mut any = false;
    for (row, t) in rows.iter_mut().zip(t) {
        *row = *row && live(t) != 0;
        any |= *row;
    }
    any
}

/// Blends a tile; the number of splats at the start of the list that some pixel may have blended. With `WEIGHTS`,
/// `weights` has one entry per slot of the list: the sums of its weights alpha T and of their squares.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn blend_tile<const WEIGHTS: bool>(
    tile: TileSplats<'_>,
    out: &mut TilePixels,
    weights: &mut [[f32; 2]],
) -> u32 {
    let mut pixels = TilePixels { t: tile.clear(), ..TilePixels::CLEAR };
    let mut row_live = [true; LANES];
    let mut last = 0;
    let mut loaded = [Splat::default(); BATCH];
    for (batch, list) in tile.ids.chunks(BATCH).enumerate() {
        for (k, s) in tile.load(list, &mut loaded).iter().enumerate() {
            let dx = tile.dx(s);
            let mut sums = [[0.0f32; LANES]; 2];
            for y in tile.reached(s) {
                if row_live[y] {
                    let TilePixels { t, red, green, blue } = &mut pixels;
                    let row = [&mut t[y], &mut red[y], &mut green[y], &mut blue[y]];
                    blend_row::<WEIGHTS>(s, &dx, tile.dy(s, y), row, &mut sums);
                }
            }
            if WEIGHTS {
                weights[batch * BATCH + k] = [sum_lanes(&sums[0]), sum_lanes(&sums[1])];
            }
        }
        last = (batch * BATCH + list.len()) as u32;
        if !still_live(&mut row_live[..tile.rows], pixels.t.iter()) {
            break;
        }
    }
    *out = pixels;
    last
}

/// Blends every tile. `last[tile]` becomes the number of splats of the tile's list that were needed.
pub(crate) fn blend(
    view: &RenderView,
    splats: &[Splat],
    lists: &TileLists,
    tiles: &mut Vec<TilePixels>,
    last: &mut Vec<u32>,
) {
    tiles.resize(view.tiles(), TilePixels::CLEAR);
    last.resize(view.tiles(), 0);
    tiles.par_iter_mut().zip(last.par_iter_mut()).enumerate().for_each(|(k, (out, last))| {
        *last = blend_tile::<false>(TileSplats::new(view, splats, lists, k), out, &mut []);
    });
}

/// Blends every tile for the weights alone: `weights[slot]` becomes the sums over the tile's
/// pixels of alpha T and of its square.
pub(crate) fn blend_weights(
    view: &RenderView,
    splats: &[Splat],
    lists: &TileLists,
    weights: &mut Vec<[f32; 2]>,
) {
    weights.clear();
    weights.resize(lists.ids.len(), [0.0; 2]);
    lists.split_mut(weights).into_par_iter().enumerate().for_each(|(k, weights)| {
        let tile = TileSplats::new(view, splats, lists, k);
        let mut pixels = TilePixels::CLEAR;
        blend_tile::<true>(tile, &mut pixels, weights);
    });
}
