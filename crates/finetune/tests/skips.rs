//! Everything that the rasterizer skips has no effect: each skip against the full computation.

mod common;

use finetune::{RenderOptions, Visibility, render};
use gs_model::Scene;

fn cameras() -> Vec<gs_model::Camera> {
    (0..3)
        .map(|i| {
            let mut c = common::camera(90, 70);
            c.translation.x += 0.4 * f64::from(i);
            c
        })
        .collect()
}

/// A scene with invisible Gaussians: behind the camera, transparent, covered.
fn crowded() -> Scene {
    let mut s = common::scene(400, 2, 3);
    for i in 0..400 {
        match i % 7 {
            0 => s.means[i][2] = -3.0,
            1 => s.opacity_logits[i] = -9.0,
            2 => s.means[i][0] = 90.0,
            _ => {}
        }
    }
    s
}

#[test]
fn gaussians_without_weight_can_be_dropped() {
    let (scene, cameras) = (crowded(), cameras());
    let weights = Visibility::of_all(&scene, &cameras).total;
    let kept: Vec<usize> = (0..scene.len()).filter(|&i| weights[i] > 0.0).collect();
    assert!(kept.len() < 300 && kept.len() > 100, "{}", kept.len());
    let less = scene.select(&kept);
    for camera in &cameras {
        let options = RenderOptions { background: [0.1, 0.5, 0.2], ..Default::default() };
        assert_eq!(render(&scene, camera, &options), render(&less, camera, &options));
    }
    // The weights of the others stay the same.
    let again = Visibility::of_all(&less, &cameras).total;
    assert!(kept.iter().zip(&again).all(|(&i, w)| weights[i].to_bits() == w.to_bits()));
}

#[test]
fn visibility_adds_the_views_up() {
    let (scene, cameras) = (crowded(), cameras());
    let all = Visibility::of_all(&scene, &cameras);
    let each: Vec<_> =
        cameras.iter().map(|c| Visibility::of_all(&scene, std::slice::from_ref(c))).collect();
    for i in 0..scene.len() {
        assert_eq!(all.total[i], each[0].total[i] + each[1].total[i] + each[2].total[i]);
        assert_eq!(all.squared[i], each[0].squared[i] + each[1].squared[i] + each[2].squared[i]);
    }
}

#[test]
fn missing_sh_bands_are_zero_bands() {
    for degree in 0..3u8 {
        let low = common::scene(200, degree, 6);
        let mut high = Scene { sh_degree: 3, sh: Vec::new(), ..low.clone() };
        for i in 0..low.len() {
            let mut sh = low.sh_of(i).to_vec();
            sh.resize(16, [0.0; 3]);
            high.sh.extend(sh);
        }
        let camera = common::camera(60, 50);
        let options = RenderOptions::default();
        assert_eq!(render(&low, &camera, &options), render(&high, &camera, &options));
    }
}

#[test]
fn renders_do_not_depend_on_the_number_of_threads() {
    let scene = common::scene(500, 3, 2);
    let camera = common::camera(120, 90);
    let images: Vec<_> = [1, 2, 8]
        .into_iter()
        .map(|n| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
            pool.install(|| render(&scene, &camera, &RenderOptions::default()))
        })
        .collect();
    assert_eq!(images[0], images[1]);
    assert_eq!(images[0], images[2]);
}
