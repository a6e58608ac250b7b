//! Charts: curves or named points over linear or logarithmic axes, drawn as SVG and PNG.
//!
//! This is the project's only chart code. A chart has two forms: a whole picture, and a plot
//! without ground and legend for a page that brings its own colours.

mod png;
mod svg;
mod ticks;

pub(crate) use svg::escape;
use ticks::{Placed, linear, logarithmic};

/// From this ratio of largest to smallest value on, a size axis is logarithmic.
const LOG_FROM: f64 = 5.0;

/// One axis.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// Quantity and unit.
    pub label: String,
    /// Whether equal ratios have equal lengths.
    pub log: bool,
}

impl Axis {
    /// A linear axis.
    pub fn linear(label: &str) -> Self {
        Self { label: label.to_owned(), log: false }
    }

    /// A logarithmic axis: equal ratios have equal lengths.
    pub fn logarithmic(label: &str) -> Self {
        Self { label: label.to_owned(), log: true }
    }

    /// Sizes in MB; logarithmic if they span enough.
    pub(crate) fn megabytes(values: impl Iterator<Item = f64> + Clone) -> Self {
        let low = values.clone().fold(f64::INFINITY, f64::min);
        let log = low > 0.0 && values.fold(0.0, f64::max) / low >= LOG_FROM;
        Self { label: "size, MB (10⁶ bytes)".to_owned(), log }
    }

    fn place(&self, value: f64) -> f64 {
        if self.log { value.log10() } else { value }
    }

    /// The axis laid out over `values`.
    fn ticks(&self, values: impl Iterator<Item = f64>) -> Placed {
        if self.log { logarithmic(values) } else { linear(values) }
    }
}

/// What a line stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Measured here: thick, filled marks.
    Ours,
    /// Another codec on the same model: thin, filled marks.
    Theirs,
    /// Published, of another training: thin and dashed, hollow marks.
    Published,
}

/// One line.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// Name in the legend.
    pub name: String,
    /// What it stands for.
    pub kind: Kind,
    /// Its points in drawing order; finite values.
    pub points: Vec<(f64, f64)>,
}

/// Marks of [`Series::sorted`]: enough for the eye, and a small file.
const SORTED_MARKS: usize = 30;

impl Series {
    /// `values` in ascending order over the share of them that is not greater, per cent; a selection of
    /// them where there are many.
    #[must_use]
    pub fn sorted(name: &str, mut values: Vec<f64>) -> Self {
        values.sort_by(f64::total_cmp);
        let last = values.len().max(2) - 1;
        let every = values.len().div_ceil(SORTED_MARKS).max(1);
        let marks = (0..last).step_by(every).chain([last]).filter(|&i| i < values.len());
        let points = marks.map(|i| (100.0 * i as f64 / last as f64, values[i])).collect();
        Self { name: name.to_owned(), kind: Kind::Theirs, points }
    }
}

/// A chart. Build it with [`Chart::new`], which drops what cannot be drawn.
#[derive(Clone, Debug, PartialEq)]
pub struct Chart {
    /// Title, one line.
    pub(crate) title: String,
    x: Axis,
    y: Axis,
    /// Lines, first on top in the legend.
    pub(crate) series: Vec<Series>,
    /// A horizontal level with its name.
    level: Option<(f64, String)>,
    /// Names stand beside the last point of their series instead of in a legend.
    names_at_points: bool,
}

/// Colours by hand: distinct in grey and to colour-blind eyes (Okabe and Ito), darkened where
/// they would be faint on white. Index by place in the legend.
const COLOURS: [&str; 8] =
    ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#b58900", "#56a4d9", "#7a5c3e", "#888888"];

impl Chart {
    /// A chart of what is finite (and positive, on a logarithmic axis).
    pub fn new(
        title: impl Into<String>,
        x: Axis,
        y: Axis,
        series: Vec<Series>,
        level: Option<(f64, String)>,
    ) -> Self {
        let drawable = |(a, b): &(f64, f64)| {
            let fine = |axis: &Axis, v: f64| v.is_finite() && (!axis.log || v > 0.0);
            fine(&x, *a) && fine(&y, *b)
        };
        let series = series.into_iter().filter_map(|mut s| {
            s.points.retain(drawable);
            (!s.points.is_empty()).then_some(s)
        });
        let series = series.collect();
        Self { title: title.into(), x, y, series, level, names_at_points: false }
    }

    /// A chart of single points, each with its name beside it.
    pub fn of_points(
        title: impl Into<String>,
        x: Axis,
        y: Axis,
        points: impl IntoIterator<Item = (String, (f64, f64))>,
    ) -> Self {
        let series = |(name, point)| Series { name, kind: Kind::Ours, points: vec![point] };
        let series = points.into_iter().map(series).collect();
        Self { names_at_points: true, ..Self::new(title, x, y, series, None) }
    }

    /// Colour of a line.
    pub(crate) fn colour(&self, index: usize) -> &'static str {
        COLOURS[index % COLOURS.len()]
    }

    fn x_ticks(&self) -> Placed {
        self.x.ticks(self.series.iter().flat_map(|s| &s.points).map(|p| p.0))
    }

    fn y_ticks(&self) -> Placed {
        let values = self.series.iter().flat_map(|s| &s.points).map(|p| p.1);
        self.y.ticks(values.chain(self.level.iter().map(|l| l.0)))
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
            Axis::megabytes([0.2, 1.7].into_iter()),
            Axis::linear("PSNR, dB"),
            vec![
                line("ours & more", Kind::Ours, 0.0),
                line("theirs", Kind::Theirs, -1.0),
                line("published", Kind::Published, -2.0),
            ],
            Some((31.9, "uncompressed".into())),
        )
    }

    #[test]
    fn sorted_values_keep_both_ends() {
        let points = Series::sorted("a", (0..1000).rev().map(f64::from).collect()).points;
        assert!(points.len() <= SORTED_MARKS + 2);
        assert_eq!((points[0], points[points.len() - 1]), ((0.0, 0.0), (100.0, 999.0)));
        assert_eq!(Series::sorted("a", vec![3.0]).points, [(0.0, 3.0)]);
        assert!(Series::sorted("a", Vec::new()).points.is_empty());
    }

    #[test]
    fn what_cannot_be_drawn_is_left_out() {
        let points = vec![(0.0, 1.0), (1.0, f64::NAN), (2.0, 3.0)];
        let line = |points| Series { name: "a".into(), kind: Kind::Ours, points };
        let log = Axis { label: "x".into(), log: true };
        let nothing = line(vec![(f64::INFINITY, 0.0)]);
        let chart = Chart::new("", log, Axis::linear("y"), vec![line(points), nothing], None);
        assert_eq!(chart.series.len(), 1);
        assert_eq!(chart.series[0].points, [(2.0, 3.0)]);
    }
}
