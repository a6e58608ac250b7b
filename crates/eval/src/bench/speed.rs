//! The `gsvx` command on models of growing size, as whole processes.
//!
//! Models are a real scene, replicated side by side and jittered: their attributes are real,
//! their number is chosen. Memory is the peak resident set that Linux reports.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use gs_model::{Scene, ply};

use super::gsvx_flags::GsvxOptions;
use crate::cells;
use crate::chart::{Axis, Chart, Series};
use crate::page::{Page, Table};
use crate::process::GsvxCommand;
use crate::{manifest, scenes};

/// Steps that are measured: name, and words of the command.
const STEPS: [(&str, &[&str]); 6] = [
    ("encode, with the estimate of the loss", &["encode"]),
    ("encode", &["encode", "--no-estimate"]),
    ("decode", &["decode"]),
    ("decode, SH degree 0", &["decode", "--max-sh-degree", "0"]),
    ("encode --lod", &["encode", "--lod", "--no-estimate"]),
    // What is beyond the coarsest level means the coarsest.
    ("decode of the coarsest level", &["decode", "--lod", "255"]),
];

/// Measures and writes the page.
pub(super) fn run(options: &GsvxOptions, gsvx: &GsvxCommand, out: &Path) -> Result<()> {
    let found = scenes::find(&options.scene)?;
    let (scene, _) = ply::read(&found.dataset.model_path)?;
    ensure!(!scene.is_empty(), "{}: the model is empty", found.name);
    let mut table =
        Table::new("Gaussians | step | wall s | user s | Gaussians/s (wall) | peak MB | stream MB");
    let mut series = STEPS.map(|(step, _)| Series::ours(step, Vec::new()));
    let dir = tempfile::tempdir().context("make a temporary folder")?;
    let [model, stream, back] = ["model.ply", "model.gsvx", "back.ply"].map(|f| dir.path().join(f));
    for &n in &options.sizes {
        let many = replicate(&scene, n);
        ply::write(&model, &many)?;
        drop(many);
        // Otherwise the disk would still be busy with it in the first measurement.
        std::fs::File::open(&model)?.sync_all()?;
        for ((step, words), line) in STEPS.iter().zip(&mut series) {
            let (input, output) =
                if words[0] == "encode" { (&model, &stream) } else { (&stream, &back) };
            let words: Vec<&dyn AsRef<std::ffi::OsStr>> =
                words.iter().map(|w| w as _).chain([input as _]).collect();
            let cost = gsvx.make(&words, output)?;
            let stream_mb = std::fs::metadata(&stream)?.len() as f64 / 1e6;
            table.told(cells![
                n,
                step,
                format!("{:.2}", cost.wall),
                format!("{:.2}", cost.user),
                format!("{:.0}", n as f64 / cost.wall),
                format!("{:.0}", cost.peak_mb),
                format!("{stream_mb:.2}"),
            ]);
            line.points.push((n as f64 / 1e6, cost.wall));
        }
    }
    let mut page = Page::new(out, "How fast?");
    page.text(format!(
        "`cargo xtask bench-gsvx {0}` times the command as a whole process, with \
         reading and writing of files, at the default quality and without cameras. Models are {0} replicated side by \
         side, every float jittered a little. {1}.",
        options.scene,
        manifest::machine(),
    ));
    let axes = ["millions of Gaussians", "seconds, wall"].map(Axis::logarithmic);
    let title = format!("{}, replicated: seconds over Gaussians", found.name);
    page.chart("", Chart::new(title, axes, series, None));
    page.table(&table);
    page.write()
}

/// `n` Gaussians: copies of the scene on a grid, every float jittered a little so that copies
/// are not equal.
pub(super) fn replicate(scene: &Scene, n: usize) -> Scene {
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
