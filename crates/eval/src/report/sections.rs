//! Parts of a report that show curves of others and differences of curves.

use super::{Block, Section};
use crate::bd::{self, Point};
use crate::chart::{LineKind, Series};
use crate::measure::Metric;
use crate::page::{self, Table, signed};
use crate::published::PAPER_CHAIN;
use crate::record::{Bd, Curve, Record, Run};

/// Bjontegaard differences of the hull of a curve against that of another.
pub(crate) fn compare(test: &Curve, anchor: &Curve) -> Bd {
    let by = |metric, compare: fn(&[Point], &[Point]) -> Option<f64>| {
        compare(&anchor.rates(metric), &test.rates(metric))
    };
    Bd {
        test: test.name.clone(),
        anchor: anchor.name.clone(),
        rates: Metric::ALL.map(|metric| by(metric, bd::bd_rate)),
        psnr: by(Metric::Psnr, bd::bd_score),
    }
}

/// Bjontegaard differences, with what they are.
pub(crate) fn differences(title: &str, all: &[Bd]) -> Section {
    let mut table = Table::new(
        "curve | against | BD-rate by PSNR, % | by SSIM, % | by SSIMULACRA2, % | BD-PSNR, dB",
    );
    for bd in all {
        let [a, b, c] = bd.rates.map(|rate| signed(rate, 2, ""));
        table.row(format!(
            "{} | {} | {a} | {b} | {c} | {}",
            bd.test,
            bd.anchor,
            signed(bd.psnr, 2, "")
        ));
    }
    Section::open(title, vec![Block::Text(BD_TEXT.into()), Block::Table(table)])
}

/// How the differences are meant.
const BD_TEXT: &str = "BD-rate: how many more bytes a curve needs than another at an equal score, on average. BD-PSNR: how \
     much higher its PSNR is at equal bytes. Between the upper-left convex hulls, by monotone interpolation (pchip). \
     Negative BD-rate: smaller at an equal score. A dash: the curves share no range, have too few points, or nobody \
     measured the score of one of them.";

/// How sizes and PSNRs are meant.
pub(crate) const UNITS: &str = "Sizes are of whole streams, decoded before rendering. Mbit = 10^6 bit. PSNR is \
     the mean over views of the per-view dB of the clamped float render against the 8-bit photo, SSIM the mean over \
     views with an 11x11 Gaussian window, SSIMULACRA2 that of the 8-bit renders as libjxl computes it (90: no \
     difference is seen side by side; 70: high quality).";

/// What to know about points recorded beside a scene.
const RECORDED_NOTE: &str = "The paper's chain is recorded: authors' voxelizer and initialisation, TMC13 with their \
     options, lossless covariance, no fine-tune. Peers are recorded too. All PSNRs by the same conventions as ours, \
     all held-out views.";

/// What to know about published points.
const PUBLISHED_NOTE: &str = "Published points are of another training of these photos (compare gains, not levels). The \
     paper's own Mbit are 2^20 bit and are converted to 10^6. On playroom the authors' files list the \
     lossy points of the two voxelizations swapped, judging by the rate increments; they are drawn as \
     published. The paper's lossy rates leave out the codebook indices, and its decoder uses the \
     fine-tuned means without coding them, so its points are optimistic.";

/// Others as lines of a chart, in MB, up to `widest` MB.
pub(crate) fn other_series(others: &[Curve], metric: Metric, widest: f64) -> Vec<Series> {
    let mut out = Vec::new();
    for other in others {
        let mut points = other.rates(metric);
        // A cloud of settings reads as a curve only along its hull.
        if points.len() > 4 {
            points = bd::hull(&points);
        }
        points.sort_by(|a, b| a.rate.total_cmp(&b.rate));
        let points: Vec<(f64, f64)> =
            points.into_iter().map(Point::in_mb).filter(|p| p.0 <= widest).collect();
        if !points.is_empty() {
            let kind = if other.is_published() { LineKind::Published } else { LineKind::Theirs };
            let name = if kind == LineKind::Published {
                format!("{} (published)", other.name)
            } else {
                other.name.clone()
            };
            out.push(Series { name, kind, points });
        }
    }
    out
}

/// Points of others as a table.
fn others_table(others: &[Curve]) -> Table {
    let mut table = Table::new("codec | settings | bytes | Mbit | PSNR dB | SSIM | SSIMULACRA2");
    for other in others {
        let mut points: Vec<&Record> = other.points.iter().collect();
        points.sort_by_key(|p| p.bytes);
        for p in points {
            let Record { setting, bytes, score, .. } = p;
            let (name, mbit, scores) = (&other.name, p.megabits(), page::scores(score));
            table.row(format!("{name} | {setting} | {bytes} | {mbit} | {scores}"));
        }
    }
    table
}

/// The others' points; nothing without others.
pub(crate) fn others(others: &[Curve]) -> Section {
    let mut blocks = Vec::new();
    if others.iter().any(|o| o.name == PAPER_CHAIN) {
        blocks.push(Block::Text(RECORDED_NOTE.into()));
    }
    if others.iter().any(Curve::is_published) {
        blocks.push(Block::Text(PUBLISHED_NOTE.into()));
    }
    if !others.is_empty() {
        blocks.push(Block::Table(others_table(others)));
    }
    Section::folded("Others on this scene", blocks)
}

/// Provenance of a run, and how many of its stages were already done.
pub(crate) fn provenance(run: &Run) -> Section {
    let mut items: Vec<String> =
        run.manifest.iter().map(|(name, value)| format!("{name}: `{value}`")).collect();
    let [skipped, stages] = run.stages;
    if stages > 0 {
        items.push(format!(
            "{skipped} of {stages} stages were already done for the same inputs, settings and program and were \
             skipped; their times are of the run that did them"
        ));
    }
    Section::open("Provenance", vec![Block::List(items)])
}
