//! `report.md` and the table on the terminal.

use std::fmt::Write as _;

use crate::published::PAPER_CHAIN;
use crate::rd_curve::record::{Bd, Coded, Curve, Run};

/// Decimal megabytes with three digits after the point.
pub(crate) fn megabytes(bytes: u64) -> String {
    format!("{:.3}", bytes as f64 / 1e6)
}

/// Decimal megabits.
fn megabits(bytes: u64) -> String {
    format!("{:.3}", bytes as f64 * 8.0 / 1e6)
}

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

fn cells(curve: &Curve, p: &Coded) -> [String; 12] {
    [
        curve.name.clone(),
        format!("{:.0}", p.quality),
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

fn rows(run: &Run) -> Vec<[String; 12]> {
    let mut rows = Vec::new();
    let none = || "-".to_owned();
    let o = &run.original;
    rows.push([
        "original PLY".into(),
        none(),
        o.file_bytes.to_string(),
        megabits(o.file_bytes),
        format!("{:.2}", o.file_bytes as f64 * 8.0 / o.gaussians.max(1) as f64),
        format!("{:.3}", o.score.psnr_db),
        format!("{:.4}", o.score.ssim),
        o.gaussians.to_string(),
        none(),
        none(),
        none(),
        format!("{:.2}", o.render_seconds),
    ]);
    for curve in &run.curves {
        rows.extend(curve.points.iter().map(|p| cells(curve, p)));
    }
    rows
}

/// Prints the table, aligned.
pub(crate) fn print_table(run: &Run) {
    let rows = rows(run);
    let header = COLUMNS.map(str::to_owned);
    let width = |c: usize| {
        let cells = rows.iter().chain([&header]).map(|r| r[c].chars().count());
        cells.max().unwrap_or(0)
    };
    let widths: Vec<usize> = (0..COLUMNS.len()).map(width).collect();
    for row in [&header].into_iter().chain(&rows) {
        let mut line = String::new();
        for (c, cell) in row.iter().enumerate() {
            // Names to the left, numbers to the right.
            let _ = if c == 0 {
                write!(line, "{cell:<w$}", w = widths[c])
            } else {
                write!(line, "  {cell:>w$}", w = widths[c])
            };
        }
        println!("{}", line.trim_end());
    }
    for bd in &run.bd {
        println!("{}", bd_line(bd));
    }
}

fn bd_line(bd: &Bd) -> String {
    let figure = |x: Option<f64>, unit: &str| x.map_or("-".into(), |x| format!("{x:+.2}{unit}"));
    if bd.rate_cubic.is_none() && bd.rate_pchip.is_none() {
        return format!("{} against {}: no common PSNR range", bd.test, bd.anchor);
    }
    format!(
        "{} against {}: BD-rate {} cubic, {} pchip; BD-PSNR {} cubic, {} pchip",
        bd.test,
        bd.anchor,
        figure(bd.rate_cubic, " %"),
        figure(bd.rate_pchip, " %"),
        figure(bd.psnr_cubic, " dB"),
        figure(bd.psnr_pchip, " dB")
    )
}

fn table(out: &mut String, header: &[&str], rows: &[Vec<String>]) {
    let _ = writeln!(out, "| {} |", header.join(" | "));
    let align = |i: usize| if i == 0 { "---" } else { "---:" };
    let rule: Vec<&str> = (0..header.len()).map(align).collect();
    let _ = writeln!(out, "|{}|", rule.join("|"));
    for row in rows {
        let _ = writeln!(out, "| {} |", row.join(" | "));
    }
    out.push('\n');
}

/// The report as Markdown.
pub(crate) fn markdown(run: &Run) -> String {
    let mut out = format!("# Rate and distortion: {}\n\n{}.\n\n", run.scene, run.what);
    let o = &run.original;
    let _ = writeln!(
        out,
        "{} views, {} held out (every 8th by sorted name), {} measured. The model has {} Gaussians \
         of SH degree {}{}; uncompressed it reaches {:.3} dB and {:.4} SSIM.\n",
        run.views,
        run.held_out,
        run.measured,
        o.gaussians,
        o.sh_degree,
        if o.invalid > 0 {
            format!(" ({} invalid ones left out)", o.invalid)
        } else {
            String::new()
        },
        o.score.psnr_db,
        o.score.ssim
    );
    out.push_str("![rate-distortion curves](rd.svg)\n\n## Points\n\n");
    out.push_str(
        "Sizes are of whole streams, decoded from the file before rendering. Mbit = 10^6 bit. PSNR \
         is the mean over views of the per-view dB of the clamped float render against the 8-bit \
         photo.\n\n",
    );
    let body: Vec<Vec<String>> = rows(run).into_iter().map(|r| r.to_vec()).collect();
    table(&mut out, &COLUMNS, &body);
    voxelizations(&mut out, run);
    sections(&mut out, run);
    differences(&mut out, run);
    others(&mut out, run);
    per_view(&mut out, run);
    pictures(&mut out, run);
    provenance(&mut out, run);
    out
}

fn voxelizations(out: &mut String, run: &Run) {
    let found = run.curves.iter().flat_map(|c| &c.voxelized).map(|v| v.importance_seconds);
    let _ = writeln!(
        out,
        "## Voxelizations\n\nQuality of the voxelized and merged models before coding. Merging \
         and coding weigh each Gaussian by its contribution to the training views (cameras only, \
         no photos; {:.1} s).\n",
        found.fold(0.0, f64::max)
    );
    let mut rows = Vec::new();
    for curve in &run.curves {
        for v in &curve.voxelized {
            let kept = 100.0 * v.gaussians as f64 / run.original.gaussians.max(1) as f64;
            let depths = (0..).zip(&v.depth_histogram).filter(|&(_, &n)| n > 0);
            let depths: Vec<String> =
                depths.map(|(d, n): (usize, _)| format!("{d}: {n}")).collect();
            rows.push(vec![
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
    table(
        out,
        &[
            "voxelization",
            "Gaussians",
            "kept",
            "PSNR dB",
            "SSIM",
            "voxelize s",
            "render s",
            "leaves by depth",
        ],
        &rows,
    );
}

fn sections(out: &mut String, run: &Run) {
    out.push_str("## What the bytes are spent on\n\n");
    let Some(first) = run.curves.first().and_then(|c| c.points.first()) else { return };
    let names: Vec<&str> = first.sections.iter().map(|(n, _)| n.as_str()).collect();
    let header: Vec<&str> = ["curve", "quality"].into_iter().chain(names.iter().copied()).collect();
    let mut rows = Vec::new();
    for curve in &run.curves {
        for p in &curve.points {
            let mut row = vec![curve.name.clone(), format!("{:.0}", p.quality)];
            row.extend(names.iter().map(|name| {
                let bytes: u64 = p.sections.iter().filter(|(n, _)| n == name).map(|(_, b)| b).sum();
                bytes.to_string()
            }));
            rows.push(row);
        }
    }
    table(out, &header, &rows);
}

fn differences(out: &mut String, run: &Run) {
    out.push_str("## Bjontegaard differences\n\n");
    out.push_str(
        "Between the upper-left convex hulls, by a cubic fit of log-rate (as the paper does) and by \
         monotone interpolation. Negative BD-rate: smaller at equal PSNR.\n\n",
    );
    for bd in &run.bd {
        let _ = writeln!(out, "- {}", bd_line(bd));
    }
    out.push('\n');
}

fn others(out: &mut String, run: &Run) {
    if run.others.is_empty() {
        return;
    }
    out.push_str("## Others on this scene\n\n");
    if run.others.iter().any(|o| o.name == PAPER_CHAIN) {
        out.push_str(
            "The paper's chain is recorded: authors' voxelizer and initialisation, TMC13 with their \
             options, lossless covariance, no fine-tune. Peers are recorded too. All PSNRs by the \
             same conventions as ours, all held-out views.\n\n",
        );
    }
    if run.others.iter().any(|o| o.source.starts_with("published")) {
        out.push_str(
            "Published points are of another training of these photos (compare gains, not levels); \
             the paper's Mbit are 2^20 bit and are converted. On playroom the authors' files list \
             the lossy points of the two voxelizations swapped, judging by the rate increments.\n\n",
        );
    }
    let mut rows = Vec::new();
    for other in &run.others {
        let mut points = other.points.clone();
        points.sort_by_key(|p| p.bytes);
        for p in points {
            rows.push(vec![
                other.name.clone(),
                p.label.clone(),
                p.bytes.to_string(),
                megabits(p.bytes),
                format!("{:.3}", p.psnr_db),
                p.ssim.map_or("-".into(), |s| format!("{s:.4}")),
            ]);
        }
    }
    table(out, &["codec", "settings", "bytes", "Mbit", "PSNR dB", "SSIM"], &rows);
}

fn per_view(out: &mut String, run: &Run) {
    out.push_str("## Views\n\n");
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
    let header: Vec<&str> = header.iter().map(String::as_str).collect();
    table(out, &header, &rows);
}

fn pictures(out: &mut String, run: &Run) {
    if run.pictures.is_empty() {
        return;
    }
    out.push_str("## Pictures\n\nLeft to right as in each caption.\n\n");
    for p in &run.pictures {
        let _ = writeln!(out, "{}: {}\n\n![{}]({})\n", p.view, p.caption, p.caption, p.file);
    }
}

fn provenance(out: &mut String, run: &Run) {
    let m = &run.manifest;
    out.push_str("## Provenance\n\n");
    let processor = if m.processor.is_empty() { "unknown processor" } else { &m.processor };
    let commit = if m.commit.is_empty() { "unknown" } else { &m.commit };
    let _ = writeln!(
        out,
        "- Command: `{}`\n- Commit: {commit}\n- Model SHA-256: {}\n- Cameras and photos SHA-256: {}\n\
         - Program SHA-256: {}\n- Machine: {processor}, {} threads, {}",
        m.command, m.model_sha256, m.views_sha256, m.program_sha256, m.threads, m.target
    );
}
