//! The shared mathematics in f64: the formulae themselves, without the rounding of f32. Tests compare it with central
//! differences, `cargo xtask stress` compares the f32 stages with it.
#![allow(dead_code, reason = "the shared text has parts that nobody asks for in f64")]

mod consts {
    pub(super) const ALPHA_MAX: f64 = 0.99;
    pub(super) const SIGMA_MAX: f64 = 700.0;
    pub(super) const LOG_SCALE_MAX: f64 = 40.0;
    pub(super) const BLUR: f64 = 0.3;
    pub(super) const MIN_QUATERNION_NORM2: f64 = 1e-30;
    pub(super) const MAX_QUATERNION_NORM2: f64 = 1e30;
}
use consts::*;

type F = f64;
type B = bool;

fn F(x: f64) -> f64 {
    x
}
fn select(otherwise: F, then: F, condition: B) -> F {
    if condition { then } else { otherwise }
}
fn min(a: F, b: F) -> F {
    a.min(b)
}
fn max(a: F, b: F) -> F {
    a.max(b)
}
fn clamp(x: F, low: F, high: F) -> F {
    x.max(low).min(high)
}
fn sqrt(x: F) -> F {
    x.sqrt()
}
fn exp_polynomial(x: F) -> F {
    libm::exp(x)
}
fn sigmoid(l: F) -> F {
    1.0 / (1.0 + exp_polynomial(-l))
}

include!("math/prelude.rs");
include!("math/project.wgsl");
include!("math/project_adjoint.wgsl");
include!("math/sh.wgsl");
include!("math/blend.wgsl");
include!("math/frame.rs");

/// Coefficients of SH degree 3.
const SH: usize = 16;

/// A Gaussian as a view shows it.
pub(crate) struct ViewGaussian {
    frame: Frame,
    pub(crate) x: f64,
    pub(crate) y: f64,
    /// As the view shows it.
    pub(crate) opacity: f64,
    /// Without compensation.
    free_opacity: f64,
    basis: [f64; SH],
    raw: [f64; 3],
    pub(crate) colour: [f64; 3],
    sh: Vec<[f64; 3]>,
}

impl ViewGaussian {
    /// `None` if it is at or behind the near plane.
    fn new(lens: &Lens, g: &Gaussian, antialiased: bool) -> Option<Self> {
        let frame = Frame::new(lens, g.mean, g.rotation, g.log_scale);
        if !frame.in_front {
            return None;
        }
        let degree = g.sh.len().isqrt() as u8 - 1;
        let basis = sh_basis(degree, direction(frame.from_eye).0);
        let raw = raw_colour(&basis, &g.sh);
        let free_opacity = sigmoid(g.opacity_logit);
        let compensation = if antialiased { compensation_of(frame.shape) } else { 1.0 };
        Some(Self {
            x: lens.fx * frame.m.x * frame.inv_z + lens.cx,
            y: lens.fy * frame.m.y * frame.inv_z + lens.cy,
            opacity: free_opacity * compensation,
            free_opacity,
            colour: raw.map(|c| c.max(0.0)),
            frame,
            basis,
            raw,
            sh: g.sh.clone(),
        })
    }

    /// The factor of half the inverse of its covariance in the image, see `Shape`.
    pub(crate) fn factor(&self) -> [f64; 3] {
        let Shape { p, q, r, .. } = self.frame.shape;
        [p, q, r]
    }

    fn offsets(&self, x: f64, y: f64) -> (f64, f64) {
        let ([p, q, r], dx, dy) = (self.factor(), self.x - x, self.y - y);
        (p * dx + q * dy, r * dy)
    }
}

/// The parameters of a Gaussian.
#[derive(Clone)]
struct Gaussian {
    mean: [f64; 3],
    rotation: [f64; 4],
    log_scale: [f64; 3],
    opacity_logit: f64,
    sh: Vec<[f64; 3]>,
}

/// Derivatives of [`crate::Loss::MSE`] by the arrays of one Gaussian, in double precision.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GradientF64 {
    /// By its SH coefficients.
    pub sh: Vec<[f64; 3]>,
    /// By its opacity logit.
    pub opacity_logit: f64,
    /// By its log-scales.
    pub log_scale: [f64; 3],
    /// By its quaternion, not normalised.
    pub rotation: [f64; 4],
    /// By its mean.
    pub mean: [f64; 3],
}

/// A view, and the Gaussians as it shows them, front to back.
struct Picture<'a> {
    lens: &'a Lens,
    size: (u32, u32),
    background: [f64; 3],
    antialiased: bool,
    /// Whether splats end where their alpha falls below 1/255, and pixels stop when little light is left.
    ends: bool,
    drawn: &'a [ViewGaussian],
}

/// What comes of a [`Picture`].
struct Evaluation {
    rgb: Vec<f64>,
    /// Pixels with an end so close that single precision may decide otherwise.
    doubtful: Vec<bool>,
    loss: f64,
    /// In the order of the splats.
    gradients: Vec<GradientF64>,
}

impl Picture<'_> {
    /// Blends it. `loss` gives for a channel of a pixel (as its number) and its value the loss and its derivative.
    fn evaluate(&self, loss: impl Fn(usize, f64) -> (f64, f64)) -> Evaluation {
        let mut out =
            Evaluation { rgb: Vec::new(), doubtful: Vec::new(), loss: 0.0, gradients: Vec::new() };
        let mut records = vec![[0.0; 9]; self.drawn.len()];
        let least = if self.ends { f64::from(super::T_STOP) } else { 0.0 };
        let cut =
            |d: &ViewGaussian| if self.ends { libm::log(255.0 * d.opacity) } else { f64::INFINITY };
        for pixel in 0..self.size.0 as usize * self.size.1 as usize {
            let (column, row) = (pixel % self.size.0 as usize, pixel / self.size.0 as usize);
            let (px, py) = (column as f64 + 0.5, row as f64 + 0.5);
            let (mut t, mut c, mut doubtful) = (1.0, [0.0; 3], false);
            for d in self.drawn {
                let (e0, e1) = d.offsets(px, py);
                let step = gate(e0, e1, cut(d), d.opacity, least, t);
                let rest = t - step.alpha * t;
                doubtful |= self.ends
                    && t > 0.0
                    && ((255.0 * step.og - 1.0).abs() < 1e-2 || (rest / least - 1.0).abs() < 1e-2);
                for ch in 0..3 {
                    c[ch] += step.w * d.colour[ch];
                }
                t = step.t;
            }
            let (mut g, mut rg) = ([0.0; 3], 0.0);
            for ch in 0..3 {
                let seen = c[ch] + t.abs() * self.background[ch];
                let (of, by) = loss(3 * pixel + ch, seen);
                (out.loss, g[ch]) = (out.loss + of, by);
                rg += seen * by;
                out.rgb.push(seen);
            }
            out.doubtful.push(doubtful);
            let mut t = 1.0;
            for (d, r) in self.drawn.iter().zip(&mut records) {
                let (e0, e1) = d.offsets(px, py);
                let cg = d.colour[0] * g[0] + d.colour[1] * g[1] + d.colour[2] * g[2];
                let step = replay(e0, e1, cut(d), d.opacity, least, t, rg, cg);
                let (v, w) = (step.v_sigma, step.w);
                let [vx, vy] = [v * e0, v * e1];
                let add = [w * g[0], w * g[1], w * g[2], v, vx * e0, vx * e1, vy * e1, vx, vy];
                r.iter_mut().zip(add).for_each(|(r, a)| *r += a);
                (t, rg) = (step.t, step.rg);
            }
        }
        out.gradients = self.drawn.iter().zip(&records).map(|(d, r)| self.gradient(d, r)).collect();
        out
    }

    /// From the sums over the pixels.
    fn gradient(&self, d: &ViewGaussian, r: &[f64; 9]) -> GradientF64 {
        let shape =
            shape_adjoint(&d.frame, Sym2(r[4], r[5], r[6]), self.antialiased.then_some(-r[3]));
        let v_raw = [0, 1, 2].map(|ch| if d.raw[ch] >= 0.0 { r[ch] } else { 0.0 });
        let mean = mean_adjoint(
            d.frame.sight(self.lens),
            d.frame.rot,
            d.frame.s,
            d.frame.shape,
            shape.axes,
            r[7],
            r[8],
        );
        let mean = add3(mean, direction_adjoint(&d.frame, &d.sh, v_raw));
        GradientF64 {
            mean: [mean.x, mean.y, mean.z],
            rotation: shape.d_rotation,
            log_scale: shape.d_log_scale,
            opacity_logit: -(r[3] * (1.0 - d.free_opacity)),
            sh: d.basis[..d.sh.len()].iter().map(|b| v_raw.map(|v| b * v)).collect(),
        }
    }
}

/// A scene at a camera, with the conventions of the f32 stages.
pub(crate) struct View {
    lens: Lens,
    size: (u32, u32),
    antialiased: bool,
    /// What the camera has in front of it, front to back.
    drawn: Vec<ViewGaussian>,
    /// The number in the scene of each.
    gaussians: Vec<usize>,
}

impl View {
    pub(crate) fn new(scene: &gs_model::Scene, camera: &gs_model::Camera) -> Self {
        let lens = Lens::new(camera);
        let of = |i: usize| Gaussian {
            mean: scene.means[i].map(f64::from),
            rotation: scene.rotations[i].map(f64::from),
            log_scale: scene.log_scales[i].map(f64::from),
            opacity_logit: f64::from(scene.opacity_logits[i]),
            sh: scene.sh_of(i).iter().map(|v| v.map(f64::from)).collect(),
        };
        let drawn = |i| Some((i, ViewGaussian::new(&lens, &of(i), scene.antialiased)?));
        let mut all: Vec<(usize, ViewGaussian)> = (0..scene.len()).filter_map(drawn).collect();
        // The stages sort by f32 depth, equals by number.
        all.sort_by(|a, b| (a.1.frame.m.z as f32).total_cmp(&(b.1.frame.m.z as f32)));
        let (gaussians, drawn) = all.into_iter().unzip();
        let size = (camera.width, camera.height);
        Self { lens, size, antialiased: scene.antialiased, drawn, gaussians }
    }

    /// The splat of each Gaussian, by its number.
    pub(crate) fn splats(&self) -> impl Iterator<Item = (usize, &ViewGaussian)> {
        self.gaussians.iter().copied().zip(&self.drawn)
    }

    /// The image, and which pixels are doubtful.
    pub(crate) fn image(&self, background: [f64; 3]) -> (Vec<f64>, Vec<bool>) {
        let of = self.picture(background).evaluate(|_, _| (0.0, 0.0));
        (of.rgb, of.doubtful)
    }

    /// Gradients of the mean squared error to a photo, by number of the Gaussian.
    pub(crate) fn gradients(
        &self,
        background: [f64; 3],
        photo: &[f32],
    ) -> impl Iterator<Item = (usize, GradientF64)> {
        let n = photo.len() as f64;
        let of = self.picture(background).evaluate(|at, seen| {
            let off = seen - f64::from(photo[at]);
            (off * off / n, 2.0 * off / n)
        });
        self.gaussians.iter().copied().zip(of.gradients)
    }

    fn picture(&self, background: [f64; 3]) -> Picture<'_> {
        let Self { lens, size, antialiased, drawn, .. } = self;
        let (size, antialiased) = (*size, *antialiased);
        Picture { lens, size, background, antialiased, ends: true, drawn }
    }
}

#[cfg(test)]
mod tests;
