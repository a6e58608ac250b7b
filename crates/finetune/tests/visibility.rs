#![allow(clippy::disallowed_methods, reason = "a test of a rasterizer, not of a bitstream")]
//! Blending weights: their sum is the image, and their squares are its energy.

use finetune::{RenderOptions, Visibility, removal, render};
use glam::{DMat3, DVec3};
use gs_model::{Camera, SH_C0, Scene};

fn camera() -> Camera {
    Camera {
        name: "test".into(),
        width: 50,
        height: 40,
        fx: 45.0,
        fy: 45.0,
        cx: 25.0,
        cy: 20.0,
        rotation: DMat3::IDENTITY,
        translation: DVec3::new(0.0, 0.0, 4.0),
        lens: None,
        near: gs_model::NEAR,
    }
}

/// White Gaussians in a small cloud.
fn scene(n: usize) -> Scene {
    let mut seed = 1u32;
    let mut unit = || {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (seed >> 8) as f32 / (1 << 23) as f32 - 1.0
    };
    let mut scene = Scene::default();
    for _ in 0..n {
        scene.means.push([unit(), unit(), unit()]);
        scene.rotations.push([1.0, unit(), unit(), unit()]);
        scene.log_scales.push([-2.0 + unit(), -2.0 + unit(), -2.0 + unit()]);
        scene.opacity_logits.push(3.0 * unit());
        scene.sh.push([0.5 / SH_C0; 3]);
    }
    scene
}

// With every colour 1 a pixel is the sum of its weights.
#[test]
fn weights_add_up_to_the_white_image() {
    let (scene, camera) = (scene(60), camera());
    let image = render(&scene, &camera, &RenderOptions::default());
    let pixels: f64 = image.rgb.iter().step_by(3).map(|&v| f64::from(v)).sum();
    let found = Visibility::of_all(&scene, &[camera]);
    let total: f64 = found.total.iter().map(|&v| f64::from(v)).sum();
    assert!(pixels > 100.0 && (pixels - total).abs() < 1e-4 * pixels, "{pixels} {total}");
}

// If only one Gaussian is white and all others are black, each pixel is its weight, so the squared
// image is the sum of its squared weights.
#[test]
fn squares_are_the_energy_of_one_gaussian() {
    let (white, camera) = (scene(25), camera());
    let found = Visibility::of_all(&white, std::slice::from_ref(&camera));
    for i in 0..white.len() {
        let mut one = white.clone();
        for (k, sh) in one.sh.iter_mut().enumerate() {
            *sh = [if k == i { 0.5 } else { -0.5 } / SH_C0; 3];
        }
        let image = render(&one, &camera, &RenderOptions::default());
        let energy: f64 = image.rgb.iter().step_by(3).map(|&v| f64::from(v).powi(2)).sum();
        let squared = f64::from(found.squared[i]);
        assert!((energy - squared).abs() <= 1e-4 * (energy + 1e-3), "{i}: {energy} {squared}");
        assert!(found.squared[i] <= found.total[i]);
    }
}

// The points of one view lie between those of another, so that many looks at one large view see all of its pixels.
#[test]
fn a_large_view_weighs_as_many_pixels_as_it_has() {
    const LOOKS: usize = 16;
    let scene = scene(25);
    let large = camera().scaled_to(500, 400).unwrap();
    let exact = removal(&scene, std::slice::from_ref(&large), |_| ()).squared;
    let sampled = Visibility::of_all(&scene, &vec![large; LOOKS]).squared;
    for (i, (exact, sampled)) in exact.into_iter().zip(sampled).enumerate() {
        let mean = sampled / LOOKS as f32;
        assert!((mean - exact).abs() <= 0.05 * exact + 1.0, "{i}: {exact} {mean}");
    }
}

// However large the one view is.
#[test]
fn a_small_gaussian_is_not_missed_between_samples() {
    let mut scene = scene(400);
    scene.log_scales.fill([-9.0; 3]);
    scene.opacity_logits.fill(-2.0);
    for size in [[250, 200], [500, 400], [4000, 3200]] {
        let view = camera().scaled_to(size[0], size[1]).unwrap();
        let unseen = Visibility::of_all(&scene, &[view]).unseen();
        assert_eq!(unseen, 0, "{size:?}");
    }
}

// The sum of squares of the difference between two renders is the definition. Where a Gaussian is opaque
// enough to stop a pixel, the effect leaves out what lies beyond; none of these does.
#[test]
fn removal_effects_are_differences_of_renders_and_weights_those_of_visibility() {
    let (mut whole, camera) = (scene(25), camera());
    for (i, sh) in whole.sh.iter_mut().enumerate() {
        *sh = [0.0, 1.0, 2.0].map(|c| libm::sinf(c + 1.7 * i as f32) / SH_C0 * 0.4);
    }
    let options = RenderOptions::default();
    let image = render(&whole, &camera, &options);
    let found = removal(&whole, std::slice::from_ref(&camera), |seen| assert_eq!(seen, image));
    let squared = Visibility::of_all(&whole, std::slice::from_ref(&camera)).squared;
    for (i, &effect) in found.effects.iter().enumerate() {
        assert!((found.squared[i] - squared[i]).abs() <= 1e-4 * squared[i], "{i}");
        let others: Vec<usize> = (0..whole.len()).filter(|&j| j != i).collect();
        let without = render(&whole.select(&others), &camera, &options);
        let pairs = image.rgb.iter().zip(&without.rgb);
        let want: f64 = pairs.map(|(a, b)| f64::from(a - b).powi(2)).sum();
        assert!((want - f64::from(effect)).abs() <= 1e-3 * (want + 1e-3), "{i}: {want} {effect}");
    }
    assert!(found.effects.iter().filter(|&&e| e > 0.01).count() > 10, "{found:?}");
}
