//! Stage `project`: one [`Splat`] per (Gaussian, view), its tile box and its depth key.

use gs_model::{Camera, Scene};
use rayon::prelude::*;

use super::*;
use crate::options::{Profile, RenderOptions};

/// Depth key of a culled Gaussian; sorts last.
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
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub(crate) struct View {
    /// Rows of the world-to-camera rotation; the fourth component is unused.
    pub(crate) rotation: [[f32; 4]; 3],
    /// Camera position; the fourth component is unused.
    pub(crate) position: [f32; 4],
    pub(crate) fx: f32,
    pub(crate) fy: f32,
    pub(crate) cx: f32,
    pub(crate) cy: f32,
    /// Clamp of the slopes x/z and y/z: 15 % of the image beyond each edge.
    pub(crate) lo_x: f32,
    pub(crate) hi_x: f32,
    pub(crate) lo_y: f32,
    pub(crate) hi_y: f32,
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) tiles_x: u32,
    pub(crate) tiles_y: u32,
    pub(crate) background: [f32; 3],
    /// 1 for [`Profile::Reference`].
    pub(crate) reference: u32,
}

impl View {
    pub(crate) fn new(camera: &Camera, options: &RenderOptions) -> Self {
        let rows = camera.rotation.transpose();
        let row = |r: glam::DVec3| [r.x as f32, r.y as f32, r.z as f32, 0.0];
        let eye = camera.position();
        let (w, h) = (f64::from(camera.width), f64::from(camera.height));
        Self {
            rotation: [row(rows.x_axis), row(rows.y_axis), row(rows.z_axis)],
            position: row(eye),
            fx: camera.fx as f32,
            fy: camera.fy as f32,
            cx: camera.cx as f32,
            cy: camera.cy as f32,
            lo_x: ((-0.15 * w - camera.cx) / camera.fx) as f32,
            hi_x: ((1.15 * w - camera.cx) / camera.fx) as f32,
            lo_y: ((-0.15 * h - camera.cy) / camera.fy) as f32,
            hi_y: ((1.15 * h - camera.cy) / camera.fy) as f32,
            width: camera.width,
            height: camera.height,
            tiles_x: camera.width.div_ceil(TILE),
            tiles_y: camera.height.div_ceil(TILE),
            background: options.background,
            reference: u32::from(options.profile == Profile::Reference),
        }
    }

    pub(crate) fn tiles(&self) -> usize {
        self.tiles_x as usize * self.tiles_y as usize
    }

    pub(crate) fn tile_at(&self, tile: usize) -> (u32, u32) {
        (tile as u32 % self.tiles_x, tile as u32 / self.tiles_x)
    }

    fn rows(&self) -> (V3, V3, V3) {
        let v = |r: [f32; 4]| V3(r[0], r[1], r[2]);
        (v(self.rotation[0]), v(self.rotation[1]), v(self.rotation[2]))
    }

    fn eye(&self) -> V3 {
        V3(self.position[0], self.position[1], self.position[2])
    }
}

/// What projection and its adjoint share: everything up to the 2D shape.
pub(crate) struct Frame {
    /// Mean minus camera position, world axes.
    pub(crate) from_eye: V3,
    /// Mean in camera axes.
    pub(crate) m: V3,
    pub(crate) inv_z: F,
    /// Clamped slopes.
    pub(crate) u: F,
    pub(crate) v: F,
    /// Normalised quaternion and 1 / |q|.
    pub(crate) unit: [F; 4],
    pub(crate) inv_norm: F,
    pub(crate) rot: Rot,
    pub(crate) s: V3,
    pub(crate) ewa: Ewa,
    pub(crate) v0: V3,
    pub(crate) v1: V3,
    pub(crate) shape: Shape,
}

impl Frame {
    /// `None` if the Gaussian is at or behind the near plane or has no rotation. Guards are
    /// phrased so that NaN fails them.
    #[inline]
    pub(crate) fn new(
        view: &View,
        mean: [f32; 3],
        q: [f32; 4],
        log_scale: [f32; 3],
    ) -> Option<Self> {
        let from_eye = sub3(V3(mean[0], mean[1], mean[2]), view.eye());
        let (w0, w1, w2) = view.rows();
        let m = V3(dot3(w0, from_eye), dot3(w1, from_eye), dot3(w2, from_eye));
        let n01 = q[0] * q[0] + q[1] * q[1];
        let n23 = q[2] * q[2] + q[3] * q[3];
        let norm2 = n01 + n23;
        if !(m.z > NEAR && norm2 >= MIN_QUATERNION_NORM2) {
            return None;
        }
        let inv_norm = 1.0 / sqrt(norm2);
        let unit = q.map(|c| c * inv_norm);
        let rot = rotation_of(unit[0], unit[1], unit[2], unit[3]);
        let scale = |l: f32| exp_own(clamp(l, -80.0, 80.0));
        let s = V3(scale(log_scale[0]), scale(log_scale[1]), scale(log_scale[2]));
        let inv_z = 1.0 / m.z;
        let u = clamp(m.x * inv_z, view.lo_x, view.hi_x);
        let v = clamp(m.y * inv_z, view.lo_y, view.hi_y);
        let ewa = ewa_of(view.fx, view.fy, u, v, inv_z, w0, w1, w2);
        let v0 = half_cov_row(ewa.t0, rot, s);
        let v1 = half_cov_row(ewa.t1, rot, s);
        let shape = shape_of(v0, v1, BLUR);
        Some(Self { from_eye, m, inv_z, u, v, unit, inv_norm, rot, s, ewa, v0, v1, shape })
    }
}

/// View direction: the unit vector from the camera to the mean.
#[inline]
pub(crate) fn direction(from_eye: V3) -> (V3, F) {
    let inv = 1.0 / sqrt(dot3(from_eye, from_eye));
    (scale3(from_eye, inv), inv)
}

/// The SH basis of `degree` at unit direction `d`; entries beyond it stay zero.
#[inline]
pub(crate) fn sh_basis(degree: u8, d: V3) -> [F; 16] {
    let mut b = [0.0; 16];
    b[0] = 0.282_094_8;
    if degree >= 1 {
        let s = sh_band1(d);
        b[1..4].copy_from_slice(&[s.x, s.y, s.z]);
    }
    if degree >= 2 {
        let s = sh_band2(d);
        b[4..9].copy_from_slice(&[s.b0, s.b1, s.b2, s.b3, s.b4]);
    }
    if degree >= 3 {
        let s = sh_band3(d);
        b[9..16].copy_from_slice(&[s.b0, s.b1, s.b2, s.b3, s.b4, s.b5, s.b6]);
    }
    b
}

/// Colour before the clamp at zero.
#[inline]
pub(crate) fn raw_colour(basis: &[F; 16], sh: &[[f32; 3]]) -> [F; 3] {
    let mut c = [0.5; 3];
    for (b, k) in basis.iter().zip(sh) {
        for ch in 0..3 {
            c[ch] += b * k[ch];
        }
    }
    c
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

/// Projects Gaussian `i`; `None` if it cannot be seen.
#[inline]
fn project_one(view: &View, scene: &Scene, i: usize) -> Option<(Splat, TileBox, u32)> {
    let opacity = sigmoid(scene.opacity_logits[i]);
    let o255 = opacity * 255.0;
    if !(o255 > 1.0) {
        return None;
    }
    let f = Frame::new(view, scene.means[i], scene.rotations[i], scene.log_scales[i])?;
    let x = view.fx * (f.m.x * f.inv_z) + view.cx;
    let y = view.fy * (f.m.y * f.inv_z) + view.cy;
    let cut = ln_own(o255);
    let shape = f.shape;
    let (cols, rows) = if view.reference == 1 {
        let half = reference_radius(&shape);
        let x_span = square_tiles(x, half, view.tiles_x);
        let y_span = square_tiles(y, half, view.tiles_y);
        let pixels = |s: (u32, u32), limit: u32| (s.0 * TILE, (s.1 * TILE).min(limit));
        (pixels(x_span, view.width), pixels(y_span, view.height))
    } else {
        // The ellipse's exact box, widened by what rounding could take away.
        let t = 2.0 * cut * 1.0001;
        let half_x = sqrt(t * shape.cov_xx) + 0.01;
        let half_y = sqrt(t * shape.cov_yy) + 0.01;
        (span(x, half_x, view.width), span(y, half_y, view.height))
    };
    if !(cols.0 < cols.1 && rows.0 < rows.1) {
        return None;
    }
    let sane = finite(x) & finite(y) & finite(shape.p) & finite(shape.q) & finite(shape.r);
    if !sane {
        return None;
    }
    let (d, _) = direction(f.from_eye);
    let raw = raw_colour(&sh_basis(scene.sh_degree, d), scene.sh_of(i));
    if !(finite(raw[0]) & finite(raw[1]) & finite(raw[2])) {
        return None;
    }
    let splat = Splat {
        x,
        y,
        p: shape.p,
        q: shape.q,
        r: shape.r,
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
    Some((splat, tiles, f.m.z.to_bits()))
}

/// Inria's radius: three standard deviations of the major axis, rounded up.
fn reference_radius(shape: &Shape) -> F {
    let mid = 0.5 * (shape.cov_xx + shape.cov_yy);
    let det = shape.det_over_m * shape.m;
    let root = sqrt(max(mid * mid - det, 0.1));
    (3.0 * sqrt(mid + root)).ceil()
}

/// Inria's tile range of a square, with its truncation towards zero.
fn square_tiles(centre: F, half: F, limit: u32) -> (u32, u32) {
    let tile = TILE as f32;
    // Inria's pixel centres are at integers: its mean is ours less one half.
    let c = centre - 0.5;
    let first = ((c - half) / tile).max(0.0) as u32;
    let last = ((c + half + tile - 1.0) / tile).max(0.0) as u32;
    (first.min(limit), last.min(limit))
}

/// Output of the stage: one entry per Gaussian, culled ones with key [`CULLED`].
#[derive(Default)]
pub(crate) struct Projected {
    pub(crate) splats: Vec<Splat>,
    pub(crate) boxes: Vec<TileBox>,
    pub(crate) keys: Vec<u32>,
}

/// Projects every Gaussian of `scene`.
pub(crate) fn project(view: &View, scene: &Scene, out: &mut Projected) {
    const CHUNK: usize = 1024;
    let n = scene.len();
    out.splats.resize(n, Splat::default());
    out.boxes.resize(n, TileBox::default());
    out.keys.resize(n, CULLED);
    out.splats
        .par_chunks_mut(CHUNK)
        .zip(out.boxes.par_chunks_mut(CHUNK))
        .zip(out.keys.par_chunks_mut(CHUNK))
        .enumerate()
        .for_each(|(c, ((splats, boxes), keys))| {
            for j in 0..splats.len() {
                match project_one(view, scene, c * CHUNK + j) {
                    Some((s, b, k)) => (splats[j], boxes[j], keys[j]) = (s, b, k),
                    None => keys[j] = CULLED,
                }
            }
        });
}
