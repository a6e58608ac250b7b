//! Stage `blend_adjoint`: one record of gradients per slot (splat and tile).

use glam::{Mat4, Vec4};
use multiversion::multiversion;
use rayon::prelude::*;

use super::blend::{LANES, TilePixels, TileSplats, still_live};
use super::project::{RenderView, Splat};
use super::tiles::BATCH;
use super::*;
use crate::forward::Forward;

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
/// four lanes share a block.
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

/// The state of a row of pixels: transmittance, the light behind the splats so far, dotted with the gradient, and
/// the gradient by the colour.
#[derive(Clone, Copy)]
struct PixelRow {
    t: [f32; LANES],
    rg: [f32; LANES],
    g: [[f32; LANES]; 3],
}

/// The adjoint of one splat on one row of pixels.
#[inline(always)]
fn replay_row<const N: usize>(
    s: &Splat,
    dx: &[f32; LANES],
    dy: f32,
    row: &mut PixelRow,
    acc: &mut [[f32; LANES]; N],
) {
    let qy = s.q * dy;
    let e1 = s.r * dy;
    let e11 = e1 * e1;
    for l in 0..LANES {
        let px = s.p * dx[l];
        let e0 = px + qy;
        let (gr, gg, gb) = (row.g[0][l], row.g[1][l], row.g[2][l]);
        let cr = s.red * gr;
        let cgr = s.green * gg;
        let cb = s.blue * gb;
        let crg = cr + cgr;
        let cg = crg + cb;
        let step = replay(e0, e1, s.cut, s.opacity, T_STOP, row.t[l], row.rg[l], cg);
        row.t[l] = step.t;
        row.rg[l] = step.rg;
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

/// The rows before the first splat.
#[inline(always)]
fn rows(
    tile: &TileSplats<'_>,
    pixels: &TilePixels,
    gradient: &TileGradient,
    background: [f32; 3],
) -> [PixelRow; LANES] {
    let start = tile.clear();
    std::array::from_fn(|y| {
        let g = [gradient.red[y], gradient.green[y], gradient.blue[y]];
        let mut rg = [0.0; LANES];
        for l in 0..LANES {
            let t = pixels.t[y][l].abs();
            let mr = (pixels.red[y][l] + t * background[0]) * g[0][l];
            let mg = (pixels.green[y][l] + t * background[1]) * g[1][l];
            let mb = (pixels.blue[y][l] + t * background[2]) * g[2][l];
            rg[l] = (mr + mg) + mb;
        }
        PixelRow { t: start[y], rg, g }
    })
}

/// Fills the records of a tile's slots.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn replay_tile<const N: usize>(
    tile: TileSplats<'_>,
    pixels: &TilePixels,
    gradient: &TileGradient,
    background: [f32; 3],
    records: &mut [[f32; N]],
) {
    let mut state = rows(&tile, pixels, gradient, background);
    let mut row_live = [true; LANES];
    let mut loaded = [Splat::default(); BATCH];
    for (list, records) in tile.ids.chunks(BATCH).zip(records.chunks_mut(BATCH)) {
        for (s, record) in tile.load(list, &mut loaded).iter().zip(records) {
            let dx = tile.dx(s);
            let reached = tile.reached(s);
            // Left and right half of the tile, four sums per vector.
            let mut sides = [[Vec4::ZERO; 2]; QUADS];
            for top in (0..LANES).step_by(BLOCK_ROWS) {
                let block = reached.start.max(top)..reached.end.min(top + BLOCK_ROWS);
                if block.is_empty() {
                    continue;
                }
                let mut acc = [[0.0f32; LANES]; N];
                for y in block {
                    if row_live[y] {
                        replay_row::<N>(s, &dx, tile.dy(s, y), &mut state[y], &mut acc);
                    }
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
        if !still_live(&mut row_live[..tile.rows], state.iter().map(|row| &row.t)) {
            break;
        }
    }
}

/// Fills `records`, one per slot in tile order; slots that no pixel needed stay zero.
pub(crate) fn blend_adjoint<const N: usize>(
    view: &RenderView,
    f: &Forward,
    gradients: &[TileGradient],
    records: &mut Vec<[f32; N]>,
) {
    records.clear();
    records.resize(f.lists.ids.len(), [0.0; N]);
    f.lists.split_mut(records).into_par_iter().enumerate().for_each(|(k, records)| {
        let mut tile = TileSplats::new(view, &f.projected.seen.splats, &f.lists, k);
        tile.ids = &tile.ids[..f.last[k] as usize];
        replay_tile(tile, &f.tiles[k], &gradients[k], view.background, records);
    });
}
