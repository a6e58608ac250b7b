//! Whether one encode gives the size or the quality that was asked for.

use std::path::Path;
use std::process::Command;

use anyhow::{Context, Result, ensure};

use crate::scenes;

/// Byte targets, in bytes per Gaussian of the model: from a thumbnail to visually lossless.
const BYTES_PER_GAUSSIAN: [f64; 5] = [2.0, 4.0, 6.0, 9.0, 13.0];
/// PSNR targets against renders of the input, dB.
const PSNR: [f64; 3] = [32.0, 38.0, 44.0];
/// A size hits its target if it is not above it, and below it by at most this share.
const TOLERANCE: f64 = 0.01;

/// Encodes each scene to each target with the command and prints a table.
pub(super) fn run(gsvx: &Path, names: &[String]) -> Result<()> {
    let dir = tempfile::tempdir().context("make a temporary folder")?;
    println!(
        "| scene | target | got | share | quality | encodes | hit |\n|---|---:|---:|---:|---:|---:|---|"
    );
    for name in names {
        let found = scenes::find(name)?;
        let model = &found.dataset.model_path;
        let cameras = &found.dataset.dir;
        let (scene, _) = gs_model::ply::read(model)?;
        for per_gaussian in BYTES_PER_GAUSSIAN {
            let target = (per_gaussian * scene.len() as f64) as u64;
            let said =
                encode(gsvx, model, cameras, dir.path(), &format!("--target-bytes={target}"))?;
            let got = said["bytes"].as_u64().context("the report has no bytes")?;
            let size = std::fs::metadata(dir.path().join("a.gsvx"))?.len();
            ensure!(size == got, "the report says {got} bytes, the file has {size}");
            let share = got as f64 / target as f64;
            let hit = (1.0 - TOLERANCE..=1.0).contains(&share);
            println!(
                "| {name} | {target} bytes | {got} bytes | {:.2} % | {} | {} | {} |",
                100.0 * share,
                said["quality"],
                said["encodes"],
                if hit { "yes" } else { "no" },
            );
        }
        for target in PSNR {
            let said =
                encode(gsvx, model, cameras, dir.path(), &format!("--target-psnr={target}"))?;
            let got = said["psnr"].as_f64().context("the report has no PSNR")?;
            println!(
                "| {name} | {target:.2} dB | {got:.3} dB in {} bytes | | {} | {} | {} |",
                said["bytes"],
                said["quality"],
                said["encodes"],
                if got >= target { "yes" } else { "no" },
            );
        }
    }
    Ok(())
}

fn encode(
    gsvx: &Path,
    model: &Path,
    cameras: &Path,
    dir: &Path,
    target: &str,
) -> Result<serde_json::Value> {
    let out = Command::new(gsvx)
        .args(["encode", "--force", "--json", target, "--cameras"])
        .arg(cameras)
        .arg(model)
        .arg("-o")
        .arg(dir.join("a.gsvx"))
        .output()
        .with_context(|| format!("start {}", gsvx.display()))?;
    ensure!(out.status.success(), "{target}: {}", String::from_utf8_lossy(&out.stderr).trim());
    serde_json::from_slice(&out.stdout).context("the report is not JSON")
}
