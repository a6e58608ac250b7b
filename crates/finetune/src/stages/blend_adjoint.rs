//! Stage `blend_adjoint`: one record of gradients per slot (splat and tile).

use glam::{Mat4, Vec4};
use multiversion::multiversion;
use rayon::prelude::*;

use super::blend::{LANES, TilePixels, live};
use super::project::{Splat, View};
use super::tiles::TileLists;
use super::*;

/// Gradient of the loss with respect to a tile's pixels; zero beyond the image's edge.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
pub(crate) struct TileGradient {
    pub(crate) red: [[f32; LANES]; LANES],
    pub(crate) green: [[f32; LANES]; LANES],
    pub(crate) blue: [[f32; LANES]; LANES],
}

impl TileGradient {
    pub(crate) const ZERO: Self = Self {
        red: [[0.0; LANES]; LANES],
        green: [[0.0; LANES]; LANES],
        blue: [[0.0; LANES]; LANES],
    };
}

/// Floats per record with frozen means: colour (3), then the sums over the pixels of v_sigma
/// times 1, e0 e0, e0 e1, e1 e1.
pub(crate) const FROZEN: usize = 7;
/// With means: also v_sigma times e0 and e1.
pub(crate) const MOVING: usize = 9;

/// Sums are computed per block of eight columns and four rows, then over the blocks, because on a GPU
/// a lane owns a block.
const BLOCK_ROWS: usize = 4;
/// Vectors of four that hold the sums of a record.
const QUADS: usize = MOVING.div_ceil(4);

/// Sums of up to four vectors over eight lanes from `side` on, halves added to halves. With `Vec4`
/// the compiler emits vector instructions; with plain arrays it emits scalar ones.
#[inline(always)]
fn sum_eight(v: &[[f32; LANES]], side: usize) -> Vec4 {
    let four = |k: usize| match v.get(k) {
        Some(v) => Vec4::from_slice(&v[side..side + 4]) + Vec4::from_slice(&v[side + 4..side + 8]),
        None => Vec4::ZERO,
    };
    let m = Mat4::from_cols(four(0), four(1), four(2), four(3)).transpose();
    (m.x_axis + m.z_axis) + (m.y_axis + m.w_axis)
}

/// The state of a row of pixels: transmittance, and the light behind the splats so far, dotted with
/// the gradient.
#[derive(Clone, Copy)]
struct PixelRow {
    t: [f32; LANES],
    rg: [f32; LANES],
}

/// The adjoint of one splat on one row of pixels.
#[inline(always)]
fn replay_row<const N: usize>(
    s: &Splat,
    dx: &[f32; LANES],
    dy: f32,
    state: &mut PixelRow,
    g: [&[f32; LANES]; 3],
    acc: &mut [[f32; LANES]; N],
) {
    let qy = s.q * dy;
    let e1 = s.r * dy;
    let e11 = e1 * e1;
    for l in 0..LANES {
        let px = s.p * dx[l];
        let e0 = px + qy;
        let (gr, gg, gb) = (g[0][l], g[1][l], g[2][l]);
        let cr = s.red * gr;
        let cgr = s.green * gg;
        let cb = s.blue * gb;
        let crg = cr + cgr;
        let cg = crg + cb;
        let step = replay(e0, e1, s.cut, s.opacity, T_STOP, state.t[l], state.rg[l], cg);
        state.t[l] = step.t;
        state.rg[l] = step.rg;
        let v = step.v_sigma;
        let v0 = v * e0;
        let wr = step.w * gr;
        let wg = step.w * gg;
        let wb = step.w * gb;
        let v00 = v0 * e0;
        let v01 = v0 * e1;
        let v11 = v * e11;
        acc[0][l] += wr;
        acc[1][l] += wg;
        acc[2][l] += wb;
        acc[3][l] += v;
        acc[4][l] += v00;
        acc[5][l] += v01;
        acc[6][l] += v11;
        if N == MOVING {
            let v1 = v * e1;
            acc[7][l] += v0;
            acc[8][l] += v1;
        }
    }
}

struct ReplayTile<'a, const N: usize> {
    view: &'a View,
    splats: &'a [Splat],
    ids: &'a [u32],
    tile: (u32, u32),
    pixels: &'a TilePixels,
    gradient: &'a TileGradient,
    records: &'a mut [[f32; N]],
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn replay_tile<const N: usize>(tile: ReplayTile<'_, N>) {
    let ReplayTile { view, splats, ids, tile: (tx, ty), pixels, gradient, records } = tile;
    let mut px = [0.0f32; LANES];
    for (l, p) in px.iter_mut().enumerate() {
        *p = (tx * TILE + l as u32) as f32 + 0.5;
    }
    let y0 = ty * TILE;
    let rows = (view.height - y0).min(TILE);
    let mut state = [PixelRow { t: [1.0; LANES], rg: [0.0; LANES] }; LANES];
    for (y, row) in state.iter_mut().enumerate() {
        for l in 0..LANES {
            let (r, g, b) = (pixels.red[y][l], pixels.green[y][l], pixels.blue[y][l]);
            let t = pixels.t[y][l].abs();
            let tr = t * view.background[0];
            let tg = t * view.background[1];
            let tb = t * view.background[2];
            let mr = (r + tr) * gradient.red[y][l];
            let mg = (g + tg) * gradient.green[y][l];
            let mb = (b + tb) * gradient.blue[y][l];
            let mrg = mr + mg;
            row.rg[l] = mrg + mb;
        }
    }
    for l in (view.width - tx * TILE).min(TILE) as usize..LANES {
        for row in &mut state {
            row.t[l] = -1.0;
        }
    }
    let mut row_live = [true; LANES];
    const BATCH: usize = 32;
    for (list, records) in ids.chunks(BATCH).zip(records.chunks_mut(BATCH)) {
        for (&i, record) in list.iter().zip(records) {
            let s = splats[i as usize];
            let mut dx = [0.0f32; LANES];
            for l in 0..LANES {
                dx[l] = s.x - px[l];
            }
            let first = s.row0.max(y0) - y0;
            let end = (s.row1 - y0.min(s.row1)).min(rows);
            // Left and right half of the tile, four sums per vector.
            let mut sides = [[Vec4::ZERO; 2]; QUADS];
            for top in (0..TILE).step_by(BLOCK_ROWS) {
                let (first, end) = (first.max(top), end.min(top + BLOCK_ROWS as u32));
                if first >= end {
                    continue;
                }
                let mut acc = [[0.0f32; LANES]; N];
                for y in first..end {
                    let y = y as usize;
                    if !row_live[y] {
                        continue;
                    }
                    let dy = s.y - ((y0 + y as u32) as f32 + 0.5);
                    let g = [&gradient.red[y], &gradient.green[y], &gradient.blue[y]];
                    replay_row::<N>(&s, &dx, dy, &mut state[y], g, &mut acc);
                }
                for (side, part) in sides.iter_mut().zip(acc.chunks(4)) {
                    side[0] += sum_eight(part, 0);
                    side[1] += sum_eight(part, 8);
                }
            }
            for (value, [left, right]) in record.chunks_mut(4).zip(sides) {
                value.copy_from_slice(&(left + right).to_array()[..value.len()]);
            }
        }
        let mut any = false;
        for y in 0..rows as usize {
            row_live[y] = row_live[y] && live(&state[y].t) != 0;
            any |= row_live[y];
        }
        if !any {
            break;
        }
    }
}

/// Fills `records`, one per slot in tile order; slots past `last` stay zero.
pub(crate) fn blend_adjoint<const N: usize>(
    view: &View,
    splats: &[Splat],
    lists: &TileLists,
    pixels: &[TilePixels],
    last: &[u32],
    gradients: &[TileGradient],
    records: &mut Vec<[f32; N]>,
) {
    records.clear();
    records.resize(lists.ids.len(), [0.0; N]);
    lists.split_mut(records).into_par_iter().enumerate().for_each(|(k, records)| {
        let ids = &lists.of(k)[..last[k] as usize];
        replay_tile(ReplayTile {
            view,
            splats,
            ids,
            tile: view.tile_at(k),
            pixels: &pixels[k],
            gradient: &gradients[k],
            records,
        });
    });
}
