//! Stage `blend`: front-to-back blending, tile by tile.

use multiversion::multiversion;
use rayon::prelude::*;

use super::project::{Splat, View};
use super::tiles::TileLists;
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

/// One splat on one row of pixels.
#[inline(always)]
fn blend_row<const WEIGHTS: bool>(
    s: &Splat,
    dx: &[f32; LANES],
    dy: f32,
    t: &mut [f32; LANES],
    red: &mut [f32; LANES],
    green: &mut [f32; LANES],
    blue: &mut [f32; LANES],
    weight: &mut [f32; LANES],
    square: &mut [f32; LANES],
) {
    let qy = s.q * dy;
    let e1 = s.r * dy;
    for l in 0..LANES {
        let px = s.p * dx[l];
        let e0 = px + qy;
        let step = gate(e0, e1, s.cut, s.opacity, T_STOP, t[l]);
        let r = step.w * s.red;
        let g = step.w * s.green;
        let b = step.w * s.blue;
        red[l] += r;
        green[l] += g;
        blue[l] += b;
        t[l] = step.t;
        if WEIGHTS {
            weight[l] += step.w;
            let w2 = step.w * step.w;
            square[l] += w2;
        }
    }
}

/// Number of pixels of a row that still blend. Integer arithmetic, so that it is vectorised.
#[inline(always)]
pub(crate) fn live(t: &[f32; LANES]) -> u32 {
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

struct BlendTile<'a> {
    view: &'a View,
    splats: &'a [Splat],
    ids: &'a [u32],
    tx: u32,
    ty: u32,
    out: &'a mut TilePixels,
    /// With `WEIGHTS`, one entry per slot of the list: the sums of its weights alpha T and of
    /// their squares.
    weights: &'a mut [[f32; 2]],
}

/// Number of splats at the start of the list that some pixel may have blended.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn blend_tile<const WEIGHTS: bool>(tile: BlendTile<'_>) -> u32 {
    let BlendTile { view, splats, ids, tx, ty, out, weights } = tile;
    let mut px = [0.0f32; LANES];
    for (l, p) in px.iter_mut().enumerate() {
        *p = (tx * TILE + l as u32) as f32 + 0.5;
    }
    let y0 = ty * TILE;
    let rows = (view.height - y0).min(TILE);
    let mut px_state = TilePixels::CLEAR;
    // Pixels beyond the image's edge begin as stopped: lanes first, then rows.
    for l in (view.width - tx * TILE).min(TILE) as usize..LANES {
        for row in &mut px_state.t {
            row[l] = -1.0;
        }
    }
    for row in &mut px_state.t[rows as usize..] {
        *row = [-1.0; LANES];
    }
    let mut row_live = [true; LANES];
    let mut last = 0;
    // Whether a row still blends is tested once per batch. In between, the sign of its
    // transmittance keeps a stopped pixel as it is.
    const BATCH: usize = 32;
    for (batch, list) in ids.chunks(BATCH).enumerate() {
        for (k, &i) in list.iter().enumerate() {
            let s = splats[i as usize];
            let mut dx = [0.0f32; LANES];
            for l in 0..LANES {
                dx[l] = s.x - px[l];
            }
            let mut weight = [0.0f32; LANES];
            let mut square = [0.0f32; LANES];
            let first = s.row0.max(y0) - y0;
            let end = (s.row1 - y0.min(s.row1)).min(rows);
            for y in first..end {
                let y = y as usize;
                if !row_live[y] {
                    continue;
                }
                let dy = s.y - ((y0 + y as u32) as f32 + 0.5);
                blend_row::<WEIGHTS>(
                    &s,
                    &dx,
                    dy,
                    &mut px_state.t[y],
                    &mut px_state.red[y],
                    &mut px_state.green[y],
                    &mut px_state.blue[y],
                    &mut weight,
                    &mut square,
                );
            }
            if WEIGHTS {
                weights[batch * BATCH + k] = [sum_lanes(&weight), sum_lanes(&square)];
            }
        }
        last = (batch * BATCH + list.len()) as u32;
        let mut any = false;
        for y in 0..rows as usize {
            row_live[y] = row_live[y] && live(&px_state.t[y]) != 0;
            any |= row_live[y];
        }
        if !any {
            break;
        }
    }
    *out = px_state;
    last
}

/// Blends every tile. `last[tile]` becomes the number of splats of the tile's list that were needed.
pub(crate) fn blend(
    view: &View,
    splats: &[Splat],
    lists: &TileLists,
    tiles: &mut Vec<TilePixels>,
    last: &mut Vec<u32>,
) {
    tiles.resize(view.tiles(), TilePixels::CLEAR);
    last.resize(view.tiles(), 0);
    tiles.par_iter_mut().zip(last.par_iter_mut()).enumerate().for_each(|(tile, (out, last))| {
        let ids = lists.of(tile);
        let (tx, ty) = view.tile_at(tile);
        let weights = &mut [];
        *last = blend_tile::<false>(BlendTile { view, splats, ids, tx, ty, out, weights });
    });
}

/// Blends every tile for the weights alone: `weights[slot]` becomes the sums over the tile's
/// pixels of alpha T and of its square.
pub(crate) fn blend_weights(
    view: &View,
    splats: &[Splat],
    lists: &TileLists,
    weights: &mut Vec<[f32; 2]>,
) {
    weights.clear();
    weights.resize(lists.ids.len(), [0.0; 2]);
    lists.split_mut(weights).into_par_iter().enumerate().for_each(|(tile, weights)| {
        let ids = lists.of(tile);
        let (tx, ty) = view.tile_at(tile);
        let mut pixels = TilePixels::CLEAR;
        let out = &mut pixels;
        blend_tile::<true>(BlendTile { view, splats, ids, tx, ty, out, weights });
    });
}
