//! An SVG chart as PNG, in the fonts of this machine.

use anyhow::{Context, Result};
use resvg::tiny_skia::{Pixmap, Transform};
use resvg::usvg::{Options, Tree};

use super::Chart;

/// Pixels per unit of the SVG.
const SCALE: f32 = 2.0;

impl Chart {
    /// The chart with its legend as PNG. Without any font on the machine it has no text.
    pub(crate) fn png(&self) -> Result<Vec<u8>> {
        let mut options = Options { font_family: "DejaVu Sans".into(), ..Options::default() };
        options.fontdb_mut().load_system_fonts();
        let tree = Tree::from_str(&self.svg(), &options).context("read the chart's SVG")?;
        let size = tree.size().to_int_size();
        let size = size.scale_by(SCALE).context("size of a chart")?;
        let mut pixels = Pixmap::new(size.width(), size.height()).context("memory for a chart")?;
        resvg::render(&tree, Transform::from_scale(SCALE, SCALE), &mut pixels.as_mut());
        pixels.encode_png().context("encode a chart as PNG")
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_chart_becomes_a_picture_with_its_colours() {
        let png = super::super::tests::sample().png().unwrap();
        let picture = image::load_from_memory(&png).unwrap().to_rgb8();
        let wanted = image::Rgb([0x00, 0x72, 0xb2]);
        assert!(picture.pixels().filter(|p| **p == wanted).count() > 100);
    }
}
