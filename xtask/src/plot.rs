//! The rate-distortion plot, as SVG.

use anyhow::{Result, anyhow};
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;

use crate::bd::{self, Point};
use crate::rd_curve::record::Run;

const SIZE: (u32, u32) = (960, 640);
/// Colours by hand: distinct in grey and to colour-blind eyes (Okabe and Ito).
const OURS: [RGBColor; 2] = [RGBColor(0, 114, 178), RGBColor(213, 94, 0)];
const THEIRS: [RGBColor; 6] = [
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(120, 120, 120),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(90, 60, 20),
];
/// Points larger than this many times our largest stream are left out of the picture (the
/// report's tables have them): raw PLY would squeeze all curves into a corner.
const WIDEST: f64 = 1.5;

/// One line of the plot, rates in MB.
struct Line {
    name: String,
    points: Vec<Point>,
    colour: RGBColor,
    ours: bool,
}

fn lines(run: &Run) -> Vec<Line> {
    let in_mb = |points: Vec<Point>| -> Vec<Point> {
        points.into_iter().map(|p| Point { rate: p.rate / 1e6, ..p }).collect()
    };
    let mut out = Vec::new();
    for (i, curve) in run.curves.iter().enumerate() {
        let (points, colour) = (in_mb(curve.curve()), OURS[i % OURS.len()]);
        out.push(Line { name: format!("gsvx, {}", curve.what), points, colour, ours: true });
    }
    let largest = out.iter().flat_map(|l| &l.points).map(|p| p.rate).fold(0.0, f64::max);
    for (i, other) in run.others.iter().enumerate() {
        let mut points = in_mb(other.curve());
        // A cloud of settings reads as a curve only along its hull.
        if points.len() > 4 {
            points = bd::hull(&points);
        }
        points.retain(|p| p.rate <= WIDEST * largest);
        points.sort_by(|a, b| a.rate.total_cmp(&b.rate));
        if !points.is_empty() {
            let colour = THEIRS[i % THEIRS.len()];
            out.push(Line { name: other.name.clone(), points, colour, ours: false });
        }
    }
    out
}

/// A range with some air around the values; never empty.
fn range(values: impl Iterator<Item = f64>, air: f64, floor: f64) -> std::ops::Range<f64> {
    let (low, high) = values
        .filter(|v| v.is_finite())
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    if low > high {
        return 0.0..1.0;
    }
    let pad = ((high - low) * air).max(1e-3 * high.abs().max(1e-3));
    (low - pad).max(floor)..high + pad
}

/// Draws the run.
pub(crate) fn svg(run: &Run) -> Result<String> {
    let mut text = String::new();
    draw(run, &mut text).map_err(|e| anyhow!("{e}"))?;
    Ok(text)
}

fn draw(run: &Run, text: &mut String) -> Result<(), Box<dyn std::error::Error>> {
    let lines = lines(run);
    let reference = run.original.score.psnr_db;
    let all = || lines.iter().flat_map(|l| &l.points);
    let xs = range(all().map(|p| p.rate), 0.05, 0.0);
    let ys = range(all().map(|p| p.psnr_db).chain([reference]), 0.06, f64::NEG_INFINITY);
    let root = SVGBackend::with_string(text, SIZE).into_drawing_area();
    root.fill(&WHITE)?;
    let title = format!("{}: held-out PSNR over size ({} views)", run.scene, run.measured);
    let mut chart = ChartBuilder::on(&root)
        .caption(title, ("sans-serif", 22))
        .margin(14)
        .x_label_area_size(48)
        .y_label_area_size(62)
        .build_cartesian_2d(xs.clone(), ys)?;
    chart
        .configure_mesh()
        .x_desc("size, MB (10^6 bytes)")
        .y_desc("PSNR, dB")
        .x_label_formatter(&|x| label(*x, &xs))
        .y_label_formatter(&|y| format!("{y:.1}"))
        .label_style(("sans-serif", 15))
        .axis_desc_style(("sans-serif", 16))
        .light_line_style(RGBColor(244, 244, 244))
        .bold_line_style(RGBColor(225, 225, 225))
        .draw()?;
    // The uncompressed model: a dashed level.
    let dash = BLACK.mix(0.6).stroke_width(1);
    chart
        .draw_series(DashedLineSeries::new(
            [(xs.start, reference), (xs.end, reference)],
            6,
            4,
            dash,
        ))?
        .label(format!("uncompressed model, {reference:.2} dB"))
        .legend(move |(x, y)| PathElement::new(vec![(x, y), (x + 22, y)], dash));
    for line in &lines {
        series(&mut chart, line)?;
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::LowerRight)
        .margin(12)
        .legend_area_size(30)
        .label_font(("sans-serif", 15))
        .background_style(WHITE.mix(0.9))
        .border_style(RGBColor(180, 180, 180))
        .draw()?;
    root.present()?;
    Ok(())
}

type Chart<'a> = ChartContext<'a, SVGBackend<'a>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

fn series<'a>(chart: &mut Chart<'a>, line: &Line) -> Result<(), Box<dyn std::error::Error>> {
    let (colour, ours) = (line.colour, line.ours);
    let width = if ours { 3 } else { 1 };
    let xy = || line.points.iter().map(|p| (p.rate, p.psnr_db));
    chart
        .draw_series(LineSeries::new(xy(), colour.stroke_width(width)))?
        .label(line.name.clone())
        .legend(move |(x, y)| {
            let stroke = PathElement::new(vec![(x, y), (x + 22, y)], colour.stroke_width(width));
            let dot = Circle::new((x + 11, y), if ours { 5 } else { 3 }, colour.filled());
            EmptyElement::at((0, 0)) + stroke + dot
        });
    chart.draw_series(xy().map(|at| Circle::new(at, if ours { 5 } else { 3 }, colour.filled())))?;
    Ok(())
}

/// Enough digits to tell the labels of an axis apart.
fn label(x: f64, range: &std::ops::Range<f64>) -> String {
    let span = range.end - range.start;
    match span {
        s if s < 0.5 => format!("{x:.3}"),
        s if s < 5.0 => format!("{x:.2}"),
        s if s < 50.0 => format!("{x:.1}"),
        _ => format!("{x:.0}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_never_empty() {
        for values in [vec![], vec![3.0], vec![1.0, 2.0], vec![f64::NAN, 5.0]] {
            let r = range(values.into_iter(), 0.1, 0.0);
            assert!(r.start < r.end, "{r:?}");
        }
    }
}
