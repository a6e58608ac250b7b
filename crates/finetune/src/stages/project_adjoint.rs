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

/// The parameters of one Gaussian that its gradient depends on.
#[derive(Clone, Copy)]
pub(crate) struct Gaussian<'a> {
    mean: [f32; 3],
    rotation: [f32; 4],
    log_scale: [f32; 3],
    opacity_logit: f32,
    sh: &'a [[f32; 3]],
    antialiased: bool,
}

impl<'a> Gaussian<'a> {
    /// Number `i` of a scene.
    #[inline(always)]
    pub(crate) fn of(scene: &'a Scene, i: usize) -> Self {
        Self {
            mean: scene.means[i],
            rotation: scene.rotations[i],
            log_scale: scene.log_scales[i],
            opacity_logit: scene.opacity_logits[i],
            sh: scene.sh_of(i),
            antialiased: scene.antialiased,
        }
    }

    /// Of a row of `SceneOptimiser`.
    #[inline(always)]
    pub(crate) fn of_row(row: &'a [f32], antialiased: bool) -> Self {
        let at = row.len() - 8;
        let four = |i: usize| [row[i], row[i + 1], row[i + 2], row[i + 3]];
        Self {
            mean: [row[0], row[1], row[2]],
            rotation: four(at + 4),
            log_scale: [row[at + 1], row[at + 2], row[at + 3]],
            opacity_logit: row[at],
            sh: row[3..at].as_chunks().0,
            antialiased,
        }
    }
}

/// `weight` times the gradient of a Gaussian that reaches a pixel. `record` is what `gather` leaves of it, 7 or 9 sums.
#[inline(always)]
pub(crate) fn parameter_gradient<const N: usize>(
    view: &RenderView,
    weight: f32,
    gaussian: &Gaussian<'_>,
    record: &[f32; N],
) -> ParameterGradient {
    let Gaussian { mean, rotation, log_scale, opacity_logit, sh, antialiased } = gaussian;
    let f = Frame::new(&view.lens, *mean, *rotation, *log_scale);
    // v_o = -(sum of v_sigma) / o.
    let v_ln_opacity = -record[3];
    let v_compensation = antialiased.then_some(v_ln_opacity);
    let shape = shape_adjoint(&f, Sym2(record[4], record[5], record[6]), v_compensation);
    // With respect to the colour before its clamp.
    let v_raw = [record[0], record[1], record[2]];
    let o = sigmoid(*opacity_logit);
    let mut out = ParameterGradient {
        // do/dl = o (1 - o).
        opacity_logit: v_ln_opacity * (1.0 - o) * weight,
        log_scale: shape.d_log_scale.map(|v| v * weight),
        rotation: shape.d_rotation.map(|v| v * weight),
        ..ParameterGradient::default()
    };
    let degree = sh.len().isqrt().saturating_sub(1) as u8;
    let basis = sh_basis(degree, direction(f.from_eye).0);
    for (d, b) in out.sh.iter_mut().zip(&basis).take(sh.len()) {
        *d = v_raw.map(|v| b * v * weight);
    }
    if N == MOVING {
        let mean = mean_adjoint(
            f.sight(&view.lens),
            f.rot,
            f.s,
            f.shape,
            shape.axes,
            record[7],
            record[8],
        );
        let mean = add3(mean, direction_adjoint(&f, sh, v_raw));
        out.mean = [mean.x, mean.y, mean.z].map(|v| v * weight);
    }
    out
}
