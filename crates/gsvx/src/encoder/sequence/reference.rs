//! The scene about which the frames of a group vary: what its static stream holds.

use crate::attributes::opacity;
use crate::covariance;
use gs_model::{LEAST_DRAWN_LOGIT, Scene};

/// The mean over the frames of each attribute, as it is coded. What never changes keeps its bits. A Gaussian that any
/// frame draws is drawn.
pub(super) fn reference(frames: &[Scene]) -> Scene {
    let mut out = frames[0].clone();
    let count = frames.len() as f32;
    let varies = |same: &dyn Fn(&Scene) -> bool| !frames[1..].iter().all(same);
    for i in 0..out.len() {
        if varies(&|f| f.means[i] == frames[0].means[i]) {
            out.means[i] = mean(frames, count, |f| f.means[i]);
        }
        if varies(&|f| f.opacity_logits[i] == frames[0].opacity_logits[i]) {
            let [a] =
                mean(frames, count, |f| [opacity::log_alpha_of_logit(f.opacity_logits[i]) as f32]);
            let drawn = frames.iter().any(|f| f.opacity_logits[i] >= LEAST_DRAWN_LOGIT);
            let least = if drawn { LEAST_DRAWN_LOGIT } else { f32::NEG_INFINITY };
            out.opacity_logits[i] = opacity::logit_of_log_alpha(a).max(least);
        }
        let shape = |f: &Scene| (f.rotations[i], f.log_scales[i]);
        if varies(&|f| shape(f) == shape(&frames[0])) {
            let c =
                mean(frames, count, |f| covariance::coordinates(f.rotations[i], f.log_scales[i]));
            let (q, s) = (&mut out.rotations[i..=i], &mut out.log_scales[i..=i]);
            covariance::decompose_into(&[c], q, s);
        }
    }
    let sh = |f: &Scene, i: usize| f.sh[i];
    for i in 0..out.sh.len() {
        if varies(&|f| sh(f, i) == sh(&frames[0], i)) {
            out.sh[i] = mean(frames, count, |f| sh(f, i));
        }
    }
    out
}

/// The mean of numbers, about the first of them.
fn mean<const N: usize>(frames: &[Scene], count: f32, of: impl Fn(&Scene) -> [f32; N]) -> [f32; N] {
    let first = of(&frames[0]);
    let mut sum = [0.0; N];
    for frame in frames {
        let values = of(frame);
        (0..N).for_each(|k| sum[k] += values[k] - first[k]);
    }
    std::array::from_fn(|k| first[k] + sum[k] / count)
}
