//! The scene of the benchmarks.

use finetune::{Photo, RenderOptions, render};
use gs_model::{Camera, Scene};

use crate::common;

/// The scene of the benchmarks: 100,000 Gaussians, SH degree 3, 480x320.
pub(crate) fn setup() -> (Scene, Camera, Photo) {
    let mut r = common::Rng::seeded(1);
    let mut scene = Scene { sh_degree: 3, ..Scene::default() };
    for _ in 0..100_000 {
        let z = r.range(2.0, 10.0);
        let (x, y) = (z * r.range(-0.6, 0.6), z * r.range(-0.42, 0.42));
        scene.means.push([x as f32, y as f32, z as f32]);
        scene.rotations.push([0; 4].map(|_| r.range_f32(-1.0, 1.0)));
        // Log-normal sizes.
        let mut log_scale = || {
            let sum: f64 = (0..6).map(|_| r.range(-1.0, 1.0)).sum();
            (-3.9 + 0.35 * sum) as f32
        };
        scene.log_scales.push([log_scale(), log_scale(), log_scale()]);
        scene.opacity_logits.push(r.range_f32(-3.0, 3.0));
        for k in 0..16 {
            let a = if k == 0 { 1.5 } else { 0.1 };
            scene.sh.push([0; 3].map(|_| r.range_f32(-a, a)));
        }
    }
    let camera = Camera {
        name: "bench".into(),
        width: 480,
        height: 320,
        fx: 400.0,
        fy: 400.0,
        cx: 240.0,
        cy: 160.0,
        rotation: glam::DMat3::IDENTITY,
        translation: glam::DVec3::ZERO,
        lens: None,
        near: gs_model::NEAR,
    };
    let photo = Photo::from(&render(&scene, &camera, &RenderOptions::default()));
    scene.sh.iter_mut().flatten().for_each(|v| *v += r.range_f32(-0.1, 0.1));
    (scene, camera, photo)
}
