//! Nothing that the command shows or says depends on the unit of the model.

mod common;

use common::Folder;
use gs_model::Scene;
use std::path::Path;

/// `scene` in a unit of which `scale` are one of its own.
fn scaled(scene: &Scene, scale: f32) -> Scene {
    let mut out = scene.clone();
    out.means.as_flattened_mut().iter_mut().for_each(|x| *x *= scale);
    let more = libm::log(f64::from(scale)) as f32;
    out.log_scales.as_flattened_mut().iter_mut().for_each(|s| *s += more);
    out
}

/// A ball of small Gaussians, closed, of radius 1, with a few large ones far away if it has a background.
fn ball(background: bool) -> Scene {
    let mut rng = testing::Rng::seeded(7);
    let mut scene = testing::trained_like(3000, 1, &mut rng);
    for (i, mean) in scene.means.iter_mut().enumerate() {
        let p: [f32; 3] = std::array::from_fn(|_| rng.signed() + 1e-3);
        let length = p.iter().map(|v| v * v).sum::<f32>().sqrt();
        let far = background && i % 20 == 0;
        *mean = p.map(|x| if far { 30.0 } else { 1.0 } * x / length);
        scene.log_scales[i] = [if far { 1.0 } else { -3.0 }; 3];
        scene.opacity_logits[i] = 3.0;
    }
    scene
}

#[test]
fn bytes_estimates_and_pictures_do_not_depend_on_the_unit() {
    let dir = Folder::new();
    let [model, stream] = ["model.ply", "a.gsvx"].map(|name| dir.join(name));
    let (room, _) = gs_model::ply::read(common::model()).unwrap();
    let (ball, before) = (ball(false), ball(true));
    for (name, scene) in [("room", room), ("ball", ball), ("ball before a sky", before)] {
        let mut all = Vec::new();
        for scale in [1.0, 1.0 / 1024.0, 1024.0] {
            gs_model::ply::write(&model, &scaled(&scene, scale)).unwrap();
            let words = "encode @ -o @ --force -q 50";
            let (made, _) = common::report(words, &[&model, &stream]);
            let picture = view(&dir, &model);
            let number = |key: &str| made[key].as_f64().unwrap();
            let loss = made["estimated_loss"]["psnr"].as_f64().unwrap();
            all.push((number("bytes"), number("gaussians"), loss, picture));
        }
        let (bytes, gaussians, loss, picture) = &all[0];
        for (b, g, l, p) in &all[1..] {
            // Logarithms of the scales are rounded elsewhere.
            assert!((b / bytes - 1.0).abs() < 2e-3, "{name}: {b} bytes instead of {bytes}");
            assert!((g / gaussians - 1.0).abs() < 2e-3, "{name}: {g} instead of {gaussians}");
            assert!((l - loss).abs() < 0.1, "{name}: {l} dB instead of {loss}");
            let off = p.iter().zip(picture).map(|(a, b)| a.abs_diff(*b)).max().unwrap();
            assert!(off <= 8, "{name}: the pictures differ by {off}");
        }
    }
}

/// The first picture of a model without cameras.
fn view(dir: &Path, model: &Path) -> Vec<u8> {
    let folder = dir.join("views");
    common::ok("render @ --orbit 1 --force -o @", &[model, &folder]);
    let file = std::fs::read_dir(&folder).unwrap().next().unwrap().unwrap().path();
    let pixels = image::open(file).unwrap().into_rgb8().into_raw();
    std::fs::remove_dir_all(folder).unwrap();
    pixels
}

#[test]
fn a_closed_object_is_whole_in_its_first_view() {
    let dir = Folder::new();
    let model = dir.join("model.ply");
    for scale in [0.15, 150.0] {
        gs_model::ply::write(&model, &scaled(&ball(false), scale)).unwrap();
        let pixels = view(&dir, &model);
        let [width, height] = finetune::framing::SIZE.map(|edge| edge as usize);
        let edge = (0..width * height).filter(|i| {
            let (x, y) = (i % width, i / width);
            x == 0 || y == 0 || x == width - 1 || y == height - 1
        });
        let lit = edge.filter(|i| pixels[3 * i..3 * i + 3].iter().any(|&v| v > 16)).count();
        assert_eq!(lit, 0, "the object is cut at the edge");
    }
}
