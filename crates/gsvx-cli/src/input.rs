//! Reading models and streams, from files or standard input.

use crate::output::is_stdio;
use anyhow::{Context, Result, anyhow};
use gs_model::Scene;
use gs_model::model::Report;
use gs_model::ply::{Invalid, ReadOptions};
use std::io::Read;
use std::path::Path;

/// The whole of a file, or of standard input for `-`.
pub(crate) fn bytes(path: &Path) -> Result<Vec<u8>> {
    if is_stdio(path) {
        let mut all = Vec::new();
        std::io::stdin().lock().read_to_end(&mut all).context("standard input")?;
        return Ok(all);
    }
    std::fs::read(path).with_context(|| format!("{}: cannot be read", path.display()))
}

/// What a person calls the input.
pub(crate) fn name(path: &Path) -> String {
    if is_stdio(path) { "standard input".into() } else { path.display().to_string() }
}

/// A model of any format that gs-model reads. Says what it skipped.
pub(crate) fn model(path: &Path, drop_invalid: bool) -> Result<(Scene, u64)> {
    let stdin = is_stdio(path);
    let invalid = if drop_invalid { Invalid::Drop } else { Invalid::Error };
    let options = ReadOptions { invalid, ..Default::default() };
    let (outcome, len) = if stdin {
        let all = bytes(path)?;
        (gs_model::model::read_named("standard input", &all, &options), all.len() as u64)
    } else {
        let len = std::fs::metadata(path).map_or(0, |m| m.len());
        (gs_model::model::read(path, &options), len)
    };
    let (scene, report) = outcome.map_err(explain)?;
    skipped(&scene, &report);
    Ok((scene, len))
}

/// A model of any format, streams included.
pub(crate) fn any(path: &Path, drop_invalid: bool) -> Result<Scene> {
    let all = bytes(path)?;
    if all.starts_with(&gsvx::stream::SIGNATURE) {
        let decoded =
            gsvx::decode(&all, &gsvx::DecodeOptions::default()).with_context(|| name(path))?;
        return Ok(decoded.scene);
    }
    let invalid = if drop_invalid { Invalid::Drop } else { Invalid::Error };
    let options = ReadOptions { invalid, ..Default::default() };
    let called = if is_stdio(path) { Path::new("standard input") } else { path };
    let (scene, report) = gs_model::model::read_named(called, &all, &options).map_err(explain)?;
    skipped(&scene, &report);
    Ok(scene)
}

fn explain(error: gs_model::Error) -> anyhow::Error {
    let hint = matches!(error, gs_model::Error::InvalidGaussian { .. });
    let error = anyhow::Error::from(error);
    if hint { anyhow!("{error}: pass --drop-invalid to leave them out") } else { error }
}

fn skipped(scene: &Scene, report: &Report) {
    for property in report.ply.iter().flat_map(|p| &p.unknown_properties) {
        eprintln!("skipped: property {property} is not part of a 3DGS model");
    }
    if scene.len() < report.gaussians_in_file {
        let dropped = report.gaussians_in_file - scene.len();
        eprintln!("skipped: {dropped} invalid Gaussians of {}", report.gaussians_in_file);
    }
}
