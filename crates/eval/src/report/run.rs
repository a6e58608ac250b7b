//! The report of a default run.

use super::headline;
use super::sections::{self, UNITS};
use super::{Block, CropView, Document, NamedChart, Section, megabits};
use crate::bd::Point;
use crate::cells;
use crate::chart::{Axis, Chart, Series};
use crate::measure::Metric;
use crate::page::Table;
use crate::published::Other;
use crate::rd_curve::record::{Coded, Curve, Original, Run};

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

/// The row of one point.
fn cells_of(curve: &Curve, p: &Coded) -> Vec<String> {
    cells![
        curve.name,
        p.setting(),
        p.bytes,
        megabits(p.bytes),
        format!("{:.2}", p.bits_per_gaussian()),
        format!("{:.3}", p.score.psnr_db),
        format!("{:.4}", p.score.ssim),
        format!("{:.2}", p.score.ssimulacra2),
        p.gaussians,
        curve.voxels_of(p).map_or("-".into(), |v| format!("{:.2}", v.voxelize_seconds)),
        format!("{:.2}", p.encode_seconds),
        format!("{:.2}", p.decode_seconds),
        format!("{:.2}", p.render_seconds),
    ]
}

/// The original and all points.
pub(crate) fn points(original: &Original, curves: &[Curve]) -> Section {
    let mut table = Table::new(COLUMNS);
    table.row(cells![
        "original PLY",
        "-",
        original.file_bytes,
        megabits(original.file_bytes),
        format!("{:.2}", original.file_bytes as f64 * 8.0 / original.gaussians.max(1) as f64),
        format!("{:.3}", original.score.psnr_db),
        format!("{:.4}", original.score.ssim),
        format!("{:.2}", original.score.ssimulacra2),
        original.gaussians,
        "-",
        "-",
        "-",
        format!("{:.2}", original.render_seconds),
    ]);
    for curve in curves.iter().rev() {
        curve.points.iter().for_each(|p| table.row(cells_of(curve, p)));
    }
    Section::open("Points", vec![Block::Text(UNITS.into()), Block::Table(table)])
}

/// Our curves, the last first, and those of others as far as they are not much larger.
pub(crate) fn curves_and_others(
    title: String,
    curves: &[Curve],
    others: &[Other],
    (metric, original): (Metric, f64),
) -> Chart {
    let line = |curve: &Curve| {
        let mut points = curve.rates(metric);
        points.sort_by(|a, b| a.rate.total_cmp(&b.rate));
        Series::ours(&curve.name, points.into_iter().map(Point::in_mb).collect())
    };
    let mut all: Vec<Series> = curves.iter().rev().map(line).collect();
    let largest = all.iter().flat_map(|s| &s.points).map(|p| p.0).fold(0.0, f64::max);
    all.extend(sections::other_series(others, metric, WIDEST * largest));
    chart(title, all, (metric, original))
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
    let invalid = if o.invalid > 0 {
        format!(" ({} invalid ones left out)", o.invalid)
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
        o.sh_degree,
        o.file_bytes as f64 / 1e6,
        o.score.psnr_db,
        o.score.ssim,
        o.score.ssimulacra2
    );
    let charts = Metric::ALL.map(|metric| {
        let name = metric.name();
        let title = format!("{}: {name} over size, {} held-out views", run.scene, run.measured);
        let original = (metric, metric.of(&o.score));
        let stem = if metric == Metric::Psnr {
            "rd".into()
        } else {
            format!("rd-{}", name.to_lowercase())
        };
        let chart = curves_and_others(title, &run.curves, &run.others, original);
        NamedChart { name, chart, stem }
    });
    let curves = run.curves.iter().rev().map(|c| format!("`{}`: {}", c.name, c.what)).collect();
    let mut sections = vec![
        Section::open(
            "Curves",
            vec![Block::Text(TERMS.into()), Block::List(curves), Block::Charts(charts.into())],
        ),
        pictures(views),
        points(o, &run.curves),
        sections::differences("Curves against each other (Bjontegaard differences)", &run.bd),
        sections::others(&run.others),
        voxelizations(run),
        spent(run),
        per_view(run),
    ];
    sections.push(sections::provenance(&run.manifest, run.skipped, run.stages));
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
            table.row(cells![
                format!("{}, {}", curve.name, v.what),
                v.gaussians,
                format!("{kept:.1} %"),
                format!("{:.3}", v.score.psnr_db),
                format!("{:.4}", v.score.ssim),
                format!("{:.2}", v.score.ssimulacra2),
                format!("{:.2}", v.voxelize_seconds),
                format!("{:.2}", v.render_seconds),
                depths.join(", "),
            ]);
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
    let mut table = Table::new(&format!("curve | quality | {}", names.join(" | ")));
    for curve in &run.curves {
        for p in &curve.points {
            let mut row = cells![curve.name, p.setting()];
            row.extend(names.iter().map(|name| {
                let part = p.parts.iter().find(|(n, _)| n == name);
                part.map_or("-".into(), |(_, bytes)| bytes.to_string())
            }));
            table.row(row);
        }
    }
    Section::folded("What the bytes are spent on", vec![Block::Table(table)])
}

fn per_view(run: &Run) -> Section {
    let mut header = "view | original dB".to_owned();
    let ends = run.curves.last().map(|c| (c, [c.points.first(), c.points.last()]));
    let mut chosen: Vec<&Coded> = Vec::new();
    if let Some((curve, ends)) = ends {
        for p in ends.into_iter().flatten() {
            header += &format!(" | {}, quality {:.0}, dB", curve.name, p.quality);
            chosen.push(p);
        }
    }
    let mut table = Table::new(&header);
    for (i, view) in run.original.score.views.iter().enumerate() {
        let mut row = cells![view.view, format!("{:.3}", view.psnr_db)];
        let db = |p: &&Coded| p.score.views.get(i).map(|v| format!("{:.3}", v.psnr_db));
        row.extend(chosen.iter().map(|p| db(p).unwrap_or("-".into())));
        table.row(row);
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
