//! Stage `project_adjoint`: from a Gaussian's gathered record to its parameters.

use gs_model::Scene;

use super::blend_adjoint::MOVING;
use super::project::View;
use super::*;

/// Gradients of one Gaussian, in the space of [`Scene`]'s arrays.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct GaussianGradient {
    /// The SH basis. The gradient with respect to the SH coefficients is its outer product with
    /// `v_raw`.
    pub(crate) basis: [f32; 16],
    /// Gradient with respect to the colour before its clamp.
    pub(crate) v_raw: [f32; 3],
    pub(crate) d_opacity_logit: f32,
    pub(crate) d_log_scale: [f32; 3],
    pub(crate) d_rotation: [f32; 4],
    /// Zero if means are frozen.
    pub(crate) d_mean: [f32; 3],
    /// Squared length of the gradient with respect to the pixel position; zero if means are
    /// frozen.
    pub(crate) image_gradient2: f32,
}

/// The parameters of one Gaussian.
#[derive(Clone, Copy)]
pub(crate) struct Gaussian<'a> {
    pub(crate) mean: [f32; 3],
    pub(crate) rotation: [f32; 4],
    pub(crate) log_scale: [f32; 3],
    pub(crate) opacity_logit: f32,
    pub(crate) sh_degree: u8,
    pub(crate) sh: &'a [[f32; 3]],
}

impl<'a> Gaussian<'a> {
    #[inline(always)]
    pub(crate) fn of(scene: &'a Scene, i: usize) -> Self {
        Self {
            mean: scene.means[i],
            rotation: scene.rotations[i],
            log_scale: scene.log_scales[i],
            opacity_logit: scene.opacity_logits[i],
            sh_degree: scene.sh_degree,
            sh: scene.sh_of(i),
        }
    }
}

/// `record` is the Gaussian's from `gather_gradients`, 7 or 9 sums.
/// `None` if the Gaussian was culled or reaches no pixel. Its gradient is then zero; computing it
/// could give NaN, for example where an overflow made the Gaussian invisible.
#[inline(always)]
pub(crate) fn gaussian_gradient<const N: usize>(
    view: &View,
    a: &Gaussian<'_>,
    record: &[f32; N],
) -> Option<GaussianGradient> {
    if record.iter().all(|&v| v == 0.0) {
        return None;
    }
    let f = Frame::new(&view.lens, a.mean, a.rotation, a.log_scale)?;
    let e = Sym2(record[4], record[5], record[6]);
    let shape = shape_adjoint(&f, e);
    let (d, _) = direction(f.from_eye);
    let basis = sh_basis(a.sh_degree, d);
    let v_raw = [record[0], record[1], record[2]];
    let o = sigmoid(a.opacity_logit);
    // v_o = -(sum of v_sigma) / o and do/dl = o (1 - o).
    let d_opacity_logit = -(record[3] * (1.0 - o));
    let mut out = GaussianGradient {
        basis,
        v_raw,
        d_opacity_logit,
        d_log_scale: shape.d_log_scale,
        d_rotation: shape.d_rotation,
        ..Default::default()
    };
    if N == MOVING {
        let e = [record[7], record[8]];
        out.d_mean = mean_adjoint(&view.lens, &f, shape.v_s, e, a.sh_degree, a.sh, v_raw);
        let gx = 2.0 * f.shape.p * e[0];
        let gy = 2.0 * (f.shape.q * e[0] + f.shape.r * e[1]);
        out.image_gradient2 = gx * gx + gy * gy;
    }
    Some(out)
}
