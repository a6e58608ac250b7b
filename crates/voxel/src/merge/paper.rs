//! The paper's merging (section 3.3): [`Merge::Paper`](crate::Merge::Paper).

use gs_model::Scene;

use super::{Shape, clamp_logit};
use crate::gaussian::{log_volume, logit, opacity};

/// Mean opacity; scale and rotation of the member of the largest volume (the first of equals).
pub(super) fn shape(scene: &Scene, members: &[u32]) -> Shape {
    let mut largest = members[0] as usize;
    let mut sum = 0.0;
    for &i in members {
        let i = i as usize;
        sum += opacity(scene.opacity_logits[i]);
        if log_volume(scene.log_scales[i]) > log_volume(scene.log_scales[largest]) {
            largest = i;
        }
    }
    let mean = logit(sum / members.len() as f64);
    Shape { opacity_logit: clamp_logit(scene, members, mean), ..Shape::of(scene, largest) }
}
