//! Scenes of many millions of Gaussians: time and memory of each stage against their number, and what that predicts.
//!
//! A scene is several files of a million Gaussians each: fox and bonsai in turn, replicated and jittered. It is
//! made in a temporary folder and removed.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use gs_model::{Scene, ply};
use serde_json::Value;

use super::gsvx::replicate;
use crate::command::{self, Cost};
use crate::scenes;

/// Scenes whose Gaussians are replicated.
const SCENES: [&str; 2] = ["fox", "bonsai"];
/// Gaussians of a file.
const FILE: usize = 1_000_000;
/// Parts of the distributed encode.
const PARTS: usize = 16;

/// What [`run`] measures.
#[derive(Clone, Debug)]
pub struct Options {
    /// Millions of Gaussians.
    pub millions: Vec<usize>,
    /// Bound on memory, as the command takes it.
    pub memory: String,
    /// The command to measure.
    pub gsvx: PathBuf,
    /// Where the page goes, relative to the root of the workspace.
    pub out: PathBuf,
}

/// A stage of the work on a scene.
struct Row {
    stage: &'static str,
    millions: usize,
    /// Seconds of all processes of the stage, and the greatest peak of one.
    wall: f64,
    user: f64,
    peak_mb: f64,
}

/// What was made of a scene.
struct Made {
    rows: Vec<Row>,
    stream_mb: f64,
    /// Share of the Gaussians in a box, and of the stream that is read for it.
    region: [f64; 2],
}

/// Measures and writes the page.
///
/// # Errors
/// If the command is not there or fails, or a scene cannot be read.
pub fn run(options: &Options) -> Result<()> {
    let gsvx = command::find(&options.gsvx)?;
    let models = SCENES.iter().map(|name| {
        let found = scenes::find(name)?;
        let (mut model, _) = ply::read(&found.dataset.model_path)?;
        model.drop_invalid();
        Ok(model)
    });
    let models = models.collect::<Result<Vec<Scene>>>()?;
    ensure!(models.iter().all(|m| !m.is_empty()), "a model is empty");
    let mut made = Vec::new();
    for &millions in &options.millions {
        let dir = tempfile::tempdir().context("make a temporary folder")?;
        made.push(measure(&gsvx, options, &models, millions, dir.path())?);
    }
    crate::page::write(&options.out, &page(options, &made), None)
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

/// The words of a command, with inputs before the last one, which [`command::measure`] adds.
fn words(first: &[&str], inputs: &[PathBuf]) -> Vec<std::ffi::OsString> {
    let inputs = inputs[..inputs.len() - 1].iter().map(|p| p.clone().into_os_string());
    first.iter().map(|w| w.into()).chain(inputs).collect()
}

fn measure(
    gsvx: &Path,
    options: &Options,
    models: &[Scene],
    millions: usize,
    dir: &Path,
) -> Result<Made> {
    let at = |name: &str| dir.join(name);
    let inputs = inputs(models, millions, dir)?;
    let last = &inputs[inputs.len() - 1];
    let mut rows = Vec::new();
    let mut row = |stage, costs: &[Cost]| {
        let sum = |of: fn(&Cost) -> f64| costs.iter().map(of).sum::<f64>();
        let peak_mb = costs.iter().map(|c| c.peak_mb).fold(0.0, f64::max);
        let row = Row { stage, millions, wall: sum(|c| c.wall), user: sum(|c| c.user), peak_mb };
        print!("{}", row.line());
        rows.push(row);
    };
    let first = ["encode", "--memory", &options.memory];
    let encode = command::measure(gsvx, &words(&first, &inputs), last, &at("city.gsvx"))?;
    row(ENCODE, &[encode]);
    let plan = command::measure(gsvx, &words(&["plan"], &inputs), last, &at("plan"))?;
    row(PLAN, &[plan]);
    let mut parts = Vec::new();
    let mut costs = Vec::new();
    for k in 1..=PARTS {
        let part = at(&format!("part-{k:02}.gsvx"));
        let words = ["encode", "--memory", &options.memory, "--part", &format!("{k}/{PARTS}")];
        costs.push(command::measure(gsvx, &words, &at("plan"), &part)?);
        parts.push(part);
    }
    row(PART, &costs);
    let join = words(&["join"], &parts);
    let join = command::measure(gsvx, &join, &parts[PARTS - 1], &at("joined.gsvx"))?;
    row(JOIN, &[join]);
    let stream = std::fs::read(at("city.gsvx"))?;
    ensure!(std::fs::read(at("joined.gsvx"))? == stream, "the joined parts are another stream");
    for file in inputs.iter().chain(&parts) {
        std::fs::remove_file(file)?;
    }
    let back = at("back.ply");
    let decode = command::measure(gsvx, &["decode"], &at("city.gsvx"), &back)?;
    row(DECODE, &[decode]);
    let region = region(gsvx, &stream, dir)?;
    Ok(Made { rows, stream_mb: stream.len() as f64 / 1e6, region })
}

/// Decodes a box of a tenth of the scene's width, around the densest chunk. Returns the share of the Gaussians in
/// it, and the share of the stream that is read for it.
fn region(gsvx: &Path, stream: &[u8], dir: &Path) -> Result<[f64; 2]> {
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
    let words = ["--json", "decode", &region];
    let cost = command::measure(gsvx, &words, &dir.join("city.gsvx"), &dir.join("box.ply"))?;
    let said: Value = serde_json::from_slice(&cost.printed).context("what decode says")?;
    let number = |key: &str| said[key].as_f64().with_context(|| format!("no {key} in {said}"));
    let share = number("gaussians")? / index.header.count as f64;
    Ok([share, number("bytes_read")? / stream.len() as f64])
}

const ENCODE: &str = "encode --memory";
const PLAN: &str = "plan";
const PART: &str = "16 parts";
const JOIN: &str = "join";
const DECODE: &str = "decode";
const STAGES: [&str; 5] = [ENCODE, PLAN, PART, JOIN, DECODE];

impl Row {
    fn line(&self) -> String {
        let Self { stage, millions, wall, user, peak_mb } = self;
        let each = user / *millions as f64;
        format!("| {millions} M | {stage} | {wall:.2} | {user:.2} | {each:.2} | {peak_mb:.0} |\n")
    }
}

/// The factor and the exponent of seconds over millions of Gaussians: least squares of the logarithms.
fn fit(points: &[(f64, f64)]) -> [f64; 2] {
    let logs: Vec<[f64; 2]> =
        points.iter().map(|&(n, s)| [libm::log(n), libm::log(s.max(1e-3))]).collect();
    let count = logs.len() as f64;
    let mean = |k: usize| logs.iter().map(|l| l[k]).sum::<f64>() / count;
    let (x, y) = (mean(0), mean(1));
    let slope = logs.iter().map(|l| (l[0] - x) * (l[1] - y)).sum::<f64>()
        / logs.iter().map(|l| (l[0] - x) * (l[0] - x)).sum::<f64>().max(1e-12);
    [libm::exp(y - slope * x), slope]
}

/// The measured rows, the fits, and what they predict.
fn page(options: &Options, made: &[Made]) -> String {
    let (scenes, memory) = (SCENES.join(" and "), &options.memory);
    let millions: Vec<String> = options.millions.iter().map(ToString::to_string).collect();
    let millions = millions.join(",");
    let mut out = format!(
        "# Larger than memory?\n\n\
         `cargo build --release -p gsvx-cli && cargo xtask bench-gsvx --millions {millions}` encodes scenes of many millions of Gaussians: \
         {scenes} in turn, replicated side by side and jittered, in files of a million each. `--memory {memory}`, {} \
         threads, {}. The stream of the joined parts is the stream of `encode --memory`, byte for byte: the command \
         checks it. Parts run one after the other; their peak is that of one. Times are those of whole processes, \
         files included. Wall seconds depend on the disk too, so predictions use user seconds.\n\n\
         | Gaussians | stage | wall s | user s | user s per million | peak MB |\n|---:|---|---:|---:|---:|---:|\n",
        rayon::current_num_threads(),
        crate::manifest::processor(),
    );
    let rows: Vec<&Row> = made.iter().flat_map(|m| &m.rows).collect();
    rows.iter().for_each(|row| out += &row.line());
    out += "\n| Gaussians | stream MB | join, of the wall seconds of plan, parts and join | a box with | reads of the stream |\n\
            |---:|---:|---:|---:|---:|\n";
    for made in made {
        let wall =
            |stage| made.rows.iter().filter(|r| r.stage == stage).map(|r| r.wall).sum::<f64>();
        let join = wall(JOIN) / (wall(PLAN) + wall(PART) + wall(JOIN));
        let [inside, read] = made.region.map(|share| 100.0 * share);
        out += &format!(
            "| {} M | {:.1} | {:.1} % | {inside:.2} % of the Gaussians | {read:.2} % |\n",
            made.rows.first().map_or(0, |r| r.millions),
            made.stream_mb,
            100.0 * join,
        );
    }
    out + &prediction(&rows)
}

/// What the measured seconds say of larger scenes.
fn prediction(rows: &[&Row]) -> String {
    let of = |stage: &str| {
        let points = rows.iter().filter(|r| r.stage == stage);
        // A join only copies bytes: it takes no user seconds.
        let seconds = |r: &&Row| if stage == JOIN { r.wall } else { r.user };
        fit(&points.map(|r| (r.millions as f64, seconds(r))).collect::<Vec<_>>())
    };
    let mut out = "\nUser seconds (of the join: wall seconds) against millions of Gaussians `n`, by least squares of the logarithms, and what they predict. \
                   Nothing beyond the first table was measured, and disks are in the join alone.\n\n\
                   | stage | seconds | 100 M | 1000 M |\n|---|---|---:|---:|\n"
        .to_owned();
    let at = |[a, b]: [f64; 2], n: f64| a * libm::pow(n, b);
    for stage in STAGES {
        let [a, b] = of(stage);
        let [small, large] = [100.0, 1000.0].map(|n| at([a, b], n));
        out += &format!("| {stage} | {a:.2} n^{b:.2} | {small:.0} | {large:.0} |\n");
    }
    out += "\nProcessor seconds, one after the other: the plan, the parts that one of so many machines encodes, and the join:\n\n\
            | machines | 100 M | 1000 M |\n|---:|---:|---:|\n";
    for machines in [1.0, 16.0, 256.0] {
        let [small, large] =
            [100.0, 1000.0].map(|n| at(of(PLAN), n) + at(of(PART), n) / machines + at(of(JOIN), n));
        out += &format!("| {machines} | {small:.0} | {large:.0} |\n");
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fit_finds_the_exponent() {
        let points: Vec<(f64, f64)> =
            [1.0, 4.0, 10.0].iter().map(|&n| (n, 3.0 * libm::pow(n, 1.1))).collect();
        let [a, b] = fit(&points);
        assert!((a - 3.0).abs() < 1e-9 && (b - 1.1).abs() < 1e-9);
    }
}
