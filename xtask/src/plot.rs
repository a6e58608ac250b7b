//! The rate-distortion plot, as SVG.

use anyhow::{Result, anyhow};
use plotters::prelude::*;

use crate::bd::{self, Point};
use crate::rd_curve::record::Run;

const SIZE: (u32, u32) = (1180, 640);
/// Width of the legend beside the plot.
const LEGEND: u32 = 330;
/// Colours by hand: distinct in grey and to colour-blind eyes (Okabe and Ito).
const OURS: [RGBColor; 4] =
    [RGBColor(0, 114, 178), RGBColor(230, 159, 0), RGBColor(110, 110, 110), RGBColor(213, 94, 0)];
const THEIRS: [RGBColor; 6] = [
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(120, 120, 120),
    RGBColor(86, 180, 233),
    RGBColor(128, 128, 0),
    RGBColor(90, 60, 20),
];
/// Points larger than this many times our largest stream are left out of the picture (the
/// report's tables have them): raw PLY would squeeze all curves into a corner.
const WIDEST: f64 = 4.5;
/// From this ratio of largest to smallest size on, the size axis is logarithmic.
const LOG_FROM: f64 = 5.0;

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

/// How sizes lie along the axis.
#[derive(Clone, Copy)]
enum Scale {
    Linear,
    /// Octaves.
    Log,
}

impl Scale {
    fn of(lines: &[Line]) -> Self {
        let rates = || lines.iter().flat_map(|l| &l.points).map(|p| p.rate);
        let (low, high) = (rates().fold(f64::INFINITY, f64::min), rates().fold(0.0, f64::max));
        if low > 0.0 && high / low >= LOG_FROM { Self::Log } else { Self::Linear }
    }

    fn place(self, megabytes: f64) -> f64 {
        match self {
            Self::Linear => megabytes,
            Self::Log => megabytes.log2(),
        }
    }

    fn label(self, place: f64, range: &std::ops::Range<f64>) -> String {
        match self {
            Self::Linear => label(place, range.end - range.start),
            Self::Log => two_digits(place.exp2()),
        }
    }
}

fn draw(run: &Run, text: &mut String) -> Result<(), Box<dyn std::error::Error>> {
    let lines = lines(run);
    let scale = Scale::of(&lines);
    let reference = run.original.score.psnr_db;
    let all = || lines.iter().flat_map(|l| &l.points);
    let xs = range(all().map(|p| scale.place(p.rate)), 0.04, f64::NEG_INFINITY);
    let ys = range(all().map(|p| p.psnr_db).chain([reference]), 0.05, f64::NEG_INFINITY);
    let root = SVGBackend::with_string(text, SIZE).into_drawing_area();
    root.fill(&WHITE)?;
    let (left, right) = root.split_horizontally(SIZE.0 - LEGEND);
    let title = format!("{}: held-out PSNR over size ({} views)", run.scene, run.measured);
    let mut chart = ChartBuilder::on(&left)
        .caption(title, ("sans-serif", 22))
        .margin(14)
        .x_label_area_size(48)
        .y_label_area_size(62)
        .build_cartesian_2d(xs.clone(), ys)?;
    let axis = match scale {
        Scale::Linear => "size, MB (10^6 bytes)",
        Scale::Log => "size, MB (10^6 bytes), logarithmic",
    };
    chart
        .configure_mesh()
        .x_desc(axis)
        .y_desc("PSNR, dB")
        .x_labels(9)
        .x_label_formatter(&|x| scale.label(*x, &xs))
        .y_label_formatter(&|y| format!("{y:.1}"))
        .label_style(("sans-serif", 15))
        .axis_desc_style(("sans-serif", 16))
        .light_line_style(TRANSPARENT)
        .bold_line_style(RGBColor(225, 225, 225))
        .draw()?;
    // The uncompressed model: a dashed level.
    let level = [(xs.start, reference), (xs.end, reference)];
    chart.draw_series(DashedLineSeries::new(level, 6, 4, BLACK.mix(0.6).stroke_width(1)))?;
    for line in &lines {
        let xy = || line.points.iter().map(|p| (scale.place(p.rate), p.psnr_db));
        let (width, radius) = line.weight();
        chart.draw_series(LineSeries::new(xy(), line.colour.stroke_width(width)))?;
        chart.draw_series(xy().map(|at| Circle::new(at, radius, line.colour.filled())))?;
    }
    legend(&right, &lines, reference)?;
    root.present()?;
    Ok(())
}

impl Line {
    /// Stroke width and dot radius.
    fn weight(&self) -> (u32, i32) {
        if self.ours { (3, 5) } else { (1, 3) }
    }
}

type Area<'a> = DrawingArea<SVGBackend<'a>, plotters::coord::Shift>;

/// Names beside the plot: inside it they would hide points.
fn legend(
    area: &Area<'_>,
    lines: &[Line],
    reference: f64,
) -> Result<(), Box<dyn std::error::Error>> {
    let font = ("sans-serif", 14).into_font();
    let mut y = 62;
    let dash = BLACK.mix(0.6).stroke_width(1);
    for x in [4, 13, 22] {
        area.draw(&PathElement::new(vec![(x, y), (x + 6, y)], dash))?;
    }
    let name = format!("uncompressed model, {reference:.2} dB");
    area.draw(&Text::new(name, (38, y - 7), font.clone()))?;
    for line in lines {
        y += 26;
        let (width, radius) = line.weight();
        let stroke = line.colour.stroke_width(width);
        area.draw(&PathElement::new(vec![(4, y), (28, y)], stroke))?;
        area.draw(&Circle::new((16, y), radius, line.colour.filled()))?;
        for (i, part) in wrap(&line.name).iter().enumerate() {
            y += if i > 0 { 17 } else { 0 };
            area.draw(&Text::new(part.clone(), (38, y - 7), font.clone()))?;
        }
    }
    Ok(())
}

/// Characters that fit on a line of the legend.
const LEGEND_CHARS: usize = 38;

fn wrap(name: &str) -> Vec<String> {
    let mut out: Vec<String> = Vec::new();
    for word in name.split(' ') {
        match out.last_mut() {
            Some(line) if line.chars().count() + 1 + word.chars().count() <= LEGEND_CHARS => {
                line.push(' ');
                line.push_str(word);
            }
            _ => out.push(word.to_owned()),
        }
    }
    out
}

/// Two significant digits, or all before the point.
fn two_digits(x: f64) -> String {
    let decimals = (1.0 - x.log10().floor()).clamp(0.0, 9.0) as usize;
    format!("{x:.decimals$}")
}

/// Three significant digits: enough to tell the labels of an axis apart.
fn label(x: f64, span: f64) -> String {
    match span {
        s if s < 0.05 => format!("{x:.4}"),
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
    fn long_names_wrap_at_words() {
        let parts = wrap("gsvx, adaptive (paper's criteria), J = 10 to 13 .. J = 12 to 15");
        assert!(parts.len() == 2 && parts.iter().all(|p| p.chars().count() <= LEGEND_CHARS));
        assert_eq!(wrap("short"), ["short"]);
    }

    #[test]
    fn octave_labels_are_short() {
        let labels = [0.022097, 0.0625, 0.25, 1.0, 8.0, 16.0, 128.0].map(two_digits);
        assert_eq!(labels, ["0.022", "0.062", "0.25", "1.0", "8.0", "16", "128"]);
    }

    #[test]
    fn ranges_are_never_empty() {
        for values in [vec![], vec![3.0], vec![1.0, 2.0], vec![f64::NAN, 5.0]] {
            let r = range(values.into_iter(), 0.1, 0.0);
            assert!(r.start < r.end, "{r:?}");
        }
    }
}
