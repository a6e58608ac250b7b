//! The page and its picture.

use super::streams::StreamKind;
use super::{Scene, TuneBenchOptions};
use crate::bd;
use crate::chart::{Chart, Series};
use crate::measure::Metric;
use crate::page::{Page, Table, number, signed};
use crate::record::{Record, rates};
use crate::report;

/// What one run for several qualities gives.
const ONE_RUN: &str = "`--qualities 42,50,58,66,78` makes five streams in 1.9 times the time of the one at 78 (fox and room, \
     quick). BD-rate against untuned by PSNR, SSIM and SSIMULACRA2, in brackets with a run for each: fox quick \
     -65.9, -56.4, -68.7 % (-71.8, -64.5, -74.9); bonsai quick -45.7, -37.4, -55.6 % (-58.0, -47.2, -65.1), \
     normal -65.4, -52.3, -72.2 % (-68.2, -56.4, -74.3); room quick -60.4, -52.0, -62.9 % (-65.6, -59.6, \
     -70.7), normal -74.7, -68.8, -75.1 % (-76.6, -72.1, -77.3).";

pub(super) fn page(options: &TuneBenchOptions, scenes: &[Scene]) -> Page {
    let names: Vec<&str> = scenes.iter().map(|s| s.name.as_str()).collect();
    let model = |s: &Scene| {
        let scores =
            Metric::ALL.map(|m| format!("{} {}", m.name(), m.words(m.of(&s.original.score))));
        format!("{}: {} Gaussians, {}", s.name, s.original.gaussians, scores.join(", "))
    };
    let models: Vec<String> = scenes.iter().map(model).collect();
    let mut page = Page::new(&options.out, "What does tuning save?");
    page.text(format!(
        "`cargo xtask bench-tune {}` runs `gsvx tune MODEL --cameras SCENE -q QUALITY --effort EFFORT` for each \
         row. \"Elsewhere\" is the PSNR against renders of the model as it was trained, at views between the cameras, beside them and farther back; after it that of `gsvx encode --cameras SCENE` at these bytes. \"At\" is the bytes against `gsvx encode --cameras SCENE --drop-unseen` ([rd.md](rd.md)) of equal score. Distil: renders of the model as targets.",
        names.join(" "),
    ));
    page.text(format!("As trained: {}.", models.join("; ")));
    if let Some(scene) = scenes.first() {
        page.chart("", chart(scene));
    }
    page.text("BD-rate against untuned:");
    page.table(&bd_table(scenes));
    page.data("Each run:", points_table(scenes));
    page.text("A model without photos is tuned to its own renders: [real-size.md](real-size.md).");
    page.text(ONE_RUN);
    page
}

/// Mean differences over the range that both curves share.
fn bd_table(scenes: &[Scene]) -> Table {
    let mut table = Table::new("scene | run | by PSNR, % | by SSIM | by SSIMULACRA2 | over, dB");
    let ends = |hull: &[bd::Point]| {
        let db = |p: Option<&bd::Point>| p.map_or(f64::NAN, |p| p.score);
        [db(hull.first()), db(hull.last())]
    };
    for scene in scenes {
        for (how, points) in &scene.tuned {
            let curves = |metric| [&scene.untuned, points].map(|p| bd::hull(&rates(p, metric)));
            let saved = Metric::ALL.map(|metric| {
                let [anchor, test] = curves(metric);
                bd::bd_rate(&anchor, &test)
            });
            let [[a, b], [c, d]] = curves(Metric::Psnr).map(|hull| ends(&hull));
            if saved.iter().any(Option::is_some) {
                let over = format!("{:.2} to {:.2}", a.max(c), b.min(d));
                let [psnr, ssim, third] = saved.map(|rate| signed(rate, 1, ""));
                let (scene, how) = (&scene.name, how.name);
                table.row(format!("{scene} | {how} | {psnr} | {ssim} | {third} | {over}"));
            }
        }
    }
    table
}

/// The points of each effort, with photos.
fn points_table(scenes: &[Scene]) -> Table {
    let mut table = Table::new(
        "scene | run | quality | bytes | dB | SSIM | SSIMULACRA2 | at PSNR, % | at SSIM, % | elsewhere, dB | untuned, dB | \
         CPU minutes | peak MB",
    );
    let off = |bytes: u64, of: f64| Some(100.0 * (bytes as f64 / of.max(1.0) - 1.0));
    for scene in scenes {
        let point = |p: &Record| Some(bd::Point { rate: p.bytes as f64, score: p.elsewhere_db? });
        let elsewhere: Vec<bd::Point> = scene.untuned_all.iter().filter_map(point).collect();
        let runs = scene.tuned.iter().filter(|(how, _)| *how != StreamKind::DISTIL);
        for (how, p) in runs.flat_map(|(how, points)| points.iter().map(|p| (how.name, p))) {
            let [db, ssim, third] = Metric::ALL
                .map(|metric| metric.words(metric.of(&p.score)).trim_end_matches(" dB").to_owned());
            let against = |metric: Metric| {
                let rate = bd::rate_at(&rates(&scene.untuned, metric), metric.of(&p.score));
                signed(rate.and_then(|rate| off(p.bytes, rate)), 1, "")
            };
            let (by_psnr, by_ssim) = (against(Metric::Psnr), against(Metric::Ssim));
            let untuned = bd::score_at(&elsewhere, p.bytes as f64);
            let elsewhere = [p.elsewhere_db, untuned].map(|db| number(db, 2));
            let Record { quality, bytes, encode, .. } = p;
            table.row(format!(
                "{} | {how} | {quality} | {bytes} | {db} | {ssim} | {third} | {by_psnr} | {by_ssim} | {} | {:.1} | {:.0}",
                scene.name,
                elsewhere.join(" | "),
                encode.user / 60.0,
                encode.peak_mb,
            ));
        }
    }
    table
}

/// All curves of a scene.
fn chart(scene: &Scene) -> Chart {
    let series = |name: String, points: &[Record]| {
        Series::ours(name, rates(points, Metric::Psnr).into_iter().map(bd::Point::in_mb).collect())
    };
    let tuned = scene.tuned.iter().map(|t| series(t.0.name.into(), &t.1));
    let all = tuned.chain([series("untuned".into(), &scene.untuned)]).collect();
    let title = format!("{}: tuned and untuned, PSNR over size", scene.name);
    report::run::chart(title, all, (Metric::Psnr, scene.original.score.psnr_db))
}
