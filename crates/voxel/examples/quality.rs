//! PSNR of merged scenes at the held-out views of a data set, before any coding.
use std::path::Path;

use finetune::{Image, RenderOptions, metrics, render, saliency};
use gs_model::dataset::Dataset;
use gs_model::{Scene, ply};
use voxel::*;

struct Bench {
    scene: Scene,
    views: Vec<(gs_model::Camera, Image)>,
}

impl Bench {
    fn psnr(&self, scene: &Scene) -> f64 {
        let o = RenderOptions::default();
        let sum: f64 =
            self.views.iter().map(|(c, p)| metrics::psnr(&render(scene, c, &o), p)).sum();
        sum / self.views.len() as f64
    }
    fn show(&self, name: &str, v: &Voxelization, rule: Merge) {
        let merged = merge(&self.scene, v, rule).unwrap();
        let bits = gpcc_lite::geometry::encode(&v.leaves, v.j_high).unwrap().len() * 8;
        let n = v.len();
        let est = |b: f64| (bits as f64 + b * n as f64) / 8e3;
        println!(
            "{name:44} n {n:7} geo {:6.2} kB60 {:7.1} kB120 {:7.1} psnr {:.3}",
            bits as f64 / n as f64,
            est(60.0),
            est(120.0),
            self.psnr(&merged)
        );
    }
}

fn main() {
    let args: Vec<String> = std::env::args().collect();
    let dir = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/scenes").join(&args[1]);
    let data = Dataset::open(&dir).unwrap();
    let (scene, _) = ply::read(&data.model_path).unwrap();
    let views = data
        .held_out()
        .into_iter()
        .map(|v| {
            let p = image::open(&v.image_path).unwrap().to_rgb8();
            (v.camera.clone(), Image::from_rgb8(p.width(), p.height(), p.as_raw()).unwrap())
        })
        .collect();
    let train: Vec<_> = data.training().into_iter().map(|v| v.camera.clone()).collect();
    let t = std::time::Instant::now();
    let sal = saliency(&scene, &train);
    println!("saliency {:?}; zero {}", t.elapsed(), sal.iter().filter(|s| **s == 0.0).count());
    let b = Bench { scene, views };
    println!("original {} psnr {:.3}", b.scene.len(), b.psnr(&b.scene));
    let cube = Cube::of(&b.scene.means).unwrap();
    let base: u8 = args[2].parse().unwrap();
    for d in base..base + 4 {
        let v = voxelize(&b.scene, &cube, &Strategy::Uniform { depth: d }).unwrap();
        b.show(&format!("uniform {d} paper"), &v, Merge::Paper);
        b.show(&format!("uniform {d} moments"), &v, Merge::Moments);
    }
    for (lo, hi) in [(base - 1, base + 3), (base, base + 3)] {
        let v = voxelize(&b.scene, &cube, &Strategy::paper(lo, hi)).unwrap();
        b.show(&format!("paper {lo}-{hi} paper"), &v, Merge::Paper);
        b.show(&format!("paper {lo}-{hi} moments"), &v, Merge::Moments);
    }
    for (name, imp) in [("oa", Importance::OpacityArea), ("sal", Importance::Given(sal.clone()))] {
        for p in [0.0, 0.5, 1.0] {
            for lambda in [1e-4, 1e-3, 1e-2] {
                let o = RateDistortion {
                    size_exponent: p,
                    importance: imp.clone(),
                    j_high: 18,
                    ..RateDistortion::new(lambda)
                };
                let t = std::time::Instant::now();
                let (v, r) = rate_distortion(&b.scene, &cube, &o).unwrap();
                let el = t.elapsed();
                b.show(
                    &format!(
                        "rd {name} p{p} l{lambda} {:?} skip {}/{}",
                        el.as_millis(),
                        r.skipped,
                        r.decided
                    ),
                    &v,
                    Merge::Moments,
                );
            }
        }
    }
}
