//! The benches: flags of each, and the call of `eval::bench`.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::Result;
use eval::bench;

/// Flags of `cargo xtask bench`.
#[derive(clap::Args, Debug)]
pub(crate) struct BenchArgs {
    /// Scene whose model is measured.
    #[arg(default_value = "fox")]
    scene: String,
    /// Repetitions; the fastest counts.
    #[arg(long, default_value_t = 3)]
    repeat: usize,
    /// Write the times of this run as the baseline that later ones are compared with.
    #[arg(long)]
    bless: bool,
    /// Run `cargo bench` of every crate first, with short measurements (minutes).
    #[arg(long)]
    criterion: bool,
    /// Run one stage in this process and print its peak memory as JSON.
    #[arg(long, hide = true, requires = "scratch")]
    memory_of: Option<String>,
    /// Folder for what stages pass on.
    #[arg(long, hide = true)]
    scratch: Option<PathBuf>,
    /// Folder of the report and its plots.
    #[arg(long, default_value = "target/bench")]
    out: PathBuf,
}

pub(crate) fn run(args: BenchArgs) -> Result<()> {
    if let (Some(stage), Some(scratch)) = (&args.memory_of, &args.scratch) {
        return bench::memory_child(&args.scene, stage, scratch);
    }
    let BenchArgs { scene, repeat, bless, criterion, out, .. } = args;
    bench::run(&bench::Options { scene, repeat, bless, criterion, child, out })
}

/// A process that measures the memory of one stage.
fn child(scene: &str, stage: &str, scratch: &Path) -> std::io::Result<Command> {
    let mut command = Command::new(std::env::current_exe()?);
    command.args(["bench", scene, "--memory-of", stage, "--scratch"]).arg(scratch);
    Ok(command)
}

/// Flags of `cargo xtask skips`.
#[derive(clap::Args, Debug)]
pub(crate) struct SkipsArgs {
    /// Scenes to count on.
    #[arg(default_values_t = ["room", "fox", "bonsai"].map(String::from))]
    scenes: Vec<String>,
    /// Where the page goes.
    #[arg(long, default_value = "docs/results/skips.md")]
    out: PathBuf,
}

pub(crate) fn skips(args: &SkipsArgs) -> Result<()> {
    bench::skips(&args.scenes, &args.out)
}

/// Flags of `cargo xtask bench-size`.
#[derive(clap::Args, Debug)]
pub(crate) struct SizeArgs {
    /// Scenes to measure; the picture is of the first.
    #[arg(default_values_t = ["fox", "bonsai", "room"].map(String::from))]
    scenes: Vec<String>,
    /// Where the page goes.
    #[arg(long, default_value = "docs/results/rd.md")]
    out: PathBuf,
}

pub(crate) fn size(args: &SizeArgs) -> Result<()> {
    eval::rd_curve::size(&args.scenes, &args.out)
}

/// Flags of `cargo xtask bench-gpcc`.
#[derive(clap::Args, Debug)]
pub(crate) struct GpccArgs {
    /// Directory of the clouds and `tmc13.jsonl`
    #[arg(long, default_value = "../shared/clouds")]
    clouds: PathBuf,
    /// Only these parts: model, geometry, adaptive, lossless, raht, speed, accuracy (all if none);
    /// a partial run is printed, not written
    #[arg(long)]
    only: Vec<String>,
    /// Only these clouds (all if none)
    #[arg(long)]
    cloud: Vec<String>,
    /// Only these attributes (all if none)
    #[arg(long)]
    attr: Vec<String>,
    /// Only these quantisation parameters
    #[arg(long)]
    qp: Vec<u8>,
    /// Where the whole report goes
    #[arg(long, default_value = "docs/results/gpcc.md")]
    out: PathBuf,
}

pub(crate) fn gpcc(args: GpccArgs) -> Result<()> {
    let GpccArgs { clouds, only, cloud, attr, qp, out } = args;
    bench::gpcc::run(&bench::gpcc::Options { clouds, only, cloud, attr, qp, out })
}

/// Flags of `cargo xtask bench-voxel`.
#[derive(clap::Args, Debug)]
pub(crate) struct VoxelArgs {
    /// Directory with `scenes` and `models`
    #[arg(long, default_value = "../shared")]
    shared: PathBuf,
    /// Only these parts: rates, tuned, criteria, speed, merging, cost (all if none)
    #[arg(long, value_delimiter = ',')]
    only: Vec<String>,
    /// Only these scenes; `room` is the fixture, the others lie in `scenes` of the shared folder
    #[arg(long, default_values_t = ["fox".to_owned(), "bonsai".to_owned(), "room".to_owned()])]
    scene: Vec<String>,
    /// Gaussians of the speed runs, in thousands
    #[arg(long, default_value_t = 2500)]
    thousands: usize,
    /// Folder of the room
    #[arg(long, default_value = "fixtures/room")]
    room: PathBuf,
    /// Steps of fine-tune in `tuned`
    #[arg(long, default_value_t = 300)]
    steps: u64,
    /// Where the page goes; the plots of `rates` lie beside it
    #[arg(long, default_value = "docs/results/voxel.md")]
    out: PathBuf,
    /// In `rates`, also try variants of the rate-distortion settings
    #[arg(long)]
    variants: bool,
}

pub(crate) fn voxel(args: VoxelArgs) -> Result<()> {
    let VoxelArgs { shared, only, scene, thousands, room, steps, out, variants } = args;
    let options =
        bench::voxel::Options { shared, only, scene, thousands, room, steps, out, variants };
    bench::voxel::run(&options)
}

/// Flags of `cargo xtask bench-finetune`.
#[derive(clap::Args, Debug)]
pub(crate) struct FinetuneArgs {
    /// Scenes: names of crates/eval/scenes.toml, or folders with photos, cameras and model
    #[arg(default_values_t = ["fox", "bonsai"].map(String::from))]
    scenes: Vec<String>,
    /// Steps of every run
    #[arg(long, default_value_t = 500)]
    steps: u64,
    /// Voxelization: uniform:DEPTH or adaptive:LOW-HIGH; may be repeated
    #[arg(
        long = "voxels",
        value_name = "KIND",
        value_parser = bench::finetune::parse_strategy,
        default_values = ["uniform:9", "uniform:11", "adaptive:7-10", "adaptive:8-12"]
    )]
    voxels: Vec<voxel::Strategy>,
    /// What is minimised
    #[arg(long, default_value = "l1-ssim", value_parser = ["l1-ssim", "mse"])]
    loss: String,
    /// Merge by blending weights over the training views rather than by opacity and area
    #[arg(long)]
    weigh: bool,
    /// Begin a second run of each voxelization from no initialisation
    #[arg(long)]
    from_none: bool,
    /// Print time and image error of the rasterizer's variants instead
    #[arg(long)]
    variants: bool,
    /// Where the page goes; the charts lie beside it
    #[arg(long, default_value = "docs/results/finetune.md")]
    out: PathBuf,
}

pub(crate) fn finetune(args: FinetuneArgs) -> Result<()> {
    let mse = args.loss == "mse";
    let FinetuneArgs { scenes, steps, voxels, weigh, from_none, variants, out, .. } = args;
    bench::finetune::run(&bench::finetune::Options {
        scenes,
        steps,
        voxels,
        mse,
        weigh,
        from_none,
        variants,
        out,
    })
}

/// Flags of `cargo xtask bench-gsvx`.
#[derive(clap::Args, Debug)]
pub(crate) struct GsvxArgs {
    /// Scene that is replicated.
    #[arg(default_value = "fox")]
    scene: String,
    /// Numbers of Gaussians.
    #[arg(long, value_delimiter = ',', default_values_t = [100_000, 1_000_000, 4_000_000])]
    sizes: Vec<usize>,
    /// The command to measure.
    #[arg(long, default_value = "target/release/gsvx")]
    gsvx: PathBuf,
    /// Instead: five byte targets and three PSNR targets per scene (comma-separated), as a table.
    #[arg(long, value_name = "SCENES", value_delimiter = ',')]
    targets: Vec<String>,
    /// Instead: what coarse levels of detail cost and show, per scene (comma-separated), as a table.
    #[arg(long, value_name = "SCENES", value_delimiter = ',')]
    lod: Vec<String>,
    /// Instead: compare rates with and without cameras, per scene (comma-separated), with skies and
    /// pairs, as docs/results/importance.md.
    #[arg(long, value_name = "SCENES", value_delimiter = ',')]
    importance: Vec<String>,
    /// Instead: whether a greater quality ever looks worse, per scene (comma-separated), as
    /// docs/results/sweep.md.
    #[arg(long, value_name = "SCENES", value_delimiter = ',')]
    sweep: Vec<String>,
    /// Instead: scenes of so many million Gaussians (comma-separated), within a bound on memory and in parts, as
    /// docs/results/scale.md. Takes about 750 MB of disk per million.
    #[arg(long, value_name = "MILLIONS", value_delimiter = ',')]
    millions: Vec<usize>,
    /// With --millions: the bound on the memory of each process.
    #[arg(long, default_value = "1G", requires = "millions")]
    memory: String,
    /// Where the page goes.
    #[arg(long, default_value = "docs/results/speed.md")]
    out: PathBuf,
}

pub(crate) fn gsvx(args: GsvxArgs) -> Result<()> {
    let GsvxArgs { scene, sizes, gsvx, targets, lod, importance, sweep, millions, memory, out } =
        args;
    if !millions.is_empty() {
        let out = "docs/results/scale.md".into();
        return bench::scale::run(&bench::scale::Options { millions, memory, gsvx, out });
    }
    if !importance.is_empty() {
        return bench::gsvx::importance(&importance, Path::new("docs/results/importance.md"));
    }
    if !sweep.is_empty() {
        return bench::gsvx::sweep(&sweep, Path::new("docs/results/sweep.md"));
    }
    if !lod.is_empty() {
        return bench::gsvx::lod(&lod);
    }
    if !targets.is_empty() {
        return bench::gsvx::targets(&gsvx, &targets);
    }
    bench::gsvx::run(&bench::gsvx::Options { scene, sizes, gsvx, out })
}

/// Flags of `cargo xtask bench-quality`.
#[derive(clap::Args, Debug)]
pub(crate) struct QualityArgs {
    /// Scenes with photos
    #[arg(default_values_t = ["room", "fox", "bonsai"].map(String::from))]
    scenes: Vec<String>,
    /// Folder of models without photos
    #[arg(long, default_value = "../shared/models")]
    models: PathBuf,
    /// The command that is measured
    #[arg(long, default_value = "target/release/gsvx")]
    gsvx: PathBuf,
    /// Where the page goes
    #[arg(long, default_value = "docs/results/quality.md")]
    out: PathBuf,
}

pub(crate) fn quality(args: QualityArgs) -> Result<()> {
    let QualityArgs { scenes, models, gsvx, out } = args;
    bench::quality::run(&bench::quality::Options { scenes, models, gsvx, out })
}

/// Flags of `cargo xtask bench-tune`.
#[derive(clap::Args, Debug)]
pub(crate) struct TuneArgs {
    /// Scenes of the page; the picture is of the first.
    #[arg(default_values_t = ["room", "fox", "bonsai"].map(String::from))]
    scenes: Vec<String>,
    /// Measure only these runs, for example normal,quick (all if none); others are shown as far as they
    /// are recorded.
    #[arg(long = "run", value_delimiter = ',')]
    runs: Vec<String>,
    /// Measure only these qualities (all if none).
    #[arg(long = "quality", value_delimiter = ',')]
    qualities: Vec<f32>,
    /// The command to measure.
    #[arg(long, default_value = "target/release/gsvx")]
    gsvx: PathBuf,
    /// Compare with `gsvx encode --cameras` of another version, not with this one without tuning
    #[arg(
        long,
        value_name = "NAME=COMMAND",
        value_parser = |s: &str| bench::tune::parse_reference(s).map_err(|e| e.to_string())
    )]
    reference: Option<bench::tune::Reference>,
    /// Where the page goes.
    #[arg(long, default_value = "docs/results/tune.md")]
    out: PathBuf,
}

pub(crate) fn tune(args: TuneArgs) -> Result<()> {
    let TuneArgs { scenes, runs, qualities, gsvx, reference, out } = args;
    bench::tune::run(&bench::tune::Options { scenes, runs, qualities, gsvx, reference, out })
}
