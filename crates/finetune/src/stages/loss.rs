//! Stage `loss`: the value of the loss and its gradient per pixel.

use multiversion::multiversion;
use rayon::prelude::*;

use super::blend::{LANES, TilePixels};
use super::blend_adjoint::TileGradient;
use super::project::View;
use super::*;
use crate::metrics::taps;

/// Radius of the SSIM window.
pub(crate) const RADIUS: usize = 5;
const TAPS: usize = 2 * RADIUS + 1;
const C1: f32 = 1.0e-4;
const C2: f32 = 9.0e-4;

/// What the loss stage reports.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct LossValue {
    /// The loss that the gradient is of.
    pub(crate) loss: f64,
    /// Mean squared error of the clamped image, for the PSNR.
    pub(crate) mse: f64,
}

/// The rendered tiles over the background, as three planes.
pub(crate) fn to_planes(view: &View, tiles: &[TilePixels], planes: &mut Vec<f32>) {
    let (w, h) = (view.width as usize, view.height as usize);
    planes.resize(3 * w * h, 0.0);
    planes.par_chunks_mut(w).enumerate().for_each(|(row, out)| {
        let (channel, y) = (row / h, row % h);
        let tiles = &tiles[y / LANES * view.tiles_x as usize..];
        for (tile, out) in tiles.iter().zip(out.chunks_mut(LANES)) {
            let colour = match channel {
                0 => &tile.red,
                1 => &tile.green,
                _ => &tile.blue,
            };
            let ly = y % LANES;
            for (l, o) in out.iter_mut().enumerate() {
                let under = tile.t[ly][l].abs() * view.background[channel];
                *o = colour[ly][l] + under;
            }
        }
    });
}

/// Gradient planes to tiles.
pub(crate) fn to_tiles(view: &View, planes: &[f32], tiles: &mut Vec<TileGradient>) {
    let (w, h) = (view.width as usize, view.height as usize);
    tiles.resize(view.tiles(), TileGradient::ZERO);
    tiles.par_iter_mut().enumerate().for_each(|(k, tile)| {
        let (tx, ty) = view.tile_at(k);
        let (x0, y0) = ((tx * TILE) as usize, (ty * TILE) as usize);
        let n = (w - x0).min(LANES);
        *tile = TileGradient::ZERO;
        for ly in 0..(h - y0).min(LANES) {
            let at = (y0 + ly) * w + x0;
            tile.red[ly][..n].copy_from_slice(&planes[at..at + n]);
            tile.green[ly][..n].copy_from_slice(&planes[w * h + at..w * h + at + n]);
            tile.blue[ly][..n].copy_from_slice(&planes[2 * w * h + at..2 * w * h + at + n]);
        }
    });
}

fn clamped_error2(x: f32, y: f32) -> f64 {
    let d = f64::from(x.clamp(0.0, 1.0) - y);
    d * d
}

/// Mean squared error over all values; `gradient` becomes its gradient with respect to `x`.
pub(crate) fn mse(w: usize, x: &[f32], y: &[f32], gradient: &mut Vec<f32>) -> LossValue {
    gradient.resize(x.len(), 0.0);
    let scale = 2.0 / x.len() as f32;
    let rows: Vec<(f64, f64)> = gradient
        .par_chunks_mut(w)
        .zip(x.par_chunks(w))
        .zip(y.par_chunks(w))
        .map(|((g, x), y)| {
            let (mut sum, mut clamped) = (0.0, 0.0);
            for ((g, &x), &y) in g.iter_mut().zip(x).zip(y) {
                let d = x - y;
                *g = scale * d;
                sum += f64::from(d) * f64::from(d);
                clamped += clamped_error2(x, y);
            }
            (sum, clamped)
        })
        .collect();
    total(&rows, x.len())
}

fn total(rows: &[(f64, f64)], n: usize) -> LossValue {
    let loss: f64 = rows.iter().map(|r| r.0).sum();
    let mse: f64 = rows.iter().map(|r| r.1).sum();
    LossValue { loss: loss / n as f64, mse: mse / n as f64 }
}

/// Buffers of the L1 + SSIM loss.
#[derive(Default)]
pub(crate) struct SsimScratch {
    /// Per row: x, y, x^2, y^2, x y blurred along the row.
    moments: Vec<f32>,
    /// Per row: the partials with respect to the mean, the variance and the covariance,
    /// blurred along the row.
    partials: Vec<f32>,
}

fn window() -> [f32; TAPS] {
    taps().map(|t| t as f32)
}

/// One row convolved with the window; `padded` holds it with [`RADIUS`] zeros either side.
#[inline(always)]
fn along(taps: &[f32; TAPS], padded: &[f32], out: &mut [f32]) {
    let n = out.len();
    for (o, p) in out.iter_mut().zip(padded) {
        *o = taps[0] * p;
    }
    for (k, t) in taps.iter().enumerate().skip(1) {
        for (o, p) in out.iter_mut().zip(&padded[k..k + n]) {
            *o += t * p;
        }
    }
}

/// Rows y - 5 ..= y + 5 that exist, each with its tap.
#[inline(always)]
fn window_rows(y: usize, h: usize) -> impl Iterator<Item = (usize, usize)> {
    (y.saturating_sub(RADIUS)..(y + RADIUS + 1).min(h)).map(move |i| (i, i + RADIUS - y))
}

struct RowMoments<'a> {
    x: &'a [f32],
    y: &'a [f32],
    out: &'a mut [f32],
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn row_moments(of: RowMoments<'_>) {
    let RowMoments { x, y, out } = of;
    let (w, taps) = (x.len(), window());
    let mut padded = vec![0.0f32; w + 2 * RADIUS];
    for (q, out) in out.chunks_exact_mut(w).enumerate() {
        for ((p, &x), &y) in padded[RADIUS..].iter_mut().zip(x).zip(y) {
            *p = match q {
                0 => x,
                1 => y,
                2 => x * x,
                3 => y * y,
                _ => x * y,
            };
        }
        along(&taps, &padded, out);
    }
}

/// Column blur of one image row of [`RowMoments`], SSIM, its partials, row blur of those.
struct RowSsim<'a> {
    w: usize,
    h: usize,
    row: usize,
    moments: &'a [f32],
    out: &'a mut [f32],
}

/// Sum of SSIM over the row.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn row_ssim(of: RowSsim<'_>) -> f64 {
    let RowSsim { w, h, row, moments, out } = of;
    let taps = window();
    let mut m = vec![0.0f32; 5 * w];
    for (i, tap) in window_rows(row % h, h) {
        let at = (row - row % h + i) * 5 * w;
        for (m, v) in m.iter_mut().zip(&moments[at..at + 5 * w]) {
            *m += taps[tap] * v;
        }
    }
    let (mx, rest) = m.split_at(w);
    let (my, rest) = rest.split_at(w);
    let (exx, rest) = rest.split_at(w);
    let (eyy, exy) = rest.split_at(w);
    let mut padded = [(); 3].map(|()| vec![0.0f32; w + 2 * RADIUS]);
    let mut values = vec![0.0f32; w];
    {
        let [pm, pv, pc] = &mut padded;
        let (pm, pv, pc) = (&mut pm[RADIUS..][..w], &mut pv[RADIUS..][..w], &mut pc[RADIUS..][..w]);
        for i in 0..w {
            let (ux, uy) = (mx[i], my[i]);
            let (uxx, uyy, uxy) = (ux * ux, uy * uy, ux * uy);
            let a1 = 2.0 * uxy + C1;
            let a2 = 2.0 * (exy[i] - uxy) + C2;
            let b1 = uxx + uyy + C1;
            let b2 = (exx[i] - uxx) + (eyy[i] - uyy) + C2;
            let inv = 1.0 / (b1 * b2);
            let s = a1 * a2 * inv;
            let d_var = -(s / b2);
            let d_cov = 2.0 * a1 * inv;
            let d_mean = 2.0 * uy * a2 * inv - 2.0 * ux * (s / b1);
            values[i] = s;
            pm[i] = d_mean - 2.0 * ux * d_var - uy * d_cov;
            pv[i] = d_var;
            pc[i] = d_cov;
        }
    }
    for (p, out) in padded.iter().zip(out.chunks_exact_mut(w)) {
        along(&taps, p, out);
    }
    values.iter().map(|&v| f64::from(v)).sum()
}

/// Column blur of the partials and the gradient of the whole loss.
struct RowGradient<'a> {
    w: usize,
    h: usize,
    row: usize,
    weight: f32,
    partials: &'a [f32],
    x: &'a [f32],
    y: &'a [f32],
    out: &'a mut [f32],
}

/// Sums over the row of |x - y| and of the clamped squared error.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn row_gradient(of: RowGradient<'_>) -> (f64, f64) {
    let RowGradient { w, h, row, weight, partials, x, y, out } = of;
    let taps = window();
    let mut m = vec![0.0f32; 3 * w];
    for (i, tap) in window_rows(row % h, h) {
        let at = (row - row % h + i) * 3 * w;
        for (m, v) in m.iter_mut().zip(&partials[at..at + 3 * w]) {
            *m += taps[tap] * v;
        }
    }
    let n = (3 * w * h) as f32;
    let (ssim_scale, l1_scale) = (-weight / n, (1.0 - weight) / n);
    let (pm, rest) = m.split_at(w);
    let (pv, pc) = rest.split_at(w);
    for i in 0..w {
        let d = x[i] - y[i];
        let sign = if d > 0.0 { l1_scale } else { -l1_scale };
        let l1 = if d == 0.0 { 0.0 } else { sign };
        let s = pm[i] + 2.0 * x[i] * pv[i] + y[i] * pc[i];
        out[i] = l1 + ssim_scale * s;
    }
    let (mut abs, mut clamped) = (0.0, 0.0);
    for (&x, &y) in x.iter().zip(y) {
        abs += f64::from((x - y).abs());
        clamped += clamped_error2(x, y);
    }
    (abs, clamped)
}

/// `(1 - weight) L1 + weight (1 - SSIM)` over three planes of `w` x `h`; `gradient` becomes its
/// gradient with respect to `x`. The window is 11x11, sigma 1.5, zero padding.
pub(crate) fn l1_ssim(
    (w, h): (usize, usize),
    weight: f32,
    [x, y]: [&[f32]; 2],
    scratch: &mut SsimScratch,
    gradient: &mut Vec<f32>,
) -> LossValue {
    let n = x.len();
    gradient.resize(n, 0.0);
    scratch.moments.resize(5 * n, 0.0);
    scratch.partials.resize(3 * n, 0.0);
    scratch
        .moments
        .par_chunks_mut(5 * w)
        .zip(x.par_chunks(w))
        .zip(y.par_chunks(w))
        .for_each(|((out, x), y)| row_moments(RowMoments { x, y, out }));
    let moments = &scratch.moments;
    let ssim: Vec<f64> = scratch
        .partials
        .par_chunks_mut(3 * w)
        .enumerate()
        .map(|(row, out)| row_ssim(RowSsim { w, h, row, moments, out }))
        .collect();
    let partials = &scratch.partials;
    let rows: Vec<(f64, f64)> = gradient
        .par_chunks_mut(w)
        .zip(x.par_chunks(w))
        .zip(y.par_chunks(w))
        .enumerate()
        .map(|(row, ((out, x), y))| {
            row_gradient(RowGradient { w, h, row, weight, partials, x, y, out })
        })
        .collect();
    let l1 = total(&rows, n);
    let ssim = ssim.iter().sum::<f64>() / n as f64;
    let weight = f64::from(weight);
    LossValue { loss: (1.0 - weight) * l1.loss + weight * (1.0 - ssim), mse: l1.mse }
}
