//! Scenes of many millions of Gaussians: time and memory of each stage.
//!
//! A scene is several files of a million Gaussians each: fox and bonsai in turn, replicated and jittered. It is
//! made in a temporary folder and removed.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use gs_model::{Scene, ply};
use serde_json::Value;

use super::gsvx_flags::GsvxOptions;
use super::speed::replicate;
use crate::cells;
use crate::page::{Page, Table};
use crate::process::{Done, GsvxCommand};
use crate::{manifest, scenes};

/// Scenes whose Gaussians are replicated.
const SCENES: [&str; 2] = ["fox", "bonsai"];
/// Gaussians of a file.
const FILE: usize = 1_000_000;
/// Parts of the distributed encode.
const PARTS: usize = 16;

/// What the page has.
struct Tables {
    stages: Table,
    streams: Table,
}

/// Measures and writes the page.
pub(super) fn run(options: &GsvxOptions, gsvx: &GsvxCommand, out: &Path) -> Result<()> {
    let model = |name: &&str| -> Result<Scene> {
        let (mut model, _) = ply::read(&scenes::find(name)?.dataset.model_path)?;
        model.drop_invalid();
        ensure!(!model.is_empty(), "{name}: the model is empty");
        Ok(model)
    };
    let models = SCENES.iter().map(model).collect::<Result<Vec<Scene>>>()?;
    let mut tables = Tables {
        stages: Table::new("Gaussians | stage | wall s | user s | peak MB"),
        streams: Table::new(
            "Gaussians | stream MB | join, of the wall seconds of plan, parts and join | a box with, of the Gaussians \
             | reads of the stream",
        ),
    };
    for &millions in &options.millions {
        let dir = tempfile::tempdir().context("make a temporary folder")?;
        let inputs = inputs(&models, millions, dir.path())?;
        measure(&Run { gsvx, memory: &options.memory, dir: dir.path() }, &inputs, &mut tables)?;
    }
    page(options, &tables, out).write()
}

/// Writes the files of a scene, file beside file.
fn inputs(models: &[Scene], files: usize, dir: &Path) -> Result<Vec<PathBuf>> {
    let extent = |m: &Scene| m.means.as_flattened().iter().fold(0.0f32, |a, x| a.max(x.abs()));
    let copies =
        (FILE as f32 / models.iter().map(Scene::len).min().unwrap_or(1) as f32).sqrt() + 1.0;
    let apart = 2.0 * models.iter().map(extent).fold(0.0, f32::max) * copies.ceil();
    let side = (files as f64).sqrt().ceil() as usize;
    let file = |i: usize| -> Result<PathBuf> {
        let mut scene = replicate(&models[i % models.len()], FILE);
        for mean in &mut scene.means {
            mean[0] += apart * (i % side) as f32;
            mean[2] += apart * (i / side) as f32;
        }
        let path = dir.join(format!("tile-{i:03}.ply"));
        ply::write(&path, &scene)?;
        Ok(path)
    };
    (0..files).map(file).collect()
}

/// The command in a folder.
struct Run<'a> {
    gsvx: &'a GsvxCommand,
    memory: &'a str,
    dir: &'a Path,
}

impl Run<'_> {
    /// `gsvx WORDS INPUTS -o NAME`.
    fn make(&self, words: &[&str], inputs: &[PathBuf], name: &str) -> Result<Done> {
        let words = words.iter().map(|w| w as &dyn AsRef<std::ffi::OsStr>);
        let all: Vec<_> = words.chain(inputs.iter().map(|i| i as _)).collect();
        self.gsvx.make(&all, &self.dir.join(name))
    }
}

fn measure(run: &Run<'_>, inputs: &[PathBuf], tables: &mut Tables) -> Result<()> {
    let millions = inputs.len();
    let at = |name: &str| run.dir.join(name);
    let mut row = |stage: &'static str, costs: &[Done]| {
        let sum = |of: fn(&Done) -> f64| costs.iter().map(of).sum::<f64>();
        let peak_mb = costs.iter().map(|c| c.peak_mb).fold(0.0, f64::max);
        let (wall, user) = (sum(|c| c.wall), sum(|c| c.user));
        let [wall_s, user_s] = [wall, user].map(|s| format!("{s:.2}"));
        let peak = format!("{peak_mb:.0}");
        tables.stages.told(cells![format!("{millions} M"), stage, wall_s, user_s, peak]);
        wall
    };
    row("encode --memory", &[run.make(&["encode", "--memory", run.memory], inputs, "city.gsvx")?]);
    let plan = row("plan", &[run.make(&["plan"], inputs, "plan")?]);
    let part = |k: usize| {
        let words = ["encode", "--memory", run.memory, "--part", &format!("{k}/{PARTS}")];
        run.make(&words, &[at("plan")], &format!("part-{k:02}.gsvx"))
    };
    let encoded = row("16 parts", &(1..=PARTS).map(part).collect::<Result<Vec<_>>>()?);
    let parts: Vec<PathBuf> = (1..=PARTS).map(|k| at(&format!("part-{k:02}.gsvx"))).collect();
    let join = row("join", &[run.make(&["join"], &parts, "joined.gsvx")?]);
    let stream = std::fs::read(at("city.gsvx"))?;
    ensure!(std::fs::read(at("joined.gsvx"))? == stream, "the joined parts are another stream");
    for file in inputs.iter().chain(&parts) {
        std::fs::remove_file(file)?;
    }
    row("decode", &[run.make(&["decode"], &[at("city.gsvx")], "back.ply")?]);
    let [inside, read] = region(run, &stream)?.map(|share| format!("{:.2} %", 100.0 * share));
    tables.streams.row(cells![
        format!("{millions} M"),
        format!("{:.1}", stream.len() as f64 / 1e6),
        format!("{:.1} %", 100.0 * join / (plan + encoded + join)),
        inside,
        read,
    ]);
    Ok(())
}

/// Decodes a box of a tenth of the scene's width, around the densest chunk. Returns the share of the Gaussians in
/// it, and the share of the stream that is read for it.
fn region(run: &Run<'_>, stream: &[u8]) -> Result<[f64; 2]> {
    let index = ::gsvx::Index::parse(stream)?;
    let chunks = &index.chunks;
    let least = |k: usize| chunks.iter().map(|c| c.bounds[0][k]).fold(f32::INFINITY, f32::min);
    let most = |k: usize| chunks.iter().map(|c| c.bounds[1][k]).fold(f32::NEG_INFINITY, f32::max);
    let width =
        |c: &::gsvx::Chunk| (0..3).map(|k| c.bounds[1][k] - c.bounds[0][k]).fold(0.0, f32::max);
    let dense = chunks.iter().min_by(|a, b| width(a).total_cmp(&width(b)));
    let middle = dense.context("a stream without chunks")?.bounds;
    let corner = |sign: f32| {
        let of = |k: usize| {
            let centre = 0.5 * (middle[0][k] + middle[1][k]);
            (centre + sign * 0.05 * (most(k) - least(k))).to_string()
        };
        [of(0), of(1), of(2)].join(",")
    };
    let region = format!("--box={},{}", corner(-1.0), corner(1.0));
    let done = run.make(&["decode", &region], &[run.dir.join("city.gsvx")], "box.ply")?;
    let said: Value = done.json()?;
    let number = |key: &str| said[key].as_f64().with_context(|| format!("no {key} in {said}"));
    let share = number("gaussians")? / index.header.count as f64;
    Ok([share, number("bytes_read")? / stream.len() as f64])
}

/// The page.
fn page(options: &GsvxOptions, tables: &Tables, out: &Path) -> Page {
    let millions: Vec<String> = options.millions.iter().map(ToString::to_string).collect();
    let mut page = Page::new(out, "Larger than memory?");
    page.text(format!(
        "`cargo xtask bench-gsvx --millions {}` encodes {} in turn, replicated \
         side by side and jittered, in files of a million each. `--memory {}`, {}. The bench checks that the joined \
         parts are the stream of `encode --memory`. Parts run one after the other; their peak is that of one. Times \
         are those of whole processes, files included. How it works: [scale.md](../scale.md).",
        millions.join(","),
        SCENES.join(" and "),
        options.memory,
        manifest::machine(),
    ));
    page.table(&tables.stages);
    page.table(&tables.streams);
    page
}
