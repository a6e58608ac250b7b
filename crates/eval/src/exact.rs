//! A rasterizer in f64, Gaussian by Gaussian and pixel by pixel: what the one of the crate finetune is measured against.
//! It is written from the equations (Zwicker et al. 2001; Kerbl et al. 2023), and shares no code with the other.

use finetune::Image;
use gs_model::{Camera, Scene};
use nalgebra::{Matrix2, Matrix2x3, Matrix3, Quaternion, UnitQuaternion, Vector3};

/// Where blending ends.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cuts {
    /// A Gaussian with less alpha does not change a pixel.
    alpha: f64,
    /// A pixel with less transmittance is finished.
    transmittance: f64,
}

impl Cuts {
    /// Those of 3DGS.
    pub(crate) const INRIA: Self = Self { alpha: 1.0 / 255.0, transmittance: 1e-4 };
    /// Next to none.
    pub(crate) const NONE: Self = Self { alpha: 1e-9, transmittance: 1e-12 };
}

/// Pixels squared by which a Gaussian is blurred.
const BLUR: f64 = 0.3;
const MOST_ALPHA: f64 = 0.99;
/// The projection is linearised at most this share of the image beyond its edge.
const BEYOND: f64 = 0.15;

/// A Gaussian in the image.
struct Splat {
    depth: f64,
    at: [f64; 2],
    conic: Matrix2<f64>,
    /// Pixels along each axis at which alpha is at the cut.
    reach: [f64; 2],
    opacity: f64,
    rgb: [f64; 3],
}

/// Renders a scene on black. The result is rounded to f32.
pub(crate) fn render(scene: &Scene, camera: &Camera, cuts: Cuts) -> Image {
    let mut splats: Vec<Splat> =
        (0..scene.len()).filter_map(|i| Splat::of(scene, i, camera, cuts)).collect();
    splats.sort_by(|a, b| a.depth.total_cmp(&b.depth));
    let (w, h) = (camera.width as usize, camera.height as usize);
    let mut pixels = vec![([0.0; 3], 1.0f64); w * h];
    for splat in &splats {
        let span = |k: usize, limit: usize| {
            let end = |sign: f64| (splat.at[k] + sign * splat.reach[k]).clamp(0.0, limit as f64);
            end(-1.0).floor() as usize..end(1.0).ceil() as usize
        };
        for y in span(1, h) {
            for x in span(0, w) {
                splat.blend(&mut pixels[y * w + x], [x, y], cuts);
            }
        }
    }
    let rgb = pixels.iter().flat_map(|(rgb, _)| rgb.map(|v| v as f32)).collect();
    Image { width: camera.width, height: camera.height, rgb }
}

impl Splat {
    fn of(scene: &Scene, i: usize, camera: &Camera, cuts: Cuts) -> Option<Self> {
        let view = Matrix3::from_column_slice(&camera.rotation.to_cols_array());
        let eye = Vector3::from(camera.position().to_array());
        let from_eye = Vector3::from(scene.means[i].map(f64::from)) - eye;
        let mean = view * from_eye;
        let depth = mean.z;
        if depth <= camera.near {
            return None;
        }
        let slope = |along: f64, focal: f64, centre: f64, size: u32| {
            let end = |share: f64| (share * f64::from(size) - centre) / focal;
            (along / depth).clamp(end(-BEYOND), end(1.0 + BEYOND))
        };
        let u = slope(mean.x, camera.fx, camera.cx, camera.width);
        let v = slope(mean.y, camera.fy, camera.cy, camera.height);
        let jacobian =
            Matrix2x3::new(camera.fx, 0.0, -camera.fx * u, 0.0, camera.fy, -camera.fy * v) / depth;
        let [qw, qx, qy, qz] = scene.rotations[i].map(f64::from);
        let turn = UnitQuaternion::from_quaternion(Quaternion::new(qw, qx, qy, qz));
        let scales = Vector3::from(scene.log_scales[i].map(|s| libm::exp(f64::from(s))));
        let half =
            jacobian * view * turn.to_rotation_matrix().matrix() * Matrix3::from_diagonal(&scales);
        let covariance = half * half.transpose() + BLUR * Matrix2::identity();
        let opacity = 1.0 / (1.0 + libm::exp(-f64::from(scene.opacity_logits[i])));
        let sigma = libm::log(opacity / cuts.alpha);
        if sigma <= 0.0 {
            return None;
        }
        let reach = [0, 1].map(|k| (2.0 * sigma * covariance[(k, k)]).sqrt() + 1.0);
        Some(Self {
            depth,
            at: [camera.fx * mean.x / depth + camera.cx, camera.fy * mean.y / depth + camera.cy],
            conic: covariance.try_inverse()?,
            reach,
            opacity,
            rgb: colour(scene.sh_of(i), from_eye.normalize()),
        })
    }

    fn blend(&self, (rgb, t): &mut ([f64; 3], f64), pixel: [usize; 2], cuts: Cuts) {
        let [dx, dy] = [0, 1].map(|k| pixel[k] as f64 + 0.5 - self.at[k]);
        let m = &self.conic;
        let sigma = 0.5 * (m.m11 * dx * dx + m.m22 * dy * dy) + m.m12 * dx * dy;
        let alpha = (self.opacity * libm::exp(-sigma)).min(MOST_ALPHA);
        if *t < 0.0 || alpha < cuts.alpha {
            return;
        }
        let left = *t * (1.0 - alpha);
        if left < cuts.transmittance {
            // Finished: what is behind does not show.
            *t = -1.0;
            return;
        }
        (0..3).for_each(|c| rgb[c] += *t * alpha * self.rgb[c]);
        *t = left;
    }
}

/// The colour that coefficients have in a direction.
fn colour(sh: &[[f32; 3]], d: Vector3<f64>) -> [f64; 3] {
    let (x, y, z) = (d.x, d.y, d.z);
    let basis = [
        0.282_094_791_773_878_14,
        -0.488_602_511_902_919_9 * y,
        0.488_602_511_902_919_9 * z,
        -0.488_602_511_902_919_9 * x,
        1.092_548_430_592_079_2 * x * y,
        -1.092_548_430_592_079_2 * y * z,
        0.315_391_565_252_520_05 * (2.0 * z * z - x * x - y * y),
        -1.092_548_430_592_079_2 * x * z,
        0.546_274_215_296_039_6 * (x * x - y * y),
        -0.590_043_589_926_643_5 * y * (3.0 * x * x - y * y),
        2.890_611_442_640_554 * x * y * z,
        -0.457_045_799_464_465_8 * y * (4.0 * z * z - x * x - y * y),
        0.373_176_332_590_115_4 * z * (2.0 * z * z - 3.0 * x * x - 3.0 * y * y),
        -0.457_045_799_464_465_8 * x * (4.0 * z * z - x * x - y * y),
        1.445_305_721_320_277 * z * (x * x - y * y),
        -0.590_043_589_926_643_5 * x * (x * x - 3.0 * y * y),
    ];
    [0, 1, 2].map(|c| {
        let sum: f64 = sh.iter().zip(&basis).map(|(sh, b)| b * f64::from(sh[c])).sum();
        (sum + 0.5).max(0.0)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rasterizer_agrees_with_the_equations_in_f64() {
        let scene = testing::trained_like(400, 3, &mut testing::Rng::seeded(7));
        let camera = finetune::framing::around(&scene, 1)[0].within(64 * 48);
        let exact = render(&scene, &camera, Cuts::INRIA);
        let shown = finetune::render(&scene, &camera, &finetune::RenderOptions::default());
        assert!(exact.rgb.iter().any(|&v| v > 0.2));
        let most = exact.rgb.iter().zip(&shown.rgb).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        // A Gaussian at the cut of alpha may count in one of the two alone.
        assert!(most < 1.5 / 255.0, "{most}");
        assert!(finetune::metrics::psnr(&shown, &exact) > 90.0);
    }
}
