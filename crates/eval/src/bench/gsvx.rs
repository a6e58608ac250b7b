//! `cargo xtask bench-gsvx`: pages on the codec as a user has it.

use std::path::{Path, PathBuf};

use anyhow::Result;

use super::{importance, scale, speed, sweep};
use crate::process::Gsvx;

/// Flags of `cargo xtask bench-gsvx`.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {
    /// Scene that is replicated.
    #[arg(default_value = "fox")]
    pub(super) scene: String,
    /// Numbers of Gaussians.
    #[arg(long, value_delimiter = ',', default_values_t = [100_000, 1_000_000, 4_000_000])]
    pub(super) sizes: Vec<usize>,
    /// The command to measure.
    #[arg(long, default_value = "target/release/gsvx")]
    gsvx: PathBuf,
    /// Instead: compare rates with and without cameras, per scene (comma-separated), as
    /// docs/results/importance.md.
    #[arg(long, value_name = "SCENES", value_delimiter = ',')]
    importance: Vec<String>,
    /// Instead: whether a greater quality ever looks worse, per scene (comma-separated), as
    /// docs/results/sweep.md.
    #[arg(long, value_name = "SCENES", value_delimiter = ',')]
    sweep: Vec<String>,
    /// Instead: scenes of so many million Gaussians (comma-separated), within a bound on memory and in parts, as
    /// docs/results/scale.md. Takes about 750 MB of disk per million.
    #[arg(long, value_name = "MILLIONS", value_delimiter = ',')]
    pub(super) millions: Vec<usize>,
    /// With --millions: the bound on the memory of each process.
    #[arg(long, default_value = "1G", requires = "millions")]
    pub(super) memory: String,
    /// Where the page goes [default: docs/results, by what is measured]
    #[arg(long)]
    out: Option<PathBuf>,
}

/// Measures and writes the page that is asked for.
///
/// # Errors
/// If the command is not there or fails, or a scene cannot be read.
pub fn run(options: &Options) -> Result<()> {
    let out = |page: &'static str| options.out.as_deref().unwrap_or(Path::new(page));
    if !options.importance.is_empty() {
        return importance::run(&options.importance, out("docs/results/importance.md"));
    }
    if !options.sweep.is_empty() {
        return sweep::run(&options.sweep, out("docs/results/sweep.md"));
    }
    let gsvx = Gsvx::find(&options.gsvx)?;
    if !options.millions.is_empty() {
        return scale::run(options, &gsvx, out("docs/results/scale.md"));
    }
    speed::run(options, &gsvx, out("docs/results/speed.md"))
}
