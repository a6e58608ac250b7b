//! Stage `adam`: the optimiser, fused with the adjoint of the projection, so that gradients are
//! never stored.

use gs_model::Scene;
use rayon::prelude::*;

use super::finite;
use super::project::View;
use super::project_adjoint::{Gaussian, gaussian_gradient};
use crate::options::LearningRates;
use crate::simd;

/// First and second moments, in the layout of the scene's arrays, flattened.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Moments {
    pub(crate) sh: [Vec<f32>; 2],
    pub(crate) opacity: [Vec<f32>; 2],
    pub(crate) log_scale: [Vec<f32>; 2],
    pub(crate) rotation: [Vec<f32>; 2],
}

impl Moments {
    pub(crate) fn zeros(scene: &Scene) -> Self {
        let two = |n: usize| [vec![0.0; n], vec![0.0; n]];
        Self {
            sh: two(3 * scene.sh.len()),
            opacity: two(scene.len()),
            log_scale: two(3 * scene.len()),
            rotation: two(4 * scene.len()),
        }
    }

    pub(crate) fn arrays(&self) -> [&Vec<f32>; 8] {
        let Self { sh, opacity, log_scale, rotation } = self;
        let [a, b] = sh;
        let [c, d] = opacity;
        let [e, f] = log_scale;
        let [g, h] = rotation;
        [a, b, c, d, e, f, g, h]
    }

    pub(crate) fn arrays_mut(&mut self) -> [&mut Vec<f32>; 8] {
        let Self { sh, opacity, log_scale, rotation } = self;
        let [a, b] = sh;
        let [c, d] = opacity;
        let [e, f] = log_scale;
        let [g, h] = rotation;
        [a, b, c, d, e, f, g, h]
    }
}

/// Constants of one step: rates over the first bias correction, and the second's inverse root.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct AdamStep {
    pub(crate) sh_dc: f32,
    pub(crate) sh_rest: f32,
    pub(crate) opacity: f32,
    pub(crate) log_scale: f32,
    pub(crate) rotation: f32,
    pub(crate) inv_sqrt_bias2: f32,
}

pub(crate) const BETA1: f32 = 0.9;
pub(crate) const BETA2: f32 = 0.999;
pub(crate) const EPSILON: f32 = 1.0e-15;

impl AdamStep {
    /// `step` counts from 1; `decay` multiplies all rates.
    pub(crate) fn new(rates: &LearningRates, step: u64, decay: f64) -> Self {
        let t = step.min(1 << 30) as f64;
        let bias1 = 1.0 - libm::pow(f64::from(BETA1), t);
        let bias2 = 1.0 - libm::pow(f64::from(BETA2), t);
        let rate = |r: f32| (f64::from(r) * decay / bias1) as f32;
        Self {
            sh_dc: rate(rates.sh_dc),
            sh_rest: rate(rates.sh_rest),
            opacity: rate(rates.opacity),
            log_scale: rate(rates.log_scale),
            rotation: rate(rates.rotation),
            inv_sqrt_bias2: (1.0 / bias2.sqrt()) as f32,
        }
    }
}

/// Updates one parameter. A gradient that is not finite counts as zero, so that one bad pixel does
/// not end a run of thousands of steps.
#[inline(always)]
pub(crate) fn update(
    p: &mut f32,
    m: &mut f32,
    v: &mut f32,
    g: f32,
    rate: f32,
    inv_sqrt_bias2: f32,
) {
    let g = if finite(g) { g } else { 0.0 };
    let m0 = *m * BETA1;
    let m1 = g * (1.0 - BETA1);
    *m = m0 + m1;
    let gg = g * g;
    let v0 = *v * BETA2;
    let v1 = gg * (1.0 - BETA2);
    *v = v0 + v1;
    let root = v.sqrt() * inv_sqrt_bias2;
    let ratio = *m / (root + EPSILON);
    let move_by = ratio * rate;
    *p -= move_by;
}

/// Gaussians per task.
const CHUNK: usize = 256;

/// One array of a chunk: parameters and both moments.
struct Slices<'a> {
    p: &'a mut [f32],
    m: &'a mut [f32],
    v: &'a mut [f32],
}

impl<'a> Slices<'a> {
    fn new(p: &'a mut [f32], [m, v]: &'a mut [Vec<f32>; 2]) -> Self {
        Self { p, m, v }
    }

    /// Splits off the first `n` values.
    fn take(&mut self, n: usize) -> Slices<'a> {
        fn head<'a>(s: &mut &'a mut [f32], n: usize) -> &'a mut [f32] {
            let (head, tail) = std::mem::take(s).split_at_mut(n);
            *s = tail;
            head
        }
        Slices { p: head(&mut self.p, n), m: head(&mut self.m, n), v: head(&mut self.v, n) }
    }

    #[inline(always)]
    fn update(&mut self, first: usize, gradient: &[f32], rates: &[f32], inv_sqrt_bias2: f32) {
        let end = first + gradient.len();
        let (p, m, v) = (&mut self.p[first..end], &mut self.m[first..end], &mut self.v[first..end]);
        for ((((p, m), v), g), rate) in p.iter_mut().zip(m).zip(v).zip(gradient).zip(rates) {
            update(p, m, v, *g, *rate, inv_sqrt_bias2);
        }
    }
}

struct Chunk<'a, const N: usize> {
    step: &'a AdamStep,
    view: &'a View,
    /// What was rendered, if not the parameters themselves.
    rendered: Option<&'a Scene>,
    first: usize,
    records: &'a [[f32; N]],
    means: &'a [[f32; 3]],
    degree: u8,
    sh: Slices<'a>,
    opacity: Slices<'a>,
    log_scale: Slices<'a>,
    rotation: Slices<'a>,
}

impl<const N: usize> simd::Kernel for Chunk<'_, N> {
    type Output = ();

    #[inline(always)]
    fn call(mut self) {
        let step = self.step;
        let k3 = 3 * gs_model::scene::sh_len(self.degree);
        let mut sh_rates = [step.sh_rest; 48];
        sh_rates[..3].fill(step.sh_dc);
        let inv = step.inv_sqrt_bias2;
        for (j, record) in self.records.iter().enumerate() {
            let gaussian = match self.rendered {
                Some(scene) => Gaussian::of(scene, self.first + j),
                None => Gaussian {
                    mean: self.means[j],
                    rotation: [0, 1, 2, 3].map(|c| self.rotation.p[4 * j + c]),
                    log_scale: [0, 1, 2].map(|c| self.log_scale.p[3 * j + c]),
                    opacity_logit: self.opacity.p[j],
                    sh_degree: self.degree,
                    sh: self.sh.p[k3 * j..k3 * (j + 1)].as_chunks().0,
                },
            };
            let g = gaussian_gradient(self.view, &gaussian, record).unwrap_or_default();
            let mut d_sh = [0.0f32; 48];
            for (k, b) in g.basis.iter().enumerate() {
                for ch in 0..3 {
                    d_sh[3 * k + ch] = b * g.v_raw[ch];
                }
            }
            self.sh.update(k3 * j, &d_sh[..k3], &sh_rates[..k3], inv);
            self.opacity.update(j, &[g.d_opacity_logit], &[step.opacity], inv);
            self.log_scale.update(3 * j, &g.d_log_scale, &[step.log_scale; 3], inv);
            self.rotation.update(4 * j, &g.d_rotation, &[step.rotation; 4], inv);
        }
    }
}

/// Updates every parameter except the means from the gathered records, 7 or 9 floats each.
/// Gaussians that the view does not see have a zero gradient: their moments decay, and their
/// parameters still move by them, as in the reference implementation.
pub(crate) fn adam<const N: usize>(
    view: &View,
    step: &AdamStep,
    records: &[[f32; N]],
    rendered: Option<&Scene>,
    scene: &mut Scene,
    moments: &mut Moments,
) {
    let degree = scene.sh_degree;
    let k3 = 3 * scene.sh_len();
    let mut sh = Slices::new(scene.sh.as_flattened_mut(), &mut moments.sh);
    let mut opacity = Slices::new(&mut scene.opacity_logits, &mut moments.opacity);
    let mut log_scale = Slices::new(scene.log_scales.as_flattened_mut(), &mut moments.log_scale);
    let mut rotation = Slices::new(scene.rotations.as_flattened_mut(), &mut moments.rotation);
    let mut chunks = Vec::with_capacity(records.len().div_ceil(CHUNK));
    for (c, (records, means)) in records.chunks(CHUNK).zip(scene.means.chunks(CHUNK)).enumerate() {
        let n = records.len();
        chunks.push(Chunk {
            step,
            view,
            rendered,
            first: c * CHUNK,
            records,
            means,
            degree,
            sh: sh.take(k3 * n),
            opacity: opacity.take(n),
            log_scale: log_scale.take(3 * n),
            rotation: rotation.take(4 * n),
        });
    }
    chunks.into_par_iter().for_each(simd::run);
}
