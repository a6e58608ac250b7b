//! How much of a voxelized model's quality the fine-tune restores, from the merged attributes and
//! from none. Voxelizes uniformly and adaptively at two depths each, fine-tunes on the training
//! views, scores on the held-out ones. Also time and image error of the rasterizer's variants.

use std::fmt::Write as _;
use std::path::PathBuf;

use anyhow::Result;
use finetune::{FineTune, FineTuneOptions, LearningRates, Loss, TrainView};
use gs_model::Scene;
use gs_model::dataset::Dataset;
use voxel::{Cube, Importance, Merge, Strategy, Voxelization, merge_weighted, voxelize};

use crate::chart::{Axis, Chart, Kind, Series};
use crate::measure;
use crate::progress::Bar;
use crate::usage;

mod variants;

/// What [`run`] measures.
#[derive(Clone, Debug)]
pub struct Options {
    /// Directory of a scene: photos, cameras, model.
    pub scene: PathBuf,
    /// Steps of every run.
    pub steps: u64,
    /// Voxelizations, [`Strategy::Uniform`] or [`Strategy::Paper`].
    pub voxels: Vec<Strategy>,
    /// Minimise the squared error instead of L1 and SSIM.
    pub mse: bool,
    /// Factor on all learning rates.
    pub rate: f32,
    /// Fraction of the learning rates at the last step.
    pub final_rate: f64,
    /// Merge by blending weights over the training views rather than by opacity and area.
    pub weigh: bool,
    /// Leave out the runs that begin from no initialisation.
    pub merged_only: bool,
    /// Time and image error of the rasterizer's variants instead.
    pub variants: bool,
    /// Where `recover-SCENE.json` and `recover-SCENE.svg` go, `variants-SCENE` likewise.
    pub out: PathBuf,
    /// Name of the files instead of `recover-SCENE`.
    pub name: Option<String>,
}

/// Parses `uniform:DEPTH` or `adaptive:LOW-HIGH`.
///
/// # Errors
/// If that is not what `text` is.
pub fn parse_strategy(text: &str) -> Result<Strategy, String> {
    let parsed = match text.split_once(':') {
        Some(("uniform", depth)) => depth.parse().ok().map(|depth| Strategy::Uniform { depth }),
        Some(("adaptive", range)) => range
            .split_once('-')
            .and_then(|(low, high)| Some(Strategy::paper(low.parse().ok()?, high.parse().ok()?))),
        _ => None,
    };
    parsed.ok_or_else(|| format!("{text}: uniform:DEPTH or adaptive:LOW-HIGH expected"))
}

struct Run {
    label: String,
    gaussians: usize,
    steps: u64,
    seconds: f64,
    /// Processor seconds, all threads.
    cpu: f64,
    /// Mean PSNR over the held-out views.
    before: f64,
    after: f64,
    /// Mean PSNR over the training views per epoch.
    epochs: Vec<f64>,
}

/// Mean PSNR.
fn score(scene: &Scene, views: &[TrainView]) -> f64 {
    measure::score(scene, views, &Bar::hidden()).0.psnr_db
}

/// The start of a trainer without initialisation, at the same means: grey, round, translucent
/// Gaussians as large as their cells.
fn blank(merged: &Scene, cells: &Voxelization) -> Scene {
    let n = merged.len();
    let log_scales =
        cells.leaves.iter().map(|leaf| [(cells.cube.cell(leaf.depth) as f32 * 0.5).ln(); 3]);
    Scene {
        means: merged.means.clone(),
        rotations: vec![[1.0, 0.0, 0.0, 0.0]; n],
        log_scales: log_scales.collect(),
        // Opacity 0.1, as the reference implementation begins with.
        opacity_logits: vec![-2.197_224_6; n],
        sh_degree: merged.sh_degree,
        sh: vec![[0.0; 3]; merged.sh.len()],
    }
}

fn tune(
    label: String,
    scene: Scene,
    train: &[TrainView],
    held_out: &[TrainView],
    args: &Options,
) -> Result<Run> {
    let steps = args.steps;
    let before = score(&scene, held_out);
    let gaussians = scene.len();
    let r = LearningRates::default();
    let options = FineTuneOptions {
        steps,
        loss: if args.mse { Loss::Mse } else { Loss::default() },
        rates: LearningRates {
            sh_dc: args.rate * r.sh_dc,
            sh_rest: args.rate * r.sh_rest,
            opacity: args.rate * r.opacity,
            log_scale: args.rate * r.log_scale,
            rotation: args.rate * r.rotation,
        },
        final_rate: args.final_rate,
        report_every: 100,
        ..FineTuneOptions::default()
    };
    let cpu = usage::cpu_seconds();
    let run = FineTune::new(scene, train.to_vec(), options)?;
    let out = run.run(|p| {
        println!(
            "  {label}: step {} of {}, {:.2} dB, {:.0} s left",
            p.step, p.steps, p.psnr, p.eta_seconds
        );
    })?;
    let cpu = usage::cpu_seconds() - cpu;
    let after = score(&out.scene, held_out);
    println!(
        "{label}: {gaussians} Gaussians, {before:.3} -> {after:.3} dB in {steps} steps, {:.0} s, {cpu:.0} \
         processor s, {:.0} MB at most so far",
        out.seconds,
        usage::peak_bytes() as f64 / 1e6,
    );
    let (seconds, epochs) = (out.seconds, out.epoch_psnr);
    Ok(Run { label, gaussians, steps, seconds, cpu, before, after, epochs })
}

/// PSNR of the training views over steps; runs without initialisation are thin lines.
fn chart(runs: &[Run], views: usize, title: String) -> Chart {
    let line = |run: &Run| Series {
        name: run.label.clone(),
        kind: if run.label.ends_with("none") { Kind::Theirs } else { Kind::Ours },
        points: (1..).zip(&run.epochs).map(|(e, &db)| ((e * views) as f64, db)).collect(),
    };
    Chart::new(
        title,
        Axis::linear("steps"),
        Axis::linear("PSNR of the epoch's views, dB"),
        runs.iter().map(line).collect(),
        None,
    )
}

/// Runs the fine-tunes and writes their table and chart.
///
/// # Errors
/// If the scene cannot be read or a fine-tune fails.
pub fn run(args: &Options) -> Result<()> {
    let (dir, out) = (&args.scene, &args.out);
    let dataset = Dataset::open(dir)?;
    let (scene, _) = gs_model::ply::read(&dataset.model_path)?;
    let train = measure::load(dataset.training())?;
    let held_out = measure::load(dataset.held_out())?;
    let model = score(&scene, &held_out);
    let name = dir.file_name().map_or_else(String::new, |n| n.to_string_lossy().into());
    println!(
        "{name}: {} Gaussians, {model:.3} dB at {} held-out views",
        scene.len(),
        held_out.len()
    );
    if args.variants {
        return variants::run(&name, &scene, &train, out);
    }
    let importance = if args.weigh {
        let cameras: Vec<_> = train.iter().map(|v| v.camera.clone()).collect();
        Importance::Given(finetune::saliency_per_view(&scene, &cameras).squared)
    } else {
        Importance::OpacityArea
    };
    let cube = Cube::of(&scene.means)?;
    let mut runs = Vec::new();
    for strategy in &args.voxels {
        let label = match strategy {
            Strategy::Uniform { depth } => format!("uniform {depth}"),
            Strategy::Paper { j_low, j_high, .. } => format!("adaptive {j_low}-{j_high}"),
            _ => continue,
        };
        let cells = voxelize(&scene, &cube, strategy)?;
        let merged = merge_weighted(&scene, &cells, Merge::default(), &importance)?;
        let none = blank(&merged, &cells);
        for (scene, from) in [(merged, "merged"), (none, "none")] {
            if from == "none" && args.merged_only {
                continue;
            }
            let label = format!("{label} from {from}");
            runs.push(tune(label, scene, &train, &held_out, args)?);
        }
    }
    let mut json = format!(
        "{{\n  \"scene\": \"{name}\", \"model_db\": {model:.3}, \"loss\": \"{}\", \"rate\": {}, \
         \"final_rate\": {}, \"weighed\": {}, \"peak_bytes\": {}, \"runs\": [\n",
        if args.mse { "mse" } else { "l1-ssim" },
        args.rate,
        args.final_rate,
        args.weigh,
        usage::peak_bytes(),
    );
    for (i, r) in runs.iter().enumerate() {
        let epochs: Vec<String> = r.epochs.iter().map(|v| format!("{v:.3}")).collect();
        let comma = if i + 1 < runs.len() { "," } else { "" };
        writeln!(
            json,
            "    {{\"run\": \"{}\", \"gaussians\": {}, \"steps\": {}, \"seconds\": {:.1}, \
             \"processor_seconds\": {:.1}, \"before_db\": {:.3}, \"after_db\": {:.3}, \"epoch_db\": [{}]}}{comma}",
            r.label,
            r.gaussians,
            r.steps,
            r.seconds,
            r.cpu,
            r.before,
            r.after,
            epochs.join(", ")
        )?;
    }
    json.push_str("  ]\n}\n");
    std::fs::create_dir_all(out)?;
    let file = args.name.clone().unwrap_or_else(|| format!("recover-{name}"));
    std::fs::write(out.join(format!("{file}.json")), json)?;
    let title = format!("{name}: fine-tune of voxelized models (original {model:.2} dB held out)");
    let svg = chart(&runs, train.len(), title).svg();
    Ok(std::fs::write(out.join(format!("{file}.svg")), svg)?)
}
