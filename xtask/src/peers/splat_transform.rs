//! PlayCanvas' splat-transform: its own compressed PLY and SOG, and its SPZ.

use std::ffi::OsStr;
use std::path::Path;
use std::time::Duration;

use anyhow::{Context, Result};

use super::{Coded, Outcome, Task, tool};

/// Name, file ending, further options of each format.
const FORMATS: [(&str, &str, &[&str]); 2] =
    [("compressed PLY", "compressed.ply", &[]), ("SPZ v4", "spz", &[])];
/// The one that takes hours without a GPU.
const SOG: (&str, &str, &[&str]) = ("SOG, CPU", "sog", &["-g", "cpu"]);

/// Encodes, decodes and measures each format.
pub(super) fn run(
    task: &Task<'_>,
    program: &Path,
    sog: bool,
    limit: Duration,
) -> Result<Vec<Outcome>> {
    let mut out = Vec::new();
    for (name, ending, options) in FORMATS.into_iter().chain(sog.then_some(SOG)) {
        out.push(task.measure("splat-transform", name, program, |dir| {
            let model = task.model.canonicalize().context("find the model")?;
            let (stream, back) = (dir.join("model").with_extension(ending), dir.join("back.ply"));
            let mut args: Vec<&OsStr> = options.iter().map(OsStr::new).collect();
            args.extend([
                OsStr::new("-q"),
                OsStr::new("-w"),
                model.as_os_str(),
                stream.as_os_str(),
            ]);
            let encode = tool::run(program, &args, dir, limit)?;
            let bytes = tool::size(&stream)?;
            let args = [OsStr::new("-q"), OsStr::new("-w"), stream.as_os_str(), back.as_os_str()];
            let decode = tool::run(program, &args, dir, limit)?;
            tool::size(&back)?;
            let scene = super::read(&back)?;
            Ok(Coded {
                bytes,
                scene,
                encode_seconds: encode.seconds,
                decode_seconds: decode.seconds,
            })
        })?);
    }
    if !sog {
        out.push(Outcome::absent(
            "splat-transform, SOG",
            "hours of k-means without a GPU; --sog --peer-seconds N runs it",
        ));
    }
    Ok(out)
}
