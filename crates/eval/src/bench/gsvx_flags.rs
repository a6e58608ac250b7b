//! Flags of `cargo xtask bench-gsvx`.

use std::path::PathBuf;

/// Flags of `cargo xtask bench-gsvx`.
#[derive(Clone, Debug, clap::Args)]
pub struct GsvxOptions {
    /// Scene that is replicated.
    #[arg(default_value = "fox")]
    pub(super) scene: String,
    /// Numbers of Gaussians.
    #[arg(long, value_delimiter = ',', default_values_t = [100_000, 1_000_000, 4_000_000])]
    pub(super) sizes: Vec<usize>,
    /// Instead: compare rates with and without cameras, per scene (comma-separated), as
    /// docs/results/importance.md.
    #[arg(long, value_name = "SCENES", value_delimiter = ',')]
    pub(super) importance: Vec<String>,
    /// Instead: whether a greater quality ever looks worse, per scene (comma-separated), as
    /// docs/results/sweep.md.
    #[arg(long, value_name = "SCENES", value_delimiter = ',')]
    pub(super) sweep: Vec<String>,
    /// Instead: scenes of so many million Gaussians (comma-separated), within a bound on memory and in parts, as
    /// docs/results/scale.md. Takes about 750 MB of disk per million.
    #[arg(long, value_name = "MILLIONS", value_delimiter = ',')]
    pub(super) millions: Vec<usize>,
    /// With --millions: the bound on the memory of each process.
    #[arg(long, default_value = "1G", requires = "millions")]
    pub(super) memory: String,
    /// Where the page goes [default: docs/results, by what is measured]
    #[arg(long)]
    pub(super) out: Option<PathBuf>,
}
