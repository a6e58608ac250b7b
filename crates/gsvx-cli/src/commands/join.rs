//! `gsvx join`: one stream from the streams of the parts of a scene.

use crate::exit::usage;
use crate::input;
use crate::output::Output;
use crate::report::Reporter;
use crate::size;
use crate::stream_file::StreamFile;
use anyhow::{Context, Error, Result, anyhow, bail};
use gsvx::Index;
use indicatif::DecimalBytes;
use serde_json::json;
use std::io::Write;
use std::ops::Range;
use std::path::PathBuf;
use std::time::Instant;

pub(crate) const EXAMPLES: &str = "\
Examples:
  gsvx join part-*.gsvx -o city.gsvx";

/// Bytes that are copied at a time.
const PIECE: u64 = 1 << 22;

#[derive(clap::Args)]
pub(crate) struct JoinArgs {
    /// All parts that gsvx encode --part has made by one plan, in any order.
    #[arg(required = true, value_name = "PART")]
    inputs: Vec<PathBuf>,
    /// The stream to write; `-` for standard output.
    #[arg(short, long, value_name = "PATH")]
    output: PathBuf,
    /// Replace an existing output.
    #[arg(long)]
    force: bool,
}

/// Joins parts.
pub(crate) fn run(args: &JoinArgs, report: Reporter) -> Result<()> {
    let inputs = &args.inputs;
    let output = Output::open(&args.output, args.force, inputs)?;
    let start = Instant::now();
    let heads = heads_of_all(inputs)?;
    let mut joined = Index::default();
    let written = output.write(|out| {
        joined = write(inputs, &heads, out)?;
        Ok(())
    })?;
    let (bytes, seconds) = (written.bytes, start.elapsed().as_secs_f64());
    let (gaussians, parts) = (joined.header.count, inputs.len());
    let size = DecimalBytes(bytes);
    let human = format!("{gaussians} Gaussians of {parts} parts, {size}, joined in {seconds:.2} s");
    let json = json!({
        "bytes": bytes,
        "gaussians": gaussians,
        "parts": parts,
        "join_seconds": seconds,
    });
    report.wrote(&written, &human, json)
}

/// Writes the stream that some streams are joined to, whose heads are known. Returns its head.
pub(crate) fn write(
    paths: &[PathBuf],
    heads: &[Index],
    out: &mut (dyn Write + Send),
) -> Result<Index> {
    let named = |number: usize| input::name(&paths[number]);
    let joined = gsvx::join(heads).map_err(|error| match error {
        gsvx::Error::NotOneScene { first, second, why } => {
            let [first, second] = [first, second].map(named);
            anyhow!("{first} and {second} are not parts of one scene: {why}")
        }
        other => other.into(),
    })?;
    out.write_all(&joined.head)?;
    let mut open: Option<(usize, StreamFile)> = None;
    for (number, range) in &joined.pieces {
        let source = match &mut open {
            Some((same, source)) if same == number => source,
            other => &mut other.insert((*number, StreamFile::open(&paths[*number])?)).1,
        };
        copy(source, range.clone(), out).with_context(|| named(*number))?;
    }
    Ok(joined.index)
}

fn copy(from: &mut StreamFile, range: Range<u64>, out: &mut (dyn Write + Send)) -> Result<()> {
    for start in range.clone().step_by(PIECE as usize) {
        let end = range.end.min(start + PIECE);
        let bytes = from.read(start..end)?;
        if bytes.len() as u64 != end - start {
            bail!("is cut short; make it again");
        }
        out.write_all(&bytes)?;
    }
    Ok(())
}

/// A part of a scene, as `--part` names it: the `k`-th of `n`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct ScenePart {
    pub(crate) k: u64,
    pub(crate) n: u64,
}

/// Reads `K/N`.
pub(crate) fn part(text: &str) -> Result<ScenePart, String> {
    match size::list(text, '/') {
        Some([k, n]) if (1..=n).contains(&k) => Ok(ScenePart { k, n }),
        _ => Err("use K/N, as in 3/16, with K from 1 to N".into()),
    }
}

impl ScenePart {
    /// What stands behind the stream of a part. Decoders ignore it.
    pub(crate) fn mark(self, plan: u32) -> String {
        format!("\ngsvx part {}/{} of plan {plan:08x}\n", self.k, self.n)
    }
}

/// The part that a stream is, and its plan.
fn mark_of(stream: &mut StreamFile, name: &str) -> Result<(ScenePart, String)> {
    let end = stream.index.stream_len();
    let bytes = stream.read(end..end + 100)?;
    let text = String::from_utf8_lossy(&bytes);
    let words: Vec<&str> = text.split_whitespace().collect();
    match words[..] {
        ["gsvx", "part", k_of_n, "of", "plan", plan] if text.ends_with('\n') => {
            Ok((part(k_of_n).map_err(Error::msg)?, plan.to_owned()))
        }
        _ => bail!("{name}: is no whole part; gsvx encode --part makes parts"),
    }
}

/// The heads of all parts of one plan.
fn heads_of_all(paths: &[PathBuf]) -> Result<Vec<Index>> {
    let (mut parts, mut heads) = (Vec::new(), Vec::new());
    for path in paths {
        let (mut stream, name) = (StreamFile::open(path)?, input::name(path));
        let (part, plan) = mark_of(&mut stream, &name)?;
        parts.push((part.k, part.n, plan, name));
        heads.push(stream.index);
    }
    parts.sort();
    let Some((_, n, plan, first)) = parts.first() else { return Ok(heads) };
    if let Some((.., other)) = parts.iter().find(|p| p.1 != *n || p.2 != *plan) {
        bail!("{other} and {first} are parts of different plans or of different numbers of parts");
    }
    if let Some(w) = parts.windows(2).find(|w| w[0].0 == w[1].0) {
        return Err(usage(format!("{} and {} are the same part", w[0].3, w[1].3)));
    }
    let missing = (1..=*n).filter(|k| parts.binary_search_by_key(k, |p| p.0).is_err());
    let missing: Vec<String> = missing.map(|k| format!("{k}/{n}")).collect();
    if !missing.is_empty() {
        bail!("parts are missing: {}", missing.join(", "));
    }
    Ok(heads)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_counted_from_one() {
        assert_eq!(part("3/16"), Ok(ScenePart { k: 3, n: 16 }));
        for wrong in ["", "3", "0/4", "5/4", "1/0", "a/b", "-1/4"] {
            assert!(part(wrong).is_err(), "{wrong}");
        }
    }
}
