//! Fast implementations against their references, access in parts, and the lossless mode.

use anyhow::{Context, Result, ensure};
use eval::scenes;
use gpcc_lite::raht::{self, RahtPlan, Rows};
use gpcc_lite::{Leaf, morton};
use gs_model::Scene;
use gsvx::{DEFAULT_QUALITY, EncodeOptions, Reader};
use std::num::NonZeroUsize;

use xshell::cmd;

use super::{Tally, Verdict};
use crate::commands::shell;

pub(super) fn checks(tally: &mut Tally, no_gpu: bool) {
    tally.check("RAHT, single against double precision", raht);
    tally.check("chunks in any order against the whole stream", in_parts);
    tally.check("lossless, bit for bit", lossless);
    tally.check("WGSL executor against Rust", || wgsl(no_gpu));
}

pub(super) fn room() -> Result<Scene> {
    let path = scenes::find(scenes::DEFAULT)?.dataset.model_path;
    Ok(gs_model::ply::read(path)?.0)
}

/// The decoder's RAHT on rows of means, in single precision, against RAHT in f64, and its inverse.
fn raht() -> Result<Verdict> {
    let scene = room()?;
    let cube = voxel::cube_of(&scene.means)?;
    let voxels = voxel::voxelize(&scene, &cube, &voxel::Strategy::Uniform { depth: 12 })?;
    let leaves: &[Leaf] = voxels.octree().leaves();
    ensure!(leaves.windows(2).all(|w| w[0].morton < w[1].morton), "leaves are not in Morton order");
    let plan = RahtPlan::new(voxels.octree().clone());
    // Values from -1 to 1 without correlation between neighbours.
    let values: Vec<f32> = leaves
        .iter()
        .map(|l| {
            let [x, y, z] = morton::decode(l.morton).map(i64::from);
            ((x * 7_919 + y * 104_729 + z * 1_299_709) % 2000 - 1000) as f32 / 1000.0
        })
        .collect();
    let mut rows = Rows::new(leaves.len(), 1);
    for (i, &v) in values.iter().enumerate() {
        rows.row_mut(i)[0] = v;
    }
    raht::forward(&plan, &mut rows)?;
    let mut coefficients: Vec<f64> = values.iter().map(|&v| f64::from(v)).collect();
    plan.forward_f64(&mut coefficients)?;
    // Row 0 has the mean; the others have the differences of children's means.
    let mut apart = 0f64;
    for k in 1..plan.len() {
        let [a, b] = plan.child_weights(k);
        let high_pass = f64::from(rows.row(plan.split_leaf(k))[0]) * (a * b / (a + b)).sqrt();
        apart = apart.max((high_pass - coefficients[k]).abs());
    }
    raht::inverse(&plan, &mut rows)?;
    let off = |i: usize| f64::from((rows.row(i)[0] - values[i]).abs());
    let back = (0..values.len()).map(off).fold(0.0, f64::max);
    ensure!(
        apart < MAX_COEFFICIENT_ERROR,
        "coefficients are {apart:.1e} apart, {MAX_COEFFICIENT_ERROR:.1e} is allowed"
    );
    ensure!(
        back < MAX_ROUND_TRIP_ERROR,
        "values come back {back:.1e} off, {MAX_ROUND_TRIP_ERROR:.1e} is allowed"
    );
    Ok(Verdict::Holds(format!(
        "{} coefficients within {apart:.1e} of f64, values from -1 to 1 back within {back:.1e}",
        values.len()
    )))
}

/// Greatest difference of a coefficient. The smallest quantisation step in use is a hundred times as
/// large.
const MAX_COEFFICIENT_ERROR: f64 = 1e-4;
/// The same of a value after the inverse.
const MAX_ROUND_TRIP_ERROR: f64 = 1e-5;

/// A stream that arrives in pieces, last ones first, decoded chunk by chunk.
fn in_parts() -> Result<Verdict> {
    let mut options = EncodeOptions::default();
    options.code.lod = true;
    options.code.chunk_leaves = NonZeroUsize::new(1500).context("a positive number")?;
    let bytes = gsvx::encode(&room()?, None, DEFAULT_QUALITY, &options)?.bytes;
    let mut reader = Reader::new();
    for (i, piece) in bytes.chunks(1000).enumerate().rev() {
        reader.give(1000 * i as u64, piece)?;
    }
    let index = reader.index().context("the head was given and is not known")?.clone();
    let mut joined = Scene { sh_degree: index.header.sh_degree, ..Scene::default() };
    for i in index.chunks_of_lod(0) {
        let layers = index.chunks[i].layers.len();
        ensure!(reader.needs(i, layers).is_empty(), "chunk {i} is not whole");
        joined.append(&reader.decode(i, layers)?);
    }
    ensure!(joined == gsvx::decode(&bytes)?, "the chunks are not the whole");
    let (chunks, levels) = (index.chunks.len(), 1 + index.coarsest_lod());
    Ok(Verdict::Holds(format!("{chunks} chunks of {levels} levels, the same floats")))
}

fn lossless() -> Result<Verdict> {
    let scene = room()?;
    let bytes = gsvx::encode_lossless(&scene, false)?.bytes;
    let back = gsvx::decode(&bytes)?;
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
    let sh = shell("")?;
    let words = "test --quiet -p finetune --features gpu --lib gpu:: -- --nocapture";
    let cargo = cmd!(sh, "cargo").args(words.split(' ')).quiet();
    let text = cargo.read().context("finetune's tests")?;
    if let Some(why) = text.lines().find_map(|l| l.strip_prefix("SKIPPED: ")) {
        return Ok(Verdict::Skipped(why.to_owned()));
    }
    let passed = text.lines().find_map(|l| l.strip_prefix("test result: ok. "));
    let passed = passed.and_then(|l| l.split(';').next()).unwrap_or("passed");
    Ok(Verdict::Holds(format!("finetune's stage-by-stage tests: {passed}")))
}
