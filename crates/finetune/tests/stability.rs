//! Stress inputs: no output of the rasterizer is NaN or infinite, and where the f64 oracle is finite
//! the image agrees with it. Prints its figures:
//! `cargo test -p finetune --test stability -- --nocapture --test-threads 1`.
#![allow(clippy::disallowed_methods, reason = "a test")]

mod common;

use common::oracle::{self, Parameters};
use finetune::{Loss, Photo, RenderOptions, TrainView, render};
use gs_model::{Camera, Scene};
use proptest::prelude::*;

fn straight(width: u32, height: u32, focal: f64) -> Camera {
    Camera {
        name: "stress".into(),
        width,
        height,
        fx: focal,
        fy: focal,
        cx: f64::from(width) / 2.0,
        cy: f64::from(height) / 2.0,
        rotation: glam::DMat3::IDENTITY,
        translation: glam::DVec3::ZERO,
        lens: None,
        near: gs_model::NEAR,
    }
}

fn one(mean: [f32; 3], rotation: [f32; 4], log_scale: [f32; 3], logit: f32) -> Scene {
    Scene {
        means: vec![mean],
        rotations: vec![rotation],
        log_scales: vec![log_scale],
        opacity_logits: vec![logit],
        sh_degree: 0,
        sh: vec![[1.2, 0.3, -0.4]],
        ..Scene::default()
    }
}

fn append(all: &mut Scene, s: Scene) {
    all.means.extend(s.means);
    all.rotations.extend(s.rotations);
    all.log_scales.extend(s.log_scales);
    all.opacity_logits.extend(s.opacity_logits);
    all.sh.extend(s.sh);
}

fn together(list: impl IntoIterator<Item = Scene>) -> Scene {
    let mut all = Scene::default();
    list.into_iter().for_each(|s| append(&mut all, s));
    all
}

/// Renders, takes all gradients of both losses, checks that everything is finite. Returns the
/// largest gradient.
fn finite_everywhere(name: &str, scene: &Scene, camera: &Camera) -> f32 {
    let options = RenderOptions { background: [0.2, 0.3, 0.4], ..RenderOptions::default() };
    let image = render(scene, camera, &options);
    assert!(image.rgb.iter().all(|v| v.is_finite()), "{name}: image");
    let mut photo = Photo::black(camera.width, camera.height);
    photo.rgb.iter_mut().enumerate().for_each(|(i, v)| *v = (i % 7 * 36) as u8);
    let mut largest = 0.0f32;
    for loss in [Loss::MSE, Loss::L1_SSIM] {
        let view = TrainView { camera: camera.clone(), photo: photo.clone() };
        let (value, gradients) = common::gradients(scene, view, loss, &options);
        assert!(value.is_finite(), "{name}: loss {value}");
        for g in gradients {
            let all = g.sh.as_flattened().iter().chain([&g.opacity_logit]).chain(&g.log_scale);
            for v in all.chain(&g.rotation).chain(&g.mean) {
                assert!(v.is_finite(), "{name}: gradient {v}");
                largest = largest.max(v.abs());
            }
        }
    }
    largest
}

/// Worst difference from the oracle outside doubtful pixels, and how many those are.
fn against_oracle(scene: &Scene, camera: &Camera) -> (f64, usize) {
    let (worst, _, doubtful) = all_pixels(scene, camera);
    (worst, doubtful)
}

/// As [`against_oracle`], with the worst difference over all pixels as the second value.
fn all_pixels(scene: &Scene, camera: &Camera) -> (f64, f64, usize) {
    let background = [0.2f32, 0.3, 0.4];
    let options = RenderOptions { background, ..RenderOptions::default() };
    let image = render(scene, camera, &options);
    let wanted = oracle::render(&Parameters::of(scene), camera, background.map(f64::from), None);
    let (mut worst, mut anywhere) = (0.0f64, 0.0f64);
    for (k, (a, b)) in image.rgb.iter().zip(&wanted.rgb).enumerate() {
        let difference = (f64::from(*a) - b).abs();
        anywhere = anywhere.max(difference);
        if !wanted.doubtful[k / 3] {
            worst = worst.max(difference);
        }
    }
    (worst, anywhere, wanted.doubtful.iter().filter(|&&d| d).count())
}

fn row(name: &str, scene: &Scene, camera: &Camera, bound: f64) {
    let largest = finite_everywhere(name, scene, camera);
    let (worst, doubtful) = against_oracle(scene, camera);
    let n = scene.len();
    println!("| {name} | {n} | {worst:.1e} | {bound:.0e} | {doubtful} | {largest:.1e} |");
    assert!(worst < bound, "{name}: {worst} from the oracle");
}

const IDENTITY: [f32; 4] = [1.0, 0.0, 0.0, 0.0];
const TURNED: [f32; 4] = [0.8, 0.2, -0.3, 0.45];

#[test]
fn stress_table() {
    println!(
        "| input | Gaussians | worst difference from f64 | bound | doubtful pixels | largest gradient |"
    );
    println!("|---|---|---|---|---|---|");
    let view = straight(64, 48, 60.0);
    let needles = (0..40).map(|i| {
        let a = i as f32 * 0.08;
        let q = [a.cos(), 0.3 * a.sin(), 0.2, a.sin()];
        one([0.1 * (i % 5) as f32, 0.02 * i as f32 - 0.4, 4.0], q, [4.6, -9.2, -9.2], 1.0)
    });
    row("needles, scale ratio 1e6, across the image", &together(needles), &view, 2e-3);
    let needle = |i: usize| {
        let (mut l, k) = ([-13.0f32; 3], i % 3);
        l[k] = 0.8;
        one([0.3, -0.2, 3.0], [0.9, 0.1 * i as f32, 0.2, -0.3], l, 2.0)
    };
    row("needles, scale ratio 1e6, within the image", &together((0..9).map(needle)), &view, 1e-4);
    let scales = (-12..=6).map(|e: i32| {
        let l = 10f32.powi(e).ln();
        one([0.05 * e as f32, 0.1, 5.0], TURNED, [l, l - 0.5, l + 0.3], -1.0)
    });
    row("scales 1e-12 to 1e6", &together(scales), &view, 1e-4);
    let logits = [-1e4, -88.0, -6.0, -5.5, 0.0, 5.0, 17.0, 88.0, 1e4];
    let opacity = logits.iter().enumerate().map(|(i, &o)| {
        one([0.25 * i as f32 - 1.0, 0.0, 3.0 + 0.1 * i as f32], TURNED, [-1.5; 3], o)
    });
    row("opacity logits -1e4 to 1e4", &together(opacity), &view, 1e-5);
    let norms = [1e-18f32, 1e-10, 1e-3, 1.0, 1e3, 1e10, 1e18];
    let rotations = norms.iter().enumerate().map(|(i, &n)| {
        let q = TURNED.map(|c| c * n);
        one([0.3 * i as f32 - 1.0, 0.2, 4.0], q, [-1.0, -2.0, -3.0], 0.5)
    });
    row("quaternion norms 1e-18 to 1e18", &together(rotations), &view, 1e-5);
    let near = [0.199, 0.2, 0.200_000_02, 0.201, 0.25]
        .iter()
        .map(|&z| one([0.3 * z, -0.2 * z, z], TURNED, [-3.0; 3], -0.5));
    row("at the near plane", &together(near), &view, 1e-4);
    let behind = (0..10).map(|i| one([0.0, 0.0, -(i as f32)], TURNED, [0.5; 3], 3.0));
    row("behind the camera", &together(behind), &view, 1e-9);
    let mut far = straight(64, 48, 60.0);
    far.translation = glam::DVec3::new(-1e6, 0.0, 0.0);
    let at = |dx: f32, z: f32| one([1e6 + dx, 0.5, z], TURNED, [-0.5; 3], 0.5);
    row(
        "scene at 1e6 units, camera beside it",
        &together([at(0.0, 4.0), at(1.0, 5.0)]),
        &far,
        1e-5,
    );
    let sky = |x: f32| one([x, 0.2e6, 1e6], TURNED, [12.0; 3], 0.5);
    row("Gaussians 1e6 units away", &together([sky(0.0), sky(2e5)]), &view, 1e-5);
    let ties = (0..5000).map(|i| {
        let (x, y) = ((i % 71) as f32 / 35.0 - 1.0, (i / 71) as f32 / 35.0 - 1.0);
        one([x, y, 2.0], IDENTITY, [-3.0, -3.5, -4.0], 2.0)
    });
    row("5000 exact depth ties", &together(ties), &straight(32, 32, 28.0), 1e-5);
}

#[test]
fn a_hundred_thousand_layers_in_one_pixel() {
    let mut scene = Scene::default();
    for i in 0..100_000 {
        // Opacities just above the cut, so that thousands count before the pixel is full.
        let z = 1.0 + (i % 977) as f32;
        append(&mut scene, one([0.0, 0.0, z], IDENTITY, [-2.0; 3], -5.5));
    }
    for (w, h) in [(1, 1), (17, 3)] {
        finite_everywhere("layers", &scene, &straight(w, h, 0.1));
    }
    let few = scene.select(&(0..6000).collect::<Vec<_>>());
    // Whether layer 2265 or 2266 is the last makes no visible difference: no pixel is excused.
    let (_, worst, _) = all_pixels(&few, &straight(1, 1, 0.1));
    println!("6000 layers of alpha 1/245 in one pixel: {worst:.1e} from the oracle");
    assert!(worst < 1e-4, "{worst}");
}

#[test]
fn extreme_image_shapes() {
    let scene = common::scene(50, 3, 4);
    for (w, h) in [(1, 1), (1, 4096), (4096, 1), (16, 16), (17, 15), (2, 33)] {
        let camera = straight(w, h, 40.0);
        finite_everywhere("shape", &scene, &camera);
        let (worst, _) = against_oracle(&scene, &camera);
        println!("{w}x{h}: {worst:.1e} from the oracle");
        assert!(worst < 1e-5, "{w}x{h}: {worst}");
    }
    for (w, h) in [(0, 0), (0, 7), (7, 0)] {
        let image = render(&scene, &straight(w, h, 40.0), &RenderOptions::default());
        assert!(image.rgb.is_empty());
    }
}

#[test]
fn degenerate_cameras_and_broken_scenes() {
    let scene = common::scene(50, 2, 8);
    let base = straight(40, 30, 35.0);
    let mut cameras = Vec::new();
    for f in [0.0, -30.0, 1e-30, 1e30, f64::NAN, f64::INFINITY] {
        cameras.push(Camera { fx: f, ..base.clone() });
        cameras.push(Camera { fx: f, fy: f, ..base.clone() });
        cameras.push(Camera { cx: f, cy: f, ..base.clone() });
        cameras.push(Camera { translation: glam::DVec3::splat(f), ..base.clone() });
    }
    cameras.push(Camera { rotation: glam::DMat3::ZERO, ..base.clone() });
    cameras.push(Camera { rotation: glam::DMat3::from_diagonal([1e20; 3].into()), ..base.clone() });
    for (k, camera) in cameras.iter().enumerate() {
        finite_everywhere(&format!("camera {k}"), &scene, camera);
    }
    // A camera at the position of a mean.
    let mut inside = base.clone();
    inside.translation = -glam::DVec3::from(scene.means[0].map(f64::from));
    finite_everywhere("inside", &scene, &inside);
    let mut short = scene.clone();
    short.sh.pop();
    let empty = render(&Scene::default(), &base, &RenderOptions::default());
    assert_eq!(render(&short, &base, &RenderOptions::default()), empty);
}

/// Any bit pattern, NaN and infinity included, weighted towards plausible values.
fn number() -> impl Strategy<Value = f32> {
    prop_oneof![
        4 => -3.0f32..3.0,
        1 => any::<u32>().prop_map(f32::from_bits),
        1 => prop_oneof![
            Just(f32::NAN),
            Just(f32::INFINITY),
            Just(f32::NEG_INFINITY),
            Just(f32::MAX),
            Just(-f32::MAX),
            Just(1e-40f32),
            Just(0.0f32),
            Just(40.0f32),
            Just(88.8f32),
        ],
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn poisoned_inputs_stay_inside(values in prop::collection::vec(number(), 14 * 12)) {
        let mut scene = Scene { sh_degree: 0, ..Scene::default() };
        for v in values.chunks_exact(14) {
            scene.means.push([v[0], v[1], v[2]]);
            scene.rotations.push([v[3], v[4], v[5], v[6]]);
            scene.log_scales.push([v[7], v[8], v[9]]);
            scene.opacity_logits.push(v[10]);
            scene.sh.push([v[11], v[12], v[13]]);
        }
        // One good Gaussian among them, so that something is drawn.
        append(&mut scene, one([0.0, 0.0, 1.0], IDENTITY, [-1.0; 3], 1.0));
        let camera = straight(20, 20, 15.0);
        let image = render(&scene, &camera, &RenderOptions::default());
        prop_assert!(image.rgb.iter().all(|v| v.is_finite()));
        // Finite colours only: the loss against a colour of 1e38 is infinite by definition.
        if image.rgb.iter().all(|v| v.abs() < 1e3) {
            finite_everywhere("poisoned", &scene, &camera);
        }
    }
}
