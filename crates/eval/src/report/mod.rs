//! Reports: one document, shown as an HTML page and on the terminal.

mod crops;
pub(crate) mod headline;
mod html;
pub(crate) mod run;
pub(crate) mod sections;

use std::fs;
use std::path::Path;

use anyhow::{Context, Result};

use crate::chart::Chart;
use crate::page::Table;

pub(crate) use crops::{CropView, LabelledImage, crops};

/// A report, independent of how it is shown.
#[derive(Debug)]
pub(crate) struct Document {
    /// One line.
    pub(crate) title: String,
    /// One sentence below it.
    pub(crate) lead: String,
    /// The figures that matter most, each with what it is.
    pub(crate) highlights: Vec<(String, String)>,
    /// The rest, in order.
    pub(crate) sections: Vec<Section>,
}

/// A part of a report under a heading.
#[derive(Debug)]
pub(crate) struct Section {
    /// Heading.
    pub(crate) title: String,
    /// Whether a page shows it unfolded.
    pub(crate) open: bool,
    /// Contents.
    pub(crate) blocks: Vec<Block>,
}

/// A piece of a report. In texts, backticks mark code.
#[derive(Debug)]
pub(crate) enum Block {
    /// A paragraph.
    Text(String),
    /// Items.
    List(Vec<String>),
    /// A table.
    Table(Table),
    /// Charts of the same curves by other metrics, to flip through; the first is shown.
    Charts(Vec<NamedChart>),
    /// Crops of views to flip through.
    Views(Vec<CropView>),
}

/// A chart to flip to.
#[derive(Debug)]
pub(crate) struct NamedChart {
    /// What the button says.
    pub(crate) name: &'static str,
    /// The chart.
    pub(crate) chart: Chart,
    /// The stem of its file.
    pub(crate) stem: String,
}

impl Section {
    /// Shown unfolded.
    pub(crate) fn open(title: impl Into<String>, blocks: Vec<Block>) -> Self {
        Self { title: title.into(), open: true, blocks }
    }

    /// Folded away on a page.
    pub(crate) fn folded(title: impl Into<String>, blocks: Vec<Block>) -> Self {
        Self { title: title.into(), open: false, blocks }
    }
}

impl Document {
    /// Writes `report.html` and an SVG of each chart into `out`.
    pub(crate) fn write(&self, out: &Path) -> Result<()> {
        let put = |name: &str, bytes: &[u8]| {
            let path = out.join(name);
            fs::write(&path, bytes).with_context(|| format!("write {}", path.display()))
        };
        for block in self.sections.iter().flat_map(|s| &s.blocks) {
            let Block::Charts(charts) = block else { continue };
            for NamedChart { chart, stem, .. } in charts {
                put(&format!("{stem}.svg"), chart.svg()?.as_bytes())?;
            }
        }
        put("report.html", html::render(self)?.as_bytes())
    }

    /// Prints title, highlights and the tables that a page shows unfolded.
    pub(crate) fn print(&self) {
        println!("{}", self.title);
        for (figure, what) in &self.highlights {
            println!("  {figure}  {what}");
        }
        for section in self.sections.iter().filter(|s| s.open) {
            for block in &section.blocks {
                if let Block::Table(table) = block {
                    print!("\n{}\n{}", section.title, table.plain());
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_says_all_and_needs_no_other_file() {
        let dir = tempfile::tempdir().unwrap();
        let mut table = Table::new("curve | bytes");
        table.row("a <b> | 12345");
        let document = Document {
            title: "Title & more".into(),
            lead: "Run `cargo xtask`.".into(),
            highlights: vec![("-80 %".into(), "smaller".into())],
            sections: vec![
                Section::open(
                    "Curves",
                    vec![Block::Charts(vec![NamedChart {
                        name: "PSNR",
                        chart: crate::chart::tests::sample(),
                        stem: "rd".into(),
                    }])],
                ),
                Section::folded("All", vec![Block::Table(table), Block::List(vec!["one".into()])]),
            ],
        };
        document.write(dir.path()).unwrap();
        let html = fs::read_to_string(dir.path().join("report.html")).unwrap();
        let marked = ["Title &amp; more", "a &lt;b&gt;", "<code>cargo xtask</code>", "<svg"];
        for text in ["12345", "Curves", "-80 %", "one", "name=\"viewport\""].iter().chain(&marked) {
            assert!(html.contains(text), "{text}");
        }
        assert!(!html.contains("src=\"http") && !html.contains("href=\"http"));
        assert!(dir.path().join("rd.svg").is_file());
    }
}
