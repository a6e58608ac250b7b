//! How much of a voxelized model's quality the fine-tune restores, from the merged attributes and, if asked for,
//! from none.

use std::path::PathBuf;

use anyhow::Result;
use voxel::Strategy;

use crate::page::Page;
use crate::rd_curve::CurveOptions;
use crate::rd_curve::plan::Voxels;
use crate::rd_curve::stages::Branch;
use crate::rd_curve::study::Study;
use crate::rd_curve::tune::Tuning;
use crate::report::tunes;

/// Flags of `cargo xtask bench-finetune`.
#[derive(Clone, Debug, clap::Args)]
pub struct FinetuneOptions {
    /// Scenes: names of crates/eval/scenes.toml, or folders with photos, cameras and model
    #[arg(default_values_t = ["fox", "bonsai"].map(String::from))]
    scenes: Vec<String>,
    /// Steps of every run
    #[arg(long, default_value_t = 200)]
    steps: u64,
    /// Voxelizations: uniform:DEPTH or adaptive:LOW-HIGH
    #[arg(long, value_delimiter = ',', value_parser = parse_strategy,
        default_values = ["uniform:9", "uniform:11", "adaptive:7-10", "adaptive:8-12"])]
    voxels: Vec<Strategy>,
    /// Begin a second run of each voxelization from no initialisation
    #[arg(long)]
    from_none: bool,
    /// Where the page goes; the pictures lie beside it
    #[arg(long, default_value = "docs/results/finetune.md")]
    out: PathBuf,
}

/// Parses `uniform:DEPTH` or `adaptive:LOW-HIGH`.
fn parse_strategy(text: &str) -> Result<Strategy, String> {
    let parsed = match text.split_once(':') {
        Some(("uniform", depth)) => depth.parse().ok().map(|depth| Strategy::Uniform { depth }),
        Some(("adaptive", range)) => range
            .split_once('-')
            .and_then(|(low, high)| Some(Strategy::paper(low.parse().ok()?, high.parse().ok()?))),
        _ => None,
    };
    parsed.ok_or_else(|| format!("{text}: uniform:DEPTH or adaptive:LOW-HIGH expected"))
}

/// Measures and writes the page.
///
/// # Errors
/// If a scene cannot be read or a fine-tune fails.
pub fn run(options: &FinetuneOptions) -> Result<()> {
    let mut page = Page::new(&options.out, "What does the fine-tune bring?");
    page.text(format!(
        "`cargo xtask bench-finetune {} --steps {}` voxelizes and merges a model, tunes the result on the training \
         views as the paper does, and measures PSNR at the held-out views. Nothing is coded. With the codec in the \
         loop: [tune.md](tune.md).",
        options.scenes.join(" "),
        options.steps,
    ));
    for name in &options.scenes {
        let study = Study::open(&CurveOptions::of(name)?)?;
        let original = study.original()?;
        let mut models = Vec::new();
        for strategy in &options.voxels {
            let voxels = Voxels::fixed(strategy.clone());
            for initialised in if options.from_none { &[true, false][..] } else { &[true] } {
                let tuning = Tuning { steps: options.steps, initialised: *initialised };
                models.push(Branch::new(&study, &voxels, Some(tuning)).voxelized()?);
            }
        }
        let name = &study.test.files.name;
        page.text(format!(
            "{name}: {} Gaussians and {:.3} dB as trained, {} training views.",
            original.gaussians,
            original.score.psnr_db,
            study.test.training.len()
        ));
        let title = format!("{name}: fine-tune of voxelized models");
        page.chart(&format!("-{name}"), tunes::chart(title, tunes::of(&models), &original));
        page.table(&tunes::table(tunes::of(&models), &original));
    }
    page.write()
}
