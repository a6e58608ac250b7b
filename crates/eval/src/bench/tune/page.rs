//! The page and its picture.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::Result;

use super::{Options, Point, Scene, Tuned, step};
use crate::bd::{self, Method};
use crate::chart::{Chart, Kind, Series};
use crate::report;

/// What was tried when the settings were chosen; by hand.
const CHOICES: &str = include_str!("choices.md");

fn rates(points: &[Point]) -> Vec<bd::Point> {
    let point =
        |p: &Point| bd::Point { rate: p.coded.bytes as f64, psnr_db: p.coded.score.psnr_db };
    points.iter().map(point).collect()
}

pub(super) fn text(options: &Options, scenes: &[Scene]) -> Result<String> {
    let names: Vec<&str> = scenes.iter().map(|s| s.name.as_str()).collect();
    let models: Vec<String> = scenes
        .iter()
        .map(|s| {
            let [db, ssim] = s.original;
            format!("{} {} Gaussians, {db:.2} dB, SSIM {ssim:.4}", s.name, s.gaussians)
        })
        .collect();
    let mut out = format!(
        "# Tune: fewer bytes at equal quality\n\n\
         `cargo build --release -p gsvx-cli && cargo xtask bench-tune {}{}` runs `gsvx tune MODEL --cameras SCENE -q QUALITY \
         --effort EFFORT` for each row below. Another process decodes the stream and compares it with the \
         photos that are held out: every 8th, which neither training nor importance nor the views kept \
         aside see. PSNR (dB) and SSIM are means over those views. {} CPU minutes are user time of all threads. The points are \
         recorded: `--run` and `--quality` measure a part, and rows that were not measured with this build \
         are missing.\n\n\
         The models as they were trained: {}. Bold: at or above that.\n\n\
         {}\n",
        names.join(" "),
        options
            .reference
            .as_ref()
            .map_or(String::new(), |r| format!(" --reference {}=COMMAND", r.name)),
        anchor(options),
        models.join("; "),
        picture(&options.out, names[0]),
    );
    let anchor = anchor_name(options);
    bd_table(&mut out, scenes, anchor)?;
    points_table(&mut out, scenes, anchor)?;
    anchor_table(&mut out, scenes, anchor)?;
    costs(&mut out, scenes)?;
    write!(out, "\n{CHOICES}")?;
    Ok(out)
}

/// What the page calls the streams that tuned ones are compared with.
fn anchor_name(options: &Options) -> &str {
    options.reference.as_ref().map_or("untuned", |r| &r.name)
}

/// How they were made.
fn anchor(options: &Options) -> String {
    let name = anchor_name(options);
    match options.reference {
        Some(_) => format!("\"{name}\" is `gsvx encode --cameras SCENE` of that version."),
        None => {
            format!("\"{name}\" is `gsvx encode --cameras SCENE --drop-unseen` of the same build.")
        }
    }
}

fn picture(out: &Path, scene: &str) -> String {
    crate::page::picture(out, &format!("PSNR over size on {scene}"))
}

/// Mean differences over the range that both curves share.
fn bd_table(out: &mut String, scenes: &[Scene], anchor: &str) -> Result<()> {
    writeln!(
        out,
        "\nBytes against {anchor} at equal PSNR, mean over the range that both curves share (BD-rate by \
         pchip; negative is smaller):\n\n\
         | scene | run | BD-rate | over, dB | last point above the model, dB |\n|---|---|---:|---|---:|"
    )?;
    for scene in scenes {
        let hull = bd::hull(&rates(&scene.anchor));
        for Tuned { how, points } in &scene.tuned {
            let test = bd::hull(&rates(points));
            let Some(rate) = bd::bd_rate(&hull, &test, Method::Pchip) else { continue };
            let (a, t) = (ends(&hull), ends(&test));
            writeln!(
                out,
                "| {} | {} | {rate:+.1} % | {:.2} to {:.2} | {:+.2} |",
                scene.name,
                how.name(),
                a.0.max(t.0),
                a.1.min(t.1),
                t.1 - scene.original[0],
            )?;
        }
    }
    Ok(())
}

/// Lowest and highest PSNR of a hull.
fn ends(hull: &[bd::Point]) -> (f64, f64) {
    let db = |p: Option<&bd::Point>| p.map_or(f64::NAN, |p| p.psnr_db);
    (db(hull.first()), db(hull.last()))
}

fn points_table(out: &mut String, scenes: &[Scene], anchor: &str) -> Result<()> {
    writeln!(
        out,
        "\n| scene | run | quality | Gaussians | bytes | dB | SSIM | bytes against {anchor} at these dB | \
         counted bytes off by | CPU minutes | peak MB |\n\
         |---|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|"
    )?;
    for scene in scenes {
        let untuned = rates(&scene.anchor);
        for (how, point) in scene.tuned.iter().flat_map(|t| t.points.iter().map(|p| (t.how, p))) {
            let p = &point.coded;
            let db = p.score.psnr_db;
            let bold = if db >= scene.original[0] { "**" } else { "" };
            let against = bd::rate_at(&untuned, db);
            let against = against.map_or("-".into(), |rate| difference(p.bytes, rate));
            let counted = point.counted_bytes.map(|n| difference(n, p.bytes as f64));
            writeln!(
                out,
                "| {} | {} | {:.0} | {} | {} | {bold}{db:.2}{bold} | {:.4} | {against} | {} | {:.1} | {:.0} |",
                scene.name,
                how.name(),
                p.quality,
                p.gaussians,
                p.bytes,
                p.score.ssim,
                counted.unwrap_or_default(),
                point.user_seconds / 60.0,
                point.peak_mb,
            )?;
        }
    }
    Ok(())
}

fn difference(bytes: u64, of: f64) -> String {
    format!("{:+.1} %", 100.0 * (bytes as f64 / of.max(1.0) - 1.0))
}

fn anchor_table(out: &mut String, scenes: &[Scene], anchor: &str) -> Result<()> {
    let head: Vec<String> =
        scenes.iter().map(|s| format!("{}: bytes | dB | SSIM", s.name)).collect();
    writeln!(
        out,
        "\n{anchor}:\n\n| quality | {} |\n|---:|{}",
        head.join(" | "),
        "---:|".repeat(3 * scenes.len())
    )?;
    let rows = scenes.first().map_or(&[][..], |s| &s.anchor);
    for (i, row) in rows.iter().enumerate() {
        let cells = scenes.iter().filter_map(|s| s.anchor.get(i)).map(|p| {
            let Point { coded, .. } = p;
            let score = &coded.score;
            format!("{} | {:.3} | {:.4}", coded.bytes, score.psnr_db, score.ssim)
        });
        let cells: Vec<String> = cells.collect();
        writeln!(out, "| {:.0} | {} |", row.coded.quality, cells.join(" | "))?;
    }
    Ok(())
}

/// What the loop costs.
fn costs(out: &mut String, scenes: &[Scene]) -> Result<()> {
    writeln!(
        out,
        "\nA step with the codec in the loop beside a plain step of fine-tune on the same Gaussians (processor \
         milliseconds, all threads, the median of three means over 240 steps), and the memory of the command beside that of \
         `--profile paper`:\n\n\
         | scene | Gaussians | plain step, ms | in the loop, ms | | plain, MB | tuned, MB | |\n\
         |---|---:|---:|---:|---:|---:|---:|---:|"
    )?;
    for scene in scenes {
        let step::Cost { gaussians, plain, in_loop } = scene.step;
        let peaks = scene.tuned.iter().flat_map(|t| &t.points).map(|p| p.peak_mb);
        let memory = match peaks.reduce(f64::max) {
            Some(peak) => format!("{peak:.0} | {:.2} x", peak / scene.plain_peak_mb.max(1.0)),
            None => " | ".into(),
        };
        writeln!(
            out,
            "| {} | {gaussians} | {:.1} | {:.1} | {:.2} x | {:.0} | {memory} |",
            scene.name,
            1e3 * plain,
            1e3 * in_loop,
            in_loop / plain.max(1e-9),
            scene.plain_peak_mb,
        )?;
    }
    Ok(())
}

/// All curves of a scene.
pub(super) fn chart(options: &Options, scene: &Scene) -> Chart {
    let series = |name: String, points: &[Point]| {
        let points = rates(points).iter().map(|p| (p.rate / 1e6, p.psnr_db)).collect();
        Series { name, kind: Kind::Ours, points }
    };
    let tuned = scene.tuned.iter().filter(|t| !t.points.is_empty());
    let mut all: Vec<Series> = tuned.map(|t| series(t.how.name(), &t.points)).collect();
    all.push(series(anchor_name(options).into(), &scene.anchor));
    let title = format!("{}: tuned and {}", scene.name, anchor_name(options));
    report::run::chart(title, all, scene.original[0])
}
