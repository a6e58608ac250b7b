//! A report as Markdown.

use std::fmt::Write as _;

use super::{Block, Document};

/// The whole report.
pub(super) fn render(document: &Document) -> String {
    let mut out = format!("# {}\n\n{}\n\n", document.title, document.lead);
    for (figure, what) in &document.highlights {
        let _ = writeln!(out, "- **{figure}** {what}");
    }
    if !document.highlights.is_empty() {
        out.push('\n');
    }
    for section in &document.sections {
        let _ = writeln!(out, "## {}\n", section.title);
        for block in &section.blocks {
            render_block(&mut out, block);
        }
    }
    out
}

fn render_block(out: &mut String, block: &Block) {
    match block {
        Block::Text(text) => {
            let _ = writeln!(out, "{text}\n");
        }
        Block::List(items) => {
            for item in items {
                let _ = writeln!(out, "- {item}");
            }
            out.push('\n');
        }
        Block::Table(table) => *out += &table.markdown(),
        Block::Chart(chart, stem) => {
            let _ = writeln!(out, "![{}]({stem}.svg)\n", chart.title);
        }
        Block::Views(_) => {}
        Block::Files(files) => {
            for (caption, file) in files {
                let _ = writeln!(out, "{caption}\n\n![{caption}]({file})\n");
            }
        }
    }
}
