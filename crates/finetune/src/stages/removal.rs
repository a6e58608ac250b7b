//! Removal effects: how the views change when one Gaussian is left out.

use gs_model::{Camera, Scene};
use multiversion::multiversion;
use rayon::prelude::*;

use super::blend::{LANES, TilePixels, live, sum_lanes};
use super::gather::gather;
use super::project::{Splat, View};
use super::{T_STOP, TILE, gate};
use crate::forward::Forward;
use crate::options::RenderOptions;

/// For each Gaussian, the sum over all pixels and channels of `cameras` of the squared change when it
/// alone is left out and what lies behind it shows instead.
///
/// A Gaussian of large blending weights counts little here if what is behind it looks the same. Costs
/// about two forward passes per camera; views are summed in the order given. The pixels at which
/// blending stops stay those of the whole scene.
#[must_use]
pub fn removal_effects(scene: &Scene, cameras: &[Camera]) -> Vec<f32> {
    let n = scene.len();
    let mut out = vec![0.0; n];
    let mut f = Forward::default();
    let (mut records, mut sums) = (Vec::new(), Vec::new());
    for camera in cameras {
        let view = View::new(camera, &RenderOptions::default());
        f.run(scene, &view);
        effects(&view, &f, &mut records);
        gather::<1>(&f.lists, &records, n, &mut sums);
        for (o, &[s]) in out.iter_mut().zip(&sums) {
            *o += s;
        }
    }
    out
}

/// Fills `records`, one per slot in tile order: the sum over the tile's pixels.
fn effects(view: &View, f: &Forward, records: &mut Vec<[f32; 1]>) {
    records.clear();
    records.resize(f.lists.ids.len(), [0.0]);
    f.lists.split_mut(records).into_par_iter().enumerate().for_each(|(k, records)| {
        effects_tile(EffectsTile {
            view,
            splats: &f.projected.splats,
            ids: &f.lists.of(k)[..f.last[k] as usize],
            tile: view.tile_at(k),
            pixels: &f.tiles[k],
            records,
        });
    });
}

/// A row of pixels: transmittance, and the light of this and all later splats and the background.
#[derive(Clone, Copy)]
struct Row {
    t: [f32; LANES],
    rest: [[f32; LANES]; 3],
}

/// One splat on one row of pixels.
#[inline(always)]
fn effect_row(s: &Splat, dx: &[f32; LANES], dy: f32, row: &mut Row, sum: &mut [f32; LANES]) {
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
            sum[l] += change * change;
        }
    }
}

struct EffectsTile<'a> {
    view: &'a View,
    splats: &'a [Splat],
    ids: &'a [u32],
    tile: (u32, u32),
    pixels: &'a TilePixels,
    records: &'a mut [[f32; 1]],
}

impl EffectsTile<'_> {
    /// The rows before the first splat. Pixels beyond the image's edge begin as stopped.
    #[inline(always)]
    fn rows(&self) -> [Row; LANES] {
        let Self { view, pixels: p, tile: (tx, _), .. } = self;
        let mut rows = [Row { t: [1.0; LANES], rest: [[0.0; LANES]; 3] }; LANES];
        for (y, row) in rows.iter_mut().enumerate() {
            for l in 0..LANES {
                let t = p.t[y][l].abs();
                let shown = [p.red[y][l], p.green[y][l], p.blue[y][l]];
                for (c, rest) in row.rest.iter_mut().enumerate() {
                    rest[l] = shown[c] + t * view.background[c];
                }
            }
            for t in &mut row.t[(view.width - tx * TILE).min(TILE) as usize..] {
                *t = -1.0;
            }
        }
        rows
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn effects_tile(tile: EffectsTile<'_>) {
    let mut state = tile.rows();
    let EffectsTile { view, splats, ids, tile: (tx, ty), records, .. } = tile;
    let y0 = ty * TILE;
    let height = (view.height - y0).min(TILE);
    let mut row_live = [true; LANES];
    const BATCH: usize = 32;
    for (list, records) in ids.chunks(BATCH).zip(records.chunks_mut(BATCH)) {
        for (&i, record) in list.iter().zip(records) {
            let s = splats[i as usize];
            let mut dx = [0.0f32; LANES];
            for (l, d) in dx.iter_mut().enumerate() {
                *d = s.x - ((tx * TILE + l as u32) as f32 + 0.5);
            }
            let mut sum = [0.0f32; LANES];
            let first = s.row0.max(y0) - y0;
            let end = (s.row1 - y0.min(s.row1)).min(height);
            for y in first..end {
                let y = y as usize;
                if row_live[y] {
                    let dy = s.y - ((y0 + y as u32) as f32 + 0.5);
                    effect_row(&s, &dx, dy, &mut state[y], &mut sum);
                }
            }
            *record = [sum_lanes(&sum)];
        }
        for (alive, row) in row_live.iter_mut().zip(&state).take(height as usize) {
            *alive = *alive && live(&row.t) != 0;
        }
        if !row_live[..height as usize].contains(&true) {
            break;
        }
    }
}
