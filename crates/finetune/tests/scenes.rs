//! PSNR and SSIM of the trained test scenes at their held-out views against the figures in
//! the scenes' README, which another renderer measured.

use finetune::{Photo, RenderOptions, metrics, render};
use gs_model::dataset::Dataset;

fn check(name: &str, psnr: f64, ssim: f64) {
    let Some(dir) = testing::shared(&format!("scenes/{name}")) else { return };
    let dataset = Dataset::open(&dir).unwrap();
    let (scene, _) = gs_model::ply::read(&dataset.model_path).unwrap();
    let (mut sum_psnr, mut sum_ssim, mut n) = (0.0, 0.0, 0.0);
    for view in dataset.held_out() {
        let photo = image::open(&view.image_path).unwrap().to_rgb8();
        let photo = Photo::new(photo.width(), photo.height(), photo.into_raw()).unwrap().image();
        let image = render(&scene, &view.camera, &RenderOptions::default());
        sum_psnr += metrics::psnr(&image, &photo);
        sum_ssim += metrics::ssim(&image, &photo);
        n += 1.0;
    }
    let (got_psnr, got_ssim) = (sum_psnr / n, sum_ssim / n);
    println!("{name}: {got_psnr:.3} dB, SSIM {got_ssim:.4} over {n} views");
    assert!((got_psnr - psnr).abs() < 0.05, "{got_psnr} dB, README says {psnr}");
    assert!((got_ssim - ssim).abs() < 0.002, "{got_ssim}, README says {ssim}");
}

#[test]
fn fox_agrees_with_the_published_figures() {
    check("fox", 31.898, 0.917);
}

#[test]
fn bonsai_agrees_with_the_published_figures() {
    check("bonsai", 30.527, 0.932);
}
