//! `cargo xtask rd-curve`: the rate-distortion curves of a scene, or an experiment of the paper.

use std::path::PathBuf;
use std::time::Duration;

use anyhow::Result;
use clap::builder::{PossibleValuesParser, TypedValueParser as _};
use eval::experiments::Experiment;
use eval::rd_curve::Effort;
use eval::{experiments, peers, rd_curve, scenes};

/// Flags of `cargo xtask rd-curve`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Args {
    /// A folder with model, cameras and photos, or a name from crates/eval/scenes.toml
    #[arg(default_value = scenes::DEFAULT)]
    scene: String,
    /// Folder of the report [default: out/rd/SCENE]
    #[arg(long)]
    out: Option<PathBuf>,
    /// Measure at most this many held-out views
    #[arg(long)]
    views: Option<usize>,
    /// Rates per curve
    #[arg(long)]
    rates: Option<usize>,
    /// Two views, five rates
    #[arg(long)]
    quick: bool,
    /// Depth of the uniform octree [default: chosen by rendering, deeper at higher rates]
    #[arg(long)]
    depth: Option<u8>,
    /// Depths of the adaptive octree, LOW:HIGH of the paper's criteria [default: about the uniform depth]
    #[arg(long, value_parser = rd_curve::parse_depths)]
    adaptive: Option<(u8, u8)>,
    /// Fine-tune each voxelized model against the training photos for this many steps [default:
    /// none; experiments: 400]
    #[arg(long, value_name = "STEPS", value_parser = clap::value_parser!(u64).range(1..))]
    finetune: Option<u64>,
    /// One of the paper's experiments instead of the default curves
    #[arg(long, value_parser = PossibleValuesParser::new(Experiment::ALL.map(Experiment::name)).map(experiment))]
    experiment: Option<Experiment>,
    /// Draw the curve of `gsvx tune` too, by effort: quick, normal (the default) or long
    #[arg(long, value_name = "EFFORT", num_args = 0..=1, require_equals = true, default_missing_value = "normal",
        value_parser = PossibleValuesParser::new(Effort::ALL.map(Effort::name)).map(effort))]
    tune: Option<Effort>,
    /// The command that tunes
    #[arg(long, value_name = "FILE", default_value = "target/release/gsvx")]
    gsvx: PathBuf,
    /// Run every stage, done before or not
    #[arg(long)]
    fresh: bool,
    #[command(flatten)]
    peers: Peers,
}

/// Where the peers' tools are.
#[derive(Clone, Debug, clap::Args)]
struct Peers {
    /// MPEG's tmc3, for the paper's own chain [default: on the PATH]
    #[arg(long, value_name = "FILE", help_heading = "Peers")]
    tmc3: Option<PathBuf>,
    /// Folder with SPZ's ply_to_spz and spz_to_ply [default: on the PATH]
    #[arg(long, value_name = "DIR", help_heading = "Peers")]
    spz: Option<PathBuf>,
    /// PlayCanvas' splat-transform [default: on the PATH]
    #[arg(long, value_name = "FILE", help_heading = "Peers")]
    splat_transform: Option<PathBuf>,
    /// Let splat-transform make SOG too: without a GPU, hours of k-means
    #[arg(long, help_heading = "Peers")]
    sog: bool,
    /// Longest run of a peer's tool, in seconds
    #[arg(long, default_value_t = 600, value_parser = clap::value_parser!(u64).range(1..), help_heading = "Peers")]
    peer_seconds: u64,
    /// Run no peer
    #[arg(long, help_heading = "Peers")]
    no_peers: bool,
}

/// `--quick`: held-out views and rates.
const QUICK: (usize, usize) = (2, 5);

/// The experiment of that name; clap has checked the name.
fn experiment(name: String) -> Experiment {
    let named = Experiment::ALL.into_iter().find(|e| e.name() == name);
    named.unwrap_or(Experiment::Baseline)
}

/// The effort of that name; clap has checked the name.
pub(crate) fn effort(name: String) -> Effort {
    Effort::ALL.into_iter().find(|e| e.name() == name).unwrap_or(Effort::Normal)
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let default = rd_curve::Options::default();
    let (views, rates) = if args.quick { QUICK } else { (default.views, default.rates) };
    let peers = args.peers.clone();
    let options = rd_curve::Options {
        scene: args.scene.clone(),
        out: args.out.clone(),
        views: args.views.unwrap_or(views),
        rates: args.rates.unwrap_or(rates),
        depth: args.depth,
        adaptive: args.adaptive,
        finetune: args.finetune,
        tune: args.tune.map(|effort| (args.gsvx.clone(), effort)),
        fresh: args.fresh,
        peers: peers::Options {
            tmc3: peers.tmc3,
            spz: peers.spz,
            splat_transform: peers.splat_transform,
            sog: peers.sog,
            limit: Duration::from_secs(peers.peer_seconds),
            none: peers.no_peers,
        },
    };
    match args.experiment {
        Some(experiment) => experiments::run(experiment, &options),
        None => rd_curve::run(&options),
    }
}
