//! `gsvx info`.

use crate::output::megabytes;
use anyhow::{Context, Result};
use gsvx::stream::Container;
use std::path::PathBuf;

/// Arguments of `gsvx info`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The stream.
    input: PathBuf,
}

/// Prints header, sections and what a truncated file still holds.
pub(crate) fn run(args: &Args) -> Result<()> {
    let name = args.input.display();
    let bytes = std::fs::read(&args.input).with_context(|| format!("{name}: cannot be read"))?;
    let container = Container::parse(&bytes).with_context(|| name.to_string())?;
    let h = &container.header;
    let total = container.expected_len();
    let per = |n: u64| 8.0 * n as f64 / (h.count.max(1) as f64);
    println!("{name}: {} ({} bytes)", megabytes(bytes.len() as u64), bytes.len());
    println!("  Gaussians      {}", h.count);
    println!("  SH degree      {}", h.sh_degree);
    println!("  octree depth   {}", h.j_high);
    println!(
        "  cube           side {} at ({}, {}, {})",
        h.cube.side, h.cube.origin[0], h.cube.origin[1], h.cube.origin[2]
    );
    println!("  bits/Gaussian  {:.2}", per(total));
    println!();
    println!("  {:<14} {:>12} {:>14} {:>7}", "section", "bytes", "bits/Gaussian", "share");
    let line = |what: &str, n: u64, note: &str| {
        let share = 100.0 * n as f64 / total.max(1) as f64;
        println!("  {what:<14} {n:>12} {:>14.2} {share:>6.1}% {note}", per(n));
    };
    line("header", container.body_offset() as u64, "");
    for entry in &container.toc {
        let note = match container.section(entry.kind) {
            Ok(_) => String::new(),
            Err(e) => format!("  {e}"),
        };
        line(&entry.kind.to_string(), entry.len, &note);
    }
    let have = bytes.len() as u64;
    if have < total {
        println!(
            "\n  truncated: {have} of {total} bytes; the sections above without a remark decode"
        );
    } else if have > total {
        println!("\n  {} bytes after the last section are not part of the stream", have - total);
    }
    Ok(())
}
