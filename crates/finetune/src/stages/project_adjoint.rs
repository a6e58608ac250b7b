//! Stage `project_adjoint`: from a Gaussian's gathered record to its parameters.

use gs_model::Scene;

use super::blend_adjoint::MOVING;
use super::project::RenderView;
use super::*;

/// Derivatives of a loss by the arrays of one Gaussian.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ParameterGradient {
    /// By its SH coefficients, as many as the scene has.
    pub sh: [[f32; 3]; 16],
    /// By its opacity logit.
    pub opacity_logit: f32,
    /// By its log-scales.
    pub log_scale: [f32; 3],
    /// By its quaternion, not normalised.
    pub rotation: [f32; 4],
    /// By its mean; zero where means are frozen.
    pub mean: [f32; 3],
}

/// `weight` times the gradient of Gaussian `i`. `record` is what `gather` leaves of it, 7 or 9 sums.
///
/// `None` if the Gaussian was culled or reaches no pixel. Its gradient is then zero; computing it
/// could give NaN, for example where an overflow made the Gaussian invisible. Many Gaussians are not in a view:
/// nothing of them is read, which takes 2 % off a step.
#[inline(always)]
pub(crate) fn parameter_gradient<const N: usize>(
    view: &RenderView,
    weight: f32,
    scene: &Scene,
    i: usize,
    record: &[f32; N],
) -> Option<ParameterGradient> {
    if *record == [0.0; N] {
        return None;
    }
    let f = Frame::new(&view.lens, scene.means[i], scene.rotations[i], scene.log_scales[i]);
    if !f.in_front {
        return None;
    }
    let shape = shape_adjoint(&f, Sym2(record[4], record[5], record[6]));
    // With respect to the colour before its clamp.
    let v_raw = [record[0], record[1], record[2]];
    let o = sigmoid(scene.opacity_logits[i]);
    let mut out = ParameterGradient {
        // v_o = -(sum of v_sigma) / o and do/dl = o (1 - o).
        opacity_logit: -(record[3] * (1.0 - o)) * weight,
        log_scale: shape.d_log_scale.map(|v| v * weight),
        rotation: shape.d_rotation.map(|v| v * weight),
        ..ParameterGradient::default()
    };
    let basis = sh_basis(scene.sh_degree, direction(f.from_eye).0);
    for (d, b) in out.sh.iter_mut().zip(&basis).take(scene.sh_len()) {
        *d = v_raw.map(|v| b * v * weight);
    }
    if N == MOVING {
        let mean = mean_adjoint(&view.lens, &f, shape.v_s, [record[7], record[8]]);
        let mean = add3(mean, direction_adjoint(&f, scene.sh_of(i), v_raw));
        out.mean = [mean.x, mean.y, mean.z].map(|v| v * weight);
    }
    Some(out)
}
