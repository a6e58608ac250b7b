//! Shared by the tests: random scenes and the f64 oracle.
#![allow(
    dead_code,
    unreachable_pub,
    clippy::disallowed_methods,
    reason = "each test binary uses a part"
)]

pub mod oracle;

use gs_model::{Camera, Scene};
pub use testing::Rng;

/// A camera at the origin that looks along +z, slightly turned and off centre.
pub fn camera(width: u32, height: u32) -> Camera {
    let turn = glam::DQuat::from_euler(glam::EulerRot::XYZ, 0.05, -0.08, 0.03);
    Camera {
        name: "test".into(),
        width,
        height,
        fx: f64::from(width) * 0.9,
        fy: f64::from(width) * 0.95,
        cx: f64::from(width) * 0.5 + 1.3,
        cy: f64::from(height) * 0.5 - 0.7,
        rotation: glam::DMat3::from_quat(turn),
        translation: glam::DVec3::new(0.1, -0.05, 0.2),
        lens: None,
        near: gs_model::NEAR,
    }
}

/// `n` anisotropic, rotated, overlapping Gaussians in front of [`camera`], quaternions not
/// normalised; every fifth one beyond the frustum clamp but large enough to be seen.
pub fn scene(n: usize, degree: u8, seed: u64) -> Scene {
    let mut r = Rng::seeded(seed);
    let mut s = Scene { sh_degree: degree, ..Scene::default() };
    for i in 0..n {
        let z = r.range(2.0, 6.0);
        let (x, size) = match i % 5 {
            4 => (z * 0.95, 0.5),
            _ => (z * r.range(-0.5, 0.5), 0.12),
        };
        s.means.push([x as f32, (z * r.range(-0.4, 0.4)) as f32, z as f32]);
        s.rotations.push([
            r.range_f32(-2.0, 2.0),
            r.range_f32(-2.0, 2.0),
            r.range_f32(-2.0, 2.0),
            r.range_f32(0.1, 2.0),
        ]);
        let l = (size * z / 3.0).ln();
        s.log_scales.push([0, 1, 2].map(|_| (l + r.range(-1.2, 0.7)) as f32));
        s.opacity_logits.push(r.range_f32(-2.0, 3.0));
        for k in 0..s.sh_len() {
            let a = if k == 0 { 1.0 } else { 0.3 };
            s.sh.push([r.range_f32(-a, a), r.range_f32(-a, a), r.range_f32(-a, a)]);
        }
    }
    s
}

/// A noisy photo of 8 bits.
pub fn photo(width: u32, height: u32, seed: u64) -> finetune::Photo {
    let mut r = Rng::seeded(seed);
    let mut image = finetune::Image::new(width, height);
    image.rgb.iter_mut().for_each(|v| *v = r.range_f32(0.0, 1.0));
    finetune::Photo::from(&image)
}

/// The loss at one view with means that move, and the gradient of each Gaussian.
pub fn gradients(
    scene: &Scene,
    view: finetune::TrainView,
    loss: finetune::Loss,
    options: &finetune::RenderOptions,
) -> (f64, Vec<finetune::ParameterGradient>) {
    let mut views = finetune::ViewGradients::new(vec![view], loss, options).unwrap();
    views.move_means(true);
    let loss = views.run(scene, 0).loss;
    (loss, (0..scene.len()).map(|i| views.of(scene, i).unwrap_or_default()).collect())
}
