//! Gaussians as engines take them: one by one, for arrays of any kind.

pub mod covariances;
pub mod packed;

use crate::scene::{SH_C0, Scene};

/// Red, green and blue as seen without view dependence, and the opacity from 0 to 1.
#[must_use]
pub fn colour(scene: &Scene, i: usize) -> [f32; 4] {
    let [r, g, b] = scene.sh_of(i)[0].map(|dc| dc * SH_C0 + 0.5);
    [r, g, b, 1.0 / (1.0 + libm::expf(-scene.opacity_logits[i]))]
}

/// A quaternion with length 1; one of length 0 stays as it is.
fn unit(rotation: [f32; 4]) -> [f32; 4] {
    let length = rotation.iter().map(|v| v * v).sum::<f32>().sqrt().max(f32::MIN_POSITIVE);
    rotation.map(|v| v / length)
}

/// Standard deviations along the axes of a Gaussian.
#[must_use]
pub fn scale(scene: &Scene, i: usize) -> [f32; 3] {
    scene.log_scales[i].map(libm::expf)
}
