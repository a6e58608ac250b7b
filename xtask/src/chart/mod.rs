//! Line charts: curves over a linear or logarithmic axis, drawn as SVG and PNG.

mod png;
mod svg;
mod ticks;

pub(crate) use svg::escape;
use ticks::{Placed, linear, logarithmic};

/// From this ratio of largest to smallest value on, a size axis is logarithmic.
const LOG_FROM: f64 = 5.0;

/// One axis.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Axis {
    /// Quantity and unit.
    pub(crate) label: String,
    /// Whether equal ratios have equal lengths.
    pub(crate) log: bool,
}

impl Axis {
    /// A linear axis.
    pub(crate) fn linear(label: &str) -> Self {
        Self { label: label.to_owned(), log: false }
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
}

/// What a line stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    /// Measured here: thick, filled marks.
    Ours,
    /// Somebody else's codec, on the same model: thin, filled marks.
    Theirs,
    /// Published, of another training: thin and dashed, hollow marks.
    Published,
}

/// One line.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Series {
    /// Name in the legend.
    pub(crate) name: String,
    /// What it stands for.
    pub(crate) kind: Kind,
    /// Where it lies, in the order it is drawn; finite values.
    pub(crate) points: Vec<(f64, f64)>,
}

/// A chart. Build it with [`Chart::new`], which drops what cannot be drawn.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Chart {
    /// One line above.
    pub(crate) title: String,
    x: Axis,
    y: Axis,
    /// Lines, first on top in the legend.
    pub(crate) series: Vec<Series>,
    /// A horizontal level with its name.
    level: Option<(f64, String)>,
}

/// Colours by hand: distinct in grey and to colour-blind eyes (Okabe and Ito), darkened where
/// they would be faint on white. Index by place in the legend.
const COLOURS: [&str; 8] =
    ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#b58900", "#56a4d9", "#7a5c3e", "#888888"];

impl Chart {
    /// A chart of what is finite (and positive, on a logarithmic axis).
    pub(crate) fn new(
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
        Self { title: title.into(), x, y, series, level }
    }

    /// Colour of a line.
    pub(crate) fn colour(&self, index: usize) -> &'static str {
        COLOURS[index % COLOURS.len()]
    }

    fn x_ticks(&self) -> Placed {
        let values = self.series.iter().flat_map(|s| &s.points).map(|p| p.0);
        if self.x.log { logarithmic(values) } else { linear(values) }
    }

    fn y_ticks(&self) -> Placed {
        let values = self.series.iter().flat_map(|s| &s.points).map(|p| p.1);
        linear(values.chain(self.level.iter().map(|l| l.0)))
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
