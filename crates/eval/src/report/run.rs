//! The report of a default run.

use super::headline;
use super::sections::{self, UNITS};
use super::{Block, CropView, Document, NamedChart, Section};
use crate::bd::Point;
use crate::chart::{Axis, Chart, Series};
use crate::measure::Metric;
use crate::page::{self, Table, number};
use crate::record::{Curve, Record, Run};

/// Points of others larger than this many times our largest stream are left out of the chart
/// (the tables have them): raw PLY would squeeze all curves into a corner.
const WIDEST: f64 = 4.5;

/// What a reader must know to read the chart.
const TERMS: &str = "Each point is a stream, decoded and rendered: its size, and its PSNR against photos that \
     the model was not trained on (held out). PSNR measures how near a render is to the photo, in dB: one dB more \
     is a fifth less squared error. Further left is smaller, higher is nearer. An octree divides space into cells; \
     its depth says how small the finest are.";

/// What gsvx is, for someone who has never heard of it.
const WHAT: &str = "gsvx compresses trained 3D Gaussian splatting models. It follows the paper Adaptive \
     Voxelization for Transform Coding of 3D Gaussian Splatting Data (arXiv 2506.00271).";

const COLUMNS: &str = "curve | quality | bytes | Mbit | bit/Gaussian | PSNR dB | SSIM | SSIMULACRA2 | Gaussians | voxelize s | \
     encode s | decode s | render s";

/// The original and all points.
fn points(run: &Run) -> Section {
    let mut table = Table::new(COLUMNS);
    let mut row = |curve: &str, p: &Record, voxelize: f64, [encode, decode]: [f64; 2]| {
        let Record { setting, bytes, gaussians, score, .. } = p;
        let seconds = [voxelize, encode, decode, score.seconds].map(|s| number(s, 2)).join(" | ");
        let (mbit, bits, scores) = (p.megabits(), p.bits_per_gaussian(), page::scores(score));
        table.row(format!(
            "{curve} | {setting} | {bytes} | {mbit} | {bits:.2} | {scores} | {gaussians} | {seconds}"
        ));
    };
    row("original PLY", &run.original, f64::NAN, [f64::NAN; 2]);
    for curve in run.curves.iter().rev() {
        for p in &curve.points {
            let voxels = curve.voxelized.iter().find(|v| v.name == p.voxels);
            let voxelize = voxels.map_or(f64::NAN, |v| v.voxelize_seconds);
            row(&curve.name, p, voxelize, [p.encode.wall, p.decode_seconds]);
        }
    }
    Section::open("Points", vec![Block::Text(UNITS.into()), Block::Table(table)])
}

/// Our curves, the last first, and those of others as far as they are not much larger.
pub(crate) fn curves_and_others(title: String, run: &Run, metric: Metric) -> Chart {
    let line = |curve: &Curve| {
        let mut points = curve.rates(metric);
        points.sort_by(|a, b| a.rate.total_cmp(&b.rate));
        Series::ours(&curve.name, points.into_iter().map(Point::in_mb).collect())
    };
    let mut all: Vec<Series> = run.curves.iter().rev().map(line).collect();
    let largest = all.iter().flat_map(|s| &s.points).map(|p| p.0).fold(0.0, f64::max);
    all.extend(sections::other_series(&run.others, metric, WIDEST * largest));
    chart(title, all, (metric, metric.of(&run.original.score)))
}

/// A score over size.
pub(crate) fn chart(
    title: String,
    series: Vec<Series>,
    (metric, original): (Metric, f64),
) -> Chart {
    let unit = if metric == Metric::Psnr { ", dB" } else { "" };
    let score = format!("{} at held-out views{unit}", metric.name());
    let axes = [Axis::logarithmic("size, MB (10⁶ bytes)"), Axis::linear(&score)];
    let level = (original, format!("uncompressed model, {}", metric.words(original)));
    Chart::new(title, axes, series, Some(level))
}

/// The report, with crops of the views where they are at hand.
pub(crate) fn document(run: &Run, views: Vec<CropView>) -> Document {
    let o = &run.original;
    let invalid = if run.invalid > 0 {
        format!(" ({} invalid ones left out)", run.invalid)
    } else {
        String::new()
    };
    let comparisons = headline::comparisons(run);
    let lead = format!(
        "{WHAT} Here the model of one scene is coded at several sizes. The scene: {}. Of {} photos {} are held out \
         from training (every 8th by name), and {} are compared with renders. The model has {} Gaussians with colours of \
         SH degree {}{invalid}; uncompressed it is {:.1} MB and reaches {:.2} dB PSNR, \
         an SSIM of {:.4} and a SSIMULACRA2 of {:.1}.",
        run.what,
        run.views,
        run.held_out,
        run.measured,
        o.gaussians,
        run.sh_degree,
        o.bytes as f64 / 1e6,
        o.score.psnr_db,
        o.score.ssim,
        o.score.ssimulacra2
    );
    let charts = Metric::ALL.map(|metric| {
        let name = metric.name();
        let title = format!("{}: {name} over size, {} held-out views", run.scene, run.measured);
        let stem = if metric == Metric::Psnr {
            "rd".into()
        } else {
            format!("rd-{}", name.to_lowercase())
        };
        let chart = curves_and_others(title, run, metric);
        NamedChart { name, chart, stem }
    });
    let curves = run.curves.iter().rev().map(|c| format!("`{}`: {}", c.name, c.what)).collect();
    let mut sections = vec![
        Section::open(
            "Curves",
            vec![Block::Text(TERMS.into()), Block::List(curves), Block::Charts(charts.into())],
        ),
        pictures(views),
        points(run),
        sections::differences("Curves against each other (Bjontegaard differences)", &run.bd),
        sections::others(&run.others),
        voxelizations(run),
        spent(run),
        per_view(run),
        sections::provenance(run),
    ];
    sections.retain(|s| !s.blocks.is_empty());
    Document {
        title: headline::title(&run.scene, &comparisons),
        lead,
        highlights: headline::highlights(run, &comparisons),
        sections,
    }
}

fn voxelizations(run: &Run) -> Section {
    let found = run.curves.iter().flat_map(|c| &c.voxelized).map(|v| v.importance_seconds);
    let text = format!(
        "Quality of the voxelized and merged models before coding. Merging and coding weigh each Gaussian by \
         its contribution to the training views (cameras only, no photos; {:.1} s).",
        found.fold(0.0, f64::max)
    );
    let mut table = Table::new(
        "voxelization | Gaussians | kept | PSNR dB | SSIM | SSIMULACRA2 | voxelize s | render s | leaves by depth",
    );
    for curve in &run.curves {
        for v in &curve.voxelized {
            let kept = 100.0 * v.gaussians as f64 / run.original.gaussians.max(1) as f64;
            let depths = (0..).zip(&v.depth_histogram).filter(|&(_, &n)| n > 0);
            let depths: Vec<String> =
                depths.map(|(d, n): (usize, _)| format!("{d}: {n}")).collect();
            table.row(format!(
                "{}, {} | {} | {kept:.1} % | {} | {:.2} | {:.2} | {}",
                curve.name,
                v.what,
                v.gaussians,
                page::scores(&v.score),
                v.voxelize_seconds,
                v.score.seconds,
                depths.join(", "),
            ));
        }
    }
    Section::folded("Voxelizations", vec![Block::Text(text), Block::Table(table)])
}

fn spent(run: &Run) -> Section {
    // The paper has other parts than gsvx.
    let mut names: Vec<&str> = Vec::new();
    for (name, _) in run.curves.iter().flat_map(|c| &c.points).flat_map(|p| &p.parts) {
        if !names.contains(&name.as_str()) {
            names.push(name);
        }
    }
    let mut table = Table::new(format!("curve | quality | {}", names.join(" | ")));
    for curve in &run.curves {
        for p in &curve.points {
            let bytes = names.iter().map(|name| {
                let part = p.parts.iter().find(|(n, _)| n == name);
                part.map_or("-".into(), |(_, bytes)| bytes.to_string())
            });
            let bytes: Vec<String> = bytes.collect();
            table.row(format!("{} | {} | {}", curve.name, p.setting, bytes.join(" | ")));
        }
    }
    Section::folded("What the bytes are spent on", vec![Block::Table(table)])
}

fn per_view(run: &Run) -> Section {
    let mut header = "view | original dB".to_owned();
    let mut chosen: Vec<&Record> = Vec::new();
    if let Some(curve) = run.curves.last() {
        chosen.extend([curve.points.first(), curve.points.last()].into_iter().flatten());
        for p in &chosen {
            header += &format!(" | {}, quality {:.0}, dB", curve.name, p.quality);
        }
    }
    let mut table = Table::new(&header);
    for (i, view) in run.original.score.views.iter().enumerate() {
        let db = chosen.iter().map(|p| number(p.score.views.get(i).map(|v| v.psnr_db), 3));
        let db: Vec<String> = [number(view.psnr_db, 3)].into_iter().chain(db).collect();
        table.row(format!("{} | {}", view.view, db.join(" | ")));
    }
    Section::folded("Views", vec![Block::Table(table)])
}

fn pictures(views: Vec<CropView>) -> Section {
    let text = "Press a button to change the picture: the photo, the render of the uncompressed model (original), of \
                streams by their size, and the difference of each from the original. Of a large view it is the window \
                where the smallest stream differs most.";
    let blocks = match views.is_empty() {
        true => Vec::new(),
        false => vec![Block::Text(text.into()), Block::Views(views)],
    };
    Section::open("Pictures", blocks)
}
