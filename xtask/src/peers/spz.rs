//! Niantic's SPZ, by its own two commands.

use std::path::Path;
use std::time::Duration;

use anyhow::{Context, Result};

use super::{Coded, Outcome, Task, tool};

/// Encodes, decodes and measures.
pub(super) fn run(
    task: &Task<'_>,
    encoder: &Path,
    decoder: &Path,
    limit: Duration,
) -> Result<Outcome> {
    task.measure("SPZ", "default", encoder, |dir| {
        let (stream, back) = (dir.join("model.spz"), dir.join("back.ply"));
        let model = task.model.canonicalize().context("find the model")?;
        let encode = tool::run(encoder, &[&model, &stream], dir, limit)?;
        let bytes = tool::size(&stream)?;
        let decode = tool::run(decoder, &[&stream, &back], dir, limit)?;
        tool::size(&back)?;
        let scene = super::read(&back)?;
        Ok(Coded { bytes, scene, encode_seconds: encode.seconds, decode_seconds: decode.seconds })
    })
}
