//! Pages of docs/results: each answers one question, in few words, with a picture beside it.

use std::path::Path;

use anyhow::{Context, Result};

use crate::chart::Chart;
use crate::scenes;

/// Markdown that shows the picture of the page at `out`.
#[must_use]
pub fn picture(out: &Path, what: &str) -> String {
    let name = out.with_extension("svg");
    let name = name.file_name().unwrap_or_default().to_string_lossy();
    format!("![{what}]({name})")
}

/// Writes a page and its picture, which has the page's name with the ending `.svg`. `out` is relative
/// to the root of the workspace.
///
/// # Errors
/// If a file cannot be written.
pub fn write(out: &Path, text: &str, picture: Option<&Chart>) -> Result<()> {
    let out = scenes::root().join(out);
    if let Some(folder) = out.parent() {
        let cannot = || format!("create {}", folder.display());
        std::fs::create_dir_all(folder).with_context(cannot)?;
    }
    let put = |path: &Path, text: &str| {
        std::fs::write(path, text).with_context(|| format!("write {}", path.display()))
    };
    put(&out, text)?;
    if let Some(chart) = picture {
        put(&out.with_extension("svg"), &chart.svg())?;
    }
    println!("written: {}", out.display());
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Words of a page outside its tables.
    fn words(page: &str) -> usize {
        let text = page.lines().filter(|l| !l.starts_with('|'));
        text.map(|l| l.split_whitespace().count()).sum()
    }

    #[test]
    fn every_page_of_results_is_short() {
        let folder = scenes::root().join("docs/results");
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_some_and(|e| e == "md") {
                let words = words(&std::fs::read_to_string(&path).unwrap());
                assert!(words <= 1500, "{}: {words} words", path.display());
            }
        }
    }
}
