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

/// Mean log-rate difference over common PSNR range, piecewise linear, percent.
fn bd(a: &[(f64, f64)], b: &[(f64, f64)], lo: f64, hi: f64) -> f64 {
    let at = |c: &[(f64, f64)], q: f64| -> f64 {
        let mut c = c.to_vec();
        c.sort_by(|x, y| x.1.total_cmp(&y.1));
        let k = (1..c.len() - 1).find(|&k| c[k].1 >= q).unwrap_or(c.len() - 1);
        let (l, r) = (c[k - 1], c[k]);
        let t = (q - l.1) / (r.1 - l.1);
        l.0.ln() + t * (r.0.ln() - l.0.ln())
    };
    let clip = |c: &[(f64, f64)]| {
        (
            c.iter().map(|x| x.1).fold(f64::MAX, f64::min),
            c.iter().map(|x| x.1).fold(f64::MIN, f64::max),
        )
    };
    let (l1, h1) = clip(a);
    let (l2, h2) = clip(b);
    let (lo, hi) = (lo.max(l1).max(l2), hi.min(h1).min(h2));
    let n = 50;
    let m: f64 = (0..n)
        .map(|i| {
            let q = lo + (hi - lo) * (i as f64 + 0.5) / n as f64;
            at(a, q) - at(b, q)
        })
        .sum::<f64>()
        / n as f64;
    (m.exp() - 1.0) * 100.0
}

fn main() {
    let args: Vec<String> = std::env::args().collect();
    let per: f64 = 90.0;
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
    let sal = saliency(&scene, &train);
    let b = Bench { scene, views };
    let orig = b.psnr(&b.scene);
    println!("original {} psnr {orig:.3}", b.scene.len());
    let cube = Cube::of(&b.scene.means).unwrap();
    let base: u8 = args[2].parse().unwrap();
    let curve = |strategies: &[Strategy], rule: Merge| -> Vec<(f64, f64)> {
        strategies
            .iter()
            .map(|s| {
                let v = voxelize(&b.scene, &cube, s).unwrap();
                let bits = gpcc_lite::geometry::encode(&v.leaves, v.j_high).unwrap().len() * 8;
                (
                    (bits as f64 + per * v.len() as f64) / 8e3,
                    b.psnr(&merge(&b.scene, &v, rule).unwrap()),
                )
            })
            .collect()
    };
    let uniform: Vec<_> = (base - 1..base + 5).map(|depth| Strategy::Uniform { depth }).collect();
    let reference = curve(&uniform, Merge::Paper);
    println!("uniform {reference:.2?}");
    let (lo, hi) = (orig - 4.0, orig - 0.3);
    let report = |name: &str, c: &[(f64, f64)]| {
        println!("{name:50} {:7.2} %  {:.2?}", bd(c, &reference, lo, hi), c)
    };
    report("uniform moments", &curve(&uniform, Merge::Moments));
    let papers: Vec<_> =
        (base - 3..base + 2).map(|d| Strategy::paper(d, (d + 4).min(21))).collect();
    report("paper paper", &curve(&papers, Merge::Paper));
    report("paper moments", &curve(&papers, Merge::Moments));
    let alpha = |i: usize| 1.0 / (1.0 + (-b.scene.opacity_logits[i]).exp());
    let sa: Vec<f32> = sal.iter().enumerate().map(|(i, s)| s * alpha(i)).collect();
    let d = RateDistortion {
        importance: Importance::Given(sa.clone()),
        j_high: 18,
        cost: CostModel { gaussian: per, ..Default::default() },
        shape: 0.3,
        ..RateDistortion::new(0.0)
    };
    let family = |o: &RateDistortion| -> Vec<Strategy> {
        [3e-4, 1e-3, 3e-3, 1e-2, 3e-2, 1e-1]
            .iter()
            .map(|&lambda| Strategy::RateDistortion(RateDistortion { lambda, ..o.clone() }))
            .collect()
    };
    let (s1, sa1) = (Importance::Given(sal.clone()), Importance::Given(sa.clone()));
    let curve = |strategies: &[Strategy], m: &Importance| -> Vec<(f64, f64)> {
        strategies
            .iter()
            .map(|s| {
                let v = voxelize(&b.scene, &cube, s).unwrap();
                let bits = gpcc_lite::geometry::encode(&v.leaves, v.j_high).unwrap().len() * 8;
                (
                    (bits as f64 + per * v.len() as f64) / 8e3,
                    b.psnr(&merge_weighted(&b.scene, &v, Merge::Moments, m).unwrap()),
                )
            })
            .collect()
    };
    let d = RateDistortion { size_exponent: 0.75, ..d };
    report("sal", &curve(&family(&RateDistortion { importance: s1.clone(), ..d.clone() }), &s1));
    report(
        "sal alpha",
        &curve(&family(&RateDistortion { importance: sa1.clone(), ..d.clone() }), &s1),
    );
    for drop in [0.1, 0.3, 1.0, 3.0, 10.0] {
        report(
            &format!("drop sal {drop}"),
            &curve(
                &family(&RateDistortion { importance: s1.clone(), drop: Some(drop), ..d.clone() }),
                &s1,
            ),
        );
        report(
            &format!("drop sal alpha {drop}"),
            &curve(
                &family(&RateDistortion { importance: sa1.clone(), drop: Some(drop), ..d.clone() }),
                &s1,
            ),
        );
    }
    for p in [0.75, 1.0, 1.25, 1.5, 2.0] {
        report(
            &format!("oa p {p}"),
            &curve(
                &family(&RateDistortion {
                    importance: Importance::OpacityArea,
                    size_exponent: p,
                    ..d.clone()
                }),
                &Importance::OpacityArea,
            ),
        );
    }
}
