//! How strongly the views depend on the covariance of each Gaussian.

use gs_model::{Camera, Scene};

use crate::forward::render;
use crate::gradients::gradients;
use crate::options::{Loss, RenderOptions};

/// Per Gaussian: sum over all pixels and channels of all views of the squared derivatives of the
/// pixel with respect to the three log-scales and to a rotation about the three axes (radians).
/// The squared error of the views grows by this times the square of a small error in them.
///
/// This is Hutchinson's unbiased estimate: each view is differentiated once along a direction of
/// random signs, one per pixel and channel, and the mean of the squared derivative is the sum above.
/// The signs are a hash of the view's and the pixel's number, so the result is always the same. Costs
/// two forward passes and one backward pass per camera.
#[must_use]
pub fn covariance_sensitivity(scene: &Scene, cameras: &[Camera]) -> Vec<f32> {
    /// Difference between the render and the artificial photo. The result does not depend on it.
    const SIZE: f32 = 0.25;
    let mut out = vec![0.0f32; scene.len()];
    let options = RenderOptions::default();
    for (view, camera) in cameras.iter().enumerate() {
        let mut photo = render(scene, camera, &options);
        for (pixel, v) in photo.rgb.iter_mut().enumerate() {
            *v += if positive(view as u64, pixel as u64) { SIZE } else { -SIZE };
        }
        let per_pixel = photo.rgb.len() as f32 / (2.0 * SIZE);
        let Some((_, g)) = gradients(scene, camera, &photo, Loss::Mse, &options) else { continue };
        for (i, sum) in out.iter_mut().enumerate() {
            let scales: f32 = g.d_log_scale[i].iter().map(|d| d * d).sum();
            // A quaternion turns by twice the angle it moves, in units of its length.
            let length2: f32 = scene.rotations[i].iter().map(|q| q * q).sum();
            let angles: f32 = g.d_rotation[i].iter().map(|d| d * d).sum::<f32>() * 0.25 * length2;
            *sum += (scales + angles) * per_pixel * per_pixel;
        }
    }
    out
}

/// A fair coin per view and pixel: the top bit of a mixed counter (splitmix64).
fn positive(view: u64, pixel: u64) -> bool {
    let mut z = (view << 40 ^ pixel).wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    (z ^ z >> 31) >> 63 == 1
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against differences of renders: of many copies of one Gaussian side by side, the mean of
    /// the estimates is the squared change of the image per squared change of a parameter.
    #[test]
    fn the_estimate_is_the_squared_change_of_the_image() {
        let mut scene = Scene::default();
        for i in 0..144 {
            let at = |k: i32| (k as f32 - 5.5) * 0.5;
            scene.means.push([at(i % 12), at(i / 12), 0.0]);
            scene.rotations.push([0.9, 0.1, 0.2, 0.3]);
            scene.log_scales.push([-2.4, -2.9, -2.6]);
            scene.opacity_logits.push(1.0);
            scene.sh.push([1.0, 0.5, -0.5]);
        }
        let camera = Camera {
            name: "front".into(),
            width: 192,
            height: 192,
            fx: 600.0,
            fy: 600.0,
            cx: 96.0,
            cy: 96.0,
            rotation: glam::DMat3::IDENTITY,
            translation: glam::DVec3::new(0.0, 0.0, 20.0),
            ignored_distortion: None,
        };
        let found = covariance_sensitivity(&scene, std::slice::from_ref(&camera));
        assert_eq!(found, covariance_sensitivity(&scene, std::slice::from_ref(&camera)));
        let mean = found.iter().map(|&v| f64::from(v)).sum::<f64>() / 144.0;

        // The Gaussians do not overlap, so all can be moved at once.
        let options = RenderOptions::default();
        let change = |edit: &dyn Fn(&mut Scene, f32)| {
            let [mut up, mut down] = [scene.clone(), scene.clone()];
            edit(&mut up, 0.01);
            edit(&mut down, -0.01);
            let (up, down) = (render(&up, &camera, &options), render(&down, &camera, &options));
            let square = |(a, b): (&f32, &f32)| f64::from(a - b) * f64::from(a - b) / 4e-4;
            up.rgb.iter().zip(&down.rgb).map(square).sum::<f64>() / 144.0
        };
        let length = 0.95f32.sqrt();
        let mut want = 0.0;
        for k in 0..3 {
            want += change(&|s, d| s.log_scales.iter_mut().for_each(|l| l[k] += d));
            // q (1, d/2 e_k): a turn by d about the Gaussian's own axis k.
            want += change(&|s, d| {
                for q in &mut s.rotations {
                    let [w, x, y, z] = q.map(|v| v / length);
                    let h = 0.5 * d;
                    let turn = [
                        [-x * h, w * h, z * h, -y * h],
                        [-y * h, -z * h, w * h, x * h],
                        [-z * h, y * h, -x * h, w * h],
                    ][k];
                    *q = [w + turn[0], x + turn[1], y + turn[2], z + turn[3]];
                }
            });
        }
        assert!((mean / want - 1.0).abs() < 0.25, "estimate {mean}, differences {want}");
    }
}
