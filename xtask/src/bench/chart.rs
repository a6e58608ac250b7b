//! Time against error of the settings of one stage, as SVG.

use anyhow::{Result, anyhow};
use plotters::prelude::*;

use super::Row;

const SIZE: (u32, u32) = (760, 460);

/// Both axes are logarithmic; an error of zero lies on the lower edge.
pub(super) fn svg(title: &str, rows: &[&Row]) -> Result<String> {
    let mut text = String::new();
    draw(title, rows, &mut text).map_err(|e| anyhow!("{e}"))?;
    Ok(text)
}

fn draw(title: &str, rows: &[&Row], text: &mut String) -> Result<(), Box<dyn std::error::Error>> {
    let positive = rows.iter().map(|r| r.error).filter(|&e| e > 0.0).fold(f64::INFINITY, f64::min);
    let floor = if positive.is_finite() { positive / 4.0 } else { 1e-3 };
    let at = |r: &Row| (1e3 * r.time.wall.max(1e-9), r.error.max(floor));
    let bounds = |value: &dyn Fn(&Row) -> f64| {
        let all = || rows.iter().map(|r| value(r));
        (all().fold(f64::INFINITY, f64::min) / 1.6, all().fold(0.0, f64::max) * 1.6)
    };
    let (x, y) = (bounds(&|r| at(r).0), bounds(&|r| at(r).1));
    let root = SVGBackend::with_string(text, SIZE).into_drawing_area();
    root.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&root)
        .caption(title, ("sans-serif", 19))
        .margin(14)
        .x_label_area_size(44)
        .y_label_area_size(72)
        .build_cartesian_2d((x.0..x.1).log_scale(), (y.0..y.1).log_scale())?;
    chart
        .configure_mesh()
        .x_desc("time, ms")
        .y_desc("error (on the lower edge: none)")
        .y_label_formatter(&|v| format!("{v:.1e}"))
        .light_line_style(TRANSPARENT)
        .bold_line_style(RGBColor(225, 225, 225))
        .draw()?;
    let colour = RGBColor(0, 114, 178);
    chart.draw_series(rows.iter().map(|r| Circle::new(at(r), 5, colour.filled())))?;
    let font = ("sans-serif", 13).into_font();
    for r in rows {
        let name = EmptyElement::at(at(r)) + Text::new(r.setting.clone(), (8, -6), font.clone());
        chart.draw_series(std::iter::once(name))?;
    }
    root.present()?;
    Ok(())
}
