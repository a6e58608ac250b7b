//! Stage `loss`: the value of the loss and its gradient per pixel.

use multiversion::multiversion;
use rayon::prelude::*;

use super::blend::{LANES, TilePixels};
use super::blend_adjoint::TileGradient;
use super::project::RenderView;
use super::*;
use crate::metrics::taps;
use crate::options::Loss;

/// Radius of the SSIM window.
pub(crate) const RADIUS: usize = 5;
const TAPS: usize = 2 * RADIUS + 1;
const C1: f32 = 1.0e-4;
const C2: f32 = 9.0e-4;

/// The loss of one view.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ViewLoss {
    /// The loss that the gradients are of.
    pub loss: f64,
    /// Mean squared error of the clamped image, for the PSNR.
    pub mse: f64,
}

impl ViewLoss {
    /// PSNR in dB, at most 100.
    #[must_use]
    pub fn psnr(&self) -> f64 {
        (-10.0 * libm::log10(self.mse)).min(100.0)
    }
}

/// The rendered tiles over the background, as three planes.
pub(crate) fn to_planes(view: &RenderView, tiles: &[TilePixels], planes: &mut Vec<f32>) {
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
pub(crate) fn to_tiles(view: &RenderView, planes: &[f32], tiles: &mut Vec<TileGradient>) {
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

/// The terms of the loss that are sums over pixels, over three planes of `n` values in all.
#[derive(Clone, Copy)]
struct PerPixel {
    l1: f32,
    mse: f32,
    n: f32,
}

impl PerPixel {
    fn new(loss: Loss, n: usize) -> Self {
        Self { l1: loss.l1, mse: loss.mse, n: n as f32 }
    }

    /// The gradient with respect to `x`.
    #[inline(always)]
    fn gradient(self, d: f32) -> f32 {
        let sign = if d > 0.0 { self.l1 / self.n } else { -self.l1 / self.n };
        let l1 = if d == 0.0 { 0.0 } else { sign };
        2.0 * self.mse / self.n * d + l1
    }

    /// The sums over a row: the weighted errors, and the squared error of the clamped image.
    fn sums(self, x: &[f32], y: &[f32]) -> (f64, f64) {
        let (l1, mse) = (f64::from(self.l1), f64::from(self.mse));
        let (mut sum, mut clamped) = (0.0, 0.0);
        for (&x, &y) in x.iter().zip(y) {
            let d = f64::from(x - y);
            sum += l1 * d.abs() + mse * d * d;
            clamped += clamped_error2(x, y);
        }
        (sum, clamped)
    }
}

/// The loss without SSIM over all values; `gradient` becomes its gradient with respect to `x`.
pub(crate) fn per_pixel(
    w: usize,
    loss: Loss,
    [x, y]: [&[f32]; 2],
    gradient: &mut Vec<f32>,
) -> ViewLoss {
    gradient.resize(x.len(), 0.0);
    let terms = PerPixel::new(loss, x.len());
    let rows = gradient.par_chunks_mut(w).zip(x.par_chunks(w)).zip(y.par_chunks(w));
    let rows: Vec<(f64, f64)> = rows
        .map(|((g, x), y)| {
            for ((g, &x), &y) in g.iter_mut().zip(x).zip(y) {
                *g = terms.gradient(x - y);
            }
            terms.sums(x, y)
        })
        .collect();
    total(&rows, x.len())
}

fn total(rows: &[(f64, f64)], n: usize) -> ViewLoss {
    let loss: f64 = rows.iter().map(|r| r.0).sum();
    let mse: f64 = rows.iter().map(|r| r.1).sum();
    ViewLoss { loss: loss / n as f64, mse: mse / n as f64 }
}

/// Buffers of a loss with SSIM.
#[derive(Default)]
pub(crate) struct SsimScratch {
    /// Per row: x, y, x^2 + y^2, x y blurred along the row.
    moments: Vec<f32>,
    /// Per row: the partials with respect to the mean, the variance and the covariance,
    /// blurred along the row.
    partials: Vec<f32>,
}

fn window() -> [f32; TAPS] {
    taps().map(|t| t as f32)
}

/// The sum of equally long rows, each times its tap, in registers. Taps at equal distances are equal.
#[inline(always)]
fn weigh(taps: &[f32; TAPS], rows: [&[f32]; TAPS], out: &mut [f32]) {
    let n = out.len();
    for row in rows {
        assert_eq!(row.len(), n);
    }
    for (i, o) in out.iter_mut().enumerate() {
        let mut sum = taps[RADIUS] * rows[RADIUS][i];
        for k in 0..RADIUS {
            sum += taps[k] * (rows[k][i] + rows[TAPS - 1 - k][i]);
        }
        *o = sum;
    }
}

/// One row convolved with the window; `padded` holds it with [`RADIUS`] zeros either side.
#[inline(always)]
fn along(taps: &[f32; TAPS], padded: &[f32], out: &mut [f32]) {
    let mut shifted: [&[f32]; TAPS] = [&[]; TAPS];
    for (k, row) in shifted.iter_mut().enumerate() {
        *row = &padded[k..k + out.len()];
    }
    weigh(taps, shifted, out);
}

/// A row of one plane of three, each of `h` rows of `w` pixels, and what is known of each of their rows.
struct PlaneRow<'a> {
    w: usize,
    h: usize,
    row: usize,
    known: &'a [f32],
}

impl PlaneRow<'_> {
    /// The column blur of `Q` quantities per pixel.
    #[inline(always)]
    fn blurred<const Q: usize>(&self, taps: &[f32; TAPS]) -> [Vec<f32>; Q] {
        let (w, y) = (self.w, self.row % self.h);
        // Above and below the picture.
        let outside = vec![0.0f32; w];
        let mut out = [(); Q].map(|()| vec![0.0f32; w]);
        // Loops instead of closures: those would not be compiled for the caller's processor.
        for (q, out) in out.iter_mut().enumerate() {
            let mut rows: [&[f32]; TAPS] = [&outside; TAPS];
            for (k, row) in rows.iter_mut().enumerate() {
                if (RADIUS..self.h + RADIUS).contains(&(y + k)) {
                    let at = ((self.row + k - RADIUS) * Q + q) * w;
                    *row = &self.known[at..at + w];
                }
            }
            weigh(taps, rows, out);
        }
        out
    }
}

/// x, y, x^2 + y^2 and x y, blurred along a row.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn row_moments(x: &[f32], y: &[f32], out: &mut [f32]) {
    let (w, taps) = (x.len(), window());
    let mut padded = vec![0.0f32; w + 2 * RADIUS];
    for (q, out) in out.chunks_exact_mut(w).enumerate() {
        for ((p, &x), &y) in padded[RADIUS..].iter_mut().zip(x).zip(y) {
            *p = match q {
                0 => x,
                1 => y,
                2 => x * x + y * y,
                _ => x * y,
            };
        }
        along(&taps, &padded, out);
    }
}

/// SSIM of a row from its moments, and its partials, blurred along the row. Returns the sum of SSIM.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn row_ssim(moments: PlaneRow<'_>, out: &mut [f32]) -> f64 {
    let (w, taps) = (moments.w, window());
    let [mx, my, squares, exy] = moments.blurred::<4>(&taps);
    let mut padded = [(); 3].map(|()| vec![0.0f32; w + 2 * RADIUS]);
    let mut values = vec![0.0f32; w];
    let [pm, pv, pc] = &mut padded;
    let (pm, pv, pc) = (&mut pm[RADIUS..][..w], &mut pv[RADIUS..][..w], &mut pc[RADIUS..][..w]);
    for i in 0..w {
        let (ux, uy) = (mx[i], my[i]);
        let (uxx, uyy, uxy) = (ux * ux, uy * uy, ux * uy);
        let a1 = 2.0 * uxy + C1;
        let a2 = 2.0 * (exy[i] - uxy) + C2;
        let b1 = uxx + uyy + C1;
        let b2 = squares[i] - (uxx + uyy) + C2;
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
    for (p, out) in padded.iter().zip(out.chunks_exact_mut(w)) {
        along(&taps, p, out);
    }
    values.iter().map(|&v| f64::from(v)).sum()
}

/// The gradient of the whole loss in a row, from the partials. Returns the sums without SSIM.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn row_gradient(
    partials: PlaneRow<'_>,
    loss: Loss,
    x: &[f32],
    y: &[f32],
    out: &mut [f32],
) -> (f64, f64) {
    let terms = PerPixel::new(loss, 3 * partials.w * partials.h);
    let scale = loss.ssim / terms.n;
    let [pm, pv, pc] = partials.blurred::<3>(&window());
    for i in 0..partials.w {
        let s = pm[i] + 2.0 * x[i] * pv[i] + y[i] * pc[i];
        out[i] = terms.gradient(x[i] - y[i]) - scale * s;
    }
    terms.sums(x, y)
}

/// The loss over three planes of rows of `w` pixels; `gradient` becomes its gradient with respect to `x`. The window of
/// SSIM is 11x11, sigma 1.5, zero padding.
pub(crate) fn with_ssim(
    w: usize,
    loss: Loss,
    [x, y]: [&[f32]; 2],
    scratch: &mut SsimScratch,
    gradient: &mut Vec<f32>,
) -> ViewLoss {
    let n = x.len();
    let h = n / (3 * w);
    gradient.resize(n, 0.0);
    scratch.moments.resize(4 * n, 0.0);
    scratch.partials.resize(3 * n, 0.0);
    let moments = scratch.moments.par_chunks_mut(4 * w).zip(x.par_chunks(w)).zip(y.par_chunks(w));
    moments.for_each(|((out, x), y)| row_moments(x, y, out));
    let of = |row, known| PlaneRow { w, h, row, known };
    let moments = &scratch.moments;
    let ssim = scratch.partials.par_chunks_mut(3 * w).enumerate();
    let ssim: Vec<f64> = ssim.map(|(row, out)| row_ssim(of(row, moments), out)).collect();
    let partials = &scratch.partials;
    let rows = gradient.par_chunks_mut(w).zip(x.par_chunks(w)).zip(y.par_chunks(w)).enumerate();
    let rows: Vec<(f64, f64)> =
        rows.map(|(row, ((out, x), y))| row_gradient(of(row, partials), loss, x, y, out)).collect();
    let mut all = total(&rows, n);
    all.loss += f64::from(loss.ssim) * (1.0 - ssim.iter().sum::<f64>() / n as f64);
    all
}
