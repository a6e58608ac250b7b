//! The executor against the f64 oracle: images, and gradients by central differences.

mod common;

use common::oracle::{self, Parameters};
use finetune::{Loss, ParameterGradient, RenderOptions, TrainView, render};
use gs_model::{Camera, Scene};

/// Largest difference outside doubtful pixels; fails if more than one pixel in 100 is doubtful.
fn worst_difference(scene: &Scene, camera: &Camera, background: [f32; 3]) -> f64 {
    let options = RenderOptions { background, ..RenderOptions::default() };
    let image = render(scene, camera, &options);
    let wanted = oracle::render(&Parameters::of(scene), camera, background.map(f64::from), None);
    let doubtful = wanted.doubtful.iter().filter(|&&d| d).count();
    assert!(doubtful * 100 <= wanted.doubtful.len() * 3, "{doubtful} doubtful pixels");
    let mut worst = 0.0f64;
    for (k, (a, b)) in image.rgb.iter().zip(&wanted.rgb).enumerate() {
        if !wanted.doubtful[k / 3] {
            worst = worst.max((f64::from(*a) - b).abs());
        }
    }
    worst
}

#[test]
fn images_agree() {
    for degree in 0..=3 {
        for seed in 0..4 {
            let scene = common::scene(60, degree, seed);
            let worst = worst_difference(&scene, &common::camera(83, 61), [0.2, 0.5, 0.9]);
            println!("degree {degree} seed {seed}: {worst:.2e}");
            assert!(worst < 1e-5, "degree {degree}, seed {seed}: {worst}");
        }
    }
}

#[test]
fn images_of_antialiased_models_agree() {
    for seed in 0..4 {
        let mut scene = antialiased(common::scene(60, 1, seed));
        let (camera, background) = (common::camera(83, 61), [0.2, 0.5, 0.9]);
        let worst = worst_difference(&scene, &camera, background);
        println!("seed {seed}: {worst:.2e}");
        assert!(worst < 1e-5, "seed {seed}: {worst}");
        let options = RenderOptions { background, ..RenderOptions::default() };
        let fine = render(&scene, &camera, &options);
        scene.antialiased = false;
        assert_ne!(fine, render(&scene, &camera, &options));
    }
}

/// The scene with Gaussians of about a pixel, for which the compensation matters.
fn antialiased(mut scene: Scene) -> Scene {
    scene.antialiased = true;
    for (scale, mean) in scene.log_scales.iter_mut().zip(&scene.means).step_by(2) {
        *scale = scale.map(|s| s - 1.8 - 0.1 * mean[2]);
    }
    scene
}

type Get = fn(&mut Parameters, usize) -> &mut f64;

/// Worst relative error of one class of gradients against central differences of the oracle
/// with frozen gates. Relative to the component, or to a hundredth of the largest component of
/// the class where the component is smaller: an f32 sum over pixels cannot do better.
fn class_error(
    name: &str,
    got: &[f32],
    base: &Parameters,
    get: Get,
    loss: &dyn Fn(&Parameters) -> f64,
) -> f64 {
    let h = 1e-5;
    let wanted: Vec<f64> = (0..got.len())
        .map(|i| {
            let mut p = base.clone();
            *get(&mut p, i) += h;
            let up = loss(&p);
            *get(&mut p, i) -= 2.0 * h;
            (up - loss(&p)) / (2.0 * h)
        })
        .collect();
    let largest = wanted.iter().fold(0.0f64, |a, b| a.max(b.abs()));
    assert!(largest > 0.0, "{name}: no gradient at all");
    let mut worst = 0.0f64;
    for (a, b) in got.iter().zip(&wanted) {
        worst = worst.max((f64::from(*a) - b).abs() / b.abs().max(0.01 * largest));
    }
    println!("{name}: worst relative error {worst:.2e}, largest gradient {largest:.2e}");
    worst
}

fn check_gradients(scene: &Scene, view: TrainView, loss: Loss) {
    let background = [0.3f32, 0.1, 0.6];
    let options = RenderOptions { background, ..RenderOptions::default() };
    let (camera, photo) = (&view.camera, &view.photo.image());
    let (value, got) = common::gradients(scene, view.clone(), loss, &options);
    let base = Parameters::of(scene);
    let background = background.map(f64::from);
    let gates = oracle::render(&base, camera, background, None).gates;
    let f = |p: &Parameters| {
        let rgb = oracle::render(p, camera, background, Some(&gates)).rgb;
        oracle::loss(&rgb, photo, loss)
    };
    assert!((value - f(&base)).abs() < 1e-5 * value, "loss {value}, oracle {}", f(&base));
    type Of = fn(&ParameterGradient) -> &[f32];
    let classes: [(&str, Of, Get); 5] = [
        ("sh", |g| g.sh.as_flattened(), |p, i| &mut p.sh[i / 3][i % 3]),
        ("opacity", |g| std::slice::from_ref(&g.opacity_logit), |p, i| &mut p.opacity_logits[i]),
        ("log-scale", |g| &g.log_scale, |p, i| &mut p.log_scales[i / 3][i % 3]),
        ("rotation", |g| &g.rotation, |p, i| &mut p.rotations[i / 4][i % 4]),
        ("mean", |g| &g.mean, |p, i| &mut p.means[i / 3][i % 3]),
    ];
    for (name, of, get) in classes {
        let len = if name == "sh" { 3 * scene.sh_len() } else { of(&got[0]).len() };
        let got: Vec<f32> = got.iter().flat_map(|g| &of(g)[..len]).copied().collect();
        let worst = class_error(name, &got, &base, get, &f);
        assert!(worst < 1e-4, "{name}: {worst}");
    }
}

#[test]
fn gradients_of_the_squared_error_agree_with_central_differences() {
    let scene = common::scene(12, 3, 7);
    let (camera, photo) = (common::camera(40, 30), common::photo(40, 30, 1));
    check_gradients(&scene, TrainView { camera, photo }, Loss::MSE);
}

#[test]
fn gradients_of_l1_and_ssim_agree_with_central_differences() {
    let scene = common::scene(8, 1, 11);
    let loss = Loss::L1_SSIM;
    let (camera, photo) = (common::camera(29, 21), common::photo(29, 21, 2));
    check_gradients(&scene, TrainView { camera, photo }, loss);
}

#[test]
fn gradients_of_the_squared_error_and_ssim_agree_with_central_differences() {
    let scene = common::scene(8, 1, 11);
    let (camera, photo) = (common::camera(29, 21), common::photo(29, 21, 2));
    check_gradients(&scene, TrainView { camera, photo }, Loss::mse_ssim(0.02));
}

#[test]
fn gradients_of_an_antialiased_model_agree_with_central_differences() {
    let scene = antialiased(common::scene(12, 1, 7));
    let (camera, photo) = (common::camera(40, 30), common::photo(40, 30, 1));
    check_gradients(&scene, TrainView { camera, photo }, Loss::MSE);
}
