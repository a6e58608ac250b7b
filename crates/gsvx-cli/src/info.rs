//! `gsvx info`.

use crate::batch;
use crate::describe;
use crate::input::{self, Opened, ReadingAny};
use crate::output::megabytes;
use crate::report::Reporter;
use anyhow::Result;
use gsvx::slices;
use gsvx::stream::{Container, Header, SectionKind};
use serde_json::json;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Shown after the help.
pub(crate) const EXAMPLES: &str = "\
Examples:
  gsvx info scene.gsvx
  gsvx info model.ply
  gsvx info scene.gsvx model.spz --json";

/// Arguments of `gsvx info`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Streams, PLY, .splat or SPZ; `-` for standard input.
    #[arg(required = true, value_name = "FILE")]
    inputs: Vec<PathBuf>,
    #[command(flatten)]
    reading: ReadingAny,
}

/// Describes streams and models.
pub(crate) fn run(args: &Args, report: Reporter) -> Result<()> {
    let files = batch::readers(&args.inputs)?;
    batch::run(&files, |file| match args.reading.open(&file.input)? {
        Opened::Stream(bytes) => stream(&bytes, &file.input, args, report),
        Opened::Model(loaded) => describe::model(&loaded, &file.input, report),
    })
}

/// Prints header and sections of a stream, and what a truncated file still holds.
fn stream(bytes: &[u8], path: &Path, args: &Args, report: Reporter) -> Result<()> {
    let name = input::name(path);
    let container = Container::parse(bytes).map_err(|e| input::explain_stream(e, path, ""))?;
    let h = &container.header;
    let (have, total) = (bytes.len() as u64, container.expected_len());
    let outliers = container.outliers();
    let gaussians = h.count.saturating_add(outliers);
    args.reading.limit().check(path, gaussians)?;
    let per = |n: u64| 8.0 * n as f64 / (gaussians.max(1) as f64);
    let mut sections = vec![("header".to_owned(), container.body_offset() as u64, None, false)];
    for entry in &container.toc {
        let payload = container.section(entry.kind);
        let predicted = matches!(payload, Ok(Some(p)) if is_predicted(entry.kind, p, h));
        let fault = payload.err().map(|e| e.to_string());
        sections.push((entry.kind.to_string(), entry.len, fault, predicted));
    }
    let mut text = String::new();
    let mut line = |s: String| {
        // Writing to a String does not fail.
        let _ = writeln!(text, "{s}");
    };
    line(format!("{name}: {} ({have} bytes)", megabytes(have)));
    let exact = match outliers {
        0 => String::new(),
        1 => ", 1 outlier of them coded exactly".into(),
        n => format!(", {n} outliers of them coded exactly"),
    };
    line(format!("  Gaussians      {gaussians}{exact}"));
    line(format!("  SH degree      {}", h.sh_degree));
    line(format!("  octree depth   {}", h.j_high));
    line(format!("  slices         {}", h.slices));
    let [x, y, z] = h.cube.origin;
    line(format!("  cube           side {} at ({x}, {y}, {z})", h.cube.side));
    line(format!("  bits/Gaussian  {:.2}\n", per(total)));
    line(format!("  {:<14} {:>12} {:>14} {:>7}", "section", "bytes", "bits/Gaussian", "share"));
    for (what, n, fault, predicted) in &sections {
        let share = 100.0 * *n as f64 / total.max(1) as f64;
        let remark = match fault {
            Some(fault) => format!("   {fault}"),
            None if *predicted => "   predicted from the degree below".into(),
            None => String::new(),
        };
        line(format!("  {what:<14} {n:>12} {:>14.2} {share:>6.1}%{remark}", per(*n)));
    }
    if have < total {
        line(format!(
            "\n  truncated: {have} of {total} bytes; the sections above that lack nothing decode"
        ));
    } else if have > total {
        line(format!("\n  {} bytes after the last section are not part of it", have - total));
    }
    let json = json!({
        "bytes": have,
        "expected_bytes": total,
        "gaussians": gaussians,
        "outliers": outliers,
        "sh_degree": h.sh_degree,
        "octree_depth": h.j_high,
        "slices": h.slices,
        "cube": { "origin": h.cube.origin, "side": h.cube.side },
        "sections": sections
            .iter()
            .map(|(what, n, fault, predicted)| {
                json!({ "name": what, "bytes": n, "fault": fault, "predicted": predicted })
            })
            .collect::<Vec<_>>(),
    });
    report.say(false, text.trim_end(), &json)
}

/// Whether an SH degree is predicted from the one below, in some slice at least: its payload then
/// does not begin with 0 (docs/bitstream.md, section 6).
fn is_predicted(kind: SectionKind, payload: &[u8], header: &Header) -> bool {
    matches!(kind, SectionKind::Sh2 | SectionKind::Sh3)
        && usize::try_from(header.slices)
            .is_ok_and(|n| slices::split(payload, n).is_ok_and(|parts| parts.iter().any(begins)))
}

fn begins(part: &&[u8]) -> bool {
    part.first().is_some_and(|&b| b != 0)
}
