//! The `gsvx` command on models of growing size, as whole processes.
//!
//! Models are a real scene, replicated side by side and jittered: their attributes are real,
//! their number is chosen. Memory is the peak resident set that Linux reports.

mod importance;
mod lod;
mod monotone;
mod targets;

pub use monotone::{ALLOWED_DB, Drop, Sweep, all_qualities};

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use gs_model::Scene;

use crate::chart::{Axis, Chart, Kind, Series};
use crate::command::{self, Cost};
use crate::scenes;

/// What [`run`] measures.
#[derive(Clone, Debug)]
pub struct Options {
    /// Scene that is replicated.
    pub scene: String,
    /// Numbers of Gaussians.
    pub sizes: Vec<usize>,
    /// The command to measure.
    pub gsvx: PathBuf,
    /// Where the page goes, relative to the root of the workspace.
    pub out: PathBuf,
}

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

/// One step on one model.
struct Row {
    step: &'static str,
    gaussians: usize,
    cost: Cost,
    /// MB of the floats of the model: 59 a Gaussian at SH degree 3.
    raw_mb: f64,
    stream_mb: f64,
}

/// Measures and writes the page.
///
/// # Errors
/// If the command is not there or fails, or the scene cannot be read.
pub fn run(options: &Options) -> Result<()> {
    let gsvx = command::find(&options.gsvx)?;
    let found = scenes::find(&options.scene)?;
    let (scene, _) = gs_model::ply::read(&found.dataset.model_path)?;
    ensure!(!scene.is_empty(), "{}: the model is empty", found.name);
    let dir = tempfile::tempdir().context("make a temporary folder")?;
    let mut rows = Vec::new();
    for &n in &options.sizes {
        rows.extend(measure_size(&gsvx, &scene, n, dir.path())?);
    }
    let text = page(options, &rows);
    crate::page::write(&options.out, &text, Some(&chart(&found.name, &rows)))
}

/// All steps on a model of `n` Gaussians.
fn measure_size(gsvx: &Path, scene: &Scene, n: usize, dir: &Path) -> Result<Vec<Row>> {
    let [model, stream, back] = ["model.ply", "model.gsvx", "back.ply"].map(|f| dir.join(f));
    let many = replicate(scene, n);
    let raw_mb = (many.len() * (11 + 3 * many.sh_len()) * 4) as f64 / 1e6;
    gs_model::ply::write(&model, &many)?;
    drop(many);
    // Otherwise the disk would still be busy with it in the first measurement.
    std::fs::File::open(&model)?.sync_all()?;
    let mut rows = Vec::new();
    for (step, words) in STEPS {
        let (input, output) =
            if words[0] == "encode" { (&model, &stream) } else { (&stream, &back) };
        let cost = command::measure(gsvx, words, input, output)?;
        let stream_mb = std::fs::metadata(&stream).map_or(0, |m| m.len()) as f64 / 1e6;
        let row = Row { step, gaussians: n, cost, raw_mb, stream_mb };
        print!("{}", row.line());
        rows.push(row);
    }
    Ok(rows)
}

impl Row {
    fn line(&self) -> String {
        let Self { step, gaussians, cost, raw_mb, stream_mb } = self;
        format!(
            "| {gaussians} | {step} | {:.2} | {:.2} | {:.0} | {:.0} | {:.2} | {stream_mb:.2} |\n",
            cost.wall,
            cost.user,
            *gaussians as f64 / cost.wall,
            cost.peak_mb,
            cost.peak_mb / raw_mb,
        )
    }
}

fn page(options: &Options, rows: &[Row]) -> String {
    let mut out = format!(
        "# How fast?\n\n\
         `cargo build --release -p gsvx-cli && cargo xtask bench-gsvx {}` times the command as a \
         whole process, with reading and writing of files, at the default quality and without \
         cameras. Models are {} replicated side by side, every float jittered a little; the raw floats are the 59 of \
         a Gaussian, four bytes each. \
         {} threads, {}.\n\n\
         {}\n\n\
         | Gaussians | step | wall s | user s | Gaussians/s (wall) | peak MB | peak / raw floats | stream MB |\n\
         |---:|---|---:|---:|---:|---:|---:|---:|\n",
        options.scene,
        options.scene,
        rayon::current_num_threads(),
        crate::manifest::processor(),
        crate::page::picture(&options.out, "Seconds over Gaussians"),
    );
    rows.iter().for_each(|row| out += &row.line());
    out
}

/// Seconds over Gaussians, a line for each step.
fn chart(scene: &str, rows: &[Row]) -> Chart {
    let line = |step: &str| Series {
        name: step.into(),
        kind: Kind::Ours,
        points: rows
            .iter()
            .filter(|r| r.step == step)
            .map(|r| (r.gaussians as f64 / 1e6, r.cost.wall))
            .collect(),
    };
    Chart::new(
        format!("gsvx on {scene}, replicated"),
        Axis::logarithmic("millions of Gaussians"),
        Axis::logarithmic("seconds, wall"),
        STEPS.map(|(step, _)| line(step)).into(),
        None,
    )
}

/// Encodes each scene to five sizes and three PSNRs with the command at `gsvx`, and prints a table of
/// what was asked for and what came.
///
/// # Errors
/// If the command is not there or fails, or a scene cannot be read.
pub fn targets(gsvx: &Path, scenes: &[String]) -> Result<()> {
    targets::run(&command::find(gsvx)?, scenes)
}

/// Writes a page that compares rates with and without cameras.
///
/// # Errors
/// If a scene cannot be read or coded, or the page cannot be written.
pub fn importance(scenes: &[String], out: &Path) -> Result<()> {
    importance::run(scenes, out)
}

/// Writes whether a greater quality ever looks worse, as a page.
///
/// # Errors
/// As [`importance`](fn@importance).
pub fn sweep(scenes: &[String], out: &Path) -> Result<()> {
    monotone::run(scenes, out)
}

/// Prints for each scene what coarse levels of detail cost, and what they show.
///
/// # Errors
/// If a scene cannot be read or coding fails.
pub fn lod(scenes: &[String]) -> Result<()> {
    lod::run(scenes)
}

/// `n` Gaussians: copies of the scene on a grid, every float jittered a little so that copies
/// are not equal.
pub(super) fn replicate(scene: &Scene, n: usize) -> Scene {
    let indices: Vec<usize> = (0..n).map(|i| i % scene.len()).collect();
    let mut out = scene.select(&indices);
    let mut seed = 1u64;
    let mut unit = || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 40) as f32 / (1u64 << 23) as f32 - 1.0
    };
    let side = (n.div_ceil(scene.len()) as f64).sqrt().ceil() as usize;
    let extent = scene.means.iter().fold(0.0f32, |m, p| m.max(p[0].abs()).max(p[2].abs()));
    for i in 0..n {
        let copy = i / scene.len();
        out.means[i][0] += 2.0 * extent * (copy % side) as f32;
        out.means[i][2] += 2.0 * extent * (copy / side) as f32;
        if copy > 0 {
            for v in &mut out.means[i] {
                *v += 1e-3 * unit();
            }
            for v in &mut out.log_scales[i] {
                *v += 0.05 * unit();
            }
            out.opacity_logits[i] += 0.05 * unit();
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn replicas_have_the_size_asked_for_and_differ() {
        let scene = Scene {
            means: vec![[0.0, 0.0, 0.0], [1.0, 2.0, 3.0]],
            rotations: vec![[1.0, 0.0, 0.0, 0.0]; 2],
            log_scales: vec![[-3.0; 3]; 2],
            opacity_logits: vec![0.0; 2],
            sh_degree: 0,
            sh: vec![[0.0; 3]; 2],
        };
        let many = replicate(&scene, 7);
        assert_eq!(many.len(), 7);
        assert!(many.validate().is_ok());
        assert_eq!(many.means[..2], scene.means[..]);
        let mut means = many.means.clone();
        means.sort_by(|a, b| a.partial_cmp(b).unwrap());
        means.dedup();
        assert_eq!(means.len(), 7);
    }
}
