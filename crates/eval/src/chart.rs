//! Charts: curves over linear or logarithmic axes, as SVG.
//!
//! This is the project's only chart code. The SVG has one form for files, on white, and one for pages, in the
//! colours of the page.

use std::ops::Range;

use anyhow::Result;
use plotters::coord::Shift;
use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};
use plotters::element::DashedPathElement;
use plotters::prelude::*;

/// One axis.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Axis {
    /// Quantity and unit.
    label: String,
    log: bool,
}

impl Axis {
    /// A linear axis.
    pub(crate) fn linear(label: &str) -> Self {
        Self { label: label.to_owned(), log: false }
    }

    /// Equal ratios have equal lengths; where the values span little, linear all the same.
    pub(crate) fn logarithmic(label: &str) -> Self {
        Self { label: label.to_owned(), log: true }
    }

    /// Laid out over `values`.
    fn place(&self, values: impl Iterator<Item = f64>) -> AxisLayout {
        let (low, high) =
            values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
        let (low, high) = if low <= high { (low, high) } else { (0.0, 1.0) };
        let log = self.log && low > 0.0 && high / low >= LOG_FROM;
        let (low, high) = if log { (low.log10(), high.log10()) } else { (low, high) };
        let air = (AIR * (high - low)).max(1e-3 * high.abs().max(1e-3));
        let ends = (low - air, high + air);
        let ticks = if log { decades(ends.0, ends.1) } else { multiples(ends.0, ends.1) };
        let label = if log { format!("{}, logarithmic", self.label) } else { self.label.clone() };
        AxisLayout { label, log, ends, ticks }
    }
}

/// From this ratio of largest to smallest value on, a logarithmic axis is one.
const LOG_FROM: f64 = 5.0;
/// Share of the span left free on either side.
const AIR: f64 = 0.04;

/// An axis laid out.
#[derive(Clone)]
struct AxisLayout {
    label: String,
    log: bool,
    /// Of the values, or of their decimal logarithms.
    ends: (f64, f64),
    /// Values that have a number.
    ticks: Vec<f64>,
}

impl Ranged for AxisLayout {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, pixels: (i32, i32)) -> i32 {
        let (from, to) = pixels;
        let place = if self.log { value.log10() } else { *value };
        let share = (place - self.ends.0) / (self.ends.1 - self.ends.0);
        from + (share * f64::from(to - from)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        if hint.weight().allow_light_points() { Vec::new() } else { self.ticks.clone() }
    }

    fn range(&self) -> Range<f64> {
        let value = |end: f64| if self.log { 10f64.powf(end) } else { end };
        value(self.ends.0)..value(self.ends.1)
    }
}

impl ValueFormatter<f64> for AxisLayout {
    fn format_ext(&self, value: &f64) -> String {
        if self.log && *value < 1e-3 {
            return format!("{value:.0e}");
        }
        // Enough digits to tell ticks apart.
        let step = if self.log { 0.1 * value.abs() } else { (self.ends.1 - self.ends.0) / 50.0 };
        let decimals = (-step.log10()).ceil().clamp(0.0, 9.0) as usize;
        let text = format!("{value:.decimals$}");
        let short = text.trim_end_matches('0').trim_end_matches('.');
        if text.contains('.') { short.to_owned() } else { text }
    }
}

/// Multiples of 1, 2 or 5 times a power of ten, about seven.
fn multiples(low: f64, high: f64) -> Vec<f64> {
    let rough = (high - low) / 8.0;
    let power = 10f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].map(|m| m * power).into_iter().find(|s| *s >= rough);
    let step = step.unwrap_or(10.0 * power);
    ((low / step).ceil() as i64..=(high / step).floor() as i64).map(|i| i as f64 * step).collect()
}

/// Round numbers of each decade, more where there are few decades.
fn decades(low: f64, high: f64) -> Vec<f64> {
    let mantissas: &[f64] = match high - low {
        span if span > 3.0 => &[1.0],
        span if span > 1.2 => &[1.0, 2.0, 5.0],
        _ => &[1.0, 1.5, 2.0, 3.0, 5.0, 7.0],
    };
    let all = (low.floor() as i32..=high.ceil() as i32)
        .flat_map(|d| mantissas.iter().map(move |m| m * 10f64.powi(d)));
    all.filter(|v| (low..=high).contains(&v.log10())).collect()
}

/// What a line stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum LineKind {
    /// Measured here: thick.
    Ours,
    /// Another codec on the same model: thin.
    Theirs,
    /// Published, of another training: thin and dashed.
    Published,
    /// Alternatives, in no order: marks without a line.
    Marks,
}

/// One line.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Series {
    /// Name in the legend.
    pub(crate) name: String,
    /// What it stands for.
    pub(crate) kind: LineKind,
    /// Its points in drawing order.
    pub(crate) points: Vec<(f64, f64)>,
}

impl Series {
    /// A line of what was measured here.
    pub(crate) fn ours(name: impl Into<String>, points: Vec<(f64, f64)>) -> Self {
        Self { name: name.into(), kind: LineKind::Ours, points }
    }

    /// Marks without a line.
    pub(crate) fn marks(name: impl Into<String>, points: Vec<(f64, f64)>) -> Self {
        Self { name: name.into(), kind: LineKind::Marks, points }
    }
}

/// A chart. Build it with [`Chart::new`], which drops what cannot be drawn.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Chart {
    /// One line.
    pub(crate) title: String,
    x: Axis,
    y: Axis,
    /// First on top.
    series: Vec<Series>,
    /// A horizontal level with its name.
    level: Option<(f64, String)>,
}

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// Distinct in grey and to colour-blind eyes (Okabe and Ito), darkened where they would be faint on white.
const COLOURS: [RGBColor; 8] = [
    RGBColor(0x00, 0x72, 0xb2),
    RGBColor(0xd5, 0x5e, 0x00),
    RGBColor(0x00, 0x9e, 0x73),
    RGBColor(0xcc, 0x79, 0xa7),
    RGBColor(0xb5, 0x89, 0x00),
    RGBColor(0x56, 0xa4, 0xd9),
    RGBColor(0x7a, 0x5c, 0x3e),
    RGBColor(0x88, 0x88, 0x88),
];
const INK: RGBColor = RGBColor(0x22, 0x22, 0x22);
const GRID: RGBColor = RGBColor(0xe2, 0xe2, 0xe2);

const WIDTH: u32 = 720;
/// Of title and plot.
const HEIGHT: u32 = 470;
/// Of a line of the legend.
const ROW: i32 = 22;

impl Chart {
    /// A chart of what is finite, and positive on a logarithmic axis.
    pub(crate) fn new(
        title: impl Into<String>,
        [x, y]: [Axis; 2],
        series: impl IntoIterator<Item = Series>,
        level: Option<(f64, String)>,
    ) -> Self {
        let fine = |axis: &Axis, v: f64| v.is_finite() && (!axis.log || v > 0.0);
        let series = series.into_iter().filter_map(|mut s| {
            s.points.retain(|&(a, b)| fine(&x, a) && fine(&y, b));
            (!s.points.is_empty()).then_some(s)
        });
        let series = series.collect();
        Self { title: title.into(), x, y, series, level }
    }

    /// The chart as a file.
    pub(crate) fn svg(&self) -> Result<String> {
        let rows = self.series.len() + usize::from(self.level.is_some());
        let size = (WIDTH, HEIGHT + ROW as u32 * rows as u32 + 12);
        let mut out = String::new();
        let area = SVGBackend::with_string(&mut out, size).into_drawing_area();
        let drawn = area.fill(&WHITE).and_then(|()| self.draw(&area)).and_then(|()| area.present());
        drawn.map_err(|e| anyhow::anyhow!("draw a chart: {e}"))?;
        drop(area);
        Ok(out)
    }

    /// The chart inside a page, in the page's colours `--ink` and `--rule`.
    pub(crate) fn inline(&self) -> Result<String> {
        let colours = [(WHITE, "none"), (INK, "var(--ink)"), (GRID, "var(--rule)")];
        Ok(colours.iter().fold(self.svg()?, |svg, (RGBColor(r, g, b), by)| {
            svg.replace(&format!("#{r:02X}{g:02X}{b:02X}"), by)
        }))
    }

    fn draw(&self, area: &Area<'_>) -> Drawing {
        let points = || self.series.iter().flat_map(|s| &s.points);
        let x = self.x.place(points().map(|p| p.0));
        let y = self.y.place(points().map(|p| p.1).chain(self.level.iter().map(|l| l.0)));
        let font = |size: i32| ("sans-serif", size).into_font().color(&INK);
        let (plot, _) = area.split_vertically(HEIGHT);
        let widest = y.ticks.iter().map(|t| y.format_ext(t).len()).max().unwrap_or(0);
        let (left, right) = (x.range().start, x.range().end);
        let names = [x.label.clone(), y.label.clone()];
        let mut chart = ChartBuilder::on(&plot)
            .margin(12)
            .margin_right(24)
            .caption(&self.title, font(20))
            .x_label_area_size(52)
            .y_label_area_size(40 + 9 * widest as u32)
            .build_cartesian_2d(x, y)?;
        chart
            .configure_mesh()
            .bold_line_style(GRID)
            .axis_style(INK)
            .label_style(font(17))
            .axis_desc_style(font(17))
            .x_desc(&names[0])
            .y_desc(&names[1])
            .draw()?;
        let at = |p: &(f64, f64)| chart.backend_coord(p);
        let legend = |row: usize| HEIGHT as i32 + ROW * row as i32 + ROW / 2;
        let name = |row: usize, name: &str| {
            area.draw(&Text::new(name.to_owned(), (66, legend(row) - 7), font(17)))
        };
        let sample = |row: usize| vec![(20, legend(row)), (56, legend(row))];
        if let Some((value, of)) = &self.level {
            let ends = [left, right].map(|x| at(&(x, *value)));
            dashed(area, &ends, 1, INK)?;
            let row = self.series.len();
            dashed(area, &sample(row), 1, INK)?;
            name(row, of)?;
        }
        // First lines last, so that they lie on top.
        for (i, series) in self.series.iter().enumerate().rev() {
            let line: Vec<Pixel> = series.points.iter().map(at).collect();
            for line in [&line, &sample(i)] {
                match series.kind {
                    LineKind::Ours => path(area, line, 3, colour(i))?,
                    LineKind::Theirs => path(area, line, 1, colour(i))?,
                    LineKind::Published => dashed(area, line, 1, colour(i))?,
                    LineKind::Marks => (),
                }
            }
            line.iter().chain([&(38, legend(i))]).try_for_each(|p| mark(area, i, *p))?;
            name(i, &series.name)?;
        }
        Ok(())
    }
}

/// A place on the picture.
type Pixel = (i32, i32);
type Drawing = Result<(), DrawingAreaErrorKind<std::io::Error>>;

fn colour(index: usize) -> RGBColor {
    COLOURS[index % COLOURS.len()]
}

fn path(area: &Area<'_>, line: &[Pixel], width: u32, colour: RGBColor) -> Drawing {
    area.draw(&PathElement::new(line, colour.stroke_width(width)))
}

fn dashed(area: &Area<'_>, line: &[Pixel], width: u32, colour: RGBColor) -> Drawing {
    area.draw(&DashedPathElement::new(line.iter().copied(), 6, 4, colour.stroke_width(width)))
}

/// A mark whose shape follows the place in the legend, so that colour is not needed.
fn mark(area: &Area<'_>, index: usize, at: Pixel) -> Drawing {
    let style = colour(index).filled();
    let (x, y) = at;
    // Colours come again after eight lines; then with another shape.
    match (index + index / COLOURS.len()) % 4 {
        0 => area.draw(&Circle::new(at, 4, style)),
        1 => area.draw(&Rectangle::new([(x - 4, y - 4), (x + 4, y + 4)], style)),
        2 => area.draw(&TriangleMarker::new(at, 6, style)),
        _ => area.draw(&Polygon::new([(x, y - 6), (x + 6, y), (x, y + 6), (x - 6, y)], style)),
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    pub(crate) fn sample() -> Chart {
        let line = |name: &str, kind, lift: f64| Series {
            name: name.into(),
            kind,
            points: vec![(0.2, 26.0 + lift), (0.5, 29.0 + lift), (1.7, 31.0 + lift)],
        };
        Chart::new(
            "a < b",
            [Axis::logarithmic("size, MB"), Axis::linear("PSNR, dB")],
            [
                line("ours & more", LineKind::Ours, 0.0),
                line("theirs", LineKind::Theirs, -1.0),
                line("published", LineKind::Published, -2.0),
            ],
            Some((31.9, "uncompressed".into())),
        )
    }

    fn numbers(axis: &Axis, values: &[f64]) -> Vec<String> {
        let placed = axis.place(values.iter().copied());
        placed.ticks.iter().map(|t| placed.format_ext(t)).collect()
    }

    #[test]
    fn axes_have_round_numbers() {
        let (linear, log) = (Axis::linear(""), Axis::logarithmic(""));
        assert_eq!(numbers(&linear, &[26.1, 31.9]), ["26", "27", "28", "29", "30", "31", "32"]);
        assert_eq!(numbers(&log, &[0.16, 4.5]), ["0.2", "0.5", "1", "2", "5"]);
        assert_eq!(numbers(&log, &[0.0241, 0.0254]).len(), 7);
        assert_eq!(numbers(&log, &[2e-6, 2.0]), ["1e-5", "1e-4", "0.001", "0.01", "0.1", "1"]);
        for values in [vec![], vec![3.0], vec![1e-4, 1e5]] {
            let n = [&linear, &log].map(|axis| numbers(axis, &values).len());
            assert!(n.iter().all(|n| (1..16).contains(n)), "{values:?}: {n:?}");
        }
    }

    #[test]
    fn what_cannot_be_drawn_is_left_out() {
        let points = vec![(0.0, 1.0), (1.0, f64::NAN), (2.0, 3.0)];
        let lines = [points, vec![(f64::INFINITY, 0.0)]].map(|p| Series::ours("a", p));
        let chart = Chart::new("", [Axis::logarithmic("x"), Axis::linear("y")], lines, None);
        assert_eq!(chart.series, [Series::ours("a", vec![(2.0, 3.0)])]);
    }

    #[test]
    fn the_svg_names_everything_and_a_page_brings_its_colours() {
        let (file, page) = (sample().svg().unwrap(), sample().inline().unwrap());
        for name in ["a &lt; b", "ours &amp; more", "published", "uncompressed", "PSNR, dB"] {
            assert!(file.contains(name) && page.contains(name), "{name}");
        }
        assert!(page.contains("var(--ink)") && !page.contains("#FFFFFF") && !file.contains("var("));
    }
}
