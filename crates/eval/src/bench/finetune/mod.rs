//! How much of a voxelized model's quality the fine-tune restores, from the merged attributes and
//! from none. Voxelizes uniformly and adaptively at two depths each, fine-tunes on the training
//! views, scores on the held-out ones. Also time and image error of the rasterizer's variants.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::Result;
use finetune::{FineTune, FineTuneOptions, LearningRates, Loss, TrainView};
use gs_model::Scene;
use voxel::{Cube, Importance, Merge, Merging, Strategy, Voxelization, voxelize};

use crate::chart::{Axis, Chart, Kind, Series};
use crate::measure;
use crate::progress::Bar;
use crate::scenes::TestScene;
use crate::usage;

mod variants;

/// What [`run`] measures.
#[derive(Clone, Debug)]
pub struct Options {
    /// Names of `scenes.toml`, or folders with photos, cameras and model.
    pub scenes: Vec<String>,
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
    /// Begin a second run of each voxelization from no initialisation.
    pub from_none: bool,
    /// Time and image error of the rasterizer's variants instead.
    pub variants: bool,
    /// Where the page goes, relative to the root of the workspace; the charts lie beside it.
    pub out: PathBuf,
}

/// Parses `uniform:DEPTH` or `adaptive:LOW-HIGH`.
///
/// # Errors
/// If `text` has another form.
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
    Ok(Run { label, gaussians, steps, cpu, before, after, epochs: out.epoch_psnr })
}

/// PSNR of the training views over steps; runs without initialisation are thin lines.
fn chart(study: &Study) -> Chart {
    let line = |run: &Run| Series {
        name: run.label.clone(),
        kind: if run.label.ends_with(FROM_NONE) { Kind::Theirs } else { Kind::Ours },
        points: (1..).zip(&run.epochs).map(|(e, &db)| ((e * study.views) as f64, db)).collect(),
    };
    Chart::new(
        format!("{}: fine-tune of voxelized models", study.name),
        Axis::linear("steps"),
        Axis::linear("PSNR of the epoch's training views, dB"),
        study.runs.iter().map(line).collect(),
        None,
    )
}

/// The runs on one scene.
struct Study {
    name: String,
    gaussians: usize,
    /// Views that are trained on, and mean PSNR of the model as trained at the held-out views.
    views: usize,
    model: f64,
    runs: Vec<Run>,
}

/// Runs the fine-tunes and writes the page, with a chart for each scene; or prints the rasterizer's
/// variants.
///
/// # Errors
/// If a scene cannot be read or a fine-tune fails.
pub fn run(args: &Options) -> Result<()> {
    let mut studies = Vec::new();
    for name in &args.scenes {
        let scene = TestScene::open(name, usize::MAX)?;
        let train = measure::load(scene.files.dataset.training())?;
        if args.variants {
            variants::run(&scene.model, &train)?;
        } else {
            studies.push(study(args, scene, &train)?);
        }
    }
    if args.variants {
        return Ok(());
    }
    let folder = args.out.parent().unwrap_or(Path::new(""));
    for study in &studies {
        let file = folder.join(format!("finetune-{}.svg", study.name));
        crate::page::write(&file, &chart(study).svg(), None)?;
    }
    crate::page::write(&args.out, &page(&studies)?, None)
}

/// Voxelizes, merges and tunes one scene.
fn study(args: &Options, scene: TestScene, train: &[TrainView]) -> Result<Study> {
    let TestScene { files, model: scene, training, held_out, .. } = scene;
    let model = score(&scene, &held_out);
    let importance = if args.weigh {
        Importance::Given(finetune::saliency_per_view(&scene, &training).squared)
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
        let merged = Merging::new(&scene, &cells, Merge::default(), &importance)?.scene();
        let none = args.from_none.then(|| blank(&merged, &cells));
        runs.push(tune(label.clone(), merged, train, &held_out, args)?);
        if let Some(none) = none {
            runs.push(tune(format!("{label}{FROM_NONE}"), none, train, &held_out, args)?);
        }
    }
    Ok(Study { name: files.name, gaussians: scene.len(), views: train.len(), model, runs })
}

/// How the label of a run without initialisation ends.
const FROM_NONE: &str = " from none";

fn page(studies: &[Study]) -> Result<String> {
    let mut out = format!(
        "# What does the fine-tune bring?\n\n\
         `{}` voxelizes and merges a model, tunes the result on the training views and measures PSNR at \
         the held-out views, which the fine-tune never sees. Nothing is coded. Means are frozen; loss, \
         rates and decay are the defaults unless the command says otherwise. What the fine-tune saves in \
         bytes is on the page of [voxelization](voxel.md). Seconds are of the processor, all threads.\n",
        crate::manifest::command()
    );
    for study in studies {
        let Study { name, gaussians, model, views, runs } = study;
        write!(
            out,
            "\n{name}: {gaussians} Gaussians and {model:.3} dB as trained, {views} training views.\n\n\
             ![{name}: PSNR over steps](finetune-{name}.svg)\n\n\
             | voxelization | Gaussians | before, dB | after, dB | below the trained model, dB | steps | seconds |\n\
             |---|---:|---:|---:|---:|---:|---:|\n"
        )?;
        for r in runs {
            writeln!(
                out,
                "| {} | {} | {:.3} | {:.3} | {:.3} | {} | {:.0} |",
                r.label,
                r.gaussians,
                r.before,
                r.after,
                model - r.after,
                r.steps,
                r.cpu
            )?;
        }
    }
    Ok(out)
}
