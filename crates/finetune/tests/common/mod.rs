//! Shared by the tests: random scenes and the f64 oracle.
#![allow(
    dead_code,
    unreachable_pub,
    clippy::disallowed_methods,
    reason = "each test binary uses a part"
)]

pub mod oracle;

use gs_model::{Camera, Scene};

/// A small generator (SplitMix64) so that scenes are the same everywhere.
pub struct Rng(pub u64);

impl Rng {
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in low..high.
    pub fn range(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    pub fn f(&mut self, low: f64, high: f64) -> f32 {
        self.range(low, high) as f32
    }
}

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
        ignored_distortion: None,
    }
}

/// `n` anisotropic, rotated, overlapping Gaussians in front of [`camera`], quaternions not
/// normalised; every fifth one beyond the frustum clamp but large enough to be seen.
pub fn scene(n: usize, degree: u8, seed: u64) -> Scene {
    let mut r = Rng(seed);
    let mut s = Scene { sh_degree: degree, ..Scene::default() };
    for i in 0..n {
        let z = r.range(2.0, 6.0);
        let (x, size) = match i % 5 {
            4 => (z * 0.95, 0.5),
            _ => (z * r.range(-0.5, 0.5), 0.12),
        };
        s.means.push([x as f32, (z * r.range(-0.4, 0.4)) as f32, z as f32]);
        s.rotations.push([r.f(-2.0, 2.0), r.f(-2.0, 2.0), r.f(-2.0, 2.0), r.f(0.1, 2.0)]);
        let l = (size * z / 3.0).ln();
        s.log_scales.push([0, 1, 2].map(|_| (l + r.range(-1.2, 0.7)) as f32));
        s.opacity_logits.push(r.f(-2.0, 3.0));
        for k in 0..s.sh_len() {
            let a = if k == 0 { 1.0 } else { 0.3 };
            s.sh.push([r.f(-a, a), r.f(-a, a), r.f(-a, a)]);
        }
    }
    s
}

/// A noisy photo.
pub fn photo(width: u32, height: u32, seed: u64) -> finetune::Image {
    let mut r = Rng(seed);
    let mut image = finetune::Image::new(width, height);
    image.rgb.iter_mut().for_each(|v| *v = r.f(0.0, 1.0));
    image
}
