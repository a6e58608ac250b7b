//! A chart as SVG: whole, with white ground and legend, or bare for a page that has its own.

use std::fmt::Write as _;

use super::{Axis, COLOURS, Chart, Kind};

/// Least room for the numbers on the left, and room for the last number on the right.
const LEFT: f64 = 66.0;
const RIGHT: f64 = 18.0;
/// Room for numbers and name of the size axis.
const BOTTOM: f64 = 58.0;
const TOP: f64 = 14.0;
/// Room for a title.
const TITLE: f64 = 30.0;
/// A line of the legend.
const ROW: f64 = 23.0;
/// Radius of a mark.
const MARK: f64 = 4.6;

/// Size of the plot with its axes, and colours of everything but the lines.
struct Theme {
    width: f64,
    height: f64,
    /// Of the numbers.
    font_size: u32,
    ground: Option<&'static str>,
    ink: &'static str,
    grid: &'static str,
    font: &'static str,
}

const PAPER: Theme = Theme {
    width: 640.0,
    height: 430.0,
    font_size: 15,
    ground: Some("#ffffff"),
    ink: "#222222",
    grid: "#e2e2e2",
    font: "DejaVu Sans, Helvetica, Arial, sans-serif",
};
/// The page's own colours, by custom properties, so that they follow its light and dark. Small:
/// on a phone the numbers must still be legible.
const PAGE: Theme = Theme {
    width: 400.0,
    height: 340.0,
    font_size: 14,
    ground: None,
    ink: "var(--ink)",
    grid: "var(--rule)",
    font: "inherit",
};

/// The same where there is room.
const WIDE_PAGE: Theme = Theme { width: 900.0, height: 460.0, font_size: 15, ..PAGE };

/// Text that is safe inside SVG and HTML.
pub(crate) fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

impl Chart {
    /// The whole chart.
    pub(crate) fn svg(&self) -> String {
        let rows = self.series.len() + usize::from(self.level.is_some());
        let rows = if self.names_at_points { 0 } else { rows };
        let height = TITLE + PAPER.height + ROW * rows as f64 + 14.0;
        let mut out = open(PAPER.width, height, &PAPER);
        let _ = writeln!(
            out,
            r#"<text x="{:.0}" y="22" font-size="16" font-weight="600" fill="{}">{}</text>"#,
            TOP,
            PAPER.ink,
            escape(&self.title)
        );
        self.plot(&mut out, TITLE, &PAPER);
        if self.names_at_points {
            out.push_str("</svg>\n");
            return out;
        }
        let mut y = TITLE + PAPER.height + ROW / 2.0;
        for (i, series) in self.series.iter().enumerate() {
            self.sample(&mut out, i, 20.0, y, &PAPER);
            row(&mut out, &series.name, y);
            y += ROW;
        }
        if let Some((_, name)) = &self.level {
            level_line(&mut out, 20.0, 56.0, y, &PAPER);
            row(&mut out, name, y);
        }
        out.push_str("</svg>\n");
        out
    }

    /// The plot alone, for a page, which shows the first on phones and the second where there is room. Its
    /// colours are the page's `--ink` and `--rule`.
    pub(crate) fn inline_svgs(&self) -> String {
        let mut out = String::new();
        for (class, theme) in [("narrow", &PAGE), ("wide", &WIDE_PAGE)] {
            let mut one = open(theme.width, theme.height, theme);
            self.plot(&mut one, 0.0, theme);
            one.push_str("</svg>\n");
            out += &one.replacen("<svg", &format!("<svg class=\"{class}\""), 1);
        }
        out
    }

    /// For each line its sample as SVG, and its name; the level last.
    pub(crate) fn legend(&self) -> Vec<(String, String)> {
        let small = |draw: &dyn Fn(&mut String)| {
            let mut out =
                r#"<svg viewBox="0 0 40 16" width="40" height="16" aria-hidden="true">"#.to_owned();
            draw(&mut out);
            out.push_str("</svg>");
            out
        };
        let mut rows: Vec<(String, String)> = (0..self.series.len())
            .map(|i| {
                (small(&|out| self.sample(out, i, 2.0, 8.0, &PAGE)), self.series[i].name.clone())
            })
            .collect();
        if let Some((_, name)) = &self.level {
            rows.push((small(&|out| level_line(out, 2.0, 38.0, 8.0, &PAGE)), name.clone()));
        }
        rows
    }

    fn plot(&self, out: &mut String, top: f64, theme: &Theme) {
        let (xs, ys) = (self.x_ticks(), self.y_ticks());
        let widest = ys.ticks.iter().map(|(_, text)| text_width(text, theme.font_size));
        let x0 = widest.fold(LEFT, |left, width| left.max(width + 32.0)).round();
        let x1 = theme.width - RIGHT;
        let (y0, y1) = (top + TOP, top + theme.height - BOTTOM);
        let px = |v: f64| x0 + (v - xs.range.0) / (xs.range.1 - xs.range.0) * (x1 - x0);
        let py = |v: f64| y1 - (v - ys.range.0) / (ys.range.1 - ys.range.0) * (y1 - y0);
        let (grid, ink, size) = (theme.grid, theme.ink, theme.font_size);
        for (at, text) in &ys.ticks {
            let y = py(*at);
            let _ = writeln!(
                out,
                r#"<path d="M{x0} {y:.1}H{x1}" stroke="{grid}"/><text x="{:.0}" y="{:.1}" font-size="{size}" text-anchor="end" fill="{ink}">{text}</text>"#,
                x0 - 8.0,
                y + 5.0
            );
        }
        for (at, text) in &xs.ticks {
            let x = px(*at);
            let _ = writeln!(
                out,
                r#"<path d="M{x:.1} {y0}V{y1}" stroke="{grid}"/><text x="{x:.1}" y="{:.1}" font-size="{size}" text-anchor="middle" fill="{ink}">{text}</text>"#,
                y1 + 21.0
            );
        }
        let _ = writeln!(out, r#"<path d="M{x0} {y0}V{y1}H{x1}" fill="none" stroke="{ink}"/>"#);
        let scale = |axis: &Axis| if axis.log { ", logarithmic" } else { "" };
        let (middle, centre) = ((x0 + x1) / 2.0, (y0 + y1) / 2.0);
        let _ = writeln!(
            out,
            r#"<text x="{middle:.0}" y="{:.0}" font-size="{size}" text-anchor="middle" fill="{ink}">{}{}</text><text transform="translate(17 {centre:.0}) rotate(-90)" font-size="{size}" text-anchor="middle" fill="{ink}">{}{}</text>"#,
            y1 + 46.0,
            escape(&self.x.label),
            scale(&self.x),
            escape(&self.y.label),
            scale(&self.y)
        );
        if let Some((value, _)) = &self.level {
            level_line(out, x0, x1, py(self.y.place(*value)), theme);
        }
        let place = |p: &(f64, f64)| (px(self.x.place(p.0)), py(self.y.place(p.1)));
        // First lines last, so that they lie on top.
        for (i, series) in self.series.iter().enumerate().rev() {
            let at: Vec<(f64, f64)> = series.points.iter().map(place).collect();
            let path: Vec<String> = at.iter().map(|(x, y)| format!("{x:.1} {y:.1}")).collect();
            self.stroke(out, i, &format!("M{}", path.join("L")));
            for ((x, y), (rate, value)) in at.iter().zip(&series.points) {
                self.mark(
                    out,
                    i,
                    *x,
                    *y,
                    theme,
                    Some(&format!("{}: {rate:.3}, {value:.3}", series.name)),
                );
            }
        }
        if self.names_at_points {
            let series = self.series.iter().enumerate();
            let last = series.filter_map(|(i, s)| {
                s.points.last().map(|p| (place(p), s.name.as_str(), self.colour(i)))
            });
            let all: Vec<Named<'_>> = last.collect();
            let plot = Area(x0, theme.width, y0, y1);
            names(out, &all, plot);
        }
    }

    fn stroke(&self, out: &mut String, index: usize, path: &str) {
        let (width, dash) = match self.series[index].kind {
            Kind::Ours => (2.8, ""),
            Kind::Theirs => (1.4, ""),
            Kind::Published => (1.4, r#" stroke-dasharray="5 4""#),
        };
        let colour = self.colour(index);
        let _ = writeln!(
            out,
            r#"<path d="{path}" fill="none" stroke="{colour}" stroke-width="{width}" stroke-linejoin="round"{dash}/>"#
        );
    }

    /// A mark whose shape follows the place in the legend, so that colour is not needed.
    fn mark(
        &self,
        out: &mut String,
        index: usize,
        x: f64,
        y: f64,
        theme: &Theme,
        says: Option<&str>,
    ) {
        let colour = self.colour(index);
        let hollow = self.series[index].kind == Kind::Published;
        let fill = if hollow { theme.ground.unwrap_or("var(--ground)") } else { colour };
        let r = MARK;
        // Colours come again after eight lines; then with another shape.
        let shape = match (index + index / COLOURS.len()) % 4 {
            0 => format!(
                "M{:.1} {y:.1}a{r} {r} 0 1 0 {} 0a{r} {r} 0 1 0 -{} 0z",
                x - r,
                2.0 * r,
                2.0 * r
            ),
            1 => format!("M{:.1} {:.1}h{w}v{w}h-{w}z", x - r * 0.9, y - r * 0.9, w = r * 1.8),
            2 => format!("M{x:.1} {:.1}l{r} {h}h-{}z", y - r * 1.1, 2.0 * r, h = r * 1.9),
            _ => format!("M{x:.1} {:.1}l{d} {d}l-{d} {d}l-{d} -{d}z", y - r * 1.25, d = r * 1.25),
        };
        let title = says.map_or(String::new(), |s| format!("<title>{}</title>", escape(s)));
        let _ = writeln!(
            out,
            r#"<path d="{shape}" fill="{fill}" stroke="{colour}" stroke-width="1.3">{title}</path>"#
        );
    }

    fn sample(&self, out: &mut String, index: usize, x: f64, y: f64, theme: &Theme) {
        self.stroke(out, index, &format!("M{x} {y}h36"));
        self.mark(out, index, x + 18.0, y, theme, None);
    }
}

fn open(width: f64, height: f64, theme: &Theme) -> String {
    let ground = theme.ground.map_or(String::new(), |g| {
        format!(r#"<rect width="{width:.0}" height="{height:.0}" fill="{g}"/>"#)
    });
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width:.0} {height:.0}\" font-family=\"{}\">{ground}\n",
        theme.font
    )
}

fn row(out: &mut String, name: &str, y: f64) {
    let _ = writeln!(
        out,
        r#"<text x="66" y="{:.1}" font-size="14" fill="{}">{}</text>"#,
        y + 5.0,
        PAPER.ink,
        escape(name)
    );
}

/// A rectangle: left, right, top, bottom.
#[derive(Clone, Copy)]
struct Area(f64, f64, f64, f64);

impl Area {
    fn meets(&self, o: &Self) -> bool {
        self.0 < o.1 && o.0 < self.1 && self.2 < o.3 && o.2 < self.3
    }

    fn holds(&self, o: &Self) -> bool {
        self.0 <= o.0 && o.1 <= self.1 && self.2 <= o.2 && o.3 <= self.3
    }
}

/// A point with its name and colour.
type Named<'a> = ((f64, f64), &'a str, &'static str);

/// Writes names beside their points, inside `plot`: to the right or to the left, at the first height
/// where a name lies neither on a mark nor on an earlier name.
fn names(out: &mut String, all: &[Named<'_>], plot: Area) {
    const SIZE: u32 = 13;
    let mark = |(x, y): (f64, f64)| Area(x - MARK, x + MARK, y - MARK, y + MARK);
    let mut taken: Vec<Area> = all.iter().map(|(at, ..)| mark(*at)).collect();
    for ((x, y), name, colour) in all {
        let width = text_width(name, SIZE);
        let near = |side: f64, step: i32| {
            let left = if side > 0.0 { x + 8.0 } else { x - 8.0 - width };
            let base = y + 4.0 + f64::from(step) * 5.0;
            Area(left, left + width, base - 0.8 * f64::from(SIZE), base + 3.0)
        };
        // Heights by growing distance: 0, -1, 1, -2, ...
        let steps = (0..40).map(|i| if i % 2 == 0 { i / 2 } else { -(i + 1) / 2 });
        let mut places = steps.flat_map(|step| [near(1.0, step), near(-1.0, step)]);
        let free = |a: &Area| plot.holds(a) && !taken.iter().any(|t| t.meets(a));
        let area = places.find(free).unwrap_or_else(|| near(1.0, 0));
        let to_the_left = area.1 < *x;
        let (x, anchor) = if to_the_left { (area.1, "end") } else { (area.0, "start") };
        let _ = writeln!(
            out,
            r#"<text x="{x:.1}" y="{:.1}" font-size="{SIZE}" text-anchor="{anchor}" fill="{colour}">{}</text>"#,
            area.3 - 3.0,
            escape(name)
        );
        taken.push(area);
    }
}

/// Width of a text in DejaVu Sans, about.
fn text_width(text: &str, size: u32) -> f64 {
    let em = |c: char| if " .,:;'|()[]fijlt-".contains(c) { 0.36 } else { 0.63 };
    text.chars().map(em).sum::<f64>() * f64::from(size)
}

fn level_line(out: &mut String, x0: f64, x1: f64, y: f64, theme: &Theme) {
    let _ = writeln!(
        out,
        r#"<path d="M{x0} {y:.1}H{x1}" stroke="{}" stroke-dasharray="7 4" stroke-width="1.2"/>"#,
        theme.ink
    );
}

#[cfg(test)]
mod tests {
    use super::super::tests::sample;
    use super::*;

    #[test]
    fn the_svg_is_well_formed_and_names_everything() {
        let chart = sample();
        for svg in [chart.svg(), chart.inline_svgs()] {
            assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"));
            assert_eq!(svg.matches("<text").count(), svg.matches("</text>").count());
            assert!(svg.contains("PSNR, dB") && svg.contains("MB") && !svg.contains("NaN"));
        }
        let whole = chart.svg();
        for name in ["a &lt; b", "ours &amp; more", "theirs", "published", "uncompressed"] {
            assert!(whole.contains(name), "{name}");
        }
        assert_eq!(chart.legend().len(), 4);
        assert!(chart.inline_svgs().contains("var(--ink)") && !whole.contains("var("));
    }

    #[test]
    fn names_beside_points_do_not_lie_on_each_other() {
        let points = [("one", (1.0, 1.0)), ("two", (1.01, 1.01)), ("far right", (1e3, 1e-3))];
        let points = points.map(|(name, at)| (name.to_owned(), at));
        let svg =
            Chart::of_points("t", Axis::logarithmic("x"), Axis::logarithmic("y"), points).svg();
        let number = |name: &str, key: &str| -> f64 {
            let line = svg.lines().find(|l| l.ends_with(&format!(">{name}</text>"))).unwrap();
            line.split(&format!(" {key}=\""))
                .nth(1)
                .unwrap()
                .split('"')
                .next()
                .unwrap()
                .parse()
                .unwrap()
        };
        let (one, two) =
            ((number("one", "x"), number("one", "y")), (number("two", "x"), number("two", "y")));
        assert!((one.0 - two.0).abs() > 20.0 || (one.1 - two.1).abs() > 12.0, "{one:?} {two:?}");
        assert!(number("far right", "x") < PAPER.width - RIGHT);
        assert!(svg.contains("y, logarithmic") && !svg.contains("NaN"));
    }
}
