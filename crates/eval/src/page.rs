//! Pages of docs/results: each answers one question, in few words, with tables and pictures.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

use crate::chart::Chart;
use crate::measure::Score;
use crate::scenes;

/// Rows under a header; the first column is names, the others are numbers. A row is written with `|` between its
/// cells.
#[derive(Clone, Debug)]
pub struct Table {
    /// Names of the columns.
    pub(crate) header: Vec<String>,
    /// As many cells each.
    pub(crate) rows: Vec<Vec<String>>,
}

/// A number, or a dash where it is unknown.
pub(crate) fn number(x: impl Into<Option<f64>>, decimals: usize) -> String {
    x.into().filter(|x| !x.is_nan()).map_or("-".into(), |x| format!("{x:.decimals$}"))
}

/// A number with its sign and a unit, or a dash where it is unknown.
pub(crate) fn signed(x: Option<f64>, decimals: usize, unit: &str) -> String {
    x.map_or("-".into(), |x| format!("{x:+.decimals$}{unit}"))
}

/// Cells of a table: PSNR, SSIM, SSIMULACRA2.
pub(crate) fn scores(of: &Score) -> String {
    let Score { psnr_db, ssim, ssimulacra2, .. } = *of;
    format!("{} | {} | {}", number(psnr_db, 3), number(ssim, 4), number(ssimulacra2, 2))
}

fn cells(row: &str) -> Vec<String> {
    row.split('|').map(|cell| cell.trim().to_owned()).collect()
}

impl Table {
    /// No rows yet.
    #[must_use]
    pub fn new(header: impl AsRef<str>) -> Self {
        Self { header: cells(header.as_ref()), rows: Vec::new() }
    }

    /// Adds a row.
    pub fn row(&mut self, row: impl AsRef<str>) {
        let row = cells(row.as_ref());
        debug_assert_eq!(row.len(), self.header.len(), "{row:?}");
        self.rows.push(row);
    }

    /// Adds a row and prints it: for rows that take a while.
    pub(crate) fn told(&mut self, row: impl AsRef<str>) {
        eprintln!("{}", row.as_ref());
        self.row(row);
    }

    /// As Markdown, with an empty line behind it.
    pub(crate) fn markdown(&self) -> String {
        let line = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
        let rule = "---:|".repeat(self.header.len().saturating_sub(1));
        let rows: String = self.rows.iter().map(|row| line(row)).collect();
        format!("{}|---|{rule}\n{rows}\n", line(&self.header))
    }

    /// As comma-separated values, for what is too long for a page; the cells lose their own commas.
    fn csv(&self) -> String {
        let cell = |cell: &String| cell.replace(',', "");
        let line = |row: &Vec<String>| row.iter().map(cell).collect::<Vec<_>>().join(",") + "\n";
        [&self.header].into_iter().chain(&self.rows).map(line).collect()
    }

    /// For a terminal: columns aligned.
    pub(crate) fn plain(&self) -> String {
        let width = |c: usize| {
            let cells = self.rows.iter().chain([&self.header]).filter_map(|r| r.get(c));
            cells.map(|cell| cell.chars().count()).max().unwrap_or(0)
        };
        let widths: Vec<usize> = (0..self.header.len()).map(width).collect();
        let mut out = String::new();
        for row in [&self.header].into_iter().chain(&self.rows) {
            let mut line = String::new();
            for (c, (cell, w)) in row.iter().zip(&widths).enumerate() {
                // Names to the left, numbers to the right.
                let _ =
                    if c == 0 { write!(line, "{cell:<w$}") } else { write!(line, "  {cell:>w$}") };
            }
            let _ = writeln!(out, "{}", line.trim_end());
        }
        out
    }
}

/// A page in the making.
pub struct Page {
    out: PathBuf,
    text: String,
    /// Tables beside the page, with the names of their files.
    data: Vec<(PathBuf, Table)>,
    /// With the names of their files.
    charts: Vec<(PathBuf, Chart)>,
}

impl Page {
    /// A page that goes to `out`, relative to the root of the workspace.
    #[must_use]
    pub fn new(out: &Path, title: &str) -> Self {
        let out = scenes::root().join(out);
        Self { out, text: format!("# {title}\n\n"), data: Vec::new(), charts: Vec::new() }
    }

    /// Adds a paragraph, or a heading with its `##`.
    pub fn text(&mut self, text: impl AsRef<str>) {
        self.text += text.as_ref();
        self.text += "\n\n";
    }

    /// Adds a table.
    pub fn table(&mut self, table: &Table) {
        self.text += &table.markdown();
    }

    /// Adds a table in a file of its own, which has the page's name, and a sentence that ends in its name.
    pub(crate) fn data(&mut self, sentence: &str, table: Table) {
        let out = self.out.with_extension("csv");
        let file = out.file_name().unwrap_or_default().to_string_lossy();
        self.text += &format!("{sentence} [{file}]({file}).\n\n");
        self.data.push((out, table));
    }

    /// Adds a picture, which has the page's name and `suffix`.
    pub(crate) fn chart(&mut self, suffix: &str, chart: Chart) {
        let stem = self.out.file_stem().unwrap_or_default().to_string_lossy();
        let file = format!("{stem}{suffix}.svg");
        self.text += &format!("![{}]({file})\n\n", chart.title);
        self.charts.push((self.out.with_file_name(file), chart));
    }

    /// Writes the page, its pictures and its data.
    ///
    /// # Errors
    /// If a file cannot be written.
    pub fn write(self) -> Result<()> {
        if let Some(folder) = self.out.parent() {
            let cannot = || format!("create {}", folder.display());
            std::fs::create_dir_all(folder).with_context(cannot)?;
        }
        let put = |path: &Path, text: &str| {
            std::fs::write(path, text).with_context(|| format!("write {}", path.display()))
        };
        put(&self.out, &format!("{}\n", self.text.trim_end()))?;
        for (path, table) in &self.data {
            put(path, &table.csv())?;
        }
        for (path, chart) in &self.charts {
            put(path, &chart.svg()?)?;
        }
        println!("written: {}", self.out.display());
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_is_aligned_on_a_terminal_and_marked_in_markdown() {
        let mut table = Table::new("name | n");
        table.row("a | 10");
        table.row("longer | 7");
        assert_eq!(table.plain(), "name     n\na       10\nlonger   7\n");
        assert_eq!(table.markdown(), "| name | n |\n|---|---:|\n| a | 10 |\n| longer | 7 |\n\n");
    }

    #[test]
    fn a_page_is_written_with_its_pictures_and_data() {
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("folder/page.md");
        let mut page = Page::new(&out, "Why?");
        page.text("Because.");
        page.chart("-fox", crate::chart::tests::sample());
        let mut table = Table::new("name | n, m");
        table.row("a | 10");
        page.data("All:", table);
        page.write().unwrap();
        let text = std::fs::read_to_string(&out).unwrap();
        assert_eq!(
            text,
            "# Why?\n\nBecause.\n\n![a < b](page-fox.svg)\n\nAll: [page.csv](page.csv).\n"
        );
        let csv = std::fs::read_to_string(out.with_extension("csv")).unwrap();
        assert_eq!(csv, "name,n m\na,10\n");
        assert!(out.with_file_name("page-fox.svg").is_file());
    }

    /// Every page of results is short, and its pictures are there.
    #[test]
    fn the_pages_of_results_are_short_and_whole() {
        let folder = scenes::root().join("docs/results");
        for entry in std::fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_none_or(|e| e != "md") {
                continue;
            }
            let text = std::fs::read_to_string(&path).unwrap();
            let prose = text.lines().filter(|l| !l.starts_with('|'));
            let words: usize = prose.map(|l| l.split_whitespace().count()).sum();
            assert!(words <= 700, "{}: {words} words", path.display());
            for link in text.split("](").skip(1).filter_map(|l| l.split([')', '#']).next()) {
                let here = link.starts_with("http") || folder.join(link).exists();
                assert!(here, "{}: {link}", path.display());
            }
        }
    }
}
