//! The report of a default run.

use super::headline;
use super::sections::{self, BD_TEXT, PUBLISHED_NOTE, UNITS};
use super::{Block, Document, Section, Table, View, megabits};
use crate::chart::{Axis, Chart, Kind, Series};
use crate::published::PAPER_CHAIN;
use crate::rd_curve::record::{Coded, Curve, Run};

/// Points of others larger than this many times our largest stream are left out of the chart
/// (the tables have them): raw PLY would squeeze all curves into a corner.
pub(crate) const WIDEST: f64 = 4.5;

/// What a reader must know to read the chart.
const TERMS: &str = "Each point is a stream, decoded and rendered: its size, and its PSNR against photos that \
     the model was not trained on (held out). PSNR measures how near a render is to the photo, in dB: one dB more \
     is a fifth less squared error. Further left is smaller, higher is nearer. An octree divides space into cells; \
     its depth says how small the finest are.";

/// What gsvx is, for someone who has never heard of it.
const WHAT: &str = "gsvx compresses trained 3D Gaussian splatting models. It follows the paper Adaptive \
     Voxelization for Transform Coding of 3D Gaussian Splatting Data (arXiv 2506.00271).";

const COLUMNS: [&str; 12] = [
    "curve",
    "quality",
    "bytes",
    "Mbit",
    "bit/Gaussian",
    "PSNR dB",
    "SSIM",
    "Gaussians",
    "voxelize s",
    "encode s",
    "decode s",
    "render s",
];

/// The row of one point.
pub(crate) fn cells(curve: &Curve, p: &Coded) -> Vec<String> {
    vec![
        curve.name.clone(),
        p.setting(),
        p.bytes.to_string(),
        megabits(p.bytes),
        format!("{:.2}", p.bits_per_gaussian()),
        format!("{:.3}", p.score.psnr_db),
        format!("{:.4}", p.score.ssim),
        p.gaussians.to_string(),
        curve.voxels_of(p).map_or("-".into(), |v| format!("{:.2}", v.voxelize_seconds)),
        format!("{:.2}", p.encode_seconds),
        format!("{:.2}", p.decode_seconds),
        format!("{:.2}", p.render_seconds),
    ]
}

/// The original and all points.
pub(crate) fn points(original: &crate::rd_curve::record::Original, curves: &[Curve]) -> Table {
    let mut table = Table::new(&COLUMNS);
    let none = || "-".to_owned();
    table.rows.push(vec![
        "original PLY".into(),
        none(),
        original.file_bytes.to_string(),
        megabits(original.file_bytes),
        format!("{:.2}", original.file_bytes as f64 * 8.0 / original.gaussians.max(1) as f64),
        format!("{:.3}", original.score.psnr_db),
        format!("{:.4}", original.score.ssim),
        original.gaussians.to_string(),
        none(),
        none(),
        none(),
        format!("{:.2}", original.render_seconds),
    ]);
    for curve in curves.iter().rev() {
        table.rows.extend(curve.points.iter().map(|p| cells(curve, p)));
    }
    table
}

/// Our curves as lines of a chart.
pub(crate) fn series(curves: &[Curve]) -> Vec<Series> {
    let line = |curve: &Curve| {
        let mut points = curve.rates();
        points.sort_by(|a, b| a.rate.total_cmp(&b.rate));
        Series {
            name: curve.name.clone(),
            kind: Kind::Ours,
            points: points.iter().map(|p| (p.rate / 1e6, p.psnr_db)).collect(),
        }
    };
    curves.iter().map(line).collect()
}

/// PSNR over size.
pub(crate) fn chart(title: String, series: Vec<Series>, original_db: f64) -> Chart {
    let sizes: Vec<f64> = series.iter().flat_map(|s| &s.points).map(|p| p.0).collect();
    Chart::new(
        title,
        Axis::megabytes(sizes.iter().copied()),
        Axis::linear("PSNR at held-out views, dB"),
        series,
        Some((original_db, format!("uncompressed model, {original_db:.2} dB"))),
    )
}

/// The report, with crops of the views where they are at hand.
pub(crate) fn document(run: &Run, views: Vec<View>) -> Document {
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
         SH degree {}{invalid}; uncompressed it is {:.1} MB and reaches {:.2} dB PSNR and an SSIM of {:.4}.",
        run.what,
        run.views,
        run.held_out,
        run.measured,
        o.gaussians,
        o.sh_degree,
        o.file_bytes as f64 / 1e6,
        o.score.psnr_db,
        o.score.ssim
    );
    let mut all = series(&run.curves);
    let largest = all.iter().flat_map(|s| &s.points).map(|p| p.0).fold(0.0, f64::max);
    all.reverse();
    all.extend(sections::other_series(&run.others, WIDEST * largest));
    let title = format!("{}: PSNR over size, {} held-out views", run.scene, run.measured);
    let chart = chart(title, all, o.score.psnr_db);
    let curves = run.curves.iter().rev().map(|c| format!("`{}`: {}", c.name, c.what)).collect();
    let mut sections = vec![
        Section::open(
            "Curves",
            vec![Block::Text(TERMS.into()), Block::List(curves), Block::Chart(chart, "rd".into())],
        ),
        pictures(run, views),
        Section::open(
            "Points",
            vec![Block::Text(UNITS.into()), Block::Table(points(o, &run.curves))],
        ),
        Section::open(
            "Curves against each other (Bjontegaard differences)",
            vec![Block::Text(BD_TEXT.into()), Block::Table(sections::bd_table(&run.bd))],
        ),
    ];
    if !run.tools.is_empty() {
        sections.push(peers(&run.tools));
    }
    if !run.others.is_empty() {
        sections.push(others(run));
    }
    sections.extend([voxelizations(run), spent(run), per_view(run)]);
    sections.push(sections::provenance(&run.manifest, run.skipped, run.stages));
    sections.retain(|s| !s.blocks.is_empty());
    Document {
        title: headline::title(&run.scene, &comparisons),
        lead,
        highlights: headline::highlights(run, &comparisons),
        sections,
    }
}

/// Peers' tools run here, and those that were not.
pub(crate) fn peers(tools: &[crate::peers::Outcome]) -> Section {
    let mut blocks = vec![Block::Text(
        "The peers' own tools on the same model; decoded models rendered like ours. Times are of whole \
         processes, reading and writing files included."
            .into(),
    )];
    let table = crate::peers::table(tools);
    if !table.rows.is_empty() {
        blocks.push(Block::Table(table));
    }
    let absent: Vec<String> = tools.iter().filter_map(crate::peers::Outcome::absence).collect();
    if !absent.is_empty() {
        blocks.push(Block::List(absent));
    }
    Section::open("Peers in this run", blocks)
}

fn voxelizations(run: &Run) -> Section {
    let found = run.curves.iter().flat_map(|c| &c.voxelized).map(|v| v.importance_seconds);
    let text = format!(
        "Quality of the voxelized and merged models before coding. Merging and coding weigh each Gaussian by \
         its contribution to the training views (cameras only, no photos; {:.1} s).",
        found.fold(0.0, f64::max)
    );
    let mut table = Table::new(&[
        "voxelization",
        "Gaussians",
        "kept",
        "PSNR dB",
        "SSIM",
        "voxelize s",
        "render s",
        "leaves by depth",
    ]);
    for curve in &run.curves {
        for v in &curve.voxelized {
            let kept = 100.0 * v.gaussians as f64 / run.original.gaussians.max(1) as f64;
            let depths = (0..).zip(&v.depth_histogram).filter(|&(_, &n)| n > 0);
            let depths: Vec<String> =
                depths.map(|(d, n): (usize, _)| format!("{d}: {n}")).collect();
            table.rows.push(vec![
                format!("{}, {}", curve.name, v.what),
                v.gaussians.to_string(),
                format!("{kept:.1} %"),
                format!("{:.3}", v.score.psnr_db),
                format!("{:.4}", v.score.ssim),
                format!("{:.2}", v.voxelize_seconds),
                format!("{:.2}", v.render_seconds),
                depths.join(", "),
            ]);
        }
    }
    Section::folded("Voxelizations", vec![Block::Text(text), Block::Table(table)])
}

fn spent(run: &Run) -> Section {
    // The paper's coding has other parts than gsvx.
    let mut names: Vec<&str> = Vec::new();
    for (name, _) in run.curves.iter().flat_map(|c| &c.points).flat_map(|p| &p.parts) {
        if !names.contains(&name.as_str()) {
            names.push(name);
        }
    }
    let header: Vec<&str> = ["curve", "quality"].into_iter().chain(names.iter().copied()).collect();
    let mut table = Table::new(&header);
    for curve in &run.curves {
        for p in &curve.points {
            let mut row = vec![curve.name.clone(), p.setting()];
            row.extend(names.iter().map(|name| {
                let part = p.parts.iter().find(|(n, _)| n == name);
                part.map_or("-".into(), |(_, bytes)| bytes.to_string())
            }));
            table.rows.push(row);
        }
    }
    Section::folded("What the bytes are spent on", vec![Block::Table(table)])
}

fn others(run: &Run) -> Section {
    let mut blocks = Vec::new();
    if run.others.iter().any(|o| o.name == PAPER_CHAIN) {
        blocks.push(Block::Text(
            "The paper's chain is recorded: authors' voxelizer and initialisation, TMC13 with their \
             options, lossless covariance, no fine-tune. Peers are recorded too. All PSNRs by the same \
             conventions as ours, all held-out views."
                .into(),
        ));
    }
    if run.others.iter().any(crate::published::Other::is_published) {
        blocks.push(Block::Text(PUBLISHED_NOTE.into()));
    }
    blocks.push(Block::Table(sections::others_table(&run.others)));
    Section::folded("Others on this scene", blocks)
}

fn per_view(run: &Run) -> Section {
    let curve = run.curves.last();
    let ends = curve.map(|c| (c.points.first(), c.points.last()));
    let mut header = vec!["view".to_owned(), "original dB".to_owned()];
    let chosen: Vec<&Coded> = ends.into_iter().flat_map(|(a, b)| [a, b]).flatten().collect();
    for p in &chosen {
        let name = curve.map_or("", |c| c.name.as_str());
        header.push(format!("{name}, quality {:.0}, dB", p.quality));
    }
    let mut rows = Vec::new();
    for (i, view) in run.original.score.views.iter().enumerate() {
        let mut row = vec![view.view.clone(), format!("{:.3}", view.psnr_db)];
        row.extend(
            chosen
                .iter()
                .map(|p| p.score.views.get(i).map_or("-".into(), |v| format!("{:.3}", v.psnr_db))),
        );
        rows.push(row);
    }
    Section::folded("Views", vec![Block::Table(Table { header, rows })])
}

fn pictures(run: &Run, views: Vec<View>) -> Section {
    if run.pictures.is_empty() {
        return Section::open("Pictures", Vec::new());
    }
    let files = run.pictures.iter().map(|p| (format!("{}: {}", p.view, p.caption), p.file.clone()));
    let mut blocks = vec![Block::Files(files.collect())];
    if !views.is_empty() {
        blocks.insert(
            0,
            Block::Text(
                "Press a button to change the picture: the photo, the render of the uncompressed model \
                 (original), of streams by their size, and the difference of each from the original. Of a large view \
                 it is the window where the smallest stream differs most; whole views, side by side, are in \
                 `pictures/`."
                    .into(),
            ),
        );
        blocks.insert(1, Block::Views(views));
    }
    Section::open("Pictures", blocks)
}

/// Prints the tables.
pub(crate) fn print(run: &Run) {
    print!("{}", points(&run.original, &run.curves).plain());
    println!();
    print!("{}", sections::bd_table(&run.bd).plain());
    if !run.tools.is_empty() {
        println!();
        print!("{}", crate::peers::table(&run.tools).plain());
        for line in run.tools.iter().filter_map(crate::peers::Outcome::absence) {
            println!("{line}");
        }
    }
}
