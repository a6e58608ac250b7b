//! Removal effects: how the views change when one Gaussian is left out.

use gs_model::{Camera, Scene};
use multiversion::multiversion;
use rayon::prelude::*;

use super::blend::{LANES, TilePixels, TileSplats, still_live, sum_lanes};
use super::gather::gather;
use super::project::{RenderView, Splat};
use super::tiles::BATCH;
use super::{T_STOP, gate};
use crate::forward::Forward;
use crate::image::Image;
use crate::options::RenderOptions;

/// What leaving out each Gaussian changes in a set of views.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Removal {
    /// Removal effects: the sum over all pixels and channels of the squared change when this Gaussian
    /// alone is left out and what lies behind it shows instead.
    pub effects: Vec<f32>,
    /// As [`crate::Visibility::squared`], from views of full size.
    pub squared: Vec<f32>,
}

/// The removal effect of each Gaussian in the views of `cameras`.
///
/// The removal effect of a Gaussian of large blending weights is small if what is behind it looks the same.
/// Costs about two forward passes per camera; views are summed in the order given. The pixels at which
/// blending stops stay those of the whole scene. `seen` gets the render of each camera, as [`crate::render`] makes it.
#[must_use]
pub fn removal(scene: &Scene, cameras: &[Camera], mut seen: impl FnMut(Image)) -> Removal {
    let n = scene.len();
    let mut out = Removal { effects: vec![0.0; n], squared: vec![0.0; n] };
    let mut f = Forward::default();
    let (mut records, mut sums) = (Vec::new(), Vec::new());
    for camera in cameras {
        let view = RenderView::new(camera, &RenderOptions::default());
        f.run(scene, &view);
        effects(&view, &f, &mut records);
        gather(&f.lists, &records, f.order.len(), &mut sums, |_, _| ());
        for (i, &[effect, squared]) in f.projected.gaussians().zip(&sums) {
            out.effects[i] += effect;
            out.squared[i] += squared;
        }
        seen(f.image(&view));
    }
    out
}

/// Fills `records`, one per slot in tile order: the sum over the tile's pixels.
fn effects(view: &RenderView, f: &Forward, records: &mut Vec<[f32; 2]>) {
    records.clear();
    records.resize(f.lists.ids.len(), [0.0; 2]);
    f.lists.split_mut(records).into_par_iter().enumerate().for_each(|(k, records)| {
        let tile = TileSplats::new(view, &f.projected.seen.splats, &f.lists, k);
        effects_tile(tile, &f.tiles[k], view.background, records);
    });
}

/// A row of pixels: transmittance, and the light of this and all later splats and the background.
#[derive(Clone, Copy)]
struct Row {
    t: [f32; LANES],
    rest: [[f32; LANES]; 3],
}

/// Sums over rows of pixels: squared changes and squared blending weights.
#[derive(Clone, Copy, Default)]
struct Sums {
    removal: [f32; LANES],
    squared: [f32; LANES],
}

/// One splat on one row of pixels.
#[inline(always)]
fn effect_row(s: &Splat, dx: &[f32; LANES], dy: f32, row: &mut Row, sums: &mut Sums) {
    let qy = s.q * dy;
    let e1 = s.r * dy;
    let colour = [s.red, s.green, s.blue];
    for l in 0..LANES {
        let px = s.p * dx[l];
        let step = gate(px + qy, e1, s.cut, s.opacity, T_STOP, row.t[l]);
        row.t[l] = step.t;
        let alpha = if step.counts { step.alpha } else { 0.0 };
        let clear = 1.0 - alpha;
        for (rest, colour) in row.rest.iter_mut().zip(colour) {
            let shown = step.w * colour;
            let behind = rest[l] - shown;
            rest[l] = behind;
            let change = alpha * behind / clear - shown;
            sums.removal[l] += change * change;
        }
        sums.squared[l] += step.w * step.w;
    }
}

/// The rows before the first splat.
#[inline(always)]
fn rows(tile: &TileSplats<'_>, p: &TilePixels, background: [f32; 3]) -> [Row; LANES] {
    let start = tile.clear();
    std::array::from_fn(|y| {
        let mut rest = [p.red[y], p.green[y], p.blue[y]];
        for (shown, background) in rest.iter_mut().zip(background) {
            for (shown, t) in shown.iter_mut().zip(&p.t[y]) {
                *shown += t.abs() * background;
            }
        }
        Row { t: start[y], rest }
    })
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn effects_tile(
    tile: TileSplats<'_>,
    pixels: &TilePixels,
    background: [f32; 3],
    records: &mut [[f32; 2]],
) {
    let mut state = rows(&tile, pixels, background);
    let mut row_live = [true; LANES];
    let mut loaded = [Splat::default(); BATCH];
    for (list, records) in tile.ids.chunks(BATCH).zip(records.chunks_mut(BATCH)) {
        for (s, record) in tile.load(list, &mut loaded).iter().zip(records) {
            let dx = tile.dx(s);
            let mut sums = Sums::default();
            for y in tile.reached(s) {
                if row_live[y] {
                    effect_row(s, &dx, tile.dy(s, y), &mut state[y], &mut sums);
                }
            }
            *record = [sum_lanes(&sums.removal), sum_lanes(&sums.squared)];
        }
        if !still_live(&mut row_live[..tile.rows], state.iter().map(|row| &row.t)) {
            break;
        }
    }
}
