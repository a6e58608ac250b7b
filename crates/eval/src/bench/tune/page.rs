//! The page and its picture.

use super::{Scene, StreamPoint, TuneBenchOptions, Tuned};
use crate::bd;
use crate::cells;
use crate::chart::{Chart, Series};
use crate::page::{Page, Table, signed};
use crate::rd_curve::streams::StreamKind;
use crate::report;

/// What the settings are chosen by.
const CHOICES: &str = include_str!("choices.md");

fn rate(point: &StreamPoint) -> bd::Point {
    bd::Point { rate: point.coded.bytes as f64, psnr_db: point.coded.score.psnr_db }
}

fn rates(points: &[StreamPoint]) -> Vec<bd::Point> {
    points.iter().map(rate).collect()
}

pub(super) fn page(options: &TuneBenchOptions, scenes: &[Scene]) -> Page {
    let names: Vec<&str> = scenes.iter().map(|s| s.name.as_str()).collect();
    let model = |s: &Scene| {
        let [db, ssim] = s.original;
        format!("{} {} Gaussians, {db:.2} dB, SSIM {ssim:.4}", s.name, s.gaussians)
    };
    let models: Vec<String> = scenes.iter().map(model).collect();
    let mut page = Page::new(&options.out, "What does tuning save?");
    page.text(format!(
        "`cargo xtask bench-tune {}` runs `gsvx tune MODEL --cameras SCENE -q \
         QUALITY --effort EFFORT` for each row below, and compares the decoded stream with the held-out photos. PSNR \
         (dB) and SSIM are means over these. \"Elsewhere\" is the PSNR against renders of the model as it was trained, at views \
         off the path of the cameras: between them, beside them and farther back. The column after it is the same of `gsvx \
         encode --cameras SCENE`, interpolated at these bytes. \"Untuned\" is `gsvx encode --cameras SCENE --drop-unseen` \
         ([rd.md](rd.md)). \"Distil\" tunes to renders of the model instead of the photos. CPU minutes are user time of all threads. `--run` and `--quality` measure a part; rows that \
         this build has not measured are missing.",
        names.join(" "),
    ));
    page.text(format!(
        "The models as they were trained: {}. Bold: at or above that.",
        models.join("; ")
    ));
    if let Some(scene) = scenes.first() {
        page.chart("", chart(scene));
    }
    page.text("BD-rate against untuned, by pchip:");
    page.table(&bd_table(scenes));
    page.table(&points_table(scenes));
    page.text("A model without photos is tuned to its own renders: [real-size.md](real-size.md).");
    page.text(CHOICES.trim());
    page
}

/// Mean differences over the range that both curves share.
fn bd_table(scenes: &[Scene]) -> Table {
    let mut table = Table::new("scene | run | BD-rate | over, dB | last point above the model, dB");
    let ends = |hull: &[bd::Point]| {
        let db = |p: Option<&bd::Point>| p.map_or(f64::NAN, |p| p.psnr_db);
        [db(hull.first()), db(hull.last())]
    };
    for scene in scenes {
        let anchor = bd::hull(&rates(&scene.untuned));
        for Tuned { how, points } in &scene.tuned {
            let test = bd::hull(&rates(points));
            let rate = bd::bd_rate(&anchor, &test);
            let ([a, b], [c, d]) = (ends(&anchor), ends(&test));
            if rate.is_some() {
                let over = format!("{:.2} to {:.2}", a.max(c), b.min(d));
                let above = format!("{:+.2}", d - scene.original[0]);
                table.row(cells![scene.name, how.name(), signed(rate, 1, " %"), over, above]);
            }
        }
    }
    table
}

/// The points of each effort, with photos.
fn points_table(scenes: &[Scene]) -> Table {
    let mut table = Table::new(
        "scene | run | quality | bytes | dB | SSIM | bytes against untuned at these dB | elsewhere, dB | \
         elsewhere without tuning, dB | CPU minutes | peak MB",
    );
    let off = |bytes: u64, of: f64| Some(100.0 * (bytes as f64 / of.max(1.0) - 1.0));
    for scene in scenes {
        let untuned = rates(&scene.untuned);
        let elsewhere: Vec<bd::Point> = scene
            .untuned_all
            .iter()
            .map(|p| bd::Point { psnr_db: p.elsewhere_db, ..rate(p) })
            .collect();
        let usual = |t: &&Tuned| matches!(t.how, StreamKind::Tune { distil: false, .. });
        let runs = scene.tuned.iter().filter(usual);
        for (how, point) in runs.flat_map(|t| t.points.iter().map(|p| (t.how, p))) {
            let p = &point.coded;
            let db = p.score.psnr_db;
            let bold = if db >= scene.original[0] { "**" } else { "" };
            let against = bd::rate_at(&untuned, db).and_then(|rate| off(p.bytes, rate));
            table.row(cells![
                scene.name,
                how.name(),
                p.quality,
                p.bytes,
                format!("{bold}{db:.2}{bold}"),
                format!("{:.4}", p.score.ssim),
                signed(against, 1, " %"),
                format!("{:.2}", point.elsewhere_db),
                bd::psnr_at(&elsewhere, p.bytes as f64).map_or("-".into(), |db| format!("{db:.2}")),
                format!("{:.1}", point.user_seconds / 60.0),
                format!("{:.0}", point.peak_mb),
            ]);
        }
    }
    table
}

/// All curves of a scene.
fn chart(scene: &Scene) -> Chart {
    let series = |name: String, points: &[StreamPoint]| {
        Series::ours(name, rates(points).into_iter().map(bd::Point::in_mb).collect())
    };
    let tuned = scene.tuned.iter().map(|t| series(t.how.name(), &t.points));
    let all = tuned.chain([series("untuned".into(), &scene.untuned)]).collect();
    let title = format!("{}: tuned and untuned, PSNR over size", scene.name);
    report::run::chart(title, all, scene.original[0])
}
