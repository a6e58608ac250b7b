//! A report as one page that needs nothing else: style, charts and pictures are inside.

use std::fmt::Write as _;

use anyhow::Result;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;

use super::{Block, CropView, Document, NamedChart};
use crate::page::Table;

/// Text that is safe inside HTML.
fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// The whole page.
pub(super) fn render(document: &Document) -> Result<String> {
    let mut out = String::new();
    let _ = writeln!(
        out,
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta name=\"color-scheme\" content=\"light dark\">\n<title>{}</title>\n\
         <style>\n{}</style>\n</head>\n<body>\n<main>\n<h1>{}</h1>\n<p class=\"lead\">{}</p>",
        escape(&document.title),
        include_str!("page.css"),
        escape(&document.title),
        inline(&document.lead)
    );
    if !document.highlights.is_empty() {
        out.push_str("<ul class=\"highlights\">\n");
        for (figure, what) in &document.highlights {
            let _ =
                writeln!(out, "<li><b>{}</b><span>{}</span></li>", escape(figure), inline(what));
        }
        out.push_str("</ul>\n");
    }
    for (index, section) in document.sections.iter().enumerate() {
        let title = escape(&section.title);
        if section.open {
            let _ = writeln!(out, "<section>\n<h2>{title}</h2>");
        } else {
            let _ = writeln!(out, "<details>\n<summary><h2>{title}</h2></summary>");
        }
        for block in &section.blocks {
            render_block(&mut out, block, index)?;
        }
        out.push_str(if section.open { "</section>\n" } else { "</details>\n" });
    }
    out.push_str("</main>\n</body>\n</html>\n");
    Ok(out)
}

/// Escaped text with `code` marked up.
fn inline(text: &str) -> String {
    let mut out = String::new();
    for (i, part) in text.split('`').enumerate() {
        let part = escape(part);
        let _ = if i % 2 == 1 { write!(out, "<code>{part}</code>") } else { write!(out, "{part}") };
    }
    out
}

fn render_block(out: &mut String, block: &Block, section: usize) -> Result<()> {
    match block {
        Block::Text(text) => {
            let _ = writeln!(out, "<p>{}</p>", inline(text));
        }
        Block::List(items) => {
            out.push_str("<ul>\n");
            for item in items {
                let _ = writeln!(out, "<li>{}</li>", inline(item));
            }
            out.push_str("</ul>\n");
        }
        Block::Table(table) => render_table(out, table),
        Block::Charts(charts) => {
            let labels: Vec<&str> = charts.iter().map(|c| c.name).collect();
            begin_choice(out, "Metric", &labels, 0, &format!("s{section}m"));
            for NamedChart { chart, .. } in charts {
                let _ = writeln!(out, "<figure class=\"chart\">\n{}</figure>", chart.inline()?);
            }
            out.push_str("</fieldset>\n");
        }
        Block::Views(views) => {
            for (i, view) in views.iter().enumerate() {
                render_view(out, view, &format!("s{section}v{i}"))?;
            }
        }
    }
    Ok(())
}

fn render_table(out: &mut String, table: &Table) {
    out.push_str("<div class=\"table\"><table>\n<thead><tr>");
    for cell in &table.header {
        let _ = write!(out, "<th>{}</th>", escape(cell));
    }
    out.push_str("</tr></thead>\n<tbody>\n");
    let mut last = "";
    for row in &table.rows {
        let name = row.first().map_or("", String::as_str);
        // A new name begins a new group of rows.
        out.push_str(if name == last || last.is_empty() { "<tr>" } else { "<tr class=\"group\">" });
        last = name;
        for (c, cell) in row.iter().enumerate() {
            let cell = inline(cell);
            let _ = if c == 0 {
                write!(out, "<th>{cell}</th>")
            } else {
                write!(out, "<td>{cell}</td>")
            };
        }
        out.push_str("</tr>\n");
    }
    out.push_str("</tbody>\n</table></div>\n");
}

/// Begins a set of figures on top of each other, one shown at a time: buttons, no script.
fn begin_choice(out: &mut String, legend: &str, labels: &[&str], shown: usize, id: &str) {
    let _ = writeln!(out, "<fieldset class=\"view\">\n<legend>{}</legend>", escape(legend));
    for (i, label) in labels.iter().enumerate() {
        let checked = if i == shown { " checked" } else { "" };
        let _ = writeln!(
            out,
            "<input type=\"radio\" name=\"{id}\" id=\"{id}c{i}\"{checked}><label for=\"{id}c{i}\">{}</label>",
            escape(label)
        );
    }
}

/// Crops of one view.
fn render_view(out: &mut String, view: &CropView, id: &str) -> Result<()> {
    let shown = view.crops.iter().position(|c| c.shown).unwrap_or(0);
    let labels: Vec<&str> = view.crops.iter().map(|crop| crop.label.as_str()).collect();
    begin_choice(out, &view.name, &labels, shown, id);
    for crop in &view.crops {
        let _ = writeln!(
            out,
            "<figure><img alt=\"{}\" src=\"data:image/png;base64,{}\"><figcaption>{}</figcaption></figure>",
            escape(&crop.label),
            STANDARD.encode(&crop.png),
            escape(&crop.caption)
        );
    }
    out.push_str("</fieldset>\n");
    Ok(())
}
