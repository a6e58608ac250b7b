//! Stage `project`: one [`Splat`] per (Gaussian, view), its tile box and its depth key.

use std::ops::Range;

use gs_model::{Camera, Scene};
use multiversion::multiversion;
use rayon::prelude::*;

use super::*;
use crate::options::{Profile, RenderOptions};

/// The place of a Gaussian that the view does not show. On a device: its depth key, which sorts last.
pub(crate) const CULLED: u32 = u32::MAX;

/// A projected Gaussian. Twelve words, three `vec4` in WGSL.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub(crate) struct Splat {
    /// Mean, pixels.
    pub(crate) x: f32,
    pub(crate) y: f32,
    /// Cholesky factor of half the conic, see `Shape`.
    pub(crate) p: f32,
    pub(crate) q: f32,
    pub(crate) r: f32,
    /// ln(255 opacity): the largest sigma that still counts.
    pub(crate) cut: f32,
    pub(crate) opacity: f32,
    /// First pixel row that the splat reaches.
    pub(crate) row0: u32,
    pub(crate) red: f32,
    pub(crate) green: f32,
    pub(crate) blue: f32,
    /// One past the last pixel row that the splat reaches.
    pub(crate) row1: u32,
}

/// Tiles that a splat may touch: a box, `x0 <= tx < x1`, `y0 <= ty < y1`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
pub(crate) struct TileBox {
    pub(crate) x0: u32,
    pub(crate) x1: u32,
    pub(crate) y0: u32,
    pub(crate) y1: u32,
}

/// A camera and the options, in the form that the stages use.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RenderView {
    pub(crate) lens: Lens,
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) tiles_x: u32,
    pub(crate) tiles_y: u32,
    pub(crate) background: [f32; 3],
    /// [`Profile::Reference`].
    pub(crate) reference: bool,
}

impl RenderView {
    pub(crate) fn new(camera: &Camera, options: &RenderOptions) -> Self {
        Self {
            lens: Lens::new(camera),
            width: camera.width,
            height: camera.height,
            tiles_x: camera.width.div_ceil(TILE),
            tiles_y: camera.height.div_ceil(TILE),
            background: options.background,
            reference: options.profile == Profile::Reference,
        }
    }

    /// A part of the view. Gaussians have the same splats in it as in the whole.
    pub(crate) fn window(&self, x: Range<u32>, y: Range<u32>) -> Self {
        let mut lens = self.lens;
        lens.cx -= x.start as f32;
        lens.cy -= y.start as f32;
        let (width, height) = (x.end - x.start, y.end - y.start);
        let (tiles_x, tiles_y) = (width.div_ceil(TILE), height.div_ceil(TILE));
        Self { lens, width, height, tiles_x, tiles_y, ..*self }
    }

    pub(crate) fn tiles(&self) -> usize {
        self.tiles_x as usize * self.tiles_y as usize
    }

    /// Rows of the rotation, and the camera's position.
    #[cfg(feature = "gpu")]
    pub(crate) fn pose(&self) -> ([[f32; 3]; 3], [f32; 3]) {
        let a = |v: V3| [v.x, v.y, v.z];
        ([self.lens.w0, self.lens.w1, self.lens.w2].map(a), a(self.lens.eye))
    }

    pub(crate) fn tile_at(&self, tile: usize) -> (u32, u32) {
        (tile as u32 % self.tiles_x, tile as u32 / self.tiles_x)
    }
}

/// Index range of the pixels (or tiles) whose centres lie in `centre` +- `half`, within
/// `0..limit`.
#[inline]
fn span(centre: F, half: F, limit: u32) -> (u32, u32) {
    let first = (centre - half - 0.5).ceil().max(0.0);
    let last = (centre + half - 0.5).floor() + 1.0;
    // Float-to-integer casts saturate, and NaN becomes 0.
    ((first as u32).min(limit), (last.max(0.0) as u32).min(limit))
}

/// Gaussians that are projected together.
const LANES: usize = 16;

type Lanes = [F; LANES];

/// A splat ends, in pixels, at most so many times its greatest scale over the depth and the focal length, and so many
/// pixels beyond that, from its mean: where its opacity is 1/255, with room for rounding.
const REACH: F = 3.4;
const EDGE: F = 2.5;

/// Where the image shows up to [`LANES`] Gaussians, and in which shape. [`finish`] makes splats of it.
#[derive(Default)]
struct Shapes {
    x: Lanes,
    y: Lanes,
    z: Lanes,
    p: Lanes,
    q: Lanes,
    r: Lanes,
    cov_xx: Lanes,
    cov_yy: Lanes,
    det: Lanes,
    opacity: Lanes,
    cut: Lanes,
    direction: [Lanes; 3],
    /// Not 0 where the Gaussian may be seen. An integer, so that the loop is vectorised.
    visible: [u32; LANES],
}

impl Shapes {
    /// Of up to [`LANES`] Gaussians, from `first` on. The loop has no branches.
    #[inline(always)]
    fn of(view: &RenderView, scene: &Scene, first: usize, count: usize) -> Self {
        let mut mean = [[0.0; LANES]; 3];
        let mut rotation = [[0.0; LANES]; 4];
        let mut log_scale = [[0.0; LANES]; 3];
        let mut logit = [0.0; LANES];
        let count = count.min(LANES);
        for l in 0..count {
            (0..3).for_each(|k| mean[k][l] = scene.means[first + l][k]);
            (0..4).for_each(|k| rotation[k][l] = scene.rotations[first + l][k]);
            (0..3).for_each(|k| log_scale[k][l] = scene.log_scales[first + l][k]);
            logit[l] = scene.opacity_logits[first + l];
        }
        let mut out = Self::default();
        for l in 0..LANES {
            let f = Frame::new(
                &view.lens,
                [mean[0][l], mean[1][l], mean[2][l]],
                [rotation[0][l], rotation[1][l], rotation[2][l], rotation[3][l]],
                [log_scale[0][l], log_scale[1][l], log_scale[2][l]],
            );
            let compensation = select(1.0, compensation_of(f.shape), scene.antialiased);
            let opacity = sigmoid(logit[l]) * compensation;
            let o255 = opacity * 255.0;
            let x = view.lens.fx * (f.m.x * f.inv_z) + view.lens.cx;
            let y = view.lens.fy * (f.m.y * f.inv_z) + view.lens.cy;
            let Shape { p, q, r, cov_xx, cov_yy, .. } = f.shape;
            let sane = finite(x) & finite(y) & finite(p) & finite(q) & finite(r);
            let (d, _) = direction(f.from_eye);
            (out.x[l], out.y[l], out.z[l]) = (x, y, f.m.z);
            (out.p[l], out.q[l], out.r[l]) = (p, q, r);
            (out.cov_xx[l], out.cov_yy[l]) = (cov_xx, cov_yy);
            out.det[l] = f.shape.det_over_m * f.shape.m;
            (out.opacity[l], out.cut[l]) = (opacity, ln_polynomial(o255));
            (out.direction[0][l], out.direction[1][l], out.direction[2][l]) = (d.x, d.y, d.z);
            // NaN is culled too.
            out.visible[l] = u32::from((o255 > 1.0) & f.in_front & sane);
        }
        out.visible[count..].fill(0);
        out
    }
}

/// False if all of up to [`LANES`] Gaussians, from `first` on, lie behind the camera or beside the image. It reads half
/// of what [`Shapes::of`] reads.
#[inline(always)]
fn may_be_seen(view: &RenderView, scene: &Scene, first: usize, count: usize) -> bool {
    let lens = &view.lens;
    let slope = |lo: F, hi: F| sqrt(1.0 + max(lo * lo, hi * hi));
    let [reach_x, reach_y] = [
        REACH * lens.fx * slope(lens.lo_x, lens.hi_x),
        REACH * lens.fy * slope(lens.lo_y, lens.hi_y),
    ];
    let (right, below) = (view.width as F - lens.cx, view.height as F - lens.cy);
    let mut seen = [0; LANES];
    for l in 0..count.min(LANES) {
        let [x, y, z] = scene.means[first + l];
        let [a, b, c] = scene.log_scales[first + l];
        let from_eye = sub3(V3(x, y, z), lens.eye);
        let z = dot3(lens.w2, from_eye);
        let (x, y) = (lens.fx * dot3(lens.w0, from_eye), lens.fy * dot3(lens.w1, from_eye));
        let scale = exp_polynomial(clamp(max(max(a, b), c), -LOG_SCALE_MAX, LOG_SCALE_MAX));
        let (half_x, half_y) = (reach_x * scale + EDGE * z, reach_y * scale + EDGE * z);
        let beside = (x + half_x < -lens.cx * z)
            | (x - half_x > right * z)
            | (y + half_y < -lens.cy * z)
            | (y - half_y > below * z);
        seen[l] = u32::from((z > lens.near) & !beside);
    }
    seen != [0; LANES]
}

/// The splat of Gaussian `i`, which is in lane `l`; `None` if it cannot be seen.
#[inline(always)]
fn finish(
    view: &RenderView,
    scene: &Scene,
    i: usize,
    shapes: &Shapes,
    l: usize,
) -> Option<(Splat, TileBox, u32)> {
    if shapes.visible[l] == 0 {
        return None;
    }
    let (x, y, cut, opacity) = (shapes.x[l], shapes.y[l], shapes.cut[l], shapes.opacity[l]);
    let (cov_xx, cov_yy) = (shapes.cov_xx[l], shapes.cov_yy[l]);
    let (cols, rows) = if view.reference {
        let half = reference_radius(cov_xx, cov_yy, shapes.det[l]);
        let x_span = square_tiles(x, half, view.tiles_x);
        let y_span = square_tiles(y, half, view.tiles_y);
        let pixels = |s: (u32, u32), limit: u32| (s.0 * TILE, (s.1 * TILE).min(limit));
        (pixels(x_span, view.width), pixels(y_span, view.height))
    } else {
        // The exact box of the ellipse, widened by more than the rounding error.
        let t = 2.0 * cut * 1.0001;
        let half_x = sqrt(t * cov_xx) + 0.01;
        let half_y = sqrt(t * cov_yy) + 0.01;
        (span(x, half_x, view.width), span(y, half_y, view.height))
    };
    if !(cols.0 < cols.1 && rows.0 < rows.1) {
        return None;
    }
    let [dx, dy, dz] = shapes.direction;
    let basis = sh_basis(scene.sh_degree, V3(dx[l], dy[l], dz[l]));
    let raw = raw_colour(&basis, scene.sh_of(i));
    if !(finite(raw[0]) & finite(raw[1]) & finite(raw[2])) {
        return None;
    }
    let splat = Splat {
        x,
        y,
        p: shapes.p[l],
        q: shapes.q[l],
        r: shapes.r[l],
        cut,
        opacity,
        row0: rows.0,
        red: max(raw[0], 0.0),
        green: max(raw[1], 0.0),
        blue: max(raw[2], 0.0),
        row1: rows.1,
    };
    let tiles = TileBox {
        x0: cols.0 / TILE,
        x1: cols.1.div_ceil(TILE),
        y0: rows.0 / TILE,
        y1: rows.1.div_ceil(TILE),
    };
    Some((splat, tiles, shapes.z[l].to_bits()))
}

/// Projects up to [`LANES`] Gaussians, from `first` on. `places` gets their places in `out`.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx2"))]
fn project_lanes(
    view: &RenderView,
    scene: &Scene,
    first: usize,
    places: &mut [u32],
    out: &mut Splats,
) {
    if !view.reference && !may_be_seen(view, scene, first, places.len()) {
        places.fill(CULLED);
        return;
    }
    let shapes = Shapes::of(view, scene, first, places.len());
    for (l, place) in places.iter_mut().enumerate() {
        *place = CULLED;
        if let Some((splat, tiles, key)) = finish(view, scene, first + l, &shapes, l) {
            *place = out.keys.len() as u32;
            out.splats.push(splat);
            out.boxes.push(tiles);
            out.keys.push(key);
        }
    }
}

/// Inria's radius: three standard deviations of the major axis, rounded up.
fn reference_radius(cov_xx: F, cov_yy: F, det: F) -> F {
    let mid = 0.5 * (cov_xx + cov_yy);
    let root = sqrt(max(mid * mid - det, 0.1));
    (3.0 * sqrt(mid + root)).ceil()
}

/// Inria's tile range of a square, with its truncation towards zero.
fn square_tiles(centre: F, half: F, limit: u32) -> (u32, u32) {
    let tile = TILE as f32;
    // Inria's pixel centres are at integers, so its mean is smaller by one half.
    let c = centre - 0.5;
    let first = ((c - half) / tile).max(0.0) as u32;
    let last = ((c + half + tile - 1.0) / tile).max(0.0) as u32;
    (first.min(limit), last.min(limit))
}

/// The splats of the Gaussians that the view may show, in the order of the scene. The later stages know a splat by its
/// place here, so their time and memory follow what is seen.
#[derive(Default)]
pub(crate) struct Splats {
    pub(crate) splats: Vec<Splat>,
    pub(crate) boxes: Vec<TileBox>,
    pub(crate) keys: Vec<u32>,
}

impl Splats {
    /// Puts the parts one behind the other.
    fn join(&mut self, parts: &[Self]) {
        join(parts, |part| &part.splats, &mut self.splats);
        join(parts, |part| &part.boxes, &mut self.boxes);
        join(parts, |part| &part.keys, &mut self.keys);
    }
}

fn join<T: Copy + Default + Send + Sync>(
    parts: &[Splats],
    of: impl Fn(&Splats) -> &[T] + Sync,
    out: &mut Vec<T>,
) {
    out.resize(parts.iter().map(|part| of(part).len()).sum(), T::default());
    let mut rest = out.as_mut_slice();
    let mut to = Vec::with_capacity(parts.len());
    for part in parts {
        let (head, tail) = rest.split_at_mut(of(part).len());
        to.push(head);
        rest = tail;
    }
    to.into_par_iter().zip(parts).for_each(|(to, part)| to.copy_from_slice(of(part)));
}

/// Output of the stage.
#[derive(Default)]
pub(crate) struct ProjectedSplat {
    pub(crate) seen: Splats,
    /// For each Gaussian of the scene the place of its splat, or [`CULLED`].
    pub(crate) places: Vec<u32>,
}

impl ProjectedSplat {
    /// The place of the splat of Gaussian `i`, if it has one.
    #[inline(always)]
    pub(crate) fn place(&self, i: usize) -> Option<usize> {
        self.places.get(i).filter(|&&place| place != CULLED).map(|&place| place as usize)
    }

    /// The Gaussians that have splats; the n-th has the n-th splat.
    pub(crate) fn gaussians(&self) -> impl Iterator<Item = usize> {
        let all = self.places.iter().enumerate();
        all.filter(|&(_, &place)| place != CULLED).map(|(i, _)| i)
    }

    /// What belongs to the splats, as an entry per Gaussian; `none` for those without a splat.
    #[cfg(all(test, feature = "gpu"))]
    pub(crate) fn spread<T: Copy>(&self, of_splats: &[T], none: T) -> Vec<T> {
        (0..self.places.len())
            .map(|i| self.place(i).map_or(none, |place| of_splats[place]))
            .collect()
    }
}

/// Projects every Gaussian of `scene`.
pub(crate) fn project(view: &RenderView, scene: &Scene, out: &mut ProjectedSplat) {
    const CHUNK: usize = 1024;
    // Arrays of inconsistent lengths: nothing can be drawn.
    let n = if scene.check_shape().is_ok() { scene.len() } else { 0 };
    out.places.resize(n, CULLED);
    let part = |(c, places): (usize, &mut [u32])| {
        let mut part = Splats::default();
        for (k, places) in places.chunks_mut(LANES).enumerate() {
            project_lanes(view, scene, c * CHUNK + k * LANES, places, &mut part);
        }
        part
    };
    let chunks = out.places.par_chunks_mut(CHUNK).enumerate().with_max_len(4);
    let parts: Vec<_> = chunks.map(part).collect();
    out.seen.join(&parts);
    let lengths = parts.iter().map(|part| part.keys.len() as u32);
    let starts: Vec<u32> =
        lengths.scan(0, |sum, n| Some(std::mem::replace(sum, *sum + n))).collect();
    out.places.par_chunks_mut(CHUNK).zip(starts).for_each(|(places, start)| {
        places.iter_mut().filter(|place| **place != CULLED).for_each(|place| *place += start);
    });
}

#[cfg(test)]
#[allow(clippy::disallowed_methods, reason = "a test")]
mod tests {
    use super::*;

    #[test]
    fn what_is_left_out_without_its_shape_cannot_be_seen() {
        let mut scene = testing::trained_like(4000, 0, &mut testing::Rng::seeded(3));
        let mut rng = testing::Rng::seeded(8);
        for (mean, scale) in scene.means.iter_mut().zip(&mut scene.log_scales) {
            mean.iter_mut().for_each(|x| *x *= 3.0);
            scale.iter_mut().for_each(|s| *s += rng.range_f32(-1.0, 2.0));
        }
        scene.opacity_logits.fill(9.0);
        let (mut left, mut kept) = (0, 0);
        for k in 0..8 {
            let eye = [0, 1, 2].map(|_| f64::from(rng.signed()));
            let target = [0, 1, 2].map(|_| 2.0 * f64::from(rng.signed()));
            let up = [0.0, 1.0, 0.0];
            let camera = Camera::looking_at(k.to_string(), eye, target, up, [40, 30], 30.0);
            let view = RenderView::new(&camera, &RenderOptions::default());
            for i in 0..scene.len() {
                let shape = Shapes::of(&view, &scene, i, 1);
                let seen = finish(&view, &scene, i, &shape, 0).is_some();
                let may = may_be_seen(&view, &scene, i, 1);
                assert!(may || !seen, "{i}");
                (left, kept) = (left + u32::from(!may), kept + u32::from(seen));
            }
        }
        assert!(left > 5000 && kept > 2000, "{left} {kept}");
    }

    /// sigma of rotated needles out to their tips, in f32: by the factor, and by the conic from
    /// `A C - B^2` as every published rasterizer has it, both against f64.
    #[test]
    fn the_factor_is_more_accurate_than_the_conic() {
        let mut rng = testing::Rng::seeded(8);
        let mut r = |low: f64, high: f64| rng.range(low, high);
        let (mut ours, mut naive, mut not_positive) = (Vec::new(), Vec::new(), 0);
        for _ in 0..20_000 {
            // Rows of V for a needle of up to 3000 pixels and a width far below one.
            let (angle, long) = (r(0.0, 6.3), libm::exp(r(0.0, 8.0)));
            let v0 = V3((long * angle.cos()) as f32, r(-0.01, 0.01) as f32, 0.0);
            let v1 = V3((long * angle.sin()) as f32, r(-0.01, 0.01) as f32, 0.0);
            let s = shape_of(v0, v1, BLUR);
            assert!(s.det_over_m * s.m >= 0.999 * BLUR * BLUR, "below the blur's determinant");
            let wide = |v: V3| [v.x, v.y, v.z].map(f64::from);
            let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
            let (w0, w1, blur) = (wide(v0), wide(v1), f64::from(BLUR));
            let (a, b, c) = (dot(w0, w0) + blur, dot(w0, w1), dot(w1, w1) + blur);
            let cross = w0[0] * w1[1] - w0[1] * w1[0];
            let det = cross * cross + blur * (a - blur + c - blur) + blur * blur;
            // A pixel along the needle where sigma is about 2, and beside it by half a pixel.
            let along = 2.0 * r(-1.0, 1.0) * long;
            let (dx, dy) = (
                (along * angle.cos() - 0.5 * angle.sin()) as f32,
                (along * angle.sin() + 0.5 * angle.cos()) as f32,
            );
            let (x, y) = (f64::from(dx), f64::from(dy));
            let exact = 0.5 * (c * x * x + a * y * y - 2.0 * b * x * y) / det;
            let e0 = s.p * dx + s.q * dy;
            let e1 = s.r * dy;
            ours.push((f64::from(e0 * e0 + e1 * e1) - exact).abs());
            let (fa, fb, fc) = (
                v0.x * v0.x + v0.y * v0.y + BLUR,
                v0.x * v1.x + v0.y * v1.y,
                v1.x * v1.x + v1.y * v1.y + BLUR,
            );
            let fdet = fa * fc - fb * fb;
            if fdet > 0.0 {
                let (qa, qb, qc) = (fc / fdet, -fb / fdet, fa / fdet);
                let sigma = 0.5 * (qa * dx * dx + qc * dy * dy) + qb * dx * dy;
                naive.push((f64::from(sigma) - exact).abs());
            } else {
                not_positive += 1;
            }
        }
        let at = |v: &mut Vec<f64>, q: f64| {
            v.sort_by(f64::total_cmp);
            v[(q * (v.len() - 1) as f64) as usize]
        };
        for q in [0.5, 0.99, 1.0] {
            println!(
                "quantile {q}: {:.1e} by the factor, {:.1e} by the conic",
                at(&mut ours, q),
                at(&mut naive, q)
            );
        }
        println!("determinant not positive: {not_positive} of 20000 by A C - B^2, none by ours");
        assert!(at(&mut ours, 1.0) < 1e-2 && at(&mut naive, 0.99) > 10.0 * at(&mut ours, 0.99));
    }
}
