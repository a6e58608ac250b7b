//! Fast implementations against their references, and the lossless mode.

use std::process::Command;

use anyhow::{Context, Result, ensure};
use eval::scenes;
use gpcc_lite::raht::Plan;
use gpcc_lite::{Leaf, morton};
use gs_model::Scene;

use super::{Tally, Verdict};

pub(super) fn checks(tally: &mut Tally, no_gpu: bool) {
    tally.check("RAHT, integers against floats", raht);
    tally.check("lossless, bit for bit", lossless);
    tally.check("WGSL executor against Rust", || wgsl(no_gpu));
}

fn room() -> Result<Scene> {
    let path = scenes::find(scenes::DEFAULT)?.dataset.model_path;
    Ok(gs_model::ply::read(path)?.0)
}

/// The decoder's fixed-point RAHT against RAHT in f64, and its inverse.
fn raht() -> Result<Verdict> {
    let scene = room()?;
    let cube = voxel::Cube::of(&scene.means)?;
    let voxels = voxel::voxelize(&scene, &cube, &voxel::Strategy::Uniform { depth: 12 })?;
    let leaves: &[Leaf] = &voxels.leaves;
    ensure!(leaves.windows(2).all(|w| w[0].morton < w[1].morton), "leaves are not in Morton order");
    let plan = Plan::new(leaves, voxels.j_high)?;
    // Values without correlation between neighbours, of 20 bits.
    let values: Vec<i64> = leaves
        .iter()
        .map(|l| {
            let [x, y, z] = morton::decode(l.morton).map(i64::from);
            (x * 7_919 + y * 104_729 + z * 1_299_709) % (1 << 20) - (1 << 19)
        })
        .collect();
    let mut fixed = values.clone();
    plan.forward_fixed(&mut fixed)?;
    let mut float: Vec<f64> = values.iter().map(|&v| v as f64).collect();
    plan.forward_f64(&mut float)?;
    let apart = fixed.iter().zip(&float).map(|(&a, b)| (a as f64 - b).abs()).fold(0.0, f64::max);
    plan.inverse_fixed(&mut fixed)?;
    let back = fixed.iter().zip(&values).map(|(a, b)| (a - b).abs()).max().unwrap_or(0);
    ensure!(
        apart < MAX_COEFFICIENT_ERROR,
        "coefficients are {apart:.3} apart, {MAX_COEFFICIENT_ERROR} is allowed"
    );
    ensure!(
        back <= MAX_ROUND_TRIP_ERROR,
        "values come back {back} off, {MAX_ROUND_TRIP_ERROR} is allowed"
    );
    Ok(Verdict::Holds(format!(
        "{} coefficients within {apart:.2} of f64, values of 20 bits back within {back}",
        values.len()
    )))
}

/// Greatest difference of a coefficient, in units of the values. Each of some forty butterflies
/// rounds. The smallest quantisation step in use is far larger.
const MAX_COEFFICIENT_ERROR: f64 = 8.0;
/// The same after the inverse.
const MAX_ROUND_TRIP_ERROR: i64 = 8;

fn lossless() -> Result<Verdict> {
    let scene = room()?;
    let bytes = gsvx::encode_lossless(&scene)?.bytes;
    let back = gsvx::decode(&bytes, &gsvx::DecodeOptions::default())?.scene;
    let bits = |s: &Scene| -> Vec<[u32; 3]> {
        let mut all: Vec<[u32; 3]> = s.means.iter().map(|m| m.map(f32::to_bits)).collect();
        all.sort_unstable();
        all
    };
    ensure!(back.len() == scene.len(), "{} Gaussians of {}", back.len(), scene.len());
    ensure!(bits(&back) == bits(&scene), "means differ");
    Ok(Verdict::Holds(format!("{} Gaussians, {} bytes", scene.len(), bytes.len())))
}

/// finetune's own tests of each stage, on whatever adapter there is, software Vulkan included.
fn wgsl(no_gpu: bool) -> Result<Verdict> {
    if no_gpu {
        return Ok(Verdict::Skipped("--no-gpu".into()));
    }
    let args = [
        "test",
        "--quiet",
        "-p",
        "finetune",
        "--features",
        "gpu",
        "--lib",
        "gpu::",
        "--",
        "--nocapture",
    ];
    let out = Command::new("cargo")
        .args(args)
        .current_dir(scenes::root())
        .output()
        .context("start cargo")?;
    let text = String::from_utf8_lossy(&out.stdout);
    if let Some(why) = text.lines().find_map(|l| l.strip_prefix("SKIPPED: ")) {
        return Ok(Verdict::Skipped(why.to_owned()));
    }
    let said = String::from_utf8_lossy(&out.stderr);
    let last = said.lines().rev().find(|l| !l.trim().is_empty()).unwrap_or_default();
    ensure!(out.status.success(), "cargo {}: {last}", args.join(" "));
    let passed = text.lines().find_map(|l| l.strip_prefix("test result: ok. "));
    let passed = passed.and_then(|l| l.split(';').next()).unwrap_or("passed");
    Ok(Verdict::Holds(format!("finetune's stage-by-stage tests: {passed}")))
}
