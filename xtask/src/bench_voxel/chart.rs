//! Curves of bytes against PSNR, as SVG.

use anyhow::{Result, anyhow};
use plotters::prelude::*;

use crate::bd::Point;

const SIZE: (u32, u32) = (900, 560);
/// Distinct in grey and to colour-blind eyes (Okabe and Ito).
const COLOURS: [RGBColor; 7] = [
    RGBColor(120, 120, 120),
    RGBColor(0, 0, 0),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(0, 158, 115),
    RGBColor(0, 114, 178),
];

/// Draws at most as many curves as there are colours.
pub(super) fn svg(title: &str, lines: &[(String, Vec<Point>)]) -> Result<String> {
    let mut text = String::new();
    draw(title, lines, &mut text).map_err(|e| anyhow!("{e}"))?;
    Ok(text)
}

fn draw(
    title: &str,
    lines: &[(String, Vec<Point>)],
    text: &mut String,
) -> Result<(), Box<dyn std::error::Error>> {
    let all = || lines.iter().flat_map(|(_, p)| p);
    let bounds = |value: &dyn Fn(&Point) -> f64| {
        all().map(value).fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)))
    };
    let (x, y) = (bounds(&|p| p.rate / 1e6), bounds(&|p| p.psnr_db));
    let root = SVGBackend::with_string(text, SIZE).into_drawing_area();
    root.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&root)
        .caption(title, ("sans-serif", 20))
        .margin(14)
        .x_label_area_size(44)
        .y_label_area_size(56)
        .build_cartesian_2d(0.0..x.1 * 1.03, y.0 - 0.3..y.1 + 0.3)?;
    chart
        .configure_mesh()
        .x_desc("size, MB (10^6 bytes)")
        .y_desc("PSNR, dB")
        .light_line_style(TRANSPARENT)
        .bold_line_style(RGBColor(225, 225, 225))
        .draw()?;
    for ((name, points), colour) in lines.iter().zip(COLOURS) {
        let xy = || points.iter().map(|p| (p.rate / 1e6, p.psnr_db));
        chart
            .draw_series(LineSeries::new(xy(), colour.stroke_width(2)))?
            .label(name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(2)));
        chart.draw_series(xy().map(|at| Circle::new(at, 3, colour.filled())))?;
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::LowerRight)
        .background_style(WHITE.mix(0.85))
        .draw()?;
    root.present()?;
    Ok(())
}
