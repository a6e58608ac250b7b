//! `gsvx info`.

use crate::batch;
use crate::commands::sequence;
use crate::describe;
use crate::frame_source;
use crate::input::{self, LARGE, OpenedInput, ReadingAny};
use crate::report::Reporter;
use crate::stream_file::{StreamBytes, StreamFile};
use anyhow::{Context, Result};
use gsvx::{Chunk, Index, Kind, Source};
use indicatif::DecimalBytes;
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};

pub(crate) const EXAMPLES: &str = "\
Examples:
  gsvx info scene.gsvx
  gsvx info model.ply
  gsvx info scene.gsvx model.spz --json";

#[derive(clap::Args)]
pub(crate) struct InfoArgs {
    /// Streams or models of any format; `-` for standard input.
    #[arg(required = true, value_name = "FILE")]
    inputs: Vec<PathBuf>,
    #[command(flatten)]
    reading: ReadingAny,
}

/// Describes streams and models.
pub(crate) fn run(args: &InfoArgs, report: Reporter) -> Result<()> {
    batch::run(&args.inputs, |path| {
        if frame_source::is_file(path) {
            return sequence::describe(&input::bytes(path)?, path, &args.reading, report);
        }
        if args.reading.model.is_stream_file(path)? {
            let stream = StreamFile::open(path)?;
            return describe_stream(&stream.source, &stream.index, path, args, report);
        }
        if let Some(parts) = args.reading.model.large(path)? {
            return describe::unread(&parts, path, report);
        }
        match args.reading.open(path)? {
            OpenedInput::Stream(bytes) => {
                let index = Index::parse(&bytes).with_context(|| input::name(path))?;
                describe_stream(&StreamBytes::Memory(bytes), &index, path, args, report)
            }
            OpenedInput::Model(loaded) => describe::model(&loaded, path, report),
        }
    })
}

/// Prints what a stream holds, and what is missing or damaged.
fn describe_stream(
    bytes: &StreamBytes,
    index: &Index,
    path: &Path,
    args: &InfoArgs,
    report: Reporter,
) -> Result<()> {
    let name = input::name(path);
    let h = &index.header;
    let (have, total) = (bytes.len(), index.stream_len());
    let exact: u64 = index.chunks.iter().filter(|c| c.kind == Kind::Exact).map(|c| c.count).sum();
    args.reading.limit.check(path, h.count)?;
    let per = |n: u64| 8.0 * n as f64 / (h.count.max(1) as f64);
    let mut text = format!("{name}: {} ({have} bytes)\n", DecimalBytes(have));
    let mut line = |s: String| text += &(s + "\n");
    let coded_exactly = match exact {
        0 => String::new(),
        n if n == h.count => ", all bit for bit".into(),
        n => format!(", {n} of them bit for bit"),
    };
    line(format!("  Gaussians      {}{coded_exactly}", h.count));
    line(format!("  SH degree      {}", h.sh_degree));
    if h.antialiased {
        line("  antialiased    yes: opacity is compensated for the blur".into());
    }
    line(format!("  octree depth   {}", h.j_high));
    let [x, y, z] = h.cube.origin.map(short);
    line(format!("  cube           side {} at ({x}, {y}, {z})", short(h.cube.side)));
    if h.origin != [0.0; 3] {
        line(describe::origin(h.origin).trim_end().into());
    }
    line(format!("  chunks         {}", index.chunks.len()));
    for lod in (0..=index.coarsest_lod()).rev().filter(|_| index.coarsest_lod() > 0) {
        let chunks = index.chunks_of_lod(lod);
        let count: u64 = chunks.map(|i| index.chunks[i].count).sum();
        line(format!("  level {lod}        {count} Gaussians"));
    }
    line(format!("  bits/Gaussian  {:.2}\n", per(total)));
    line(format!("  {:<16} {:>12} {:>14} {:>7}", "part", "bytes", "bits/Gaussian", "share"));
    for (part, n) in index.parts() {
        let share = 100.0 * n as f64 / total.max(1) as f64;
        line(format!("  {part:<16} {n:>12} {:>14.2} {share:>6.1}%", per(n)));
    }
    // Of a larger stream only the head is read.
    let is_compared = total.min(have) <= LARGE;
    let mut faults =
        if is_compared { gsvx::faults(bytes).with_context(|| name.clone())? } else { Vec::new() };
    if !is_compared {
        line(format!(
            "\n  Only the head was read, not {} of chunks; gsvx decode finds damage in them",
            DecimalBytes(total)
        ));
        if have < total {
            faults.push(format!("{} bytes are missing at the end", total - have));
        }
    }
    for fault in &faults {
        line(format!("\n  {fault}"));
    }
    if have > total {
        line(format!("\n  {} bytes after the last chunk are not part of it", have - total));
    }
    let json = json!({
        "bytes": have,
        "expected_bytes": total,
        "gaussians": h.count,
        "exact_gaussians": exact,
        "sh_degree": h.sh_degree,
        "antialiased": h.antialiased,
        "octree_depth": h.j_high,
        "origin": h.origin,
        "cube": { "origin": h.cube.origin, "side": h.cube.side },
        "lods": 1 + index.coarsest_lod(),
        "chunks": index.chunks.iter().map(chunk_json).collect::<Vec<_>>(),
        "parts": parts(&index.parts()),
        "faults": faults,
        "chunks_compared": is_compared,
    });
    report.say(false, text.trim_end(), &json)
}

/// Bytes by part of a stream.
pub(crate) fn parts(parts: &[(&str, u64)]) -> Map<String, Value> {
    parts.iter().map(|&(part, n)| (part.to_owned(), n.into())).collect()
}

fn chunk_json(chunk: &Chunk) -> Value {
    json!({
        "exact": chunk.kind == Kind::Exact,
        "lod": chunk.lod,
        "gaussians": chunk.count,
        "bounds": chunk.bounds,
        "offset": chunk.layers.first().map(|l| l.offset),
        "layers": chunk.layers.iter().map(|l| l.len).collect::<Vec<_>>(),
    })
}

/// A number with five digits, without the zeros of very small and very large ones.
fn short(x: f64) -> String {
    if x == 0.0 || (1e-3..1e6).contains(&x.abs()) {
        format!("{}", (x * 1e4).round() / 1e4)
    } else {
        format!("{x:.4e}")
    }
}
