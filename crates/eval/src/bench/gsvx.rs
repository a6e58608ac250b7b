//! `cargo xtask bench-gsvx`: the `gsvx` command on models of growing size, as whole processes.
//!
//! Models are a real scene, replicated side by side and jittered: their attributes are real,
//! their number is chosen. Memory is the peak resident set that Linux reports.

use std::path::PathBuf;

use anyhow::{Context, Result, ensure};
use gs_model::{Scene, ply};

use crate::chart::{Axis, Chart, Series};
use crate::page::{Page, Table, number};
use crate::process::{GsvxCommand, Usage};
use crate::{manifest, scenes};

/// Flags of `cargo xtask bench-gsvx`.
#[derive(Clone, Debug, clap::Args)]
pub struct GsvxOptions {
    /// Scene that is replicated
    #[arg(default_value = "fox")]
    scene: String,
    /// Numbers of Gaussians
    #[arg(long, value_delimiter = ',', default_values_t = [100_000, 1_000_000, 3_000_000])]
    sizes: Vec<usize>,
    /// Where the page goes
    #[arg(long, default_value = "docs/results/speed.md")]
    out: PathBuf,
}

/// What is done: a name, the words of the command, its input and its output in the bench's folder.
const STEPS: [[&str; 4]; 12] = [
    ["encode, with the estimate of the loss", "encode", MODEL, STREAM],
    ["encode", "encode --no-estimate", MODEL, STREAM],
    ["decode", "decode", STREAM, "back.ply"],
    ["decode, SH degree 0", "decode --max-sh-degree=0", STREAM, "back.ply"],
    ["encode --lod", "encode --lod --no-estimate", MODEL, STREAM],
    // A number beyond the coarsest level means the coarsest.
    ["decode of the coarsest level", "decode --lod=255", STREAM, "back.ply"],
    ["encode --memory 1G", "encode --memory=1G", MODEL, "other.gsvx"],
    ["plan", "plan", MODEL, PLAN],
    ["encode, a part of 16", "encode --part=1/16", PLAN, "other.gsvx"],
    ["render, a view of a megapixel", "render --orbit=1 --size=1000x1000", STREAM, "pictures"],
    ["render, nine views of a megapixel", "render --orbit=9 --size=1000x1000", STREAM, "pictures"],
    ["tune --effort quick", "tune --orbit=32 --effort=quick", MODEL, "other.gsvx"],
];
const MODEL: &str = "model.ply";
const STREAM: &str = "model.gsvx";
const PLAN: &str = "model.plan";
/// Steps of the chart; the table has all.
const DRAWN: [&str; 5] = [
    "encode",
    "decode",
    "encode --memory 1G",
    "render, nine views of a megapixel",
    "tune --effort quick",
];

/// Measures and writes the page.
///
/// # Errors
/// If the command is not there or fails, or the scene cannot be read.
pub fn run(options: &GsvxOptions) -> Result<()> {
    let gsvx = GsvxCommand::find()?;
    let found = scenes::find(&options.scene)?;
    let (scene, _) = ply::read(&found.dataset.model_path)?;
    ensure!(!scene.is_empty(), "{}: the model is empty", found.name);
    let mut table = Table::new("Gaussians | step | wall s | user s | peak MB | written MB");
    let most = options.sizes.iter().max().copied().unwrap_or_default();
    let mut largest = Table::new("step | wall s | user s | peak MB | written MB");
    let mut series = DRAWN.map(|step| Series::ours(step, Vec::new()));
    for &n in &options.sizes {
        let dir = tempfile::tempdir().context("make a temporary folder")?;
        let model = dir.path().join(MODEL);
        ply::write(&model, &replicate(&scene, n))?;
        // Otherwise the disk would still be busy with it in the first measurement.
        std::fs::File::open(&model)?.sync_all()?;
        for [step, words, input, output] in STEPS {
            let output = dir.path().join(output);
            let mut command = gsvx.words(words.split(' '));
            command.arg(dir.path().join(input));
            let Usage { wall, user, peak_mb } = gsvx.make(&mut command, &output)?.usage;
            let written = std::fs::metadata(&output)?;
            let written = written.is_file().then(|| written.len() as f64 / 1e6);
            let written = number(written, 2);
            let row = format!("{step} | {wall:.2} | {user:.2} | {peak_mb:.0} | {written}");
            table.told(format!("{n} | {row}"));
            if n == most {
                largest.row(row);
            }
            if let Some(drawn) = DRAWN.iter().position(|drawn| *drawn == step) {
                series[drawn].points.push((n as f64 / 1e6, wall));
            }
        }
    }
    let mut page = Page::new(&options.out, "How fast?");
    page.text(format!(
        "`cargo xtask bench-gsvx {0} --sizes {1}`, the default quality, no cameras. Models are {0} \
         replicated and jittered. {2}. Larger scenes: [scale.md](../scale.md).",
        options.scene,
        options.sizes.iter().map(ToString::to_string).collect::<Vec<_>>().join(","),
        manifest::machine(),
    ));
    let axes = ["millions of Gaussians", "seconds, wall"].map(Axis::logarithmic);
    let title = format!("{}, replicated: seconds over Gaussians", found.name);
    page.chart("", Chart::new(title, axes, series, None));
    page.text(format!("{most} Gaussians:"));
    page.table(&largest);
    page.data("All sizes:", table);
    page.write()
}

/// `n` Gaussians: copies of the scene on a grid, every float jittered a little so that copies
/// are not equal.
fn replicate(scene: &Scene, n: usize) -> Scene {
    let indices: Vec<usize> = (0..n).map(|i| i % scene.len()).collect();
    let mut out = scene.select(&indices);
    let mut rng = testing::Rng::seeded(1);
    let side = (n.div_ceil(scene.len()) as f64).sqrt().ceil() as usize;
    let extent = scene.means.iter().fold(0.0f32, |m, p| m.max(p[0].abs()).max(p[2].abs()));
    for i in 0..n {
        let copy = i / scene.len();
        out.means[i][0] += 2.0 * extent * (copy % side) as f32;
        out.means[i][2] += 2.0 * extent * (copy / side) as f32;
        if copy > 0 {
            out.means[i].iter_mut().for_each(|v| *v += 1e-3 * rng.signed());
            out.log_scales[i].iter_mut().for_each(|v| *v += 0.05 * rng.signed());
            out.opacity_logits[i] += 0.05 * rng.signed();
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn replicas_have_the_size_asked_for_and_differ() {
        let scene = testing::trained_like(20, 0, &mut testing::Rng::seeded(1));
        let many = replicate(&scene, 70);
        assert!(many.len() == 70 && many.validate().is_ok());
        assert_eq!(many.means[..20], scene.means[..]);
        let mut means = many.means.clone();
        means.sort_by(|a, b| a.partial_cmp(b).unwrap());
        means.dedup();
        assert_eq!(means.len(), 70);
    }
}
